"""The catch-all rival: the base model plus a smooth discrepancy of unknown shape, and evidences on one footing.

The discrepancy of log friction is a Gaussian process with an additive squared-exponential kernel: one term per input
that varies, for the force (driven rows) and for friction itself (all rows), and one for frequency together with each of
voltage, time and speed. Every other witness has terms of its own, likewise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln, logsumexp

from model.diagnosis.data import Measurements
from model.diagnosis.fit import Fit
from model.diagnosis.noise import Noise
from model.diagnosis.witness import FRICTION
from model.support.arrays import Array

LENGTH = 0.8  # of the kernel, in standardised inputs
AMPLITUDES = (0.005, 0.012, 0.03, 0.08, 0.2)  # of the discrepancy of log friction
MOST_DISTINCT = 220
GRID = 0.05  # in standardised inputs
FAINT = 1e-3  # of the noise: what is smaller in a direction at the largest amplitude counts as nothing
ROUNDING = 1e-11  # of squared singular values, as a share of the largest
NEGLIGIBLE = 1e-7  # eigenvalues of a kernel below this share of the largest
LOG_INPUTS = ("frequency_hz", "normal_force_n", "speed_m_s")
INPUTS = ("frequency_hz", "voltage_v", "normal_force_n", "speed_m_s", "time_s")
SCALES = np.exp(np.linspace(np.log(0.2), np.log(5.0), 41))  # of the noise, integrated over


def standardised(data: Measurements, name: str) -> Array:
    """One input [n] to zero mean and unit spread; logarithms where it spans decades."""
    values = data.columns[name]
    rows = data.driven if name in ("frequency_hz", "voltage_v") else data.sliding if name == "speed_m_s" else None
    rows = np.ones(data.count, bool) if rows is None else rows
    x = np.log(np.where(rows, np.maximum(values, 1e-12), 1.0)) if name in LOG_INPUTS else values
    x = np.where(rows, x, 0.0)
    centre, spread = x[rows].mean(), x[rows].std()
    return np.asarray(np.where(rows, (x - centre) / (spread if spread > 0 else 1.0), 0.0))


def features(data: Measurements, noise: Noise) -> list[Array]:
    """Whitened features F [n, m] of every term (F F' is its kernel at unit amplitude); all terms together come last."""
    parts = []
    for witness in data.witnesses:
        mine = data.of(witness)
        for part in _terms(data.subset(mine), witness == FRICTION):
            parts.append(np.zeros((data.count, part.shape[1])))
            parts[-1][mine] = part
    if not parts:
        return [np.zeros((data.count, 0))]
    whitened = [noise.whiten(part) for part in parts]
    return [*whitened, _compressed(np.concatenate(whitened, axis=1))]


def _compressed(together: Array) -> Array:
    """G [n, k] with G G' = F F' but for what no amplitude would show: many terms share their directions."""
    square, directions = np.linalg.eigh(together.T @ together)
    return np.asarray(together @ directions[:, square > (FAINT / AMPLITUDES[-1]) ** 2])


def _terms(data: Measurements, has_force: bool) -> list[Array]:
    """The terms of one witness's observations; `has_force`: driven rows tell of more than the others."""
    driven = data.driven.astype(float)[:, None]
    inputs = {name: standardised(data, name) for name in INPUTS if data.varies(name)}
    parts = []
    for name, x in inputs.items():
        part = _roots(x[:, None])
        parts.append(part * driven)
        if has_force and name not in ("frequency_hz", "voltage_v"):
            parts.append(part)
    for name in ("voltage_v", "time_s", "speed_m_s"):
        if "frequency_hz" in inputs and name in inputs:
            parts.append(_roots(np.stack([inputs["frequency_hz"], inputs[name]], axis=1)) * driven)
    return parts


def _roots(x: Array) -> Array:
    """F [n, m] with F F' = exp(-|x - x'|^2/(2 LENGTH^2)), from the distinct rows of `x` alone."""
    distinct, row = np.unique(np.round(x, 9), axis=0, return_inverse=True)
    if len(distinct) > MOST_DISTINCT:  # e.g. a time of its own for every row: a grid represents a smooth function
        distinct, row = np.unique(np.round(x / GRID) * GRID, axis=0, return_inverse=True)
    square = np.sum((distinct[:, None, :] - distinct[None, :, :]) ** 2, axis=2)
    values, vectors = np.linalg.eigh(np.exp(-0.5 * square / LENGTH**2))
    kept = values > NEGLIGIBLE * values[-1]
    return np.asarray((vectors[:, kept] * np.sqrt(values[kept]))[row.ravel()])


@dataclass(frozen=True)
class Evidence:
    """log evidence, with the noise scale and any discrepancy amplitude integrated out, and where it lies."""

    log_evidence: float
    scale: float
    amplitude: float
    term: int = -1


def evidence(fit: Fit, noise: Noise, discrepancy: list[Array] | None = None) -> Evidence:
    """Evidence of a fitted model, linear around its most probable parameters; with `discrepancy` features too.

    Every model of a data set is judged by this one formula, so that differences mean something.
    """
    target = fit.residual + fit.jacobian @ fit.vector
    if discrepancy is None:
        logs = _by_scale(target, fit.jacobian, noise)
        return Evidence(float(logsumexp(logs)), float(SCALES[np.argmax(logs)]), 0.0)
    logs = np.array(
        [
            [_by_scale(target, np.concatenate([fit.jacobian, a * term], axis=1), noise) for a in AMPLITUDES]
            for term in discrepancy
        ]
    )
    term, amplitude, scale = np.unravel_index(np.argmax(logs), logs.shape)
    per_term = logsumexp(logs, axis=(1, 2)) - np.log(len(AMPLITUDES))
    total = float(logsumexp(per_term + np.log(_shares(len(discrepancy)))))
    return Evidence(total, float(SCALES[scale]), AMPLITUDES[amplitude], int(term))


def _shares(count: int) -> Array:
    """Prior of each term alone, and of all together: half and half."""
    return np.append(np.full(count - 1, 0.5 / (count - 1)), 0.5) if count > 1 else np.ones(1)


def log_marginal(target: Array, spread: Array, noise: Noise) -> float:
    """log N(target; 0, s^2 + spread spread') with the noise scale s integrated out."""
    return float(logsumexp(_by_scale(target, spread, noise)))


def _by_scale(target: Array, spread: Array, noise: Noise) -> Array:
    """log N(target; 0, s^2 + spread spread') + log prior weight of each noise scale s."""
    square, directions = np.linalg.eigh(spread.T @ spread)  # of the singular values: half the work of a decomposition
    kept = square > ROUNDING * square[-1]
    square = square[kept]
    along = (directions[:, kept].T @ (spread.T @ target)) ** 2 / square
    rest = max(float(target @ target - along.sum()), 0.0)
    s2 = SCALES[:, None] ** 2
    total = s2 + square
    free = target.size - square.size
    log_likelihood = -0.5 * (np.sum(np.log(total) + along / total, axis=1) + free * np.log(s2[:, 0]) + rest / s2[:, 0])
    half = 0.5 * noise.degrees
    log_prior = half * np.log(half) - gammaln(half) - 2.0 * half * np.log(SCALES) - half / SCALES**2
    return np.asarray(log_likelihood + log_prior + np.log(2.0 * np.log(SCALES[1] / SCALES[0])))


def discrepancy_mean(fit: Fit, found: Evidence, discrepancy: list[Array]) -> Array:
    """The discrepancy that the catch-all sees beside a fitted model, whitened [n]: its posterior mean."""
    _, spread, weights = _posterior(fit, found, discrepancy)
    k = fit.vector.size
    return np.asarray(spread[:, k:] @ weights[k:])


def left_beside(fit: Fit, found: Evidence, discrepancy: list[Array]) -> Array:
    """What even the model with that discrepancy beside it leaves, in standard deviations of the noise [n]."""
    target, spread, weights = _posterior(fit, found, discrepancy)
    return np.asarray((target - spread @ weights) / found.scale)


def _posterior(fit: Fit, found: Evidence, discrepancy: list[Array]) -> tuple[Array, Array, Array]:
    """Target [n], directions [n, m] of the parameters and the discrepancy, and their posterior mean weights [m]."""
    spread = np.concatenate([fit.jacobian, found.amplitude * discrepancy[found.term]], axis=1)
    target = fit.residual + fit.jacobian @ fit.vector
    inner = spread.T @ spread / found.scale**2 + np.eye(spread.shape[1])
    return target, spread, np.linalg.solve(inner, spread.T @ target / found.scale**2)
