"""The whole touch: parameters -> stack -> pressure -> friction and current. No physics of its own."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from model import current, friction, grid, pressure, published
from model.chain import PreparedTouch, prepare, touch_friction
from model.description import ModelDescription
from model.dielectrics import EPS0, Array
from model.effects.base import SPEED_REFERENCE_M_S
from model.errors import ModelError, nearest
from model.gap_table import GapTable, gap_table
from model.roughness import SelfAffineShape
from model.touch import Attraction, Drive, Friction, Values

WAVEFORMS = ("sine", "square", "dc")
MEAN_SQUARE = {"sine": 0.5, "square": 1.0, "dc": 1.0}  # of a waveform of amplitude 1 V
UNDRIVEN_HZ = 250.0  # stands for the ignored frequency of rows without voltage
SPEEDS_SMOOTH = 1e-2  # see `between`; between speeds of a correction, good to 1 % at best, this leaves 1e-3
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
    """Answers for n conditions, all arrays [n]; NaN where the contact pulls in or the published equations fail.

    `within_theory` is False where p_e exceeds 10 p0 or the tabulated pressures, and where there is no equilibrium.
    `notes` say in words what the equations of a published variant could not answer.
    """

    electrostatic_force_n: Array
    cof: Array
    current_rms_a: Array
    stuck_current_rms_a: Array
    within_theory: NDArray[np.bool_]
    notes: tuple[str, ...] = ()


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
        load_pa, load_n = touch.circuit.load_pa, np.asarray(drive.normal_force_n, dtype=np.float64)
        attraction = self._attraction(drive, touch)
        p_e = attraction.pressure_pa
        total_pa = load_pa + p_e + touch.circuit.added_pa
        sliding = current.sliding_current_per_v(self.table, touch.circuit, total_pa, touch.omega) * touch.rms_v
        stuck = current.stuck_current_per_v(touch.circuit.h_m, touch.omega) * touch.rms_v
        return Prediction(
            electrostatic_force_n=attraction.force_n,
            cof=touch_friction(self.description.friction_law, p, touch, attraction.force_n / p.contact_area_m2, load_n),
            current_rms_a=p.contact_area_m2 * np.sqrt(np.sum(sliding**2, axis=1)),
            stuck_current_rms_a=p.contact_area_m2 * np.sqrt(np.sum(stuck**2, axis=1)),
            within_theory=p_e <= THEORY_PRESSURE_RATIO * load_pa,
            notes=attraction.notes,
        )

    def _attraction(self, drive: Drive, touch: PreparedTouch) -> Attraction:
        """The one place where the variants part; the current, of which the paper prints nothing, is always ours."""
        if self.description.is_published:
            return published.solve(self.description, self.table, drive)
        p_e = pressure.solve(self.table, touch.circuit)
        return Attraction(p_e, p_e * self.description.values.contact_area_m2)

    def surface(
        self,
        frequency_hz: Array,
        voltage_v: Array,
        normal_force_n: Array,
        speed_m_s: float = SPEED_REFERENCE_M_S,
        time_s: float = 0.0,
    ) -> SurfaceSolution:
        """Every combination of frequency [f], rising voltage amplitude [v] and rising normal force [n], for a sine."""
        if self.description.is_published:
            return self._surface_point_by_point(frequency_hz, voltage_v, normal_force_n, speed_m_s, time_s)
        p = self.description.values
        drive, touch = self._grid(frequency_hz, voltage_v, normal_force_n, speed_m_s, time_s)
        load_pa = normal_force_n / p.contact_area_m2
        solution = grid.solve_grid(self.table, touch, load_pa)
        omega, rms_v = (x.reshape(touch.shape)[:, :, None] for x in (touch.omega, touch.rms_v))
        within_theory = solution.electrostatic_pressure_pa <= THEORY_PRESSURE_RATIO * load_pa
        force, amperes = solution.electrostatic_pressure_pa, solution.admittance_per_m
        force *= p.contact_area_m2  # in place: fresh memory for a whole surface costs as much as the arithmetic
        amperes *= EPS0 * p.contact_area_m2 * omega * rms_v
        stuck = current.stuck_current_per_v(touch.circuit.h_m, touch.omega).reshape(touch.shape)
        answer = SurfaceSolution(
            electrostatic_force_n=force,
            cof=self._grid_cof(touch, force, normal_force_n),
            current_rms_a=amperes,
            stuck_current_rms_a=p.contact_area_m2 * stuck * rms_v[:, :, 0],
            pulled_in=solution.pulled_in,
            within_theory=within_theory,
        )
        if _attracts_undriven(drive, touch):  # the frequency is ignored: one answer for all of them
            rest = self._undriven(normal_force_n, np.full(1, speed_m_s), time_s)
            answer.electrostatic_force_n[:, 0] = rest.electrostatic_force_n
            answer.cof[:, 0] = rest.cof
            answer.current_rms_a[:, 0] = answer.stuck_current_rms_a[:, :1] = 0.0
            answer.pulled_in[:, 0] = ~np.isfinite(rest.electrostatic_force_n)
            answer.within_theory[:, 0] = rest.within_theory
        return answer

    def cof_at_speeds(self, frequency_hz: Array, voltage_v: Array, normal_force_n: Array, speed_m_s: Array) -> Array:
        """Friction [f, s, v, n] of a `surface` at each speed [s] and time 0, solved at once."""
        axes = frequency_hz, voltage_v, normal_force_n
        if self.description.is_published:
            return np.stack([self.surface(*axes, s).cof for s in speed_m_s.tolist()], axis=1)
        p = self.description.values
        drive, touch = self._grid(frequency_hz[:, None], voltage_v, normal_force_n, speed_m_s[:, None], 0.0)
        load_pa = normal_force_n / p.contact_area_m2
        force = grid.solve_grid(self.table, touch, load_pa, SPEEDS_SMOOTH).electrostatic_pressure_pa
        force *= p.contact_area_m2
        shape = frequency_hz.size, speed_m_s.size, voltage_v.size, normal_force_n.size
        cof = np.array(np.broadcast_to(self._grid_cof(touch, force, normal_force_n), shape))
        if _attracts_undriven(drive, touch):
            cof[:, :, 0] = self._undriven(normal_force_n, speed_m_s, 0.0).cof.reshape(speed_m_s.size, -1)
        return cof

    def _grid(
        self, frequency_hz: Array, voltage_v: Array, normal_force_n: Array, speed_m_s: Values, time_s: float
    ) -> tuple[Drive, PreparedTouch]:
        """Every frequency and voltage by a sine, ready for `solve_grid`; speeds may be an axis between the two."""
        drive = Drive(
            frequency_hz=frequency_hz[..., None],
            voltage_v=voltage_v,
            voltage_offset_v=0.0,
            mean_square_factor=MEAN_SQUARE["sine"],
            normal_force_n=normal_force_n[0],
            speed_m_s=speed_m_s,
            time_s=time_s,
        )
        return drive, prepare(self.description.values, self.description.dielectric, self.description.effects, drive)

    def _grid_cof(self, touch: PreparedTouch, force_n: Array, normal_force_n: Array) -> Array:
        """Friction [..., n] from force, with the attraction that is not electrostatic."""
        p, added_pa = self.description.values, touch.circuit.added_pa
        if added_pa.any():
            force_n = force_n + added_pa.reshape(touch.shape)[..., None] * p.contact_area_m2
        laws = Friction(*(np.asarray(value)[..., None] for value in vars(touch.friction).values()))
        return friction.cof(self.description.friction_law, p.cof_off, force_n, normal_force_n, laws)

    def _undriven(self, normal_force_n: Array, speed_m_s: Array, time_s: float) -> Prediction:
        """Without voltage, for every speed and load."""
        speed, load = (x.ravel() for x in np.meshgrid(speed_m_s, normal_force_n, indexing="ij"))
        zero = np.zeros_like(load)
        return self.predict(Conditions(zero, zero, load, speed_m_s=speed, time_s=zero + time_s))

    def _surface_point_by_point(
        self, frequency_hz: Array, voltage_v: Array, normal_force_n: Array, speed_m_s: float, time_s: float
    ) -> SurfaceSolution:
        """Each point by itself, as published."""
        f, v, n = np.meshgrid(frequency_hz, voltage_v, normal_force_n, indexing="ij")
        shape = f.shape
        speed, time = np.full(f.size, speed_m_s), np.full(f.size, time_s)
        found = self.predict(Conditions(f.ravel(), v.ravel(), n.ravel(), speed_m_s=speed, time_s=time))
        cof = found.cof.reshape(shape)
        return SurfaceSolution(
            electrostatic_force_n=found.electrostatic_force_n.reshape(shape),
            cof=cof,
            current_rms_a=found.current_rms_a.reshape(shape),
            stuck_current_rms_a=found.stuck_current_rms_a.reshape(shape).max(axis=2),
            pulled_in=~np.isfinite(cof),
            within_theory=found.within_theory.reshape(shape),
        )


def _attracts_undriven(drive: Drive, touch: PreparedTouch) -> bool:
    """Whether something attracts where no voltage is applied."""
    square = touch.circuit.mean_square_v2.reshape(touch.shape)
    return bool(np.any((drive.voltage_v == 0.0) & (square != 0.0)))


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
