"""The catch-all alternative: the base model plus a smooth discrepancy of unknown shape. Its
evidence is comparable with that of every other model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaln, logsumexp

from model.diagnosis.model_fit import Fit
from model.diagnosis.noise import Noise
from model.diagnosis.priors import AMPLITUDES, EXACT, FORM_ERRORS
from model.support.arrays import Array

ROUNDING = 1e-11  # of squared singular values, as a share of the largest
LEAST_CHI2 = 1e-6  # of a signature: fainter ones are rounding
SCALES = np.exp(np.linspace(np.log(0.2), np.log(5.0), 41))  # of the noise, integrated over


@dataclass(frozen=True)
class Evidence:
    """log evidence with the noise scale and any discrepancy's amplitude integrated out.

    Two more describe the form of the effect. `bend` is the share by which it differs, in the way of
    that number, and `at_bend` the log evidence with that alone. `exact` is the log evidence of the
    exact form.
    """

    log_evidence: float
    scale: float
    amplitude: float
    term: int = -1
    bend: float = 0.0
    way: int = 0
    at_bend: float = np.inf
    exact: float = np.inf

    @property
    def exact_share(self) -> float:
        """Probability of a form that is not off, beside those that are."""
        return float(np.exp(min(np.log(EXACT) + self.exact - self.log_evidence, 0.0)))


def evidence(fit: Fit, noise: Noise, forms: Sequence[Array] = ()) -> Evidence:
    """Evidence of a fitted model, linear around its most probable parameters; `forms` [n, m]: ways
    its form may be off.

    Each witness apart first.

    Every model of a data set is judged by this one formula, so that differences mean something.
    """
    target = fit.residual + fit.jacobian @ fit.vector
    by_scale = _by_scale(target, fit.jacobian, noise)
    exact, scale = float(logsumexp(by_scale)), float(SCALES[np.argmax(by_scale)])
    if not forms:
        return Evidence(exact, scale, 0.0, at_bend=exact, exact=exact)

    def by_bend(form: Array, bends: Sequence[float]) -> Array:
        return np.array(
            [_by_scale(target, np.hstack([fit.jacobian, bend * form]), noise) for bend in bends]
        )

    off = np.array(
        [by_bend(form, errors) for form, errors in zip(forms, FORM_ERRORS, strict=False)]
    )
    each = logsumexp(off, axis=2)
    total = float(np.logaddexp(np.log(EXACT) + exact, np.log1p(-EXACT) + _mean(each)))
    found = Evidence(total, scale, 0.0, at_bend=exact, exact=exact)
    if each.max() <= exact:
        return found
    way, bend = np.unravel_index(np.argmax(each), each.shape)
    scale = float(SCALES[np.argmax(off[way, bend])])
    return replace(
        found, scale=scale, bend=FORM_ERRORS[way][bend], way=int(way), at_bend=float(each.max())
    )


def _mean(logs: Array) -> float:
    return float(logsumexp(logs) - np.log(logs.size))


def evidence_beside(
    fit: Fit, noise: Noise, discrepancy: list[Array], bent: Array, alone: Evidence
) -> Evidence:
    """The same with a discrepancy of unknown shape beside the model; `bent` [n, m]: what its form
    is off.

    By what the discrepancy adds to a form that is off by that, so that all forms count in both.
    """
    target = fit.residual + fit.jacobian @ fit.vector
    own = np.concatenate([fit.jacobian, bent], axis=1)
    logs = np.array(
        [
            [_by_scale(target, np.concatenate([own, a * term], axis=1), noise) for a in AMPLITUDES]
            for term in discrepancy
        ]
    )
    term, amplitude, scale = np.unravel_index(np.argmax(logs), logs.shape)
    per_term = logsumexp(logs, axis=(1, 2)) - np.log(len(AMPLITUDES))
    adds = float(logsumexp(per_term + np.log(_shares(len(discrepancy))))) - alone.at_bend
    return Evidence(
        alone.log_evidence + adds, float(SCALES[scale]), AMPLITUDES[amplitude], int(term)
    )


def _shares(count: int) -> Array:
    """Prior of each term alone, and of all together: half and half."""
    return np.append(np.full(count - 1, 0.5 / (count - 1)), 0.5) if count > 1 else np.ones(1)


def log_marginal(target: Array, spread: Array, noise: Noise) -> float:
    """log N(target; 0, s^2 + spread spread') with the noise scale s integrated out."""
    return float(logsumexp(_by_scale(target, spread, noise)))


def _by_scale(target: Array, spread: Array, noise: Noise) -> Array:
    """log N(target; 0, s^2 + spread spread') + log prior weight of each noise scale s."""
    # of the singular values: half the work of a decomposition
    square, directions = np.linalg.eigh(spread.T @ spread)
    kept = square > ROUNDING * square[-1]
    square = square[kept]
    along = (directions[:, kept].T @ (spread.T @ target)) ** 2 / square
    rest = max(float(target @ target - along.sum()), 0.0)
    s2 = SCALES[:, None] ** 2
    total = s2 + square
    free = target.size - noise.sure - square.size
    log_likelihood = -0.5 * (
        np.sum(np.log(total) + along / total, axis=1) + free * np.log(s2[:, 0]) + rest / s2[:, 0]
    )
    half = 0.5 * noise.degrees
    log_prior = half * np.log(half) - gammaln(half) - 2.0 * half * np.log(SCALES) - half / SCALES**2
    return np.asarray(log_likelihood + log_prior + np.log(2.0 * np.log(SCALES[1] / SCALES[0])))


def remaining(fit: Fit, scale: float, loose: Array) -> Array:
    """What a model leaves that may be off by `loose` [n, m], whitened, in standard deviations of
    the noise [n].
    """
    target, spread, weights = _posterior(fit, scale, loose)
    return np.asarray((target - spread @ weights) / scale)


def taken_up(fit: Fit, scale: float, loose: Array) -> Array:
    """The part of what such a model says that comes from what is `loose`, whitened [n]."""
    _, _, weights = _posterior(fit, scale, loose)
    return np.asarray(loose @ weights[-loose.shape[1] :])


def explained(fit: Fit, scale: float, loose: Array, signatures: Array) -> Array:
    """How much of what such a model leaves each of some `signatures` [m, n] explains, in chi^2 [m]:
    the score test.

    None where it would have to be negative. What parameters and what is loose could take up of a
    signature does not count, as far as their priors let them.
    """
    target, spread, _ = _posterior(fit, scale, loose)
    beyond = signatures - (spread @ _weights(spread, scale, signatures.T)).T
    size2 = np.maximum(np.sum(beyond * signatures, axis=1), LEAST_CHI2)
    return np.asarray(np.maximum(beyond @ target, 0.0) ** 2 / size2 / scale**2)


def _posterior(fit: Fit, scale: float, loose: Array) -> tuple[Array, Array, Array]:
    """Target [n], directions [n, k] of the parameters and of what is loose, and their posterior
    mean weights [k].
    """
    spread = np.concatenate([fit.jacobian, loose], axis=1)
    target = fit.residual + fit.jacobian @ fit.vector
    return target, spread, _weights(spread, scale, target)


def _weights(spread: Array, scale: float, values: Array) -> Array:
    """Posterior mean weights [k] or [k, m] of directions [n, k] that explain `values` [n] or [n,
    m].
    """
    inner = spread.T @ spread / scale**2 + np.eye(spread.shape[1])
    return np.asarray(np.linalg.solve(inner, spread.T @ values / scale**2))
