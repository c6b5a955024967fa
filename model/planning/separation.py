"""lambda_ij: what is left of one model's prediction when another is fitted to it, in chi^2.

A difference of lambda moves the log evidence of two models by lambda/2 in the mean, with a
standard deviation of sqrt(lambda). What two models need to be told apart follows from SURE.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from model.diagnosis.hypotheses import Candidate
from model.diagnosis.model_fit import Fit, Problem
from model.diagnosis.priors import LOG_ODDS

# Of two models that are equally probable before, the true one reaches SURE in 97.5 % of data sets:
# x^2/2 - 2 x = LOG_ODDS, with x = sqrt(lambda). Below ALIKE it does in less than half of them.
APART = (2.0 + sqrt(4.0 + 2.0 * LOG_ODDS)) ** 2
ALIKE = 2.0 * LOG_ODDS


def imitate(problem: Problem, true: Fit, alternative: Candidate) -> Fit:
    """`alternative` fitted to what `true` predicts, without noise; its chi^2 is lambda_ij."""
    prediction = problem.predictor.predicted(true.kinds, true.vector[None])[0]
    noiseless = Problem(problem.predictor, prediction, problem.noise)
    fits = [noiseless.fit(alternative.kinds, alternative.fit.vector)]
    start = np.zeros(alternative.fit.vector.size)
    shared = len(problem.predictor.free)
    start[:shared] = true.vector[:shared]
    fits.append(noiseless.fit(alternative.kinds, start))
    return min(fits, key=lambda fit: fit.chi2)


def separation(problem: Problem, first: Candidate, second: Candidate) -> float:
    """lambda_ij in the noise that the first leaves, the smaller way round."""
    both = (imitate(problem, first.fit, second), imitate(problem, second.fit, first))
    return min(fit.chi2 for fit in both) / first.fit.scale2
