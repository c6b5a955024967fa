"""Effects that may be there without a trace in a data set."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from model.diagnosis.model_fit import Fit, Problem
from model.diagnosis.space import FARTHEST
from model.effects import Effect
from model.support.arrays import Array

NO_TRACE = 2.0  # lambda below which an effect is not there: what a parameter costs by Akaike
DRAWS = 64  # of an effect's prior: shares of it to some per cent


class Hidden(NamedTuple):
    """How an effect may be there without a trace in these data.

    `log_odds` against nothing missing is of that part of its prior which leaves none. `usual`:
    lambda of an effect of usual size, the median of its prior's draws. That draw is `vector` [k],
    and `signature` [n] what it adds to the data, in standard deviations.
    """

    log_odds: float
    usual: float
    vector: Array
    signature: Array


def unseen(problem: Problem, base: Fit, kind: type[Effect]) -> Hidden:
    """How an effect may be there unseen.

    From draws of the prior, with the finger and the gains as the base model has them, and linear
    about that.
    """
    vectors, signatures, visible = _drawn(problem, base, kind)
    residual, hidden = base.residual / np.sqrt(base.scale2), visible < NO_TRACE
    odds = np.exp(signatures[hidden] @ residual - 0.5 * visible[hidden])
    log_odds = float(np.log(max(odds.sum(), 1e-300) / DRAWS))
    usual = np.argsort(visible)[DRAWS // 2]
    return Hidden(log_odds, float(visible[usual]), vectors[usual], signatures[usual])


def unseen_draws(problem: Problem, base: Fit, kind: type[Effect]) -> tuple[Array, Array]:
    """Vectors [m, k] of those draws of an effect's prior that leave no trace, and what each adds.

    The latter [m, n] in standard deviations of the noise.
    """
    vectors, signatures, visible = _drawn(problem, base, kind)
    return vectors[visible < NO_TRACE], signatures[visible < NO_TRACE]


def _drawn(problem: Problem, base: Fit, kind: type[Effect]) -> tuple[Array, Array, Array]:
    """Draws [DRAWS, k] of an effect's prior, what each adds [DRAWS, n], and how visible it is.

    In standard deviations of the noise. What the finger and the gains would take up does not count
    as visible, unless they are at their ends already.
    """
    from scipy.stats import qmc  # noqa: PLC0415  (slow to import, and the daemon does without)

    draws = ndtri(qmc.Sobol(len(kind.parameters()), seed=0).random(DRAWS))
    shared = np.broadcast_to(base.vector, (DRAWS, base.vector.size))
    vectors = np.concatenate([shared, draws], axis=1)
    scale = np.sqrt(base.scale2)
    own = base.jacobian[:, np.abs(base.vector) < FARTHEST] / scale
    signatures = (base.residual - problem.whitened((kind,), vectors)) / scale
    along = signatures @ own
    hidden = np.linalg.solve(own.T @ own + np.eye(own.shape[1]), along.T).T
    visible = np.sum(signatures**2, axis=1) - np.sum(along * hidden, axis=1)
    return vectors, signatures, np.maximum(visible, 0.0)
