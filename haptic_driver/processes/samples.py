"""What a tick leaves behind: a sample and its flags. Without pydantic, which the render process
does not load.
"""

from __future__ import annotations

from enum import IntFlag

import numpy as np

from haptic_driver.signals import COURSE_POINTS


class Flag(IntFlag):
    """What has happened since arming; each stays up until the next arming."""

    OVERRUN = 1
    SATURATED_SENSOR = 2
    STALE_SENSOR = 4
    UNREACHABLE = 8
    REJECTED = 16
    LEASE_LOST = 32
    TRIPPED = 64
    FAULT = 128
    FEEDBACK_LIMIT = 256
    UNDERRUN = 512
    CONTROL_SILENT = 1024
    FRICTION_FROM_CURRENT = 2048  # what is felt is estimated: no force sensor measures it
    # the finger pressed harder or slid faster than the surface was solved for
    OUTSIDE_SURFACE = 8192
    LATENCY = 4096  # friction is surely felt sooner or later than the rig's file says
    EVENT_LINE = 16384  # an edge of the event line is missing
    BY_TIME = 32768  # waves have their length, not their place

    def names(self) -> list[str]:
        """Lower-case names of the flags that are up."""
        return [flag.name.lower() for flag in Flag if flag in self and flag.name]


SAMPLE = np.dtype(
    [
        ("tick", "u8"),
        ("time_s", "f8"),  # CLOCK_MONOTONIC when the tick was due
        ("lateness_s", "f8"),
        ("compute_s", "f8"),
        ("finger_time_s", "f8"),  # of the finger sample used
        ("position_x_m", "f8"),  # raw
        ("position_y_m", "f8"),
        ("output_x_m", "f8"),  # extrapolated to output time
        ("output_y_m", "f8"),
        ("speed_m_s", "f8"),
        ("normal_force_n", "f8"),
        ("lateral_force_n", "f8"),
        ("in_contact", "u1"),
        ("felt_time_s", "f8"),  # of the force reading, to which the next four belong
        (
            "target_cof",
            "f8",
        ),  # of the moment that was felt, latency and lag taken out; NaN where nothing was asked
        ("reachable", "u1"),  # whether that target was
        ("expected_cof", "f8"),
        ("measured_cof", "f8"),  # NaN without sliding contact, and without a force sensor
        ("estimated_cof", "f8"),  # by the model where no force sensor is; NaN where one is
        ("estimated_cof_std", "f8"),  # 1 sigma
        ("asked_time_s", "f8"),  # when what this tick decides acts on the finger
        ("asked_cof", "f8"),  # of that moment
        ("feedback_gain", "f8"),  # the finger's estimated gain
        ("frequency_hz", "f8"),
        ("voltage_v", "f8"),  # peak at the electrode, as commanded
        ("electrode_time_s", "f8"),  # of the electrode monitors' last reading; NaN without one
        ("electrode_voltage_v", "f8"),  # peak, as read
        ("electrode_voltage_phase_rad", "f8"),  # NaN where nobody tells it
        ("current_a", "f8"),  # peak, stray current included
        ("current_phase_rad", "f8"),
        ("monitor_voltage_v", "f8"),  # by the amplifier's own monitors, as last looked at
        ("monitor_current_a", "f8"),
        ("contact_area_m2", "f8"),  # apparent, as the touch screen tells it; NaN where it does not
        ("contact_area_std_m2", "f8"),  # 1 sigma
        (
            "output_on",
            "u1",
        ),  # also at 0 V; 0 with a voltage: on its way, while the output comes up or after a gap
        ("flags", "u4"),
    ]
)
"""One tick as it goes through the ring buffer to recorder, API and dashboard."""

ADDED = (  # since recordings were first written; NaN of those that have them not
    "estimated_cof",
    "estimated_cof_std",
    "electrode_time_s",
    "electrode_voltage_v",
    "electrode_voltage_phase_rad",
    "current_a",
    "current_phase_rad",
    "monitor_voltage_v",
    "monitor_current_a",
    "contact_area_m2",
    "contact_area_std_m2",
)

COURSE = np.dtype([("order", "u8"), ("powers_v2", "f8", (COURSE_POINTS,))])
"""What an analog envelope is to do until the next tick, and the order that render followed."""
