"""A slide over the simulated rig, as its ticks and the electrode itself had it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from haptic_driver.fidelity.measure import Fidelity
from haptic_driver.fidelity.perception import Perception, load_perception
from haptic_driver.fidelity.samples import fidelity_of_samples
from haptic_driver.fidelity.sliding import runs, sliding
from haptic_driver.fidelity.strokes import moving_average
from haptic_driver.rig.evidence import KnownOutput
from haptic_driver.rig.slide import Slide
from haptic_driver.signals import TICK_S, Array, Mask

AVERAGE_TICKS = 10  # as fidelity compares friction
LEAST_STROKE_TICKS = 20


@dataclass(frozen=True)
class SlideRecord:
    """One rendered slide: arrays [n], one entry per tick.

    `samples` are what the daemon's recordings hold, of dtype SAMPLE. `voltage_v` and `frequency_hz`
    are what the simulated amplifier and generator really put out. `lowest_voltage_v` is the least
    that an output that is on has. `saturated` is where the force sensor was. `rejections` counts
    refusals of the safety gate. `off` is what was known about the output after the end. `reach_hz`:
    how fast the rig's output can follow a texture. `noise_n`: of one reading of the force sensor.
    """

    slide: Slide
    samples: NDArray[np.void]
    voltage_v: Array
    frequency_hz: Array
    off_screen: Mask
    saturated: Mask
    lowest_voltage_v: float
    max_voltage_v: float
    rejections: int
    off: KnownOutput
    reach_hz: float
    noise_n: float

    @property
    def sliding(self) -> Mask:
        """Where friction is known: in contact, sliding, and a texture underneath; without a force
        sensor, where it is estimated.
        """
        known = sliding(self.samples) | np.isfinite(self.samples["estimated_cof"])
        return np.asarray(known & np.isfinite(self.samples["target_cof"]))

    @property
    def is_estimated(self) -> bool:
        """Whether friction was estimated, and nowhere measured."""
        measured = np.isfinite(self.samples["measured_cof"]).any()
        return bool(np.isfinite(self.samples["estimated_cof"]).any() and not measured)

    @property
    def strokes(self) -> list[slice]:
        """Uninterrupted sliding, at least 20 ms long."""
        return [slice(a, b) for a, b in runs(self.sliding) if b - a >= LEAST_STROKE_TICKS]

    @property
    def target_cof(self) -> Array:
        """Friction asked for, of the moment that was felt; NaN where nothing was asked."""
        return np.asarray(self.samples["target_cof"])

    @property
    def measured_cof(self) -> Array:
        """Friction felt, forces averaged over 10 ms; NaN where it is unknown."""
        lateral_n, normal_n = (
            moving_average(np.abs(self.samples[name]), AVERAGE_TICKS)
            for name in ("lateral_force_n", "normal_force_n")
        )
        known = np.isfinite(self.samples["measured_cof"])
        return np.where(known, lateral_n / np.where(known, normal_n, 1.0), np.nan)


@dataclass(frozen=True)
class Score:
    """How well one slide was rendered, and what else counts; see `haptic demo --json` for the
    names.

    While the force sensor is saturated friction is unknown, and is not judged.
    `output_on_without_contact_s`: with more than the lowest voltage that an output has while on.
    """

    fidelity: Fidelity
    contact_time_s: float
    max_voltage_v: float
    output_on_without_contact_s: float


def score(record: SlideRecord, perception: Perception | None = None) -> Score:
    samples = record.samples
    felt = fidelity_of_samples(
        samples, perception or load_perception(), record.reach_hz, record.noise_n
    )
    more = record.voltage_v > 1.01 * record.lowest_voltage_v
    return Score(
        fidelity=felt,
        contact_time_s=float(np.count_nonzero(samples["in_contact"]) * TICK_S),
        max_voltage_v=record.max_voltage_v,
        output_on_without_contact_s=float(np.count_nonzero(more & record.off_screen) * TICK_S),
    )
