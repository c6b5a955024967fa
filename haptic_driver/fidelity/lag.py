"""How far felt friction lags behind asked friction, by cross-correlation, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy import fft

from haptic_driver.fidelity.sliding import runs
from haptic_driver.fidelity.strokes import without_line
from haptic_driver.signals import Array
from haptic_driver.textures.bands import LEAST_COF

SEARCH_S = 0.1  # to either side; more than any latency of which friction is still rendered
# Of correlation. The next period of a fine grating at constant speed came within 0.02 of the true
# one under 3 mN of noise, that of linen within 0.06.
EQUALLY_GOOD = 0.03
LEAST_CORRELATION = 0.3  # below, the best of 200 lags of unrelated signals may be as good
# Of the peak's correlation, somewhere within the search: a target that keeps more changes so
# slowly that drift moves its peak by milliseconds.
MOST_KEPT = 0.5
MOST_ERROR_S = 0.005  # of a lag that is worth telling, since 10 ms are a fault
BLOCKS = 10  # of the jackknife: enough for a spread, and half a second each of a live record
LIFT_S = 0.05  # without forces: shorter, readings were missing, and the stroke goes on
LEAST_TICKS = 20  # of a stroke; a line through fewer would take the texture out
PARABOLA_TICKS = 0.05  # by which a parabola is off at the cusp that sharp edges leave


@dataclass(frozen=True)
class Latency:
    """The lag of felt behind asked friction, seconds; None with `why` where it is unknown.

    `error_s` is one standard error, by leaving out a tenth of the record at a time. `others_s`
    are lags that fit as well, of a periodic target: then `lag_s` is nearest to the expected.
    """

    lag_s: float | None
    error_s: float | None
    correlation: float | None
    others_s: list[float]
    why: str

    def __str__(self) -> str:
        if self.lag_s is None or self.error_s is None:
            return f"latency unknown: {self.why}"
        lag_ms, error_ms = 1e3 * self.lag_s, 1e3 * self.error_s
        said = f"felt {lag_ms:.1f} ms after asked, give or take {error_ms:.1f} ms"
        return f"{said}; {self.why}" if self.why else said


class Peak(NamedTuple):
    """The best lag of a correlation and, in `others`, those that are equally good; in ticks."""

    lag: float
    correlation: float
    others: list[float]


def latency_of(
    asked_cof: Array, felt_cof: Array, tick_s: float, expected_s: float = 0.0
) -> Latency:
    """Measure the lag of felt behind asked friction: arrays [n] of the same ticks, NaN in gaps.

    A constant gain, an offset, and drift along a stroke do not matter. ValueError where the
    arrays differ in length.
    """
    _require_same_length(asked_cof, felt_cof)
    lift, most = round(LIFT_S / tick_s), round(SEARCH_S / tick_s)
    answer_cof = _where_asked(asked_cof, felt_cof, lift, most)
    asked, felt = _without_drift(asked_cof, lift), _without_drift(answer_cof, lift)
    both = np.isfinite(asked) & np.isfinite(felt)
    if np.count_nonzero(both) < 2 * most:
        return _unknown(f"less than {2.0 * SEARCH_S:g} s of sliding")
    if np.std(asked[both]) < LEAST_COF:
        return _unknown("the target hardly changes")
    correlation = correlation_by_lag(asked, felt, most)
    peak = best_peak(correlation, expected_s / tick_s)
    if peak is None or peak.correlation < LEAST_CORRELATION:
        return _unknown("felt friction does not follow the target at any lag")
    error_s = tick_s * _standard_error(asked, felt, round(peak.lag))
    if np.nanmin(correlation) > MOST_KEPT * peak.correlation or not error_s < MOST_ERROR_S:
        return _unknown("the target changes too slowly, or friction is known too rarely")
    others_s = [tick_s * lag for lag in peak.others]
    why = ""
    if others_s:
        listed = ", ".join(f"{1e3 * lag_s:.0f}" for lag_s in others_s)
        why = f"the target is periodic, {listed} ms fit as well, this is nearest to the expected"
    return Latency(tick_s * peak.lag, error_s, peak.correlation, others_s, why)


def correlation_by_lag(asked: Array, felt: Array, most: int) -> Array:
    """Pearson correlation of asked[t] with felt[t + lag], for lags -most..most: array [2 most + 1].

    Every lag is judged over the pairs that are known (NaN is unknown). It is NaN where these are
    less than half of those at lag 0. The method is masked normalised correlation, Padfield,
    10.1109/TIP.2011.2181402.
    """
    _require_same_length(asked, felt)
    size = 1 << (asked.size + most - 1).bit_length()  # a power of two is quickest
    asked_there, x, x2 = fft.rfft(_powers(asked), size).conj()
    felt_there, y, y2 = fft.rfft(_powers(felt), size)
    products = [asked_there * felt_there, x * felt_there, x2 * felt_there]
    products += [asked_there * y, asked_there * y2, x * y]
    sums = fft.irfft(products, size)[:, np.arange(-most, most + 1)]
    pairs = np.round(sums[0])
    enough = (pairs > 2.0) & (pairs >= 0.5 * pairs[most])
    return _pearson(np.where(enough, pairs, np.nan), *sums[1:])


def best_peak(correlation: Array, expected: float = 0.0) -> Peak | None:
    """The highest peak between the ends of a correlation by lag; None where there is none.

    Of several that are equally good the one nearest to `expected`, in ticks. Between ticks a
    parabola through three values says where the top is.
    """
    most = correlation.size // 2
    known = np.where(np.isfinite(correlation), correlation, -np.inf)
    middle = known[1:-1]
    # of scipy's find_peaks, which takes half a second to import, what correlations need
    tops = 1 + np.flatnonzero((middle > known[:-2]) & (middle >= known[2:]))
    tops = tops[np.isfinite(correlation[tops - 1]) & np.isfinite(correlation[tops + 1])]
    if tops.size == 0:
        return None
    good = tops[correlation[tops] >= correlation[tops].max() - EQUALLY_GOOD]
    chosen = good[np.argmin(np.abs(good - most - expected))]
    lags = {int(top): float(top - most + _vertex(correlation[top - 1 : top + 2])) for top in good}
    lag = lags.pop(int(chosen))
    return Peak(lag, float(correlation[chosen]), list(lags.values()))


def _powers(values: Array) -> Array:
    """Whether a value is there, it, and its square, 0 where it is not: array [3, n]."""
    there = np.isfinite(values)
    centre = values[there].mean() if there.any() else 0.0  # keeps rounding small
    x = np.where(there, values - centre, 0.0)
    return np.array([there.astype(float), x, x * x])


def _pearson(pairs: Array, x: Array, x2: Array, y: Array, y2: Array, xy: Array) -> Array:
    """Correlation from sums over pairs; NaN where either hardly varies."""
    x_power = x2 - x * x / pairs
    y_power = y2 - y * y / pairs
    varies = np.minimum(x_power, y_power) > 1e-12 * pairs  # a millionth of friction is rounding
    covariance = np.where(varies, xy - x * y / pairs, np.nan)
    return np.asarray(covariance / np.sqrt(np.where(varies, x_power * y_power, 1.0)))


def _vertex(three: Array) -> Array:
    """Where a parabola through values [3, ...] at -1, 0 and 1 has its top, NaN without one."""
    bend = three[0] - 2.0 * three[1] + three[2]
    top = 0.5 * (three[0] - three[2])
    return np.asarray(np.divide(top, bend, out=np.full_like(bend, np.nan), where=bend < 0.0))


def _standard_error(asked: Array, felt: Array, lag: int) -> float:
    """Standard error of a lag, in ticks: the jackknife over tenths of the record.

    NaN where they do not all agree that there is a peak, or too few neighbours are known.
    """
    first, last = max(1 - lag, 0), asked.size - max(lag + 1, 0)
    place = np.arange(first, last)
    shifted = felt[place + lag + np.array([[-1], [0], [1]])]
    known = np.isfinite(asked[place]) & np.isfinite(shifted).all(axis=0)
    if np.count_nonzero(known) < BLOCKS:
        return np.nan
    y = shifted[:, known]
    x = np.broadcast_to(asked[place[known]], y.shape)
    terms = np.array([np.ones_like(y), x, x * x, y, y * y, x * y])
    starts = np.linspace(0, y.shape[1], BLOCKS, endpoint=False).astype(int)
    blocks = np.add.reduceat(terms, starts, axis=-1)
    without_one = blocks.sum(axis=-1, keepdims=True) - blocks
    lags = _vertex(_pearson(*without_one))
    return float(np.hypot(np.sqrt((BLOCKS - 1) * np.var(lags)), PARABOLA_TICKS))


def _where_asked(asked: Array, felt: Array, lift: int, most: int) -> Array:
    """Felt friction, NaN within `most` ticks of sliding where nothing is asked for `lift` ticks.

    There, as beyond a profile's end, it is the bare screen's, and its step is no lag.
    """
    answer = felt.copy()
    for start, end in runs(np.isfinite(felt) & ~np.isfinite(asked)):
        if end - start >= lift:
            answer[max(start - most, 0) : end + most] = np.nan
    return answer


def _without_drift(values: Array, lift: int) -> Array:
    """Each stroke less a straight line, NaN where nothing is known and in strokes of a few ticks.

    A stroke ends where nothing is known for `lift` ticks.
    """
    known = np.isfinite(values)
    touching = known.copy()
    for start, end in runs(~known):
        touching[start:end] = end - start < lift
    left = np.full(values.size, np.nan)
    for start, end in runs(touching):
        place = start + np.flatnonzero(known[start:end])
        if place.size >= LEAST_TICKS:
            left[place] = without_line(values[place], place.astype(float))
    return left


def _require_same_length(asked: Array, felt: Array) -> None:
    if asked.shape != felt.shape:
        raise ValueError(f"asked has shape {asked.shape}, felt {felt.shape}")


def _unknown(why: str) -> Latency:
    return Latency(None, None, None, [], why)
