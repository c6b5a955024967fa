"""What a rig allows at the electrode, over arrays: what surfaces are marked with and controllers
keep inside.

The last gate (`render/safety.py`) judges every single point again, by code of its own. The touch
current is the primary quantity. A point must stay under the limit curve both for the sliding finger
and for the worst case (stuck or wet). A series resistance or the amplifier's own current limit may
bound the latter. Limits of voltage hold for what is set and for what the model says that the
electrode gets.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from math import inf, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from haptic_driver.signals import Array

# ICNIRP 2010, Health Phys. 99:818, contact current, general public: 0.5 mA to 2.5 kHz, 0.2 mA per
# kHz to 100 kHz.
ICNIRP_PUBLIC_A_RMS = ((1.0, 0.5e-3), (2.5e3, 0.5e-3), (100e3, 20e-3), (10e6, 20e-3))

# 0.50 % of the body's surface (Agarwal and Sahu 2010, Indian J. Plast. Surg. 43:49, 300 adults), of
# which 1.8 m2 are usual.
PALM_M2 = 9e-3

ON_NODE = 1e-9  # of a cell: so near to a node is the node
ROUNDING = 1e-9
TINY = 1e-300  # stands for 0 in logarithms


@dataclass(frozen=True)
class OperatingLimits:
    """Limits of one rig, at the electrode.

    `contact_current_a_rms`: (frequency_hz, current) points, straight between them on logarithmic
    axes and held at the ends. `slew_v_per_s` and `amplifier_current_a` (peak) are the amplifier's;
    the latter charges `panel_capacitance_f`. `series_resistance_ohm` and `amplifier_current_a`
    bound the worst-case finger current; leave them at 0 and inf where they have not been measured.
    Current is limited through `touching_area_m2` of contact in all, or one touch where that is
    more.
    """

    voltage_v: float
    frequency_low_hz: float
    frequency_high_hz: float
    slew_v_per_s: float = inf
    contact_current_a_rms: tuple[tuple[float, float], ...] = ICNIRP_PUBLIC_A_RMS
    series_resistance_ohm: float = 0.0
    amplifier_current_a: float = inf
    panel_capacitance_f: float = 0.0
    touching_area_m2: float = 0.0

    def stuck_current(self, of_one: Array | float, per_m2: Array | float) -> Array:
        """That of all contact which a limit has to hold for, from that of one touch and of a square
        metre.
        """
        return np.maximum(of_one, self.touching_area_m2 * np.asarray(per_m2))

    def touches(self, one_touch_m2: float) -> int:
        """How many touches of this area it holds for, one at least."""
        return max(int(self.touching_area_m2 / one_touch_m2 * (1.0 + ROUNDING)), 1)

    def holds_for(self, one_touch_m2: float) -> str:
        """For how much contact, in words; `one_touch_m2` is that of the model's finger."""
        if self.touching_area_m2 <= one_touch_m2:
            return f"one touch of {1e6 * one_touch_m2:.3g} mm² alone"
        return f"{1e6 * self.touching_area_m2:.3g} mm² of contact in all"

    def contact_current_limit_a_rms(self, frequency_hz: Array | float) -> Array:
        """The limit curve at each frequency."""
        f, i = np.log(np.array(self.contact_current_a_rms)).T
        return np.asarray(np.exp(np.interp(np.log(frequency_hz), f, i)))

    def highest_voltages_v(
        self,
        frequency_hz: Array | float,
        stuck_current_a_per_v: Array | float,
        electrode_gain: Array | float = 1.0,
    ) -> dict[str, Array]:
        """Largest voltage to set at each frequency, by each limit; infinite where it has none.

        Per volt that is set the finger gets `stuck_current_a_per_v` (A rms) at worst, and the
        electrode `electrode_gain`. The worst case counts only as far as the hardware can deliver
        it.
        """
        f, gain = np.asarray(frequency_hz, dtype=np.float64), np.maximum(electrode_gain, 1.0)
        limit = self.contact_current_limit_a_rms(f)
        by_hardware = np.where(
            self.amplifier_current_a <= sqrt(2.0) * limit,
            inf,
            sqrt(2.0) * limit * self.series_resistance_ohm / gain,
        )
        with np.errstate(divide="ignore"):
            return {
                "voltage": np.full(f.shape, self.voltage_v) / gain,
                "slew rate": np.divide(self.slew_v_per_s, 2.0 * pi * f) / gain,
                "amplifier current": (
                    np.divide(self.amplifier_current_a, 2.0 * pi * f * self.panel_capacitance_f)
                    / gain
                ),
                "worst-case current": np.maximum(
                    np.divide(limit, stuck_current_a_per_v), by_hardware
                ),
            }

    def highest_voltage_v(
        self,
        frequency_hz: Array | float,
        stuck_current_a_per_v: Array | float,
        electrode_gain: Array | float = 1.0,
    ) -> Array:
        """The smallest of `highest_voltages_v` at each frequency; 0 outside the band."""
        f = np.asarray(frequency_hz, dtype=np.float64)
        in_band = (f >= self.frequency_low_hz) & (f <= self.frequency_high_hz)
        by_limit = self.highest_voltages_v(f, stuck_current_a_per_v, electrode_gain)
        return np.where(in_band, reduce(np.minimum, by_limit.values()), 0.0)

    def highest_within_v(self, worst: WorstCase) -> Array:
        """Largest voltage [f] up to which every one is allowed, within the worst case's range."""
        by_limit = self.highest_within_by_limit_v(worst).values()
        f = worst.frequency_hz
        in_band = (f >= self.frequency_low_hz) & (f <= self.frequency_high_hz)
        allowed_v = np.minimum(reduce(np.minimum, by_limit), worst.voltage_v[-1])
        # what nobody knows is not allowed
        return np.where(in_band & np.isfinite(allowed_v), allowed_v, 0.0)

    def highest_within_by_limit_v(self, worst: WorstCase) -> dict[str, Array]:
        """Largest voltage [f] up to which each limit allows every one; infinite where it has
        none.
        """
        rows = worst.frequency_hz[:, None], worst.stuck_current_a_per_v, worst.electrode_gain
        by_limit = self.highest_voltages_v(*rows)
        return {
            name: _first_forbidden(allowed_v, worst.voltage_v)
            for name, allowed_v in by_limit.items()
        }

    def permits(
        self,
        frequency_hz: Array | float,
        voltage_v: Array | float,
        current_rms_a: Array | float,
        stuck_current_rms_a: Array | float,
        electrode_voltage_v: Array | float = 0.0,
    ) -> NDArray[np.bool_]:
        """Whether points are inside every limit; arrays broadcast. NaN anywhere is outside."""
        f, v = np.asarray(frequency_hz, dtype=np.float64), np.asarray(voltage_v, dtype=np.float64)
        per_volt, gain = _per_volt(stuck_current_rms_a, v), _per_volt(electrode_voltage_v, v)
        in_band = (f >= self.frequency_low_hz) & (f <= self.frequency_high_hz)
        proportional = in_band & (v >= 0.0) & (v <= self.highest_voltage_v(f, per_volt, gain))
        return np.asarray(proportional & (current_rms_a <= self.contact_current_limit_a_rms(f)))


