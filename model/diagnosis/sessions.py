"""Sessions that are unlike the others: noisier, or with an effect that the others do not have.

Sessions are compared by one witness, friction where there is any: those that only sweep are no
worse for being unlike.
"""

from __future__ import annotations

import numpy as np
from scipy.special import fdtrc, logsumexp

from model.diagnosis.data import Measurements
from model.diagnosis.evidence import log_marginal
from model.diagnosis.model_fit import Fit
from model.diagnosis.noise import Noise
from model.diagnosis.priors import AMPLITUDES, LOG_ODDS
from model.support.arrays import Array, Mask

UNLIKE_P = 1e-4
FEWEST_SESSIONS = 3
SMOOTH = 30  # directions of the discrepancy in which sessions are compared


def unlike_sessions(data: Measurements, left: Array) -> dict[int, float]:
    """Sessions whose whitened residuals `left` [n] are larger than usual, and how many times
    larger.

    The median session is the usual one, so fewer than half may be unlike without an effect. Each is
    judged by an F test, the largest first.
    """
    compared = _compared(data)
    numbers = [int(s) for s in np.unique(data.session[compared])]
    if len(numbers) < FEWEST_SESSIONS:
        return {}
    rows = {s: int(np.sum(compared & (data.session == s))) for s in numbers}
    square = {s: float(np.mean(left[compared & (data.session == s)] ** 2)) for s in numbers}
    usual = float(np.median(list(square.values())))
    largest = sorted(numbers, key=lambda s: -square[s])[: (len(numbers) - 1) // 2]
    p = {
        s: float(fdtrc(rows[s], int(compared.sum()) - rows[s], square[s] / usual)) for s in largest
    }
    return {s: float(np.sqrt(square[s] / usual)) for s in largest if p[s] < UNLIKE_P / len(numbers)}


def split_sessions(
    data: Measurements, noise: Noise, fit: Fit, discrepancy: Array
) -> tuple[Mask, Mask] | None:
    """Rows [n] of sessions whose smooth discrepancy from the base model differs from that of the
    rest, and of the rest.

    None if none differ; sessions that are not compared belong to both.

    Sessions are ordered along the direction in which their discrepancies differ most, and cut in
    two at every place. A discrepancy for each part must exceed one for all by the number of
    possible cuts and LOG_ODDS.
    """
    compared = _compared(data)
    session = data.session[compared]
    numbers = np.unique(session)
    if numbers.size < FEWEST_SESSIONS or not discrepancy.size:
        return None
    residual, jacobian = fit.residual[compared], fit.jacobian[compared]
    target = residual + jacobian @ fit.vector
    _, _, directions = np.linalg.svd(discrepancy[compared], full_matrices=False)
    smooth = discrepancy[compared] @ directions[:SMOOTH].T

    def weight(part: Mask | None) -> float:
        parts = (
            smooth
            if part is None
            else np.concatenate([smooth * part[:, None], smooth * ~part[:, None]], axis=1)
        )
        spreads = [np.concatenate([jacobian, a * parts], axis=1) for a in AMPLITUDES]
        return float(logsumexp([log_marginal(target, spread, noise) for spread in spreads]))

    patterns = np.array([_pattern(smooth, residual, session == s) for s in numbers])
    order = numbers[np.argsort(np.linalg.svd(patterns - patterns.mean(axis=0))[0][:, 0])]
    cuts = [np.isin(session, order[: i + 1]) for i in range(numbers.size - 1)]
    weights = [weight(cut) for cut in cuts]
    best = int(np.argmax(weights))
    gain = weights[best] - weight(None) - np.log(2.0) * (numbers.size - 1)
    if gain <= LOG_ODDS:
        return None
    first, rest = order[: best + 1], order[best + 1 :]
    return ~np.isin(data.session, rest), ~np.isin(data.session, first)


def _compared(data: Measurements) -> Mask:
    """The observations [n] by which sessions are compared."""
    return data.of(data.witnesses[0])


def _pattern(smooth: Array, residual: Array, rows: Mask) -> Array:
    """What one session says of the discrepancy: its weights, pulled to zero where the session has
    little to say.
    """
    part = AMPLITUDES[-1] * smooth[rows]
    return np.asarray(
        np.linalg.solve(part.T @ part + np.eye(part.shape[1]), part.T @ residual[rows])
    )


def inflation(data: Measurements, unlike: dict[int, float]) -> Array:
    """Factor [n] on the noise of every row that makes unlike sessions as likely as the others."""
    return np.array([unlike.get(int(s), 1.0) for s in data.session])


def names(data: Measurements, rows: Mask) -> list[str]:
    """Names of the sessions to which rows belong."""
    return [data.session_names[int(s)] for s in np.unique(data.session[rows])]
