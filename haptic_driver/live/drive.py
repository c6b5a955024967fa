"""What the forces of a sample answer to: the command that is felt then, and how sure that is.

Friction follows attraction with a first-order lag of the way slid, and attraction goes with the
voltage squared. So the square is lagged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from haptic_driver.render.feedback import FeedbackSettings
from haptic_driver.signals import Array, Mask

# after another carrier: set points come 10 ms late, and friction needs 20 ms at the slowest
SETTLING_S = 0.05
TIMING_S = {"envelope": 0.001, "set_point": 0.010}  # so much early or late may the drive be
LATER = (0.0, -1.0, 1.0, 2.0, 3.0)  # by how many of these it may be felt later than its budget says
PLAINLY = 0.9  # of the scatter about the budget's timing: another one leaves less
NO_POWER_V2 = 1.0


class Felt(NamedTuple):
    """Forces [n] and what they answer to.

    `least_hz` and `most_hz` are the ends of the carrier since SETTLING_S, `power_v2` the lagged
    voltage squared. `unsure_v2` is what the drive's timing may change of it: anything where a
    reading only repeats the last.
    """

    time_s: Array
    normal_force_n: Array
    lateral_force_n: Array
    speed_m_s: Array
    carrier_hz: Array
    least_hz: Array
    most_hz: Array
    power_v2: Array
    unsure_v2: Array

    def during(self, part: slice | Mask) -> Felt:
        return Felt(*(values[part] for values in self))


def felt(
    samples: NDArray[np.void], latency_s: Mapping[str, float], strokes: Sequence[slice], block: int
) -> Felt:
    """Samples of SAMPLE [n > 1] beside their commands; at 0 V the carrier is the last or the first.

    The carrier's ends are those before any of the `block` samples up to one.
    """
    drive = "envelope" if "envelope" in latency_s else "set_point"
    place, power_v2 = _commanded(samples, _later_s(samples, TIMING_S[drive], strokes))
    step_s = float(np.median(np.diff(samples["time_s"])))
    driven = np.flatnonzero(samples["voltage_v"][place] > 0.0)
    carrier_hz = np.zeros(samples.size)
    if driven.size:
        last = np.searchsorted(driven, np.arange(samples.size), side="right") - 1
        carrier_hz = samples["frequency_hz"][place][driven[np.maximum(last, 0)]]
    look_back = block + round(SETTLING_S / step_s)
    lately_hz = _with_those_around(carrier_hz, look_back - 1, 0)
    least_hz, most_hz = lately_hz.min(axis=1), lately_hz.max(axis=1)
    shift = round(TIMING_S[drive] / step_s)
    shifted_v2 = _with_those_around(power_v2, shift, shift)
    unsure_v2 = np.ptp(shifted_v2, axis=1)
    if drive == "envelope":  # early as often as late: valleys are felt less deep
        power_v2 = shifted_v2.mean(axis=1)
    power_v2[power_v2 < NO_POWER_V2] = 0.0
    forces_n = samples["normal_force_n"], samples["lateral_force_n"]
    repeated = np.all(np.diff(forces_n, prepend=np.nan) == 0.0, axis=0)
    unsure_v2[repeated] = np.inf  # control was late: a reading of before
    touch = samples["time_s"], *forces_n, samples["speed_m_s"]
    return Felt(*touch, carrier_hz, least_hz, most_hz, power_v2, unsure_v2)


def _with_those_around(values: Array, before: int, after: int) -> Array:
    """Each of values [n] with so many before and after it [n, m]; beyond its ends they go on."""
    padded = np.pad(values, (before, after), mode="edge")
    return np.asarray(sliding_window_view(padded, before + 1 + after))


def _later_s(samples: NDArray[np.void], timing_s: float, strokes: Sequence[slice]) -> float:
    """How much later than by its budget the drive was felt; 0 unless friction plainly says so.

    At the right timing a line over the voltage squared leaves the least of each stroke's friction.
    """
    left = {}
    for later_s in (timing_s * later for later in LATER):
        _, power_v2 = _commanded(samples, later_s)
        left[later_s] = 0.0
        for part in strokes:
            y, x = (v[part] - v[part].mean() for v in (samples["measured_cof"], power_v2))
            left[later_s] += float(y @ y - (y @ x) ** 2 / max(x @ x, NO_POWER_V2))
    best_s = min(left, key=left.__getitem__)
    return best_s if left[best_s] < PLAINLY * left[0.0] else 0.0


def _commanded(samples: NDArray[np.void], later_s: float) -> tuple[NDArray[np.intp], Array]:
    """Which sample's command each sample feels, and the lagged square of its voltage."""
    acts_s = np.maximum.accumulate(samples["asked_time_s"]) + later_s
    place = np.maximum(np.searchsorted(acts_s, samples["felt_time_s"], side="right") - 1, 0)
    time_s = samples["time_s"]
    way_m = np.nan_to_num(samples["speed_m_s"]) * np.diff(time_s, prepend=time_s[0])
    shares = -np.expm1(-2.0 * np.pi * FeedbackSettings(0.0).cutoff_hz_per_m_s * way_m)
    powers_v2 = (samples["voltage_v"][place] ** 2).tolist()
    lagged = accumulate(
        zip(powers_v2, shares.tolist(), strict=True),
        lambda last, new: last + new[1] * (new[0] - last),
        initial=powers_v2[0],
    )
    return place, np.array(list(lagged)[1:])
