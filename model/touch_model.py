"""The whole touch, in the order of the paper: drive, layers, contact, closed loop; force, friction,
current.

No physics of its own: it puts the stages in order, and every effect in its place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from model import friction, solver
from model.conditions import Conditions, sines
from model.contact.gap_table import GapTable, gap_table
from model.description import ModelDescription
from model.effects.base import Effect
from model.electric import current
from model.electric.circuit import GapCircuit
from model.electric.dielectrics import EPS0, Dielectric
from model.electric.layers import branch, leak_per_m_pa
from model.parameters import FrictionLaw, TouchParameters
from model.support.arrays import Array, ComplexArray, Mask, Values
from model.touch import SPEED_REFERENCE_M_S, Attraction, Branch, Contact, Drive, Friction

# the contact theory asks for pressures not too high: p_e up to this many times p0
THEORY_PRESSURE_RATIO = 10.0


@dataclass(frozen=True)
class Prediction:
    """Answers for touches of any shape; NaN where there is no equilibrium.

    This is where the contact pulls in, where a pressure leaves the table, or where the published
    equations fail. `stuck_current_rms_a` and `electrode_voltage_v` need no equilibrium.
    `pulled_in` marks what lies past the fold of V(p_e). `within_theory` is False where p_e exceeds
    10 p0 or the tabulated pressures, and where there is no equilibrium. `electrode_current_a` and
    `electrode_voltage_v` are complex peak phasors of the fundamental, stray current included. Their
    phase is against the set voltage. The two rms currents are the touch's alone, which safety
    limits are about. `cof` is NaN where no finger slides. `notes` say in words what the equations
    of a published variant could not answer.
    """

    electrostatic_force_n: Array
    cof: Array
    current_rms_a: Array
    stuck_current_rms_a: Array
    electrode_current_a: ComplexArray
    electrode_voltage_v: ComplexArray
    pulled_in: Mask
    within_theory: Mask
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class PreparedTouch:
    """Touches [n] ready for the closed loop, and what the stages after it need.

    Each branch [n, c] has `omega` and the amplifier's `rms_v`. All others are [n]: `electrode_v` is
    the phasor of the voltage's fundamental, `area_m2` the apparent area of the contact. Current
    flows through `touch_area_m2`, 0 without a finger, and `stray_f` lies beside it. `shape` is that
    of the conditions.
    """

    circuit: GapCircuit
    omega: Array
    rms_v: Array
    electrode_v: ComplexArray
    area_m2: Array
    touch_area_m2: Array
    stray_f: Array
    friction: Friction
    shape: tuple[int, ...]


def prepare(
    parameters: TouchParameters, dielectric: Dielectric, effects: Sequence[Effect], drive: Drive
) -> PreparedTouch:
    """The stages before the closed loop: drive, layers and contact, every effect in its place.

    Parameters and effect values may be arrays that broadcast against the conditions, so that a fit
    runs many parameter sets in one call.
    """
    set_frequency_hz = drive.frequency_hz
    for effect in effects:
        drive = effect.drive(drive)
    softening = 1.0 + drive.resting * (parameters.rest_softening - 1.0)
    contact, laws = (
        Contact(gap_shift_m=parameters.gap_offset_m, modulus_factor=softening),
        Friction(),
    )
    for effect in effects:
        contact = effect.contact(contact, parameters, drive)
        laws = effect.friction(laws, drive)
    parameters = replace(parameters, contact_area_m2=_area_m2(parameters, contact, drive))
    branches = _branches(parameters, dielectric, set_frequency_hz, drive)
    for effect in effects:
        branches = [effect.stack(b, parameters, drive) for b in branches]
    return _broadcast(parameters, branches, contact, laws, drive)


def _area_m2(parameters: TouchParameters, contact: Contact, drive: Drive) -> Values:
    """Apparent area of each contact: as seen, or else as the model has it."""
    area_m2 = parameters.contact_area_m2 * contact.area_factor
    seen_m2 = drive.seen_area_m2
    return np.where(seen_m2 > 0.0, seen_m2, area_m2) if np.any(seen_m2) else area_m2


def _branches(
    parameters: TouchParameters, dielectric: Dielectric, frequency_hz: Array, drive: Drive
) -> list[Branch]:
    """The alternating part of the drive and, where there is any, its bias."""
    alternating = replace(
        branch(parameters, dielectric, frequency_hz),
        mean_square_v2=drive.mean_square_v2,
        driven_square_v2=drive.mean_square_factor * drive.voltage_v**2,
        crest_square=1.0 / drive.mean_square_factor,
    )
    if not np.any(drive.voltage_offset_v != 0.0):
        return [alternating]
    bias = replace(
        branch(parameters, dielectric, np.zeros(1)),
        mean_square_v2=drive.offset_mean_square_v2,
        driven_square_v2=drive.voltage_offset_v**2,
    )
    return [alternating, bias]


def _broadcast(
    parameters: TouchParameters,
    branches: Sequence[Branch],
    contact: Contact,
    laws: Friction,
    drive: Drive,
) -> PreparedTouch:
    """Everything that the closed loop and the current need, one row per touch."""
    by_branch = [
        {
            "h_m": b.h_m(parameters),
            "k_gap": b.k_gap,
            "bypass_per_m": b.gap_admittance_s_per_m2 / (1j * b.omega * EPS0),
            "leak_per_m_pa": leak_per_m_pa(parameters, b) / contact.modulus_factor,
            "mean_square_v2": b.mean_square_v2 * np.abs(b.field_gain) ** 2,
            "crest_square": b.crest_square,
            "omega": b.omega,
            "rms_v": np.sqrt(b.driven_square_v2),
        }
        for b in branches
    ]
    shared = {
        "pressure_scale_pa": parameters.pressure_scale_pa * contact.modulus_factor,
        "length_scale_m": parameters.roughness_rms_m,
        "gap_shift_m": contact.gap_shift_m,
        "load_pa": drive.normal_force_n / parameters.contact_area_m2,
        "added_pa": contact.added_pressure_pa,
        "field_limit_v_per_m": contact.field_limit_v_per_m,
    }
    electrode = {
        "electrode_v": drive.fundamental_v,
        "area_m2": parameters.contact_area_m2,
        "touch_area_m2": drive.touching * (1.0 + drive.other_touches) * parameters.contact_area_m2,
        "stray_f": (
            parameters.stray_capacitance_f
            * (parameters.open_circuit + drive.touching * (1.0 - parameters.open_circuit))
        ),
    }
    every = [
        value
        for fields in (vars(drive), shared, electrode, *by_branch)
        for value in fields.values()
    ]
    shape = np.broadcast_shapes(*{np.shape(value) for value in every})

    def rows(*values: Values) -> Any:
        table = np.empty((*shape, len(values)), np.result_type(np.float64, *values))
        for c, value in enumerate(values):
            table[..., c] = value
        return table.reshape(-1, len(values))

    columns = {name: rows(*(b[name] for b in by_branch)) for name in by_branch[0]}
    omega, rms_v = columns.pop("omega"), columns.pop("rms_v")
    circuit = GapCircuit(**{name: rows(value).ravel() for name, value in shared.items()}, **columns)
    return PreparedTouch(
        circuit,
        omega,
        rms_v,
        **{name: rows(value).ravel() for name, value in electrode.items()},
        friction=laws,
        shape=shape,
    )


def cof(
    law: FrictionLaw,
    parameters: TouchParameters,
    touch: PreparedTouch,
    p_e_pa: Array,
    load_n: Values,
) -> Array:
    """Friction under the electrostatic pressure [n] and what else attracts, in the shape of the
    conditions.
    """
    attraction_n = (touch.area_m2 * (p_e_pa + touch.circuit.added_pa)).reshape(touch.shape)
    return friction.cof(law, parameters.cof_off, attraction_n, load_n, touch.friction)


def electrode_current_a(
    table: GapTable, touch: PreparedTouch, gaps_per_m: ComplexArray, total_pa: Array
) -> ComplexArray:
    """Peak phasor in A in the shape of the conditions, of the gaps' admittance [n, c] under the
    pressure [n] in all.
    """
    admittance = gaps_per_m[:, 0] + current.contact_admittance_per_m(table, touch.circuit, total_pa)
    admittance = np.where(touch.touch_area_m2 > 0.0, admittance, 0.0)  # NaN of a touch that is none
    electrode = touch.omega[:, 0], touch.electrode_v, touch.touch_area_m2, touch.stray_f
    return current.electrode_current_a(admittance, *electrode).reshape(touch.shape)


@dataclass(frozen=True)
class TouchModel:
    """One finger on one screen, with chosen effects, ready to answer for any conditions."""

    description: ModelDescription

    @cached_property
    def table(self) -> GapTable:
        """The gap table of this finger's roughness shape (loaded or built at first use)."""
        return gap_table(self.description.values.roughness_shape)

    def predict(self, conditions: Conditions) -> Prediction:
        """Force, friction and current of arbitrary conditions [n]."""
        return self.answer(conditions.drive())

    def cof(self, conditions: Conditions) -> Array:
        """Friction alone of arbitrary conditions [n], as `predict` has it, in less time."""
        drive = conditions.drive()
        touch = self._prepare(drive)
        return self._cof(drive, touch, self._attraction(drive, touch))

    def surface(
        self,
        frequency_hz: Array,
        voltage_v: Array,
        normal_force_n: Array,
        speed_m_s: float = SPEED_REFERENCE_M_S,
        time_s: float = 0.0,
    ) -> Prediction:
        """Every combination of frequency [f], voltage amplitude [v] and normal force [n] for a
        sine, [f, v, n].
        """
        f, v = frequency_hz[:, None, None], voltage_v[:, None]
        return self.answer(sines(f, v, normal_force_n, speed_m_s, time_s))

    def cof_at_speeds(
        self, frequency_hz: Array, voltage_v: Array, normal_force_n: Array, speed_m_s: Array
    ) -> Array:
        """Friction [f, s, v, n] of a `surface` at each speed [s] and time 0."""
        f, v, speed = (
            frequency_hz[:, None, None, None],
            voltage_v[:, None],
            speed_m_s[:, None, None],
        )
        drive = sines(f, v, normal_force_n, speed, 0.0)
        touch = self._prepare(drive)
        return self._cof(drive, touch, self._attraction(drive, touch))

    def pulled_in_at(
        self, frequency_hz: Array, voltage_v: Array, normal_force_n: Array, speed_m_s: float
    ) -> Mask:
        """Whether the contact pulls in, at each point of a `surface` of this speed [f, v, n]."""
        drive = sines(
            frequency_hz[:, None, None], voltage_v[:, None], normal_force_n, speed_m_s, 0.0
        )
        touch = self._prepare(drive)
        return self._attraction(drive, touch).pulled_in.reshape(touch.shape)

    def answer(self, drive: Drive) -> Prediction:
        """Force, friction and current, in the shape to which the drive and the effects
        broadcast.
        """
        touch = self._prepare(drive)
        circuit = touch.circuit
        attraction = self._attraction(drive, touch)
        total_pa = circuit.load_pa + attraction.pressure_pa + circuit.added_pa

        def amperes(admittance_per_m: ComplexArray) -> Array:
            return current.current_rms_a(admittance_per_m, touch.omega, touch.rms_v, touch.area_m2)

        gaps_per_m = current.sliding_admittance_per_m(self.table, circuit, total_pa)
        within_theory = attraction.pressure_pa <= THEORY_PRESSURE_RATIO * circuit.load_pa
        return Prediction(
            electrostatic_force_n=drive.touching * attraction.force_n.reshape(touch.shape),
            cof=self._cof(drive, touch, attraction),
            current_rms_a=drive.touching * amperes(gaps_per_m).reshape(touch.shape),
            stuck_current_rms_a=amperes(current.stuck_admittance_per_m(circuit)).reshape(
                touch.shape
            ),
            electrode_current_a=electrode_current_a(self.table, touch, gaps_per_m, total_pa),
            electrode_voltage_v=touch.electrode_v.reshape(touch.shape),
            pulled_in=attraction.pulled_in.reshape(touch.shape),
            within_theory=within_theory.reshape(touch.shape),
            notes=attraction.notes,
        )

    def worst_case(self, drive: Drive) -> tuple[Array, Array, Array]:
        """Stuck current of one touch in A rms, that in A/m2, and the electrode's peak voltage, as
        `answer` has them; without any contact theory.
        """
        touch = self._prepare(drive)
        admittance = current.stuck_admittance_per_m(touch.circuit)
        density = current.current_rms_a(admittance, touch.omega, touch.rms_v, 1.0)
        answers = touch.area_m2 * density, density, np.abs(touch.electrode_v)
        stuck_a, per_m2, electrode_v = (values.reshape(touch.shape) for values in answers)
        return stuck_a, per_m2, electrode_v

    def contact_area_m2(self, normal_force_n: float) -> float:
        """Apparent area of the touch under a load, by the model."""
        load_n = np.array([normal_force_n])
        touch = self._prepare(sines(np.array([250.0]), np.zeros(1), load_n, 0.0, 0.0))
        return float(touch.area_m2[0])

    def _prepare(self, drive: Drive) -> PreparedTouch:
        described = self.description
        return prepare(described.values, described.dielectric, described.effects, drive)

    def _cof(self, drive: Drive, touch: PreparedTouch, attraction: Attraction) -> Array:
        p, law = self.description.values, self.description.friction_law
        friction = cof(law, p, touch, attraction.force_n / touch.area_m2, drive.normal_force_n)
        return np.where((drive.touching == 1.0) & (drive.resting == 0.0), friction, np.nan)

    def _attraction(self, drive: Drive, touch: PreparedTouch) -> Attraction:
        """The one place where the variants part; the current, of which the paper prints nothing, is
        always ours.
        """
        if self.description.is_published:
            # scipy is slow to import, and the rest does without
            from model import published  # noqa: PLC0415

            return published.solve(self.description, self.table, drive)
        p_e, pulled_in = solver.solve(self.table, touch.circuit)
        return Attraction(p_e, p_e * touch.area_m2, pulled_in)
