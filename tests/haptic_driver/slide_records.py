"""Records of slides made by hand."""

from __future__ import annotations

import numpy as np

from haptic_driver.processes.samples import SAMPLE
from haptic_driver.rig.evidence import OffEvidence
from haptic_driver.rig.slide import Slide
from haptic_driver.simulation.slide import SlideRecord
from hw.amplifier.analog import AmplifierState


def made_samples(count=100, **changed):
    """So many ticks at 50 mm/s under 0.5 N, friction 0.6 wanted and met; and whatever else
    differs.
    """
    samples = np.zeros(count, SAMPLE)
    usual = {
        "tick": np.arange(1, count + 1),
        "time_s": 1e-3 * np.arange(count),
        "position_x_m": 5e-5 * np.arange(count),
        "speed_m_s": 0.05,
        "normal_force_n": 0.5,
        "in_contact": 1,
        "target_cof": 0.6,
        "measured_cof": 0.6,
        "reachable": 1,
        "feedback_gain": 1.0,
        "voltage_v": 70.0,
    }
    for name, values in (usual | changed).items():
        samples[name] = values
    if "lateral_force_n" not in changed:
        samples["lateral_force_n"] = samples["measured_cof"] * samples["normal_force_n"]
    return samples


def made_record(count=100, samples=None, **changed):
    """A record of such samples; and whatever else differs."""
    time = np.arange(count) * 1e-3
    fields = {
        "slide": Slide("by hand", time, 0.05 * time, np.full(count, 0.5)),
        "samples": made_samples(count) if samples is None else samples,
        "voltage_v": np.full(count, 70.0),
        "frequency_hz": np.full(count, 250.0),
        "off_screen": np.zeros(count, bool),
        "saturated": np.zeros(count, bool),
        "lowest_voltage_v": 1.0,
        "max_voltage_v": 77.0,
        "rejections": 0,
        "off": OffEvidence(True, AmplifierState.DISABLED, 0.0, 0.0).at(0.0),
        "reach_hz": 500.0,
        "noise_n": 0.0,
    }
    return SlideRecord(**(fields | changed))
