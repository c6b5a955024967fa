"""The whole touch: parameters -> stack -> pressure -> friction and current. No physics of its own."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from model import current, friction, pressure
from model.chain import prepare, touch_friction
from model.description import ModelDescription
from model.dielectrics import Array
from model.effects.base import SPEED_REFERENCE_M_S
from model.errors import ModelError, nearest
from model.gap_table import GapTable, gap_table
from model.roughness import SelfAffineShape
from model.touch import Drive

WAVEFORMS = ("sine", "square", "dc")
MEAN_SQUARE = {"sine": 0.5, "square": 1.0, "dc": 1.0}  # of a waveform of amplitude 1 V
UNDRIVEN_HZ = 250.0  # stands for the ignored frequency of rows without voltage
THEORY_PRESSURE_RATIO = 10.0  # the contact theory asks for pressures not too high: p_e up to this many times p0


@dataclass(frozen=True)
class Conditions:
    """Conditions of n touches, all arrays [n].

    `voltage_v` is the amplitude at the electrode; where it is 0 the frequency is ignored. `waveform` holds names of
    `WAVEFORMS`; a square wave is treated at its fundamental, with the mean square of the whole wave. `voltage_offset_v`
    is a steady bias added to it. `speed_m_s` and `time_s` matter to some effects only.
    """

    frequency_hz: Array
    voltage_v: Array
    normal_force_n: Array
    voltage_offset_v: Array | None = None
    waveform: NDArray[np.str_] | None = None
    speed_m_s: Array | None = None
    time_s: Array | None = None

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
        if self.speed_m_s is not None:
            _check(self.speed_m_s, 0.0, 10.0, "speed_m_s", "m/s")
        if self.time_s is not None:
            _check(self.time_s, -1e9, 1e9, "time_s", "s")

    def drive(self) -> Drive:
        """The same as the chain's first stage takes it."""
        voltage = np.asarray(self.voltage_v, dtype=np.float64)
        offset = np.zeros_like(voltage) if self.voltage_offset_v is None else np.asarray(self.voltage_offset_v)
        wave = np.full(voltage.shape, "sine") if self.waveform is None else np.asarray(self.waveform)
        steady = (wave == "dc").astype(np.float64)
        voltage = np.where(steady == 1.0, voltage + offset, voltage)  # two direct voltages are one
        frequency = np.where(voltage == 0.0, UNDRIVEN_HZ, np.where(wave == "dc", 0.0, self.frequency_hz))
        return Drive(
            frequency_hz=frequency,
            voltage_v=voltage,
            voltage_offset_v=np.where(steady == 1.0, 0.0, offset),
            mean_square_factor=np.array([MEAN_SQUARE[name] for name in wave]),
            normal_force_n=np.asarray(self.normal_force_n, dtype=np.float64),
            speed_m_s=SPEED_REFERENCE_M_S if self.speed_m_s is None else np.asarray(self.speed_m_s),
            time_s=0.0 if self.time_s is None else np.asarray(self.time_s),
            steady=steady,
        )


@dataclass(frozen=True)
class Prediction:
    """Answers for n conditions, all arrays [n]; NaN where the contact pulls in.

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
    """One finger on one screen, with chosen effects, ready to answer for any conditions."""

    description: ModelDescription

    @cached_property
    def table(self) -> GapTable:
        """The gap table of this finger's roughness shape (loaded or built at first use)."""
        p = self.description.values
        zeta1 = p.cut_off_wavenumber_per_m / p.roll_off_wavenumber_per_m
        return gap_table(SelfAffineShape(p.hurst_exponent, zeta1, p.contact_gamma))

    def predict(self, conditions: Conditions) -> Prediction:
        """Force, friction and current of arbitrary conditions."""
        p, effects = self.description.values, self.description.effects
        drive = conditions.drive()
        touch = prepare(p, self.description.dielectric, effects, drive)
        p_e = pressure.solve(self.table, touch.circuit)
        load_pa, load_n = touch.circuit.load_pa, np.asarray(drive.normal_force_n, dtype=np.float64)
        total_pa = load_pa + p_e + touch.circuit.added_pa
        sliding = current.sliding_current_per_v(self.table, touch.circuit, total_pa, touch.omega) * touch.rms_v
        stuck = current.stuck_current_per_v(touch.circuit.h_m, touch.omega) * touch.rms_v
        return Prediction(
            electrostatic_force_n=p_e * p.contact_area_m2,
            cof=touch_friction(self.description.friction_law, p, touch, p_e, load_n),
            current_rms_a=p.contact_area_m2 * np.sqrt(np.sum(sliding**2, axis=1)),
            stuck_current_rms_a=p.contact_area_m2 * np.sqrt(np.sum(stuck**2, axis=1)),
            within_theory=p_e <= THEORY_PRESSURE_RATIO * load_pa,
        )

    def surface(self, frequency_hz: Array, voltage_v: Array, normal_force_n: Array) -> SurfaceSolution:
        """Every combination of frequency [f], rising voltage amplitude [v] and rising normal force [n], for a sine."""
        if self.description.effects:
            return self._surface_point_by_point(frequency_hz, voltage_v, normal_force_n)
        p = self.description.values
        load_pa = normal_force_n / p.contact_area_m2
        at_one_volt = Conditions(frequency_hz, np.ones_like(frequency_hz), np.ones_like(frequency_hz))
        touch = prepare(p, self.description.dielectric, (), at_one_volt.drive())
        solution = pressure.solve_grid(self.table, touch.circuit, voltage_v, load_pa)
        p_e = solution.electrostatic_pressure_pa
        force = p_e * p.contact_area_m2
        rms_a = voltage_v * np.sqrt(0.5) * p.contact_area_m2
        shape = p_e.shape
        whole = touch.circuit.repeated(shape[1] * shape[2])
        omega = np.repeat(touch.omega, shape[1] * shape[2], axis=0)
        sliding = current.sliding_current_per_v(self.table, whole, (load_pa + p_e).ravel(), omega)
        stuck = current.stuck_current_per_v(touch.circuit.h_m, touch.omega)
        return SurfaceSolution(
            electrostatic_force_n=force,
            cof=friction.cof(self.description.friction_law, p.cof_off, force, normal_force_n),
            current_rms_a=sliding.reshape(shape) * rms_a[:, None],
            stuck_current_rms_a=stuck * rms_a,
            pulled_in=voltage_v[:, None] > solution.pull_in_voltage_v[:, None, :],
            within_theory=p_e <= THEORY_PRESSURE_RATIO * load_pa,
        )

    def _surface_point_by_point(self, frequency_hz: Array, voltage_v: Array, normal_force_n: Array) -> SurfaceSolution:
        """With effects, which may depend on voltage or load: each point by itself, at reference speed and time 0."""
        f, v, n = np.meshgrid(frequency_hz, voltage_v, normal_force_n, indexing="ij")
        shape = f.shape
        found = self.predict(Conditions(f.ravel(), v.ravel(), n.ravel()))
        cof = found.cof.reshape(shape)
        return SurfaceSolution(
            electrostatic_force_n=found.electrostatic_force_n.reshape(shape),
            cof=cof,
            current_rms_a=found.current_rms_a.reshape(shape),
            stuck_current_rms_a=found.stuck_current_rms_a.reshape(shape).max(axis=2),
            pulled_in=~np.isfinite(cof),
            within_theory=found.within_theory.reshape(shape),
        )


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
