"""Sessions that are unlike the others: noisier, or with an effect that the others do not have."""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp
from scipy.stats import f as f_distribution

from model.diagnosis.data import Measurements
from model.diagnosis.fit import Fit
from model.diagnosis.noise import Noise
from model.diagnosis.rival import AMPLITUDES, log_marginal
from model.support.arrays import Array, Mask

UNLIKE_P = 1e-4
FEWEST_SESSIONS = 3
SPLIT_NATS = 3.0
SMOOTH = 30  # directions of the discrepancy in which sessions are compared


def unlike_sessions(data: Measurements, left: Array) -> dict[int, float]:
    """Sessions whose whitened residuals `left` [n] are larger than usual, and how many times larger.

    Usual is the median session, so that it does not matter how many are unlike while they are fewer than half; each is
    judged by an F test, the largest first.
    """
    numbers = [int(s) for s in np.unique(data.session)]
    if len(numbers) < FEWEST_SESSIONS:
        return {}
    rows = {s: int(np.sum(data.session == s)) for s in numbers}
    square = {s: float(np.mean(left[data.session == s] ** 2)) for s in numbers}
    usual = float(np.median(list(square.values())))
    largest = sorted(numbers, key=lambda s: -square[s])[: (len(numbers) - 1) // 2]
    p = {s: f_distribution.sf(square[s] / usual, rows[s], data.count - rows[s]) for s in largest}
    return {s: float(np.sqrt(square[s] / usual)) for s in largest if p[s] < UNLIKE_P / len(numbers)}


def split_sessions(data: Measurements, noise: Noise, fit: Fit, discrepancy: Array) -> Mask | None:
    """Rows [n] of sessions whose smooth discrepancy from the base model differs from that of the rest; None if none.

    Sessions are ordered along the direction in which their discrepancies differ most and cut in two at every place; a
    discrepancy for each part must beat one for all by the number of possible cuts and SPLIT_NATS.
    """
    numbers = np.unique(data.session)
    if numbers.size < FEWEST_SESSIONS or not discrepancy.size:
        return None
    target = fit.residual + fit.jacobian @ fit.vector
    _, _, directions = np.linalg.svd(discrepancy, full_matrices=False)
    smooth = discrepancy @ directions[:SMOOTH].T

    def weight(part: Mask | None) -> float:
        parts = smooth if part is None else np.concatenate([smooth * part[:, None], smooth * ~part[:, None]], axis=1)
        spreads = [np.concatenate([fit.jacobian, a * parts], axis=1) for a in AMPLITUDES]
        return float(logsumexp([log_marginal(target, spread, noise) for spread in spreads]))

    patterns = np.array([_pattern(smooth, fit.residual, data.session == s) for s in numbers])
    order = numbers[np.argsort(np.linalg.svd(patterns - patterns.mean(axis=0))[0][:, 0])]
    cuts = [np.isin(data.session, order[: i + 1]) for i in range(numbers.size - 1)]
    weights = [weight(cut) for cut in cuts]
    best = int(np.argmax(weights))
    gain = weights[best] - weight(None) - np.log(2.0) * (numbers.size - 1)
    return cuts[best] if gain > SPLIT_NATS else None


def _pattern(smooth: Array, residual: Array, rows: Mask) -> Array:
    """What one session says of the discrepancy: its weights, pulled to zero where the session has little to say."""
    part = AMPLITUDES[-1] * smooth[rows]
    return np.asarray(np.linalg.solve(part.T @ part + np.eye(part.shape[1]), part.T @ residual[rows]))


def inflation(data: Measurements, unlike: dict[int, float]) -> Array:
    """Factor [n] on the noise of every row that makes unlike sessions as likely as the others."""
    return np.array([unlike.get(int(s), 1.0) for s in data.session])


def names(data: Measurements, rows: Mask) -> list[str]:
    """Names of the sessions to which rows belong."""
    return [data.session_names[int(s)] for s in np.unique(data.session[rows])]
