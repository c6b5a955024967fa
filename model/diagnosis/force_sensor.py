"""A rival that is never named: a force sensor whose lateral reading has its zero off and a share of the load in it.

Friction that it reads depends on load much as by a law of friction, and no other witness sees either.
"""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp

from model.diagnosis.fit import Problem
from model.diagnosis.naming import Candidate
from model.diagnosis.rival import log_marginal
from model.diagnosis.witness import FRICTION
from model.friction import LOAD_REFERENCE_N

SHARES = (0.01, 0.03, 0.1, 0.3)  # of the load in the lateral reading, and as much of LOAD_REFERENCE_N for its zero


def force_sensor_evidence(problem: Problem, base: Candidate) -> float:
    """log evidence of such a sensor beside the base model, linear about it; -inf where friction has but one load."""
    data = problem.predictor.data
    friction = data.of(FRICTION)
    if not data.subset(friction).varies("normal_force_n"):
        return -np.inf
    load_n = data.columns["normal_force_n"]
    fit = base.fit
    predicted = problem.predictor.predicted((), fit.vector[None])[0]  # what is observed would bring its noise along
    lateral_n = np.exp(np.where(friction, predicted, 0.0)) * load_n
    shifts_n = np.stack([np.full(load_n.size, LOAD_REFERENCE_N), load_n], axis=1)
    shown = problem.noise.whiten(np.where(friction[:, None], shifts_n / lateral_n[:, None], 0.0))
    target = fit.residual + fit.jacobian @ fit.vector
    logs = [log_marginal(target, np.hstack([fit.jacobian, share * shown]), problem.noise) for share in SHARES]
    return float(logsumexp(logs) - np.log(len(SHARES)))
