"""From the samples of passes to the numbers of a data sheet, each with an interval of 95 %."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite, nan, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from haptic_driver.fidelity.samples import tick_s
from haptic_driver.fidelity.sliding import AFTER_TOUCH_S, runs, since, sliding, turns
from haptic_driver.lab.papers.sheet_passes import EDGE_M, HALF_M, LINE_S, LINES_HZ, REST_S
from haptic_driver.signals import Array, Mask

CONFIDENCE = 0.95
BLOCK_S = 0.1  # over which friction is averaged to tell how much it wanders
BEFORE_S, AFTER_S = 0.04, 0.12  # of a step, that are looked at
PLATEAU_S = 0.03  # at both ends of that
FINE_S = 0.25e-3  # of the mean response to steps, each placed by its own crossing
RESAMPLED = 200
HALF_POWER = sqrt(0.5)
MARGIN_S = 0.1  # at both ends of a line: no rig answers sooner or later
MOST_OFF = 0.5  # of the pattern's half period: an edge is not looked for farther away


class Number(NamedTuple):
    """A value with its interval; NaN where it is unknown."""

    value: float
    low: float
    high: float

    @property
    def is_known(self) -> bool:
        return isfinite(self.value)


UNKNOWN = Number(nan, nan, nan)


class Response(NamedTuple):
    """How friction answers to steps one way: `delay_s` from the command to half of the change.

    `time_s`, `share`: the mean course [n] of the change, 0 at half of it.
    """

    delay_s: Number
    ten_to_ninety_s: Number
    time_s: Array
    share: Array


def mean_of(values: Sequence[float] | Array) -> Number:
    """The mean of independent values and its interval by Student's t."""
    known = np.asarray(values, dtype=float)
    known = known[np.isfinite(known)]
    if known.size < 2:
        return UNKNOWN
    half = stats.t.ppf(0.5 + 0.5 * CONFIDENCE, known.size - 1) * stats.sem(known)
    return Number(float(known.mean()), float(known.mean() - half), float(known.mean() + half))


def deviation_of(values: Sequence[float] | Array) -> Number:
    """The standard deviation of independent values and its interval by chi square."""
    known = np.asarray(values, dtype=float)
    n = int(known.size)
    if n < 3:
        return UNKNOWN
    deviation = float(known.std(ddof=1))
    tail = 0.5 - 0.5 * CONFIDENCE
    low, high = (deviation * sqrt((n - 1) / stats.chi2.ppf(p, n - 1)) for p in (1.0 - tail, tail))
    return Number(deviation, float(low), float(high))


def settled(samples: NDArray[np.void]) -> Mask:
    """Where a finger has been sliding for a while since it touched or turned [n]."""
    moves = sliding(samples)
    begins = turns(np.gradient(samples["output_x_m"])) | ~moves
    return np.asarray(moves & (since(samples["time_s"], begins) >= AFTER_TOUCH_S))


def cof_in_blocks(samples: NDArray[np.void]) -> Array:
    """Friction in blocks of `BLOCK_S`, where settled: lateral over normal force, summed."""
    lateral, normal = np.abs(samples["lateral_force_n"]), samples["normal_force_n"]
    found = []
    for start, stop in runs(settled(samples)):
        ticks = max(round(BLOCK_S / tick_s(samples)), 1)
        for i in range(start, stop - ticks + 1, ticks):
            part = slice(i, i + ticks)
            found.append(lateral[part].sum() / normal[part].sum())
    return np.array(found)


def noise_n(passes: Sequence[NDArray[np.void]]) -> Number:
    """Of one reading of the lateral force, at constant friction, each block without its line."""
    left: list[float] = []
    lost = 0  # degrees of freedom
    for samples in passes:
        lateral = np.abs(samples["lateral_force_n"])
        for start, stop in runs(settled(samples)):
            x = np.arange(stop - start)
            if x.size > 2:
                line = np.polynomial.Polynomial.fit(x, lateral[start:stop], 1)
                left += (lateral[start:stop] - line(x)).tolist()
                lost += 2
    known = deviation_of(left)
    scale = sqrt((len(left) - 1) / (len(left) - lost)) if len(left) > lost + 2 else nan
    return Number(*(scale * value for value in known))


