"""One touch on its way through the chain: what the stages hand to one another, and what effects may
change.

All fields are floats or arrays that broadcast against the conditions, so that many conditions and
many parameter sets run at once. A drive has one branch per frequency in it: its alternating part
and, where there is a bias, direct current.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.parameters import TouchParameters
from model.support.arrays import Array, Values

# of the paper's experiment; there effects of speed leave the base model as it is
SPEED_REFERENCE_M_S = 0.02
LOAD_REFERENCE_N = 0.5  # of the paper's experiment; there effects of load do
SINE_MEAN_SQUARE = 0.5  # of amplitude 1 V; square waves and direct voltages have 1


@dataclass(frozen=True)
class Drive:
    """What the experimenter sets: amplitude and bias at the amplifier's output, load, speed and
    time.

    `mean_square_factor` is 1/2 for a sine, 1 for a square wave or direct current. `steady` is 1
    where `voltage_v` itself is direct. `voltage_phase_rad` is that of the electrode's voltage
    against the set one. `surface_voltage_v` stands on the insulator whatever is driven.
    `kept_square` of the mean square, and `kept_offset_square` of the bias's, is not screened and
    attracts. `touching` is 0 where there is no finger, `resting` 1 where it does not slide.
    `seen_area_m2` is the touch's apparent area where it was seen, 0 where not. `other_touches` have
    so many times its area, and their current flows too.
    """

    frequency_hz: Values
    voltage_v: Values
    voltage_offset_v: Values
    mean_square_factor: Values
    normal_force_n: Values
    speed_m_s: Values
    time_s: Values
    steady: Values = 0.0
    voltage_phase_rad: Values = 0.0
    surface_voltage_v: Values = 0.0
    kept_square: Values = 1.0
    kept_offset_square: Values = 1.0
    touching: Values = 1.0
    resting: Values = 0.0
    seen_area_m2: Values = 0.0
    other_touches: Values = 0.0

    @property
    def fundamental_v(self) -> Values:
        """Complex peak phasor of the voltage's fundamental, 4/pi times a square wave's
        amplitude.
        """
        is_square = (self.mean_square_factor > SINE_MEAN_SQUARE) & (self.steady == 0.0)
        return (
            np.where(is_square, 4.0 / np.pi, 1.0)
            * self.voltage_v
            * np.exp(1j * self.voltage_phase_rad)
        )

    @property
    def mean_square_v2(self) -> Values:
        """Mean square voltage of the main branch; the surface's own acts here unless there is a
        bias to meet it.
        """
        voltage_v = np.sqrt(self.kept_square) * self.voltage_v
        against = 2.0 * self.steady * voltage_v * self.surface_voltage_v
        surface = np.where(self.voltage_offset_v == 0.0, self.surface_voltage_v**2, 0.0)
        return self.mean_square_factor * voltage_v**2 - against + surface

    @property
    def offset_mean_square_v2(self) -> Values:
        """Mean square voltage of the bias, less the surface's."""
        offset_v = np.sqrt(self.kept_offset_square) * self.voltage_offset_v
        against = (offset_v - self.surface_voltage_v) ** 2
        return np.where(self.voltage_offset_v == 0.0, 0.0, against)


@dataclass(frozen=True)
class Branch:
    """The electrical stack at one frequency of the drive: permittivities, and what stands behind
    and beside the gap.

    `omega` is in rad/s. `mean_square_v2` attracts; `driven_square_v2` of it is the amplifier's,
    with `crest_square` as peak over mean square. `series_length_m` adds to h.
    `gap_admittance_s_per_m2` lies in parallel with the air gap, beside the contact leak.
    `field_gain` is the field in the gap's air over the mean field of the gap.
    """

    omega: Values
    k_insulator: Values
    k_skin: Values
    k_gap: Values
    mean_square_v2: Values = 0.0
    driven_square_v2: Values = 0.0
    crest_square: Values = 1.0
    series_length_m: Values = 0.0
    gap_admittance_s_per_m2: Values = 0.0
    field_gain: Values = 1.0

    def skin_length_m(self, p: TouchParameters) -> Values:
        """Complex length of the skin, d2/k2."""
        return p.skin_thickness_m / self.k_skin

    def h_m(self, p: TouchParameters) -> Values:
        """Complex length of everything but the gap."""
        return (
            p.insulator_thickness_m / self.k_insulator
            + self.skin_length_m(p)
            + self.series_length_m
        )


@dataclass(frozen=True)
class Contact:
    """How the rough skin lies on the screen.

    `modulus_factor` scales Y*; `gap_shift_m` lifts every gap; `added_pressure_pa` pulls beside the
    electric field; `field_limit_v_per_m` caps the amplitude of the local field; `area_factor`
    scales A_0.
    """

    modulus_factor: Values = 1.0
    gap_shift_m: Values = 0.0
    added_pressure_pa: Values = 0.0
    field_limit_v_per_m: Values = float("inf")
    area_factor: Values = 1.0


@dataclass(frozen=True)
class Friction:
    """How friction follows from load: cof_off cof_off_factor load^load_exponent / applied load.

    Both loads are in units of `LOAD_REFERENCE_N`.
    """

    cof_off_factor: Values = 1.0
    load_exponent: Values = 1.0


@dataclass(frozen=True)
class Attraction:
    """What electricity does to n touches [n]: mean pressure in Pa and force in N, NaN where there
    is no answer.

    `pulled_in` where that is because V(p_e) has turned back; `notes` say in words why, where the
    equations are to blame and not the contact.
    """

    pressure_pa: Array
    force_n: Array
    pulled_in: NDArray[np.bool_]
    notes: tuple[str, ...] = ()
