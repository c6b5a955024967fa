"""Current through a finger at the highest voltage that a rig's file allows, carrier by carrier.

Computed with the model, never measured. The worst case is a finger without an air gap: stuck or
wet, under whatever load, at whatever time.
"""

from __future__ import annotations

from math import inf, log10, pi, sqrt
from typing import NamedTuple

import numpy as np

from haptic_driver.limits import OperatingLimits, WorstCase
from haptic_driver.lookup.build import CORRECTION_SPEEDS_M_S, SurfaceAxes, axes_within
from haptic_driver.lookup.worst_case import needs, worst_case
from haptic_driver.rig.config import RigConfig
from haptic_driver.signals import Array
from model.conditions import sines
from model.description import ModelDescription
from model.touch import SPEED_REFERENCE_M_S
from model.touch_model import TouchModel

CARRIERS = 61  # that a figure is drawn through
VOLTAGES = 32

# IEC 60990, network for perception and reaction, as public service manuals print it: a body of
# 1500 ohm beside 0.22 uF in series with 500 ohm, and beside the latter 10 kohm in series with
# 0.022 uF, over which U2 is read; the touch current is U2 / 500 ohm, from 15 Hz to 1 MHz.
BODY_OHM, FILTER_OHM, FILTER_F = 500.0, 10e3, 0.022e-6
NETWORK_HZ = 15.0, 1e6


class TouchCurrents(NamedTuple):
    """All [f]; currents in A rms, NaN where the model has no answer.

    `voltage_v` is the highest that the limits allow, peak, and `held_by` the limit that holds it.
    `fault_a` flows into a finger without a gap if the amplifier gives the most that it can.
    `weighted_a` is `stuck_a` as the network of IEC 60990 weighs it, NaN outside its range.
    """

    frequency_hz: Array
    voltage_v: Array
    held_by: list[str]
    sliding_a: Array
    stuck_a: Array
    limit_a: Array
    weighted_a: Array
    fault_a: Array

    @property
    def share(self) -> Array:
        """Of the limit, the larger of both fingers."""
        return np.fmax(self.sliding_a, self.stuck_a) / self.limit_a


def touch_currents(config: RigConfig, description: ModelDescription) -> TouchCurrents:
    """Over the rig's band: steps of 1, 2 and 5 per decade, its ends, and even steps between."""
    limits = config.operating_limits()
    axes = axes_within(
        description,
        SurfaceAxes(
            frequency_low_hz=limits.frequency_low_hz,
            frequency_high_hz=limits.frequency_high_hz,
            frequency_count=CARRIERS,
            voltage_high_v=limits.voltage_v,
            voltage_count=VOLTAGES,
        ),
    )
    low_hz, high_hz = axes.frequency_low_hz, axes.frequency_high_hz
    frequency_hz = np.union1d(axes.frequency_hz, listed_hz(low_hz, high_hz))
    of_one, per_m2, gain = worst_case(description, frequency_hz, axes.voltage_v)
    stuck = limits.stuck_current(of_one, per_m2)
    worst = WorstCase.of(frequency_hz, axes.voltage_v, stuck, gain)
    voltage_v = limits.highest_within_v(worst)
    stuck_a, electrode_v = (
        _highest(per_volt, worst.voltage_v, voltage_v)
        for per_volt in (worst.stuck_current_a_per_v, worst.electrode_gain)
    )
    stuck_a = np.minimum(stuck_a, _deliverable_a(limits, electrode_v))
    by_limit = limits.highest_within_by_limit_v(worst)
    names = list(by_limit)
    held_by = [names[i] for i in np.argmin(list(by_limit.values()), axis=0)]
    most_v = fault_voltage_v(config)
    fault_a = np.minimum(
        worst.stuck_current_a_per_v.max(axis=1) * most_v,
        _deliverable_a(limits, np.full(frequency_hz.shape, most_v)),
    )
    return TouchCurrents(
        frequency_hz,
        voltage_v,
        held_by,
        _sliding_a(description, frequency_hz, voltage_v, axes.normal_force_n),
        stuck_a,
        limits.contact_current_limit_a_rms(frequency_hz),
        stuck_a * network_weight(frequency_hz),
        fault_a,
    )


def listed_hz(low_hz: float, high_hz: float) -> Array:
    """The carriers of a table: 1, 2, 5 per decade from `low_hz` to `high_hz`, and both ends."""
    decades = range(int(log10(low_hz)) - 1, int(log10(high_hz)) + 1)
    steps = [m * 10.0**k for k in decades for m in (1, 2, 5)]
    return np.array([low_hz, *(f for f in steps if low_hz < f < high_hz), high_hz])


def network_weight(frequency_hz: Array) -> Array:
    """U2 / (500 ohm times the current into the network); NaN where the network is not meant."""
    s = 2j * pi * np.asarray(frequency_hz)
    branch_ohm = FILTER_OHM + 1.0 / (s * FILTER_F)
    body_ohm = BODY_OHM * branch_ohm / (BODY_OHM + branch_ohm)
    weight = np.abs(body_ohm / BODY_OHM / (1.0 + s * FILTER_OHM * FILTER_F))
    low_hz, high_hz = NETWORK_HZ
    return np.where((frequency_hz >= low_hz) & (frequency_hz <= high_hz), weight, np.nan)


def fault_voltage_v(config: RigConfig) -> float:
    """The peak that generator and amplifier could give together, whatever the driver limits."""
    reach_v = 0.5 * config.generator_kind().amplitude_high_vpp * config.amplifier.gain_v_per_v
    return min(reach_v, config.amplifier.voltage_limit_v)


def _deliverable_a(limits: OperatingLimits, electrode_v: Array) -> Array:
    """The most that amplifier and series resistor let through, A rms; the finger as a short."""
    ohm = limits.series_resistance_ohm
    by_resistor = np.full(electrode_v.shape, inf) if ohm == 0.0 else electrode_v / (sqrt(2.0) * ohm)
    return np.minimum(by_resistor, limits.amplifier_current_a / sqrt(2.0))


def _highest(per_volt: Array, nodes_v: Array, voltage_v: Array) -> Array:
    """The largest [f] that any voltage up to `voltage_v` [f] makes, of values [f, v - 1]."""
    up_to_v = np.minimum(nodes_v[1:], voltage_v[:, None])
    within = nodes_v[:-1] < voltage_v[:, None]
    return np.asarray(np.where(within, up_to_v * per_volt, 0.0).max(axis=1))


def _sliding_a(
    description: ModelDescription, frequency_hz: Array, voltage_v: Array, loads_n: Array
) -> Array:
    """The largest [f] over loads, and over speeds where the model knows of any."""
    usual = np.array([SPEED_REFERENCE_M_S])
    speeds = CORRECTION_SPEEDS_M_S[[0, -1]] if needs(description, "speed_m_s") else usual
    f, v = frequency_hz[:, None, None], voltage_v[:, None, None]
    drive = sines(f, v, loads_n, speeds[:, None], 0.0)
    current_a = TouchModel(description).answer(drive).current_rms_a
    return np.asarray(np.fmax.reduce(current_a, axis=(1, 2)))