def touches(passes: Sequence[NDArray[np.void]]) -> tuple[Number, Number]:
    """Relative deviation of friction within touches and between them, of blocks and of touches.

    What wanders within a touch is taken out of the second.
    """
    means, within, counts = [], [], []
    for samples in passes:
        blocks = cof_in_blocks(samples)
        if blocks.size >= 2:
            means.append(float(blocks.mean()))
            within += (blocks / blocks.mean() - 1.0).tolist()
            counts.append(blocks.size)
    if len(means) < 3:
        return UNKNOWN, UNKNOWN
    freedom: float = sqrt((len(within) - 1) / (len(within) - len(counts)))
    inside = Number(*(freedom * value for value in deviation_of(within)))
    outside = deviation_of(np.array(means) / np.mean(means))
    share = inside.value**2 / float(np.mean(counts))
    return inside, Number(*(sqrt(max(value**2 - share, 0.0)) for value in outside))


def responses(samples: NDArray[np.void], rises: bool) -> Response | None:
    """To the steps in time of one pass, up or down; None where fewer than three are there."""
    asked, time_s = samples["asked_cof"], samples["time_s"]
    jumps = np.diff(asked, prepend=asked[0])
    felt_s, cof = _felt(samples)
    time, delays, courses = np.arange(-BEFORE_S, AFTER_S, FINE_S), [], []
    calm = settled(samples)
    for i in np.flatnonzero((jumps > 0.0) if rises else (jumps < 0.0)).tolist():
        t = felt_s - time_s[i]
        near = (t >= -BEFORE_S) & (t <= AFTER_S)
        if not calm[i] or not np.isfinite(cof[near]).all() or t[-1] < AFTER_S:
            continue
        before = cof[near & (t < -BEFORE_S + PLATEAU_S)].mean()
        after = cof[near & (t > AFTER_S - PLATEAU_S)].mean()
        share = (cof[near] - before) / (after - before)
        delay_s = _crossing(t[near], share, 0.5)
        if isfinite(delay_s):
            delays.append(delay_s)
            courses.append(np.interp(time, t[near] - delay_s, share))
    if len(delays) < 3:
        return None
    found = np.array(courses)
    duration = _resampled(found, lambda mean: _ten_to_ninety(time, mean))
    return Response(mean_of(delays), duration, time, found.mean(axis=0))


def edge_errors_m(samples: NDArray[np.void], low: float, high: float) -> Array:
    """How far along its way the finger was beyond an edge when friction had changed by half [n]."""
    felt_s, cof = _felt(samples)
    x_m = np.interp(felt_s, samples["finger_time_s"], samples["position_x_m"])
    calm, middle = settled(samples), 0.5 * (low + high)
    found = []
    for start, stop in runs(calm):
        above = cof[start:stop] > middle
        way = np.sign(x_m[stop - 1] - x_m[start])
        edges_m = (np.round(x_m[start:stop] / HALF_M + 0.5) - 0.5) * HALF_M
        for edge_m in np.unique(edges_m):
            near = np.abs(x_m[start:stop] - edge_m) < MOST_OFF * HALF_M - EDGE_M
            beyond = (x_m[start:stop] - edge_m)[near] * way
            if beyond.size < 4 or min(-beyond.min(), beyond.max()) < 0.8 * MOST_OFF * HALF_M:
                continue  # the stroke ends here
            rises = above[near][-1]
            if above[near][0] != rises:
                share = (cof[start:stop][near] - middle) / (high - low) * (1 if rises else -1) + 0.5
                found.append(_crossing(beyond, share, 0.5))
    return np.array(found)


