"""What a rig allows at the electrode, over arrays: what surfaces are marked with and controllers keep inside.

The last gate (`render/safety.py`) judges every single point again, by code of its own. The touch current is the
primary quantity: a point must stay under the limit curve both for the sliding finger and for the worst case (stuck or
wet), which a series resistance or the amplifier's own current limit may bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from math import inf, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from haptic_driver.signals import Array

# ICNIRP 2010, Health Phys. 99:818, contact current, general public: 0.5 mA to 2.5 kHz, 0.2 mA per kHz to 100 kHz.
ICNIRP_PUBLIC_A_RMS = ((1.0, 0.5e-3), (2.5e3, 0.5e-3), (100e3, 20e-3), (10e6, 20e-3))


@dataclass(frozen=True)
class OperatingLimits:
    """Limits of one rig, at the electrode.

    `contact_current_a_rms`: (frequency_hz, current) points, straight between them on logarithmic axes and held at the
    ends. `slew_v_per_s` and `amplifier_current_a` (peak) are the amplifier's; the latter charges `panel_capacitance_f`.
    `series_resistance_ohm` and `amplifier_current_a` bound the worst-case finger current; leave them at 0 and inf where
    they have not been measured.
    """

    voltage_v: float
    frequency_low_hz: float
    frequency_high_hz: float
    slew_v_per_s: float = inf
    contact_current_a_rms: tuple[tuple[float, float], ...] = ICNIRP_PUBLIC_A_RMS
    series_resistance_ohm: float = 0.0
    amplifier_current_a: float = inf
    panel_capacitance_f: float = 0.0

    def contact_current_limit_a_rms(self, frequency_hz: Array | float) -> Array:
        """The limit curve at each frequency."""
        f, i = np.log(np.array(self.contact_current_a_rms)).T
        return np.asarray(np.exp(np.interp(np.log(frequency_hz), f, i)))

    def highest_voltages_v(self, frequency_hz: Array | float, stuck_current_a_per_v: Array | float) -> dict[str, Array]:
        """Largest voltage at each frequency, by each limit that is proportional to voltage; infinite where it has none.

        `stuck_current_a_per_v`: worst-case finger current, A rms per volt of amplitude. The worst case counts only as
        far as the hardware can deliver it.
        """
        f = np.asarray(frequency_hz, dtype=np.float64)
        limit = self.contact_current_limit_a_rms(f)
        by_hardware = np.where(
            self.amplifier_current_a <= sqrt(2.0) * limit, inf, sqrt(2.0) * limit * self.series_resistance_ohm
        )
        with np.errstate(divide="ignore"):
            return {
                "voltage": np.full(f.shape, self.voltage_v),
                "slew rate": np.divide(self.slew_v_per_s, 2.0 * pi * f),
                "amplifier current": np.divide(self.amplifier_current_a, 2.0 * pi * f * self.panel_capacitance_f),
                "worst-case current": np.maximum(np.divide(limit, stuck_current_a_per_v), by_hardware),
            }

    def highest_voltage_v(self, frequency_hz: Array | float, stuck_current_a_per_v: Array | float) -> Array:
        """The smallest of `highest_voltages_v` at each frequency; 0 outside the band."""
        f = np.asarray(frequency_hz, dtype=np.float64)
        in_band = (f >= self.frequency_low_hz) & (f <= self.frequency_high_hz)
        lowest = reduce(np.minimum, self.highest_voltages_v(f, stuck_current_a_per_v).values())
        return np.where(in_band, lowest, 0.0)

    def permits(
        self,
        frequency_hz: Array | float,
        voltage_v: Array | float,
        current_rms_a: Array | float,
        stuck_current_rms_a: Array | float,
    ) -> NDArray[np.bool_]:
        """Whether points are inside every limit; arrays broadcast. NaN anywhere is outside."""
        f, v = np.asarray(frequency_hz, dtype=np.float64), np.asarray(voltage_v, dtype=np.float64)
        per_volt = np.divide(
            stuck_current_rms_a, v, out=np.zeros(np.broadcast(stuck_current_rms_a, v).shape), where=v > 0
        )
        in_band = (f >= self.frequency_low_hz) & (f <= self.frequency_high_hz)
        proportional = in_band & (v >= 0.0) & (v <= self.highest_voltage_v(f, per_volt))
        return np.asarray(proportional & (current_rms_a <= self.contact_current_limit_a_rms(f)))
