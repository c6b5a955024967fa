"""Drives beyond the sine: the spectrum of the force, impedance and current of the touch, where the
force turns steep.

A drive is a sum of tones, direct voltage among them. Each tone k has its own field in every gap u,
E_k(u) = V_k/(a_k u + b_k). The pressure eps0/2 <E^2>_u has lines at the sums and differences of the
tones. The contact is assumed to rest under the time mean of the pressure, as in the closed loop of
`pressure`. It does not follow the force's own pulsation, which is a judgement and not a
measurement.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from model import solver
from model.contact.gap_integrals import stencil
from model.contact.gap_table import gap_nodes
from model.contact.resolution import LOG_P_AXIS
from model.electric.circuit import GapCircuit
from model.electric.current import sliding_admittance_per_m, stuck_admittance_per_m
from model.electric.dielectrics import EPS0
from model.support.arrays import Array, ComplexArray
from model.support.errors import ModelError
from model.touch import SINE_MEAN_SQUARE, SPEED_REFERENCE_M_S, Drive
from model.touch_model import PreparedTouch, TouchModel, prepare

SQUARE_HARMONICS = 25  # odd ones; what is left out carries 0.8 % of the mean square
SAME_LINE_HZ = 1e-6


@dataclass(frozen=True)
class Tones:
    """A drive as the real part of sum V_k exp(j 2 pi f_k t); `amplitude_v` complex [k], at 0 Hz the
    real mean.
    """

    frequency_hz: Array
    amplitude_v: ComplexArray

    def __post_init__(self) -> None:
        """Refuse two tones of one frequency: they are one."""
        if (
            np.unique(self.frequency_hz).size != np.size(self.frequency_hz)
            or np.min(self.frequency_hz) < 0.0
        ):
            raise ModelError(
                "the tones of a drive need frequencies of their own, none negative",
                "Add them up first",
            )

    @property
    def mean_square_v2(self) -> Array:
        """Mean square of each tone [k]."""
        square = np.abs(self.amplitude_v) ** 2
        return np.where(self.frequency_hz == 0.0, square, 0.5 * square)

    def at(self, time_s: Array) -> Array:
        """The voltage at each time [t]."""
        phase = np.exp(2j * pi * self.frequency_hz[:, None] * time_s)
        return np.asarray((self.amplitude_v @ phase).real)


def sine(frequency_hz: float, voltage_v: float, offset_v: float = 0.0) -> Tones:
    """A cosine of amplitude `voltage_v`, on a steady bias."""
    return _tones({0.0: offset_v, frequency_hz: voltage_v})


def square(frequency_hz: float, voltage_v: float, harmonics: int = SQUARE_HARMONICS) -> Tones:
    """A square wave between +- `voltage_v`, by its first odd harmonics."""
    order = 2.0 * np.arange(harmonics) + 1.0
    sign = np.where(order % 4.0 == 1.0, 1.0, -1.0)
    amplitude_v = np.asarray(4.0 * voltage_v / (pi * order) * sign, dtype=np.complex128)
    return Tones(np.asarray(order * frequency_hz), amplitude_v)


def amplitude_modulated(
    carrier_hz: float, voltage_v: float, modulation_hz: float, depth: float
) -> Tones:
    """`voltage_v` (1 + depth cos(2 pi f_m t)) on a carrier: the carrier and its two sidebands."""
    if not 0.0 < modulation_hz < carrier_hz:
        raise ModelError(
            f"modulation at {modulation_hz:g} Hz is not below the carrier's {carrier_hz:g} Hz",
            "Lower it",
        )
    side = 0.5 * depth * voltage_v
    return _tones(
        {carrier_hz - modulation_hz: side, carrier_hz: voltage_v, carrier_hz + modulation_hz: side}
    )


def _tones(amplitude_v: dict[float, float]) -> Tones:
    present = {f: v for f, v in amplitude_v.items() if v != 0.0} or {0.0: 0.0}
    return Tones(np.array(list(present)), np.array(list(present.values()), dtype=complex))


@dataclass(frozen=True)
class ForceSpectrum:
    """Lines [m] of the electrostatic force: the real part of sum F_m exp(j 2 pi f_m t), F_m
    `force_n`; 0 Hz first.
    """

    frequency_hz: Array
    force_n: ComplexArray

    def line(self, frequency_hz: float) -> complex:
        """The line at a frequency; 0 where there is none."""
        at = np.abs(self.frequency_hz - frequency_hz) <= SAME_LINE_HZ + 1e-9 * frequency_hz
        return complex(self.force_n[at].sum())


def force_spectrum(model: TouchModel, tones: Tones, normal_force_n: float) -> ForceSpectrum:
    """Every line of the force that `tones` exert under a load; ModelError where the contact pulls
    in.

    Effects that know a drive only by one mean square are refused (`knows_one_tone_only`).
    """
    touch, circuit = _one_touch(model, tones, normal_force_n)
    field, mass = _field_per_v(model, circuit, _total_pressure_pa(model, circuit))
    left = np.sqrt(
        circuit.mean_square_v2[0] / np.where(tones.mean_square_v2 > 0.0, tones.mean_square_v2, 1.0)
    )
    # `left`: of each amplitude, by effects on the drive
    field = field * (tones.amplitude_v * left)[:, None]
    f = tones.frequency_hz
    # cos^2 has mean 1/2; a steady field squared has no other line
    both = np.where(f == 0.0, 1.0, 0.5)
    half = 0.5 * EPS0 * float(touch.area_m2[0])
    lines = [(0.0, complex(half * np.sum(both * (np.abs(field) ** 2 @ mass))))]
    for i in range(f.size):
        if f[i] > 0.0:
            lines.append((2.0 * f[i], half * 0.5 * complex(field[i] ** 2 @ mass)))
        for j in range(i):
            steady = 2.0 if min(f[i], f[j]) == 0.0 else 1.0
            high, low = (i, j) if f[i] > f[j] else (j, i)
            lines.append(
                (
                    f[high] - f[low],
                    half * steady * complex((field[high] * field[low].conj()) @ mass),
                )
            )
            if steady == 1.0:
                lines.append((f[high] + f[low], half * complex((field[high] * field[low]) @ mass)))
    return _summed(lines)


def _summed(lines: list[tuple[float, complex]]) -> ForceSpectrum:
    """Lines of equal frequency added up, in order of frequency."""
    lines = sorted(lines, key=lambda line: line[0])
    frequencies: list[float] = []
    forces: list[complex] = []
    for frequency, force in lines:
        if frequencies and frequency - frequencies[-1] <= SAME_LINE_HZ + 1e-9 * frequency:
            forces[-1] += force
        else:
            frequencies.append(frequency)
            forces.append(force)
    return ForceSpectrum(np.array(frequencies), np.array(forces))


def impedance(
    model: TouchModel, frequency_hz: Array, normal_force_n: float, stuck: bool = False
) -> ComplexArray:
    """Impedance [f] in ohm of a sliding finger at small voltage, or with no gap anywhere
    (`stuck`).
    """
    tones = Tones(
        np.asarray(frequency_hz, dtype=float), np.zeros(np.size(frequency_hz), dtype=complex)
    )
    touch, circuit = _one_touch(model, tones, normal_force_n)
    jw_eps0 = 1j * touch.omega[:, 0] * EPS0
    area = float(touch.area_m2[0])
    unattracted_pa = circuit.load_pa + circuit.added_pa
    per_m = (
        stuck_admittance_per_m(circuit)
        if stuck
        else sliding_admittance_per_m(model.table, circuit, unattracted_pa)
    )
    return np.asarray(1.0 / (area * jw_eps0 * per_m[0]))


def _total_pressure_pa(model: TouchModel, circuit: GapCircuit) -> Array:
    """Pressure [1] at the equilibrium under all tones; ModelError where the contact pulls in."""
    p_e, _ = solver.solve(model.table, circuit)
    if not np.isfinite(p_e).all():
        raise ModelError("the contact pulls in under this drive", "Give a lower voltage")
    return np.asarray(p_e + circuit.load_pa + circuit.added_pa)


@dataclass(frozen=True)
class Steepness:
    """`exponent` [f, v, n]: d ln(force)/d ln(voltage), 2 where the gaps do not give way, NaN at 0 V
    and past pull-in.

    `pull_in_v` [f, n]: lowest voltage of the axis at which the contact has pulled in, NaN where it
    never does.
    """

    frequency_hz: Array
    voltage_v: Array
    normal_force_n: Array
    exponent: Array
    pull_in_v: Array


def steepness(
    model: TouchModel, frequency_hz: Array, voltage_v: Array, normal_force_n: Array
) -> Steepness:
    """Where the force turns steep, for a sine; `voltage_v` evenly spaced from 0."""
    solved = model.surface(frequency_hz, voltage_v, normal_force_n)
    with np.errstate(divide="ignore", invalid="ignore"):
        per_square = np.log(solved.electrostatic_force_n[:, 1:] / voltage_v[1:, None] ** 2)
        # of what is left when the square is taken out
        slope = np.gradient(per_square, np.log(voltage_v[1:]), axis=1)
    exponent = np.full(solved.cof.shape, np.nan)
    exponent[:, 1:] = 2.0 + slope
    pulled_in = solved.pulled_in
    pull_in_v = np.where(pulled_in.any(axis=1), voltage_v[np.argmax(pulled_in, axis=1)], np.nan)
    return Steepness(frequency_hz, voltage_v, normal_force_n, exponent, pull_in_v)


def _one_touch(
    model: TouchModel, tones: Tones, normal_force_n: float
) -> tuple[PreparedTouch, GapCircuit]:
    """The tones as touches of their own [k], and as the branches [1, k] of the one touch they make
    together.
    """
    if model.description.is_published:
        raise ModelError(
            "the equations as printed know no drive but the sine",
            "Use a model of variant 'corrected'",
        )
    for effect in model.description.effects:
        if effect.knows_one_tone_only:
            raise ModelError(
                f"effect '{effect.name}' is not formulated for several tones",
                "Leave it out of the model",
            )
    steady = tones.frequency_hz == 0.0
    drive = Drive(
        frequency_hz=tones.frequency_hz,
        voltage_v=np.abs(tones.amplitude_v),
        voltage_offset_v=0.0,
        mean_square_factor=np.where(steady, 1.0, SINE_MEAN_SQUARE),
        normal_force_n=normal_force_n,
        speed_m_s=SPEED_REFERENCE_M_S,
        time_s=0.0,
        steady=steady.astype(float),
    )
    p = model.description.values
    touch = prepare(p, model.description.dielectric, model.description.effects, drive)
    together = GapCircuit(*(x.T if x.ndim == 2 else x[:1] for x in touch.circuit))  # type: ignore[arg-type]
    return touch, together


def _field_per_v(
    model: TouchModel, circuit: GapCircuit, pressure_pa: Array
) -> tuple[ComplexArray, Array]:
    """E/V [k, u] of each tone in each gap, 1/m, and P(u) du [u] by the gap table's own
    distributions.
    """
    a = 1.0 + (circuit.bypass_per_m[0] + circuit.leak_per_m_pa[0] * pressure_pa) * circuit.h_m[0]
    gap_m = gap_nodes() * circuit.length_scale_m[0] + circuit.gap_shift_m[0]
    field = 1.0 / (a[:, None] * gap_m + (circuit.k_gap[0] * circuit.h_m[0])[:, None])
    row, weights = stencil(float(np.log(pressure_pa / circuit.pressure_scale_pa)[0]), LOG_P_AXIS)
    return field, np.asarray(np.array(weights) @ model.table.mass[row : row + 4])