def gains(samples: NDArray[np.void]) -> tuple[Array, Array]:
    """Of felt against asked friction at each of `LINES_HZ`, and their standard errors [n]."""
    felt_s, cof = _felt(samples)
    calm = settled(samples) & np.isfinite(samples["asked_cof"])
    start_s = samples["time_s"][0] + REST_S
    found = []
    for hz in LINES_HZ:
        long_s = round(2.0 * hz * LINE_S) * 0.5 / hz
        within_s = start_s + MARGIN_S, start_s + long_s - MARGIN_S
        asked = _line(samples["time_s"][calm], samples["asked_cof"][calm], hz, within_s)
        felt = _line(felt_s[calm], cof[calm], hz, within_s)
        found.append((abs(felt[0]) / abs(asked[0]), felt[1] / abs(asked[0])))
        start_s += long_s + REST_S
    gain, error = np.array(found).T
    return gain, error


def half_power_hz(gain: Array, error: Array) -> Number:
    """Where gain falls below -3 dB for good; infinite at the upper end where it does not."""
    rng = np.random.default_rng(0)
    drawn = [_falls_hz(gain + error * rng.standard_normal(gain.size)) for _ in range(RESAMPLED)]
    low, high = np.quantile(drawn, [0.5 - 0.5 * CONFIDENCE, 0.5 + 0.5 * CONFIDENCE])
    return Number(_falls_hz(gain), float(low), float(high))


def _falls_hz(gain: Array) -> float:
    hz = np.array(LINES_HZ)
    above = np.flatnonzero(gain >= HALF_POWER)
    if above.size == 0:
        return float(hz[0])
    i = int(above[-1])
    if i == hz.size - 1:
        return float(hz[-1])
    share = (gain[i] - HALF_POWER) / (gain[i] - gain[i + 1])
    return float(hz[i] * (hz[i + 1] / hz[i]) ** share)


def _line(
    time_s: Array, values: Array, hz: float, within_s: tuple[float, float]
) -> tuple[complex, float]:
    """The complex amplitude of one frequency by least squares with a mean, and its error."""
    here = np.isfinite(values) & (time_s >= within_s[0]) & (time_s < within_s[1])
    t, y = time_s[here] - within_s[0], values[here]
    if t.size < 8:
        return complex(nan), nan
    angle = 2.0 * np.pi * hz * t
    design = np.column_stack([np.cos(angle), np.sin(angle), np.ones(t.size)])
    found, *_ = np.linalg.lstsq(design, y, rcond=None)
    deviation = float(np.std(y - design @ found))
    return complex(found[0], -found[1]), deviation * sqrt(2.0 / t.size)


def _felt(samples: NDArray[np.void]) -> tuple[Array, Array]:
    """When forces were read, and friction then; each reading once, NaN where unknown."""
    return samples["felt_time_s"], samples["measured_cof"]


def _crossing(x: Array, share: Array, level: float) -> float:
    """Where `share` first stays above `level`, between two points; NaN where it never does."""
    below = np.flatnonzero(share < level)
    if below.size == 0 or below[-1] + 1 >= share.size:
        return nan
    i = int(below[-1])
    part = (level - share[i]) / (share[i + 1] - share[i])
    return float(x[i] + part * (x[i + 1] - x[i]))


def _ten_to_ninety(time_s: Array, share: Array) -> float:
    """Between the first time above 90 % and the last time before it below 10 %."""
    reached = np.flatnonzero(share >= 0.9)
    if reached.size == 0 or reached[0] == 0:
        return nan
    i = int(reached[0])
    below = np.flatnonzero(share[:i] < 0.1)
    if below.size == 0:
        return nan
    k = int(below[-1])
    begins = np.interp(0.1, share[k : k + 2], time_s[k : k + 2])
    ends = np.interp(0.9, share[i - 1 : i + 1], time_s[i - 1 : i + 1])
    return float(ends - begins)


def _resampled(courses: Array, number: Callable[[Array], float]) -> Number:
    """A number of the mean course, its interval by drawing courses anew."""
    rng = np.random.default_rng(0)
    n = len(courses)
    drawn = [number(courses[rng.integers(0, n, n)].mean(axis=0)) for _ in range(RESAMPLED)]
    low, high = np.nanquantile(drawn, [0.5 - 0.5 * CONFIDENCE, 0.5 + 0.5 * CONFIDENCE])
    return Number(float(number(courses.mean(axis=0))), float(low), float(high))
