"""What is asked of the model: conditions of many touches, checked, and the drive that they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.support.arrays import Array, Values
from model.support.errors import RowError, nearest
from model.touch import SINE_MEAN_SQUARE, SPEED_REFERENCE_M_S, Drive

WAVEFORMS = ("sine", "square", "dc")
FINGERS = ("sliding", "resting", "none")
RANGES = {
    "frequency_hz": (1e-3, 1e9, "Hz"),
    "voltage_v": (0.0, 1e5, "V"),
    "normal_force_n": (1e-4, 1e3, "N"),
    "voltage_offset_v": (-1e5, 1e5, "V"),
    "speed_m_s": (0.0, 10.0, "m/s"),
    "time_s": (-1e9, 1e9, "s"),
    "contact_area_m2": (1e-7, 1e-2, "m^2"),
}
UNDRIVEN_HZ = 250.0  # stands for the ignored frequency of rows without voltage


@dataclass(frozen=True)
class Conditions:
    """Conditions of n touches, all arrays [n].

    `voltage_v` is the amplitude at the electrode; where it is 0 or direct the frequency is ignored.
    `waveform` holds names of `WAVEFORMS`; a square wave is treated at its fundamental, with the
    mean square of the whole wave. `voltage_offset_v` is a steady bias added to it. `speed_m_s` and
    `time_s` matter to some effects only. `finger` holds names of `FINGERS`: a resting one has no
    speed, and softer skin (`TouchParameters.rest_softening`); without a finger nothing is left but
    the stray capacitance. Only sliding fingers have kinetic friction. `contact_area_m2` is the
    apparent area where it was seen, NaN where not: there it is the model's.
    """

    frequency_hz: Array
    voltage_v: Array
    normal_force_n: Array
    voltage_offset_v: Array | None = None
    waveform: NDArray[np.str_] | None = None
    speed_m_s: Array | None = None
    time_s: Array | None = None
    finger: NDArray[np.str_] | None = None
    contact_area_m2: Array | None = None

    def __post_init__(self) -> None:
        """Refuse what has no physical meaning, naming the row."""
        wave = self._wave()
        for name, words, known in (
            ("waveform", wave, WAVEFORMS),
            ("finger", self._finger(), FINGERS),
        ):
            unknown = ~np.any([words == one for one in known], axis=0)  # faster than np.isin
            if unknown.any():
                i = int(np.argmax(unknown))
                raise RowError(
                    i, f"{name} '{words[i]}' is unknown", nearest(str(words[i]), list(known))
                )
        driven = np.asarray(self.voltage_v) != 0.0
        for name, (low, high, unit) in RANGES.items():
            if (given := getattr(self, name)) is not None:
                values = np.asarray(given, dtype=np.float64)
                wrong = ~((values >= low) & (values <= high))
                if name == "frequency_hz":
                    wrong &= driven & (wave != "dc")
                if name == "contact_area_m2":
                    wrong &= ~np.isnan(values)
                if wrong.any():
                    i = int(np.argmax(wrong))
                    said = f"{name} = {values[i]:g} is out of range"
                    raise RowError(i, said, f"It must lie in {low:g}..{high:g} {unit}")

    def drive(self) -> Drive:
        """The same as the model's first stage takes it."""
        wave, voltage = self._wave(), np.asarray(self.voltage_v, dtype=np.float64)
        finger = self._finger()
        speed = SPEED_REFERENCE_M_S if self.speed_m_s is None else np.asarray(self.speed_m_s)
        direct = wave == "dc"
        offset = (
            np.zeros_like(voltage)
            if self.voltage_offset_v is None
            else np.asarray(self.voltage_offset_v)
        )
        voltage = np.where(direct, voltage + offset, voltage)  # two direct voltages are one
        return Drive(
            frequency_hz=np.where(
                voltage == 0.0, UNDRIVEN_HZ, np.where(direct, 0.0, self.frequency_hz)
            ),
            voltage_v=voltage,
            voltage_offset_v=np.where(direct, 0.0, offset),
            mean_square_factor=np.where(wave == "sine", SINE_MEAN_SQUARE, 1.0),
            normal_force_n=np.asarray(self.normal_force_n, dtype=np.float64),
            speed_m_s=np.where(finger == "resting", 0.0, speed),
            time_s=0.0 if self.time_s is None else np.asarray(self.time_s),
            steady=direct.astype(np.float64),
            touching=(finger != "none").astype(np.float64),
            resting=(finger == "resting").astype(np.float64),
            seen_area_m2=0.0
            if self.contact_area_m2 is None
            else np.nan_to_num(self.contact_area_m2),
        )

    def _finger(self) -> NDArray[np.str_]:
        return (
            np.full(np.shape(self.voltage_v), "sliding")
            if self.finger is None
            else np.asarray(self.finger)
        )

    def _wave(self) -> NDArray[np.str_]:
        return (
            np.full(np.shape(self.voltage_v), "sine")
            if self.waveform is None
            else np.asarray(self.waveform)
        )


def sines(
    frequency_hz: Array, voltage_v: Array, normal_force_n: Array, speed_m_s: Values, time_s: float
) -> Drive:
    """The drive of every combination; everything broadcasts."""
    return Drive(
        frequency_hz=np.where(voltage_v == 0.0, UNDRIVEN_HZ, frequency_hz),
        voltage_v=voltage_v,
        voltage_offset_v=0.0,
        mean_square_factor=SINE_MEAN_SQUARE,
        normal_force_n=normal_force_n,
        speed_m_s=speed_m_s,
        time_s=time_s,
    )
