"""Records of slides made by hand."""

from __future__ import annotations

import numpy as np

from haptic_driver.rig.evidence import OffEvidence
from haptic_driver.rig.slide import Slide
from haptic_driver.simulation.slide import SlideRecord
from hw.amplifier.analog import AmplifierState


def made_record(count=100, **changed):
    """So many ticks at 50 mm/s under 0.5 N, friction 0.6 wanted and met; and whatever else differs."""
    time = np.arange(count) * 1e-3
    fields = {
        "slide": Slide("by hand", time, 0.05 * time, np.full(count, 0.5)),
        "target_cof": np.full(count, 0.6),
        "measured_cof": np.full(count, 0.6),
        "fine_target_cof": np.full(count, 0.6),
        "fine_measured_cof": np.full(count, 0.6),
        "voltage_v": np.full(count, 70.0),
        "frequency_hz": np.full(count, 250.0),
        "in_contact": np.ones(count, bool),
        "reachable": np.ones(count, bool),
        "off_screen": np.zeros(count, bool),
        "saturated": np.zeros(count, bool),
        "feedback_gain": np.ones(count),
        "max_voltage_v": 77.0,
        "rejections": 0,
        "off": OffEvidence(True, AmplifierState.DISABLED, 0.0),
    }
    return SlideRecord(**(fields | changed))
