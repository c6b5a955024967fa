"""What the stages hand to one another: finger -> target -> operating point -> safe point -> drive
command.

All SI floats with the unit in the name; `voltage_v` is always the peak amplitude at the electrode.
"""

from __future__ import annotations

from math import nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Mask = NDArray[np.bool_]

TICK_S = 0.001
WITHIN = 0.05  # of the friction asked for: what counts as rendered
SLIDING_M_S = 0.002  # below, a finger rests and kinetic friction is not defined
SETTLED_M = 0.0003  # of a stroke: before, the skin still stretches, and friction has not come up


class FingerSample(NamedTuple):
    """One raw reading of the finger: position on the screen and forces, at a time.

    `lateral_force_n` is what friction is measured by, of either sign; NaN where it is unknown: no
    sensor, a reading that is stale or saturated. `now_s` is when the tick is due; NaN: at the time
    of the reading. `contact_area_m2` is NaN where the screen does not tell it.
    """

    time_s: float
    position_x_m: float
    position_y_m: float
    normal_force_n: float
    lateral_force_n: float = nan
    now_s: float = nan
    contact_area_m2: float = nan


class FingerState(NamedTuple):
    """The finger as the stages see it: contact decided, velocity estimated, position at output
    time.

    `time_s` is when the tick is due, `contact_s` how long the touch has lasted by then. `met_m_s`
    is its speed where its place waits for the next report; NaN: that of its velocity.
    """

    time_s: float
    position_x_m: float
    position_y_m: float
    velocity_x_m_s: float
    velocity_y_m_s: float
    normal_force_n: float
    in_contact: bool
    lateral_force_n: float = nan
    contact_s: float = 0.0
    met_m_s: float = nan
    contact_area_m2: float = nan


class TargetFriction(NamedTuple):
    """The coefficient of friction that the texture asks for here; `active` is False where it asks
    for nothing.
    """

    cof: float
    active: bool


class OperatingPoint(NamedTuple):
    """What the controller wants: a sine of `frequency_hz` and peak `voltage_v`, and what it expects
    of it.

    `cof` is the friction expected; `reachable` is False when the target lay outside
    `cof_low`..`cof_high` and the nearest reachable friction was taken instead.
    """

    frequency_hz: float
    voltage_v: float
    cof: float
    current_rms_a: float
    stuck_current_rms_a: float
    reachable: bool
    cof_low: float
    cof_high: float


class SafeOperatingPoint(NamedTuple):
    """An operating point that passed the last gate, or zero volts with the reason why it did
    not.
    """

    frequency_hz: float
    voltage_v: float
    rejection: str | None


class DriveCommand(NamedTuple):
    """What the actuator shall put out; `output_on` False means zero volts, carrier off.

    `full_scale_v` is the most that the limits allow at this frequency under any load. A carrier has
    that amplitude where an envelope takes it down, and a finger gets it where the envelope fails.
    """

    frequency_hz: float
    voltage_v: float
    output_on: bool
    full_scale_v: float = 0.0


# per tick: with so many per millisecond a texture of 800 Hz keeps 99.5 % of its force (sinc^2)
COURSE_POINTS = 20


class Course(NamedTuple):
    """Peak voltage squared at the electrode, V^2 [n], over the next `span_s`: evenly spaced, the
    last at its end.
    """

    powers_v2: NDArray[np.float64]
    span_s: float


NO_COURSE = Course(np.empty(0), 0.0)
NO_COMMAND = DriveCommand(frequency_hz=10e3, voltage_v=0.0, output_on=False)
