"""Fits in prior units: maximum a posteriori by damped Gauss-Newton, and the evidence around it.

The noise scale is integrated out: -(n + nu)/2 log(1 + chi^2/nu) replaces -chi^2/2.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from model.diagnosis.noise import Noise
from model.diagnosis.smooth import discrepancy_terms, smooth_terms
from model.diagnosis.space import FARTHEST, Predictor
from model.effects import Effect
from model.support.arrays import Array

STEP = 1e-4  # of finite differences, in prior standard deviations
ITERATIONS = 40
TOLERANCE = 1e-3  # nats
FIRST_ITERATIONS = 5  # of every start, before the best go on
STARTS_KEPT = 2
MOST_IN_ONE_VALLEY = 2  # parameters of an effect
OTHER_VALLEY = 0.7  # prior standard deviations of the last of more
SAME_VALLEY = 0.3  # prior standard deviations of all parameters together
BAD = 1e3  # stands for a residual that the model cannot give, in standard deviations


@dataclass(frozen=True)
class Fit:
    """A model at its most probable parameters.

    `vector` [k] in prior units; `residual` [n] and `jacobian` [n, k] whitened, the latter of the prediction;
    `covariance` [k, k] of the vector; `log_evidence` up to a constant that all models of one data set share.
    """

    kinds: tuple[type[Effect], ...]
    vector: Array
    residual: Array
    jacobian: Array
    covariance: Array
    chi2: float
    scale2: float
    log_evidence: float


class Problem:
    """One data set with its noise: what every fit shares."""

    def __init__(self, predictor: Predictor, observed: Array, noise: Noise) -> None:
        self.predictor = predictor
        self.observed = observed
        self.noise = noise

    @cached_property
    def discrepancy(self) -> list[Array]:
        """Terms of a discrepancy of unknown shape, as `discrepancy_terms` gives them; all together come last."""
        return discrepancy_terms(self.predictor.data, self.noise)

    @cached_property
    def smooth(self) -> Array:
        """Smooth functions of each input, as `smooth_terms` gives them."""
        return smooth_terms(self.predictor.data)

    def whitened(self, kinds: Sequence[type[Effect]], vectors: Array) -> Array:
        """Whitened residuals [m, n] of parameter vectors [m, k]; unsolvable rows are far off, never NaN."""
        raw = self.predictor.less(self.observed, self.predictor.predicted(kinds, vectors))
        raw = np.where(np.isfinite(raw), raw, BAD * self.noise.own_std)
        return self.noise.whiten(raw.T).T

    def cost(self, chi2: Array | float, vectors: Array) -> Array:
        """-log posterior of parameter vectors, scale integrated out."""
        nu, n = self.noise.degrees, self.observed.size
        return np.asarray(0.5 * (n + nu) * np.log1p(np.asarray(chi2) / nu) + 0.5 * np.sum(np.square(vectors), axis=-1))

    def linearise(self, kinds: Sequence[type[Effect]], vector: Array) -> tuple[Array, Array]:
        """Residual [n] and Jacobian of the prediction [n, k], both whitened, in one call of the model."""
        return next(self.linearised(kinds, vector[None]))

    def linearised(self, kinds: Sequence[type[Effect]], vectors: Array) -> Iterator[tuple[Array, Array]]:
        """The same at each of some vectors [m, k], still in one call."""
        steps = np.where(vectors > 0.0, -STEP, STEP)  # inwards: what lies beyond the farthest is flat
        m, k = vectors.shape
        stepped = vectors[:, None] + np.eye(k + 1, k, -1) * steps[:, None]  # as it is, then each parameter in turn
        residuals = self.whitened(kinds, stepped.reshape(-1, k)).reshape(m, k + 1, -1)
        for own, step in zip(residuals, steps, strict=True):
            yield own[0], -(own[1:] - own[0]).T / step

    def fit(self, kinds: Sequence[type[Effect]], start: Array, iterations: int = ITERATIONS) -> Fit:
        """Damped Gauss-Newton from one start."""
        nu, n = self.noise.degrees, self.observed.size
        vector = np.clip(start, -FARTHEST, FARTHEST)
        residual, jacobian = self.linearise(kinds, vector)
        chi2 = float(residual @ residual)
        cost = float(self.cost(chi2, vector))
        damping = 1e-3
        for _ in range(iterations):
            weight = (n + nu) / (nu + chi2)
            gradient = weight * jacobian.T @ residual - vector
            free = ~((np.abs(vector) >= FARTHEST) & (gradient * vector > 0.0))  # what is at its end stays there
            normal = weight * jacobian[:, free].T @ jacobian[:, free] + np.eye(int(free.sum()))
            dampings = damping * np.array([0.1, 1.0, 20.0])
            steps = np.zeros((dampings.size, vector.size))
            damped = normal + dampings[:, None, None] * np.diag(np.diag(normal))
            steps[:, free] = np.linalg.solve(damped, gradient[free, None])[..., 0]
            if 0.5 * float(gradient @ steps[0]) < TOLERANCE:  # nothing more is to be expected
                break
            trials = np.clip(vector + steps, -FARTHEST, FARTHEST)
            residuals = self.whitened(kinds, trials)
            # Valleys bend: what a step found beside what is linear in it says where along the valley it should end.
            bent = residual - (trials - vector) @ jacobian.T - residuals
            steps[:, free] = np.linalg.solve(damped, -weight * (bent @ jacobian[:, free])[..., None])[..., 0]
            trials = np.vstack([trials, np.clip(trials + steps, -FARTHEST, FARTHEST)])
            residuals = np.vstack([residuals, self.whitened(kinds, trials[dampings.size :])])
            costs = self.cost(np.sum(residuals**2, axis=1), trials)
            best = int(np.argmin(costs))
            gain = cost - float(costs[best])
            if gain > 0.0:
                vector, cost = trials[best], float(costs[best])
                damping = float(np.clip(dampings[best % dampings.size], 1e-9, 1e6))
                residual, jacobian = self.linearise(kinds, vector)
                chi2 = float(residual @ residual)
            else:
                damping = min(damping * 1e3, 1e9)
            if 0.0 < gain < TOLERANCE or damping >= 1e8:
                break
        return self._finish(tuple(kinds), vector, residual, jacobian)

    def _finish(self, kinds: tuple[type[Effect], ...], vector: Array, residual: Array, jacobian: Array) -> Fit:
        nu, n = self.noise.degrees, self.observed.size
        chi2 = float(residual @ residual)
        scale2 = (nu + chi2) / (n + nu)
        normal = jacobian.T @ jacobian / scale2 + np.eye(vector.size)
        _, log_determinant = np.linalg.slogdet(normal)
        log_evidence = -float(self.cost(chi2, vector)) - 0.5 * float(log_determinant)
        covariance = np.asarray(np.linalg.inv(normal), dtype=np.float64)
        return Fit(kinds, vector, residual, jacobian, covariance, chi2, scale2, log_evidence)

    def best_fit(self, kinds: Sequence[type[Effect]], base: Array, starts: Sequence[float]) -> Fit:
        """The best of several starts: from `base`, the last effect's first parameter at each of `starts`.

        Effects of three parameters have valleys that do not meet: they start from another last parameter as well.
        """
        start = np.zeros(self.predictor.size(kinds))
        start[: base.size] = base[: start.size]
        if not kinds:
            return self.fit(kinds, start)
        count = len(kinds[-1].parameters())
        begun = []
        for value, last in product(starts, (0.0, OTHER_VALLEY) if count > MOST_IN_ONE_VALLEY else (0.0,)):
            start[start.size - count], start[-1] = value, last if count > 1 else value
            begun.append(self.fit(kinds, start, FIRST_ITERATIONS))
        begun.sort(key=lambda fit: -fit.log_evidence)
        best = self.fit(kinds, begun[0].vector)
        others = [fit for fit in begun[1:] if np.linalg.norm(fit.vector - best.vector) > SAME_VALLEY]
        kept = [best, *(self.fit(kinds, fit.vector) for fit in others[: STARTS_KEPT - 1])]
        return max(kept, key=lambda fit: fit.log_evidence)
