"""Samples of rendering cut into windows of even sliding, each a row as `haptic measure` has them.

Even means that load, speed and carrier hardly change; the voltage may, as fast as a texture wants
it. The samples of a stretch with about the same lagged voltage squared are a window. Strokes are
trials; after a pause a session begins.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_driver.fidelity.average import WINDOW_COLUMNS, average, standard_error
from haptic_driver.fidelity.sliding import runs, sliding, turns
from haptic_driver.live.drive import NO_POWER_V2, SETTLING_S, Felt, felt
from haptic_driver.processes.samples import Flag
from haptic_driver.signals import SETTLED_M

# samples that are averaged before it is asked whether a condition is steady: sensors are noisy
BLOCK = 10
SHORTEST_S = 0.1  # enough samples to tell how they remember one another
LONGEST_S = 1.0
LARGEST_CHANGE = np.array([[0.10], [0.30], [1e-6]])  # of load, speed, carrier, within one stretch
BINS = 5  # windows of a stretch, evenly spaced in the voltage squared, besides that without voltage
# of a stretch's highest voltage squared: where timing matters more, a sample says little
UNSURE = 0.16
UNNOTICED_S = 0.2  # so long may an output have been without voltage before that is noticed
GAP_S = 0.005  # without a sample, or longer: another stroke
PAUSE_S = 5.0  # between strokes, or longer: another session


class Window(NamedTuple):
    """Friction over `lasted_s` of sliding at one voltage, and its standard error `cof_std`.

    `time_s` is the mean over its samples, on their clock. Sessions, and strokes (`trial`) in each,
    count from 1.
    """

    frequency_hz: float
    voltage_v: float
    normal_force_n: float
    speed_m_s: float
    cof: float
    cof_std: float
    time_s: float
    lasted_s: float
    session: int
    trial: int


class Counted(NamedTuple):
    """The last session and stroke, and when that ended."""

    session: int
    trial: int
    ended_s: float


NONE_YET = Counted(0, 0, -inf)


def windows(
    samples: NDArray[np.void], latency_s: Mapping[str, float], counted: Counted = NONE_YET
) -> tuple[list[Window], Counted]:
    """The windows in samples of SAMPLE [n], in order of time, and the count to go on from.

    `latency_s` is the budget from a sample to its effect, by where it is spent and in `total`.
    """
    strokes = list(_strokes(samples, latency_s["total"] + SETTLING_S)) if samples.size > 1 else []
    if not strokes:
        return [], counted
    every, found = felt(samples, latency_s, strokes, BLOCK), []
    for stroke in map(every.during, strokes):
        seen = [each for part in _even(stroke) for each in _by_voltage(stroke.during(part))]
        if not seen:
            continue
        session, trial, ended_s = counted
        paused = stroke.time_s[0] - ended_s > PAUSE_S
        session, trial = (session + 1, 1) if paused else (session, trial + 1)
        counted = Counted(session, trial, float(stroke.time_s[-1]))
        found += [each._replace(session=session, trial=trial) for each in seen]
    return _with_shared_noise(found), counted


def row(window: Window, start_s: float, *, simulated: bool) -> dict[str, str]:
    """A window as a row of measured data, as text by column, with times since `start_s`."""
    numbers = window._replace(time_s=window.time_s - start_s)
    texts = {name: f"{getattr(numbers, name):.9g}" for name in WINDOW_COLUMNS}
    return texts | {"simulated": "true" if simulated else "false"}


def _with_shared_noise(found: list[Window]) -> list[Window]:
    """The windows with errors that also rest on the noise of the others.

    Where a window lasts a few correlation times, its scatter says little about the error of its
    mean. So the relative variance of a mean over one second is drawn to that of all windows
    together, which counts as the longest.
    """
    if not found:
        return found
    lasted_s, std = np.array([(each.lasted_s, each.cof_std / each.cof) for each in found]).T
    own = lasted_s * std**2
    shared = LONGEST_S * np.average(own, weights=lasted_s)
    stds = np.sqrt((lasted_s * own + shared) / (lasted_s + LONGEST_S) / lasted_s).tolist()
    return [each._replace(cof_std=std * each.cof) for each, std in zip(found, stds, strict=True)]


def _strokes(samples: NDArray[np.void], settling_s: float) -> Iterator[slice]:
    """Where the finger slides without a break or a turn, and friction is known.

    Only of what was out all the time. Before the first sample nobody knows; what was commanded is
    felt within `settling_s`.
    """
    unmeasured = int(Flag.SATURATED_SENSOR | Flag.FRICTION_FROM_CURRENT)  # up until the next arming
    time_s, speed_m_s = samples["time_s"], samples["speed_m_s"]
    usable = sliding(samples) & (samples["flags"] & unmeasured == 0)
    usable &= time_s >= time_s[0] + settling_s
    lost_s = time_s[(samples["voltage_v"] > 0.0) & (samples["output_on"] == 0)]
    usable &= np.searchsorted(lost_s, time_s - settling_s) == np.searchsorted(
        lost_s, time_s + UNNOTICED_S
    )
    gap = np.diff(time_s, prepend=time_s[0]) > GAP_S
    breaks = gap | turns(samples["lateral_force_n"])
    for begin, end in runs(usable, breaks):
        if end - begin < BLOCK:
            continue
        way_m = np.cumsum(speed_m_s[begin:end] * np.gradient(time_s[begin:end]))
        start = begin + int(np.searchsorted(way_m, SETTLED_M))
        if end - start >= BLOCK:
            yield slice(start, end)


def _even(stroke: Felt) -> Iterator[slice]:
    """The even stretches of one stroke: each as long as it stays even, up to LONGEST_S."""
    count = stroke.time_s.size // BLOCK
    touch = [
        values[: count * BLOCK].reshape(count, BLOCK).mean(axis=1)
        for values in (stroke.normal_force_n, stroke.speed_m_s)
    ]
    least, most = (
        np.stack([*touch, hz[BLOCK - 1 :: BLOCK]]) for hz in (stroke.least_hz, stroke.most_hz)
    )
    block_s = BLOCK * float(np.mean(np.diff(stroke.time_s)))
    longest = max(round(LONGEST_S / block_s), 1)
    start = 0
    while start < count:
        ahead = slice(start, start + 2 * longest)
        low = np.minimum.accumulate(least[:, ahead], axis=1)
        high = np.maximum.accumulate(most[:, ahead], axis=1)
        steady = np.all(high - low <= LARGEST_CHANGE * high, axis=0)
        long = steady.size if steady.all() else int(np.argmin(steady))
        if long > longest:  # in halves, rather than with a short rest that says little
            long = long // 2
        if long * block_s >= SHORTEST_S - 0.5 * block_s:
            yield slice(start * BLOCK, (start + long) * BLOCK)
        start += max(long, 1)


def _by_voltage(stretch: Felt) -> Iterator[Window]:
    """The windows of one stretch, not counted yet.

    The errors rest on the scatter of the whole stretch about its windows.
    """
    step_s = float(np.mean(np.diff(stretch.time_s)))
    sure = stretch.unsure_v2 <= max(UNSURE * stretch.power_v2.max(), NO_POWER_V2)
    time_s, load_n, lateral_n, speed_m_s, carrier_hz, *_, power_v2, _ = stretch.during(sure)
    place = np.ceil(BINS * power_v2 / power_v2.max(initial=NO_POWER_V2))
    parts = [part for k in np.unique(place) if np.count_nonzero(part := place == k) >= BLOCK]
    if not parts:
        return
    lateral_n = np.abs(lateral_n)
    means = [average(time_s[part], lateral_n[part], load_n[part]) for part in parts]
    powers_v2 = [float(np.mean(power_v2[part])) for part in parts]
    cof = np.interp(power_v2, powers_v2, [mean.cof for mean in means])
    error = standard_error((lateral_n - cof * load_n) / np.mean(load_n))
    for part, mean, window_v2 in zip(parts, means, powers_v2, strict=True):
        count = np.count_nonzero(part)
        told = mean._replace(cof_std=error * float(np.sqrt(power_v2.size / count)))
        frequency_hz = carrier_hz[-1] if window_v2 > 0.0 else 0.0
        speed = np.mean(speed_m_s[part])
        at = frequency_hz, np.sqrt(window_v2), mean.normal_force_n, speed
        f, v, n, s = (float(f"{value:.6g}") for value in at)
        if told.valid:
            yield Window(f, v, n, s, told.cof, told.cof_std, told.time_s, count * step_s, 0, 0)
