"""Envelope: the amplitude within one tick, for a carrier whose amplitude an analog output can change fast.

A tick is too slow for texture: at 100 mm/s a ridge of 0.2 mm is 500 Hz. So the texture is asked along the way that the
finger makes until the next tick, the controller gives the voltage of each of these points, and between them the force,
which goes with the voltage squared, runs straight: the envelope is the square root of it.

Everything here is pure, as in `tick.py`; the render process calls `envelope` after `tick`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from haptic_driver.errors import BadInputError
from haptic_driver.render import safety, texture
from haptic_driver.render.tick import Tick, TickSettings, TickState
from haptic_driver.signals import EnvelopeBlock

Array = NDArray[np.float64]


@dataclass(frozen=True)
class EnvelopeSettings:
    """`tick_s` is cut into `points` at which texture and surface are asked, and played at `sample_rate_hz`.

    With 20 points per millisecond a texture of 800 Hz keeps 99.5 % of its amplitude (sinc^2 of straight lines).
    `rise_s`: how long the amplitude takes to come up after a touch.
    """

    tick_s: float = 1e-3
    sample_rate_hz: float = 50e3
    points: int = 20
    rise_s: float = 0.010

    def __post_init__(self) -> None:
        """Refuse what cannot be played."""
        finite = all(0.0 < x < inf for x in (self.tick_s, self.sample_rate_hz, self.rise_s))
        if not (finite and 1 <= self.points <= self.samples):
            raise BadInputError(
                "bad_envelope", f"envelope settings make no sense: {self}",
                "choose 1 point or more per tick, not more than samples",
            )  # fmt: skip

    @property
    def samples(self) -> int:
        """Samples per tick."""
        return round(self.tick_s * self.sample_rate_hz)


class EnvelopeState(NamedTuple):
    """Where the last block ended: voltage squared, and how far the touch has come up; refusals of the last gate."""

    power_v2: float = 0.0
    risen: float = 0.0
    safety: safety.SafetyState = safety.INITIAL


def envelope(
    settings: EnvelopeSettings, stages: TickSettings, state: EnvelopeState, after: TickState, done: Tick
) -> tuple[EnvelopeState, EnvelopeBlock]:
    """The block from this tick to the next; zero without contact, after a refusal, and where any sample is refused."""
    carrier_hz = done.wanted.frequency_hz
    if not done.finger.in_contact or done.safe.rejection is not None:
        return EnvelopeState(safety=state.safety), EnvelopeBlock(carrier_hz, np.zeros(settings.samples), False)
    cof = _along(stages.texture, done, settings)
    voltage_v, peak = stages.controller.along(after.controller, cof, done.finger, carrier_hz)
    powers_v2 = np.concatenate(((state.power_v2,), voltage_v * voltage_v))
    risen = min(state.risen + settings.tick_s / settings.rise_s, 1.0)
    samples_v = np.empty(settings.samples)
    synthesise(powers_v2, state.risen, risen, samples_v)
    bound = peak._replace(voltage_v=max(peak.voltage_v, state.power_v2**0.5))
    guard, refused = safety.gate_envelope(stages.limits, state.safety, bound, samples_v)
    if refused:
        return EnvelopeState(safety=guard), EnvelopeBlock(carrier_hz, np.zeros(settings.samples), False)
    return EnvelopeState(float(powers_v2[-1]), risen, guard), EnvelopeBlock(carrier_hz, samples_v, True)


def _along(target: texture.Target, done: Tick, settings: EnvelopeSettings) -> Array:
    """Friction wanted at each point of the way until the next tick, NaN for none; scripts hold over one tick."""
    finger = done.finger
    if not isinstance(target, texture.Texture):
        return np.full(settings.points, done.target.cof)
    ahead_s = settings.tick_s * np.arange(1, settings.points + 1) / settings.points
    return target.cof_at(
        finger.position_x_m + finger.velocity_x_m_s * ahead_s, finger.position_y_m + finger.velocity_y_m_s * ahead_s
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def synthesise(powers_v2: Array, risen_before: float, risen: float, out: Array) -> None:
    """Peak voltages `out` [m] between `powers_v2` [n + 1], the first of which was reached when the block before ended.

    Both are evenly spaced and end together. Straight lines in voltage squared, times the rise of the touch.
    """
    points = powers_v2.size - 1
    per_sample = points / out.size
    for m in range(out.size):
        place = (m + 1) * per_sample
        k = min(int(place), points - 1)
        power_v2 = powers_v2[k] + (place - k) * (powers_v2[k + 1] - powers_v2[k])
        share = risen_before + (risen - risen_before) * (m + 1) / out.size
        out[m] = share * np.sqrt(max(power_v2, 0.0))
