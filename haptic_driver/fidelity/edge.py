"""From a touch to the voltage at the electrode: a loop-back by the daemon's own samples, stage by
stage.

A touch asks for voltage, and the amplifier's monitor shows when it is there. What comes out is a
set point that was commanded in some tick before: its voltage tells which.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_driver.signals import Array

EDGE_V = 5.0  # above what the monitor read before the touch
WITHIN_S = 0.5  # of the touch; a lift sooner ends it
READS_S = 0.1  # after the edge, over which it is seen how often the monitor is looked at
SAME = 0.02  # of a voltage: commanded and read
MOST = 95.0  # percentile that is told beside the median
# What no loop-back on the rig can tell.
UNSEEN = (
    "panel: a touch screen stamps a report after its scan, so the age of a report is not in it",
    "electrode: the monitor is the amplifier's own; leads and the electrode come after it",
)
NO_MONITOR = (
    "wait, output, total: no monitor of the amplifier's voltage was read, so nobody knows when it"
    " is there; name one in the rig's file (analog_inputs, amplifier.voltage_monitor_v_per_v)"
)


class Touch(NamedTuple):
    """What one touch took, s.

    `read_s`: from the reading that made it a touch to the tick that used it. `tick_s`: computed.
    `wait_s`: until that voltage was commanded which then came out, by the bounded rise and the wait
    for a set point. `output_s`: until the monitor showed it. `lead_s`: by which the driver renders
    ahead of a tick. `look_s`: between two looks at the monitor, by which the edge may seem late.
    Without a monitor `wait_s`, `output_s` and `look_s` are NaN.
    """

    read_s: float
    tick_s: float
    wait_s: float
    output_s: float
    lead_s: float
    look_s: float

    @property
    def total_s(self) -> float:
        """From the reading to the edge."""
        return self.read_s + self.tick_s + self.wait_s + self.output_s


class Stage(NamedTuple):
    """One part of the way: the median and the 95 % of it, s; `said` tells what it is."""

    name: str
    median_s: float
    most_s: float
    said: str


def touches(samples: NDArray[np.void]) -> tuple[list[Touch], dict[str, int]]:
    """The touches in samples [n] of ticks in their order, and how many were left out, by why."""
    found, left_out = list[Touch](), dict[str, int]()
    seen = bool(np.isfinite(samples["monitor_voltage_v"]).any())
    for i in touched(samples).tolist():
        each = _touch(samples, i) if seen else _unseen(samples, i)
        if isinstance(each, Touch):
            found.append(each)
        else:
            left_out[each] = left_out.get(each, 0) + 1
    return found, left_out


def touched(samples: NDArray[np.void]) -> NDArray[np.intp]:
    """The ticks [m] at which a touch begins, of which all that counts has been recorded."""
    begins = np.flatnonzero(np.diff(samples["in_contact"].astype(np.int8)) == 1) + 1
    end_s = float(samples["time_s"][-1]) if samples.size else 0.0
    return begins[samples["time_s"][begins] <= end_s - WITHIN_S]


def stages(found: Sequence[Touch], report_s: float, dialogue_s: float) -> list[Stage]:
    """Stages in their order, `total` and `lead` behind them; those that nobody knows are left out.

    `report_s`: between reports of the panel, NaN where unknown; `dialogue_s`: what the generator's
    took. `found` holds at least one.
    """
    dialogue = f"of which the dialogue with the generator {1e3 * dialogue_s:.2g} ms"
    look_s = _median([one.look_s for one in found])
    told = [
        Stage("panel", 0.5 * report_s, 0.01 * MOST * report_s, "reckoned from its reports' pace"),
        _stage("read", [one.read_s for one in found], "until a tick uses the reading"),
        _stage("tick", [one.tick_s for one in found], "computed"),
        _stage("wait", [one.wait_s for one in found], "bounded rise, and wait for a set point"),
        _stage(
            "output",
            [one.output_s for one in found],
            f"until the monitor shows it, {dialogue}; it is looked at every"
            f" {1e3 * look_s:.2g} ms, and shows an edge so late at most",
        ),
        _stage("total", [one.total_s for one in found], "from the reading to the edge"),
        _stage("lead", [one.lead_s for one in found], "so far ahead of a tick the driver renders"),
    ]
    return [stage for stage in told if np.isfinite(stage.median_s)]


def _stage(name: str, took_s: Sequence[float], said: str) -> Stage:
    most_s = float(np.percentile(took_s, MOST))
    return Stage(name, _median(took_s), most_s, said)


def _median(values: Sequence[float]) -> float:
    known = [value for value in values if math.isfinite(value)]
    return float(np.median(known)) if known else math.nan


def _unseen(samples: NDArray[np.void], i: int) -> Touch:
    """The touch that begins at tick `i`, as far as it is known without a monitor.

    A tick with a new place became a touch by that; else by the force.
    """
    before, first = samples[i - 1], samples[i]
    stamps = [first["felt_time_s"]]
    if first["finger_time_s"] > before["finger_time_s"] or not np.isfinite(stamps[0]):
        stamps.append(first["finger_time_s"])
    return Touch(
        float(first["time_s"] + first["lateness_s"] - np.nanmin(stamps)),
        float(first["compute_s"]),
        math.nan,
        math.nan,
        float(first["asked_time_s"] - first["time_s"]),
        math.nan,
    )


def _touch(samples: NDArray[np.void], i: int) -> Touch | str:
    """The touch that begins at tick `i`, or why it does not count."""
    before, first = samples[i - 1], samples[i]
    count = int(np.searchsorted(samples["time_s"], first["time_s"] + WITHIN_S)) - i
    lasted = samples[i : i + count]
    lifted = np.flatnonzero(lasted["in_contact"] == 0)
    lasted = lasted[: lifted[0]] if lifted.size else lasted
    if not np.isfinite(before["monitor_voltage_v"]):
        return "the monitor had not been read yet"
    if not before["output_on"]:
        return "the output had to be switched on first"
    shown = np.flatnonzero(lasted["monitor_voltage_v"] > before["monitor_voltage_v"] + EDGE_V)
    if not shown.size:
        return f"no edge of {EDGE_V:g} V came before the finger was lifted"
    edge = lasted[shown[0]]
    ready_s = lasted["time_s"] + lasted["lateness_s"] + lasted["compute_s"]
    came_out = lasted["voltage_v"][: shown[0] + 1] >= (1.0 - SAME) * edge["monitor_voltage_v"]
    if not came_out.any():
        return "the monitor showed more than was commanded"
    commanded_s = ready_s[np.argmax(came_out)]
    return _unseen(samples, i)._replace(
        wait_s=float(commanded_s - ready_s[0]),
        output_s=float(edge["time_s"] + edge["lateness_s"] - commanded_s),
        look_s=_look_s(lasted[shown[0] :]),
    )


def _look_s(after: NDArray[np.void]) -> float:
    """The median time between readings of the monitor, whose noise tells one from the next."""
    soon = after[after["time_s"] <= after["time_s"][0] + READS_S]
    new = np.flatnonzero(np.diff(soon["monitor_voltage_v"])) + 1
    between_s: Array = np.diff(soon["time_s"][new])
    return float(np.median(between_s)) if between_s.size else math.nan
