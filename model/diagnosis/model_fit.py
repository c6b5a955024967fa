"""Fits in prior units: maximum a posteriori by damped Gauss-Newton, and the evidence around it.

The noise scale is integrated out: -(n + nu)/2 log(1 + chi^2/nu) replaces -chi^2/2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from model.diagnosis.noise import Noise
from model.diagnosis.smooth import compressed, discrepancy_terms, roots, smooth_terms, standardised
from model.diagnosis.space import FARTHEST, Predictor
from model.effects import Effect
from model.support.arrays import Array, Mask

STEP = 1e-4  # of finite differences, in prior standard deviations
ITERATIONS = 40
TOLERANCE = 1e-3  # nats
DAMPINGS = np.array([0.1, 1.0, 20.0])  # tried at each step, times the last that was best
FIRST_ITERATIONS = 5  # of every start, before the best go on
STARTS_KEPT = 2
MOST_IN_ONE_VALLEY = 2  # parameters of an effect
OTHER_VALLEY = 0.7  # prior standard deviations of the last of more
SAME_VALLEY = 0.3  # prior standard deviations of all parameters together
BAD = 1e3  # stands for a residual that the model cannot give, in standard deviations


@dataclass(frozen=True)
class Fit:
    """A model at its most probable parameters.

    `vector` [k] is in prior units. `residual` [n] and `jacobian` [n, k], of the prediction, are
    whitened. `covariance` [k, k] is of the vector. `log_evidence` is up to a constant that all
    models of one data set share.
    """

    kinds: tuple[type[Effect], ...]
    vector: Array
    residual: Array
    jacobian: Array
    covariance: Array
    chi2: float
    scale2: float
    log_evidence: float


class _Nearby(NamedTuple):
    """What is linear about vectors [m, k]: residuals [m, n], and Jacobians [m, n, k] without what
    stays at its end. Also the weight of chi^2 [m, 1], the gradient of the posterior [m, k], and
    steps [m, 3, k] by damped normal matrices.
    """

    vectors: Array
    residuals: Array
    jacobians: Array
    weight: Array
    gradient: Array
    dampings: Array
    damped: Array
    steps: Array

    @property
    def promising(self) -> Mask:
        """Where more is to be expected of a step than nothing."""
        return np.asarray(0.5 * np.sum(self.gradient * self.steps[:, 0], axis=1) >= TOLERANCE)

    def only(self, which: Mask) -> _Nearby:
        return _Nearby(*(field[which] for field in self))


class Problem:
    """One data set with its noise: what every fit shares.

    `loose` [n, m]: whitened directions in which predictions may be off besides, each with weights
    of unit variance.
    """

    def __init__(
        self, predictor: Predictor, observed: Array, noise: Noise, loose: Array | None = None
    ) -> None:
        self.predictor = predictor
        self.observed = observed
        self.noise = noise
        self._loose = None if loose is None else np.linalg.svd(loose, full_matrices=False)[:2]

    @cached_property
    def discrepancy(self) -> list[Array]:
        """Terms of a discrepancy of unknown shape, whitened; all together come last."""
        terms = discrepancy_terms(self.predictor.data, self.predictor.force_share())
        whitened = [self.noise.whiten(term) for term in terms]
        return [*whitened, compressed(np.hstack(whitened))]

    @cached_property
    def smooth(self) -> Array:
        """Smooth functions of each input, as `smooth_terms` gives them."""
        return smooth_terms(self.predictor.data)

    @cached_property
    def smooth_in_drive(self) -> dict[str, Array]:
        """Smooth functions of frequency and of amplitude where there is voltage, the same for all
        witnesses [n, m].
        """
        return {name: self._smooth_where_driven(name) for name in ("frequency_hz", "voltage_v")}

    def _smooth_where_driven(self, name: str) -> Array:
        data = self.predictor.data
        if not data.varies(name):
            return np.zeros((data.count, 0))
        return roots(standardised(data, name, decades=True)[:, None]) * data.driven[:, None]

    def whitened(self, kinds: Sequence[type[Effect]], vectors: Array, group: int = 1) -> Array:
        """Whitened residuals [m, n] of parameter vectors [m, k]; unsolvable rows are far off, never
        NaN.

        Of every `group` vectors all are all but the same.
        """
        raw = self.predictor.less(self.observed, self.predictor.predicted(kinds, vectors, group))
        raw = np.where(np.isfinite(raw), raw, BAD * self.noise.own_std)
        white = self.noise.whiten(raw.T).T
        if self._loose is None:
            return white
        along, size = self._loose
        return np.asarray(white - (white @ along * (1.0 - 1.0 / np.sqrt(1.0 + size**2))) @ along.T)

    def loosened(self, loose: Array) -> Problem:
        """The same with predictions that may be off by `loose` [n, m] as well."""
        return Problem(self.predictor, self.observed, self.noise, loose)

    def whole(self, fit: Fit) -> Fit:
        """A fit of what is loosened, about which this problem is linear: residuals and Jacobian are
        whole.

        Its chi^2 and scale stay those of what is left.
        """
        residuals, jacobians = self.linearised(fit.kinds, fit.vector[None])
        return replace(fit, residual=residuals[0], jacobian=jacobians[0])

    def refitted(self, fit: Fit, loose: Array) -> Fit:
        """`fit` moved to where it is most probable if predictions may be off by `loose` [n, m] as
        well.
        """
        return self.whole(self.loosened(loose).fit(fit.kinds, fit.vector))

    def cost(self, chi2: Array | float, vectors: Array) -> Array:
        """-log posterior of parameter vectors, scale integrated out."""
        nu, n = self.noise.degrees, self.observed.size - self.noise.sure
        return np.asarray(
            0.5 * (n + nu) * np.log1p(np.asarray(chi2) / nu)
            + 0.5 * np.sum(np.square(vectors), axis=-1)
        )

    def linearised(self, kinds: Sequence[type[Effect]], vectors: Array) -> tuple[Array, Array]:
        """Residuals [m, n] and Jacobians of the prediction [m, n, k] at vectors [m, k], whitened,
        in one call.
        """
        # inwards: what lies beyond the farthest is flat
        steps = np.where(vectors > 0.0, -STEP, STEP)
        m, k = vectors.shape
        # as it is, then each parameter in turn
        stepped = vectors[:, None] + np.eye(k + 1, k, -1) * steps[:, None]
        residuals = self.whitened(kinds, stepped.reshape(-1, k), k + 1).reshape(m, k + 1, -1)
        return residuals[:, 0], -np.swapaxes(
            (residuals[:, 1:] - residuals[:, :1]) / steps[:, :, None], 1, 2
        )

    def fit(self, kinds: Sequence[type[Effect]], start: Array, iterations: int = ITERATIONS) -> Fit:
        """Damped Gauss-Newton from one start."""
        return self.fits(kinds, start[None], iterations)[0]

    def fits(
        self, kinds: Sequence[type[Effect]], starts: Array, iterations: int = ITERATIONS
    ) -> list[Fit]:
        """Damped Gauss-Newton from each of some starts [m, k], a step of all at a time."""
        vectors = np.clip(starts, -FARTHEST, FARTHEST)
        residuals, jacobians = self.linearised(kinds, vectors)
        costs = self.cost(np.sum(residuals**2, axis=1), vectors)
        damping, going = np.full(len(starts), 1e-3), np.arange(len(starts))
        for _ in range(iterations):
            near = self._nearby(vectors[going], residuals[going], jacobians[going], damping[going])
            near, going = near.only(near.promising), going[near.promising]
            if not going.size:
                break
            found, found_costs, of_damping = self._best_step(kinds, near)
            gain = costs[going] - found_costs
            better = gain > 0.0
            damping[going] = np.where(better, of_damping, np.minimum(damping[going] * 1e3, 1e9))
            if (moved := going[better]).size:
                vectors[moved], costs[moved] = found[better], found_costs[better]
                residuals[moved], jacobians[moved] = self.linearised(kinds, vectors[moved])
            going = going[~(better & (gain < TOLERANCE)) & (damping[going] < 1e8)]
        return [
            self._finish(tuple(kinds), *fit)
            for fit in zip(vectors, residuals, jacobians, strict=True)
        ]

    def _nearby(
        self, vectors: Array, residuals: Array, jacobians: Array, damping: Array
    ) -> _Nearby:
        """What is linear about each of some vectors."""
        nu, n = self.noise.degrees, self.observed.size - self.noise.sure
        weight = (n + nu) / (nu + np.sum(residuals**2, axis=1))[:, None]
        gradient = weight * np.einsum("mnk,mn->mk", jacobians, residuals) - vectors
        # what is at its end stays there
        free = ~((np.abs(vectors) >= FARTHEST) & (gradient * vectors > 0.0))
        jacobians = jacobians * free[:, None]
        normal = weight[..., None] * np.swapaxes(jacobians, 1, 2) @ jacobians + np.eye(
            vectors.shape[1]
        )
        dampings = damping[:, None] * DAMPINGS
        damped = (
            normal[:, None]
            + dampings[..., None, None] * (normal * np.eye(vectors.shape[1]))[:, None]
        )
        steps = np.linalg.solve(damped, (gradient * free)[:, None, :, None])[..., 0]
        return _Nearby(vectors, residuals, jacobians, weight, gradient, dampings, damped, steps)

    def _best_step(
        self, kinds: Sequence[type[Effect]], near: _Nearby
    ) -> tuple[Array, Array, Array]:
        """The best vectors [m, k] that the steps lead to, their costs [m] and dampings [m]."""
        m, count, k = near.steps.shape
        start = near.vectors[:, None]
        trials = np.clip(start + near.steps, -FARTHEST, FARTHEST)
        residuals = self.whitened(kinds, trials.reshape(-1, k)).reshape(m, count, -1)
        # Valleys bend: what a step found beside what is linear in it says where along the valley it
        # should end.
        bent = (
            near.residuals[:, None]
            - (trials - start) @ np.swapaxes(near.jacobians, 1, 2)
            - residuals
        )
        aside = np.linalg.solve(
            near.damped, -(near.weight[..., None] * (bent @ near.jacobians))[..., None]
        )[..., 0]
        corrected = np.clip(trials + aside, -FARTHEST, FARTHEST)
        after = self.whitened(kinds, corrected.reshape(-1, k)).reshape(m, count, -1)
        trials, residuals = np.hstack([trials, corrected]), np.hstack([residuals, after])
        costs = self.cost(np.sum(residuals**2, axis=2), trials)
        each, best = np.arange(m), np.argmin(costs, axis=1)
        return (
            trials[each, best],
            costs[each, best],
            np.clip(near.dampings[each, best % count], 1e-9, 1e6),
        )

    def _finish(
        self, kinds: tuple[type[Effect], ...], vector: Array, residual: Array, jacobian: Array
    ) -> Fit:
        nu, n = self.noise.degrees, self.observed.size - self.noise.sure
        chi2 = float(residual @ residual)
        scale2 = (nu + chi2) / (n + nu)
        normal = jacobian.T @ jacobian / scale2 + np.eye(vector.size)
        _, log_determinant = np.linalg.slogdet(normal)
        log_evidence = -float(self.cost(chi2, vector)) - 0.5 * float(log_determinant)
        covariance = np.asarray(np.linalg.inv(normal), dtype=np.float64)
        return Fit(kinds, vector, residual, jacobian, covariance, chi2, scale2, log_evidence)

    def best_fit(self, kinds: Sequence[type[Effect]], base: Array, starts: Sequence[float]) -> Fit:
        """The best of several starts: from `base`, the last effect's first parameter at each of
        `starts`.

        Effects of three parameters have valleys that do not meet: they start from another last
        parameter as well.
        """
        count = len(kinds[-1].parameters())
        pairs = list(product(starts, (0.0, OTHER_VALLEY) if count > MOST_IN_ONE_VALLEY else (0.0,)))
        from_each = np.zeros((len(pairs), self.predictor.size(kinds)))
        from_each[:, : base.size] = base[: from_each.shape[1]]
        for start, (value, last) in zip(from_each, pairs, strict=True):
            start[-count], start[-1] = value, last if count > 1 else value
        begun = sorted(
            self.fits(kinds, from_each, FIRST_ITERATIONS), key=lambda fit: -fit.log_evidence
        )
        best = self.fit(kinds, begun[0].vector)
        others = [
            fit for fit in begun[1:] if np.linalg.norm(fit.vector - best.vector) > SAME_VALLEY
        ]
        kept = [best, *(self.fit(kinds, fit.vector) for fit in others[: STARTS_KEPT - 1])]
        return max(kept, key=lambda fit: fit.log_evidence)
