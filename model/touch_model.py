"""The whole touch: parameters -> stack -> pressure -> friction and current. No physics of its own."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from model import current, friction, layers, pressure
from model.dielectrics import Array
from model.errors import ModelError, nearest
from model.gap_table import GapTable, gap_table
from model.parameters import ModelDescription
from model.roughness import SelfAffineShape

WAVEFORMS = ("sine", "square", "dc")
MEAN_SQUARE = {"sine": 0.5, "square": 1.0, "dc": 1.0}  # of a waveform of amplitude 1 V
THEORY_PRESSURE_RATIO = 10.0  # the contact theory asks for pressures not too high: p_e up to this many times p0


@dataclass(frozen=True)
class Conditions:
    """Conditions of n touches, all arrays [n].

    `voltage_v` is the amplitude at the electrode; where it is 0 the frequency is ignored. `waveform` holds names of
    `WAVEFORMS`; a square wave is treated at its fundamental, with the mean square of the whole wave. `voltage_offset_v`
    is a steady bias added to it.
    """

    frequency_hz: Array
    voltage_v: Array
    normal_force_n: Array
    voltage_offset_v: Array | None = None
    waveform: NDArray[np.str_] | None = None

    def __post_init__(self) -> None:
        """Refuse what has no physical meaning, naming the row."""
        driven = np.asarray(self.voltage_v) != 0.0
        wave = np.full(driven.shape, "sine") if self.waveform is None else np.asarray(self.waveform)
        for i, name in enumerate(wave):
            if name not in WAVEFORMS:
                raise ModelError(f"row {i + 1}: waveform '{name}' is unknown", nearest(str(name), list(WAVEFORMS)))
        _check(self.frequency_hz, 1e-3, 1e9, "frequency_hz", "Hz", driven & (wave != "dc"))
        _check(self.voltage_v, 0.0, 1e5, "voltage_v", "V")
        _check(self.normal_force_n, 1e-4, 1e3, "normal_force_n", "N")
        if self.voltage_offset_v is not None:
            _check(self.voltage_offset_v, -1e5, 1e5, "voltage_offset_v", "V")


@dataclass(frozen=True)
class Prediction:
    """Answers for n conditions, all arrays [n]; NaN where the contact pulls in or lies outside the tabulated pressures.

    `within_theory` is False where p_e exceeds 10 p0 or the tabulated pressures, and where there is no equilibrium.
    """

    electrostatic_force_n: Array
    cof: Array
    current_rms_a: Array
    stuck_current_rms_a: Array
    within_theory: NDArray[np.bool_]


@dataclass(frozen=True)
class SurfaceSolution:
    """Answers on a grid [frequency, voltage, normal force] for a sine; NaN where the contact pulls in.

    `stuck_current_rms_a` is [frequency, voltage]; `pulled_in` and `within_theory` are masks of the grid.
    """

    electrostatic_force_n: Array
    cof: Array
    current_rms_a: Array
    stuck_current_rms_a: Array
    pulled_in: NDArray[np.bool_]
    within_theory: NDArray[np.bool_]


@dataclass(frozen=True)
class TouchModel:
    """One finger on one screen, ready to answer for any conditions."""

    description: ModelDescription

    @cached_property
    def table(self) -> GapTable:
        """The gap table of this finger's roughness shape (loaded or built at first use)."""
        p = self.description.values
        zeta1 = p.cut_off_wavenumber_per_m / p.roll_off_wavenumber_per_m
        return gap_table(SelfAffineShape(p.hurst_exponent, zeta1, p.contact_gamma))

    @property
    def scales(self) -> pressure.ContactScales:
        """This finger's scales of pressure and gap."""
        p = self.description.values
        h_rms = p.roughness_rms_m
        return pressure.ContactScales(p.effective_modulus_pa * p.roll_off_wavenumber_per_m * h_rms, h_rms)

    def stack(self, frequency_hz: Array) -> layers.Stack:
        """The electrical stack at each frequency; 0 Hz means direct current."""
        return layers.stack(self.description.values, self.description.dielectric, frequency_hz)

    def predict(self, conditions: Conditions) -> Prediction:
        """Force, friction and current of arbitrary conditions."""
        p = self.description.values
        voltage, load_n = (np.asarray(v, dtype=np.float64) for v in (conditions.voltage_v, conditions.normal_force_n))
        wave = np.full(voltage.shape, "sine") if conditions.waveform is None else np.asarray(conditions.waveform)
        frequency = np.where(wave == "dc", 0.0, conditions.frequency_hz)
        offset = (
            np.zeros_like(voltage) if conditions.voltage_offset_v is None else np.asarray(conditions.voltage_offset_v)
        )
        voltage = np.where(wave == "dc", voltage + offset, voltage)  # two direct voltages are one
        offset = np.where(wave == "dc", 0.0, offset)
        driven = self.stack(np.where(voltage == 0.0, 1.0, frequency))
        mean_square = voltage**2 * np.array([MEAN_SQUARE[name] for name in wave])
        components = [(driven, mean_square)]
        if offset.any():
            components.append((self.stack(np.zeros_like(voltage)), offset**2))

        load_pa = load_n / p.contact_area_m2
        p_e = pressure.solve(self.table, self.scales, components, load_pa)
        force = p_e * p.contact_area_m2
        sliding, stuck = np.zeros_like(force), np.zeros_like(force)
        for stack, square in components:
            rms = np.sqrt(square)
            sliding += self._sliding(stack, rms, load_pa + p_e) ** 2
            stuck += current.stuck_current_rms_a(stack, rms, p.contact_area_m2) ** 2
        return Prediction(
            electrostatic_force_n=force,
            cof=friction.cof(self.description.friction_law, p.cof_off, force, load_n),
            current_rms_a=np.sqrt(sliding),
            stuck_current_rms_a=np.sqrt(stuck),
            within_theory=p_e <= THEORY_PRESSURE_RATIO * load_pa,
        )

    def surface(self, frequency_hz: Array, voltage_v: Array, normal_force_n: Array) -> SurfaceSolution:
        """Every combination of frequency [f], rising voltage amplitude [v] and rising normal force [n], for a sine."""
        p = self.description.values
        load_pa = normal_force_n / p.contact_area_m2
        sine = self.stack(frequency_hz)
        solution = pressure.solve_grid(self.table, self.scales, sine, voltage_v, load_pa)
        p_e = solution.electrostatic_pressure_pa
        force = p_e * p.contact_area_m2
        rms = voltage_v * current.RMS_OF_SINE
        return SurfaceSolution(
            electrostatic_force_n=force,
            cof=friction.cof(self.description.friction_law, p.cof_off, force, normal_force_n),
            current_rms_a=self._sliding(sine.reshaped((-1, 1, 1)), rms[:, None], load_pa + p_e),
            stuck_current_rms_a=current.stuck_current_rms_a(sine.reshaped((-1, 1)), rms, p.contact_area_m2),
            pulled_in=voltage_v[:, None] > solution.pull_in_voltage_v[:, None, :],
            within_theory=p_e <= THEORY_PRESSURE_RATIO * load_pa,
        )

    def _sliding(self, stack: layers.Stack, rms_v: Array, pressure_pa: Array) -> Array:
        area_m2 = self.description.values.contact_area_m2
        return current.sliding_current_rms_a(self.table, self.scales, stack, rms_v, pressure_pa, area_m2)


def _check(
    values: Array, low: float, high: float, name: str, unit: str, where: NDArray[np.bool_] | None = None
) -> None:
    v = np.asarray(values, dtype=np.float64)
    wrong = ~((v >= low) & (v <= high))
    if where is not None:
        wrong &= where
    if wrong.any():
        i = int(np.argmax(wrong))
        raise ModelError(f"row {i + 1}: {name} = {v[i]:g} is out of range", f"It must lie in {low:g}..{high:g} {unit}")