@dataclass(frozen=True)
class WorstCase:
    """What finger and electrode get at most of each volt that is set, whatever the load and the
    time.

    Nodes `frequency_hz` [f] and `voltage_v` [v], the first of which is 0. `stuck_current_a_per_v`
    (A rms) and `electrode_gain` [f, v - 1] hold between a voltage and the next: the larger of both
    ends.
    """

    frequency_hz: Array
    voltage_v: Array
    stuck_current_a_per_v: Array
    electrode_gain: Array

    @classmethod
    def of(
        cls,
        frequency_hz: Array,
        voltage_v: Array,
        stuck_current_a_per_v: Array,
        electrode_gain: Array,
    ) -> WorstCase:
        """That of values [f, v] at the nodes."""
        ends = stuck_current_a_per_v, electrode_gain
        return cls(frequency_hz, voltage_v, *(np.maximum(x[:, :-1], x[:, 1:]) for x in ends))

    def at(self, frequency_hz: float) -> WorstCase:
        """At one frequency of its range, [1, v - 1].

        Between two nodes values go straight on logarithmic axes, plus a margin as large as their
        bend there. A kink or a hump between the nodes lies below.
        """
        nodes = np.log(self.frequency_hz)
        cells = nodes.size - 1
        place = float(
            np.clip((np.log(frequency_hz) - nodes[0]) / (nodes[-1] - nodes[0]) * cells, 0.0, cells)
        )
        rows = [
            _between(values, place) for values in (self.stuck_current_a_per_v, self.electrode_gain)
        ]
        return WorstCase(np.array([frequency_hz]), self.voltage_v, *rows)


def _first_forbidden(allowed_v: Array, voltage_v: Array) -> Array:
    """The voltage [f] up to which all is allowed; each cell of voltage by itself allows `allowed_v`
    [f, v - 1].
    """
    below_v, above_v = voltage_v[:-1], voltage_v[1:]
    is_whole = np.broadcast_to(allowed_v, (allowed_v.shape[0], above_v.size)) >= above_v
    last = np.where(is_whole.all(axis=1), above_v.size - 1, np.argmin(is_whole, axis=1))
    ends_v = np.where(is_whole, allowed_v, np.maximum(allowed_v, below_v))
    return np.asarray(ends_v[np.arange(last.size), last])


def _per_volt(values: Array | float, voltage_v: Array) -> Array:
    """Values over the voltage that is set; 0 without any."""
    shape = np.broadcast(values, voltage_v).shape
    return np.divide(values, voltage_v, out=np.zeros(shape), where=voltage_v > 0.0)


def _between(values: Array, place: float) -> Array:
    """Rows of values [f, k] at a place among evenly spaced nodes, [1, k]; see `WorstCase.at`."""
    nearest = round(place)
    if abs(place - nearest) < ON_NODE:
        return np.asarray(values[nearest][None, :])
    i = int(place)
    logs = np.log(np.maximum(values[max(i - 1, 0) : i + 3], TINY))
    bends = np.maximum(-np.diff(logs, 2, axis=0), 0.0)
    k = min(i, 1)
    straight = logs[k] + (place - i) * (logs[k + 1] - logs[k])
    return np.asarray(np.exp(straight + 0.25 * bends.sum(axis=0)))[None, :]
