"""Parameters, effects and drive -> the circuit that the closed loop solves: puts stages in order, has no physics.

Parameters and effect values may be arrays that broadcast against the conditions, so that a fit runs many parameter sets
in one call.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from model import friction as friction_stage
from model.dielectrics import EPS0, Array, Dielectric
from model.effects.base import Effect
from model.layers import branch, leak_per_m_pa
from model.parameters import FrictionLaw, TouchParameters
from model.pressure import GapCircuit
from model.touch import Contact, Drive, Friction, Values


@dataclass(frozen=True)
class PreparedTouch:
    """A circuit with what the stages after it need: `omega` and driven `rms_v` of each branch [n, c], and the shape."""

    circuit: GapCircuit
    omega: Array
    rms_v: Array
    friction: Friction
    shape: tuple[int, ...]


def prepare(
    parameters: TouchParameters, dielectric: Dielectric, effects: Sequence[Effect], drive: Drive
) -> PreparedTouch:
    """Run the stages drive, stack, contact and friction, every effect in its place, and broadcast the result."""
    set_frequency_hz = drive.frequency_hz
    for effect in effects:
        drive = effect.drive(drive)
    driven = drive.mean_square_factor * drive.voltage_v**2
    crest = 1.0 / drive.mean_square_factor
    branches = [(branch(parameters, dielectric, set_frequency_hz), (drive.mean_square_v2, driven, crest))]
    if np.any(drive.voltage_offset_v != 0.0):
        steady = (drive.offset_mean_square_v2, drive.voltage_offset_v**2, 1.0)
        branches.append((branch(parameters, dielectric, np.zeros(1)), steady))
    contact, friction = Contact(gap_shift_m=parameters.gap_offset_m), Friction()
    for effect in effects:
        branches = [(effect.stack(b, parameters, drive), squares) for b, squares in branches]
        contact = effect.contact(contact, parameters, drive)
        friction = effect.friction(friction, drive)

    modulus_pa = parameters.effective_modulus_pa * contact.modulus_factor
    pressure_scale_pa = modulus_pa * parameters.roll_off_wavenumber_per_m * parameters.roughness_rms_m
    leak_factor = 1.0 / np.asarray(contact.modulus_factor)
    electrical = [
        (
            b.h_m(parameters), b.k_gap, b.gap_admittance_s_per_m2 / (1j * b.omega * EPS0),
            leak_per_m_pa(parameters, b) * leak_factor, square * np.abs(b.field_gain) ** 2, b.omega, driven, crest,
        )
        for b, (square, driven, crest) in branches
    ]  # fmt: skip
    load_pa = drive.normal_force_n / parameters.contact_area_m2
    mechanical = [
        pressure_scale_pa, parameters.roughness_rms_m, contact.gap_shift_m, load_pa, contact.added_pressure_pa,
        contact.field_limit_v_per_m, drive.voltage_v,
    ]  # fmt: skip
    shape = np.broadcast_shapes(*(np.shape(v) for v in [*mechanical, *(x for row in electrical for x in row)]))

    def flat(value: Values, dtype: type = float) -> Any:
        filled: Any = np.empty(shape, dtype=dtype)
        filled[...] = value
        return filled.ravel()

    def by_branch(position: int, dtype: type) -> Any:
        rows = [flat(row[position], dtype)[:, None] for row in electrical]
        return rows[0] if len(rows) == 1 else np.concatenate(rows, axis=1)  # fresh memory costs more than the numbers

    scale, length, shift, load, added, limit, _ = (flat(v) for v in mechanical)
    circuit = GapCircuit(
        pressure_scale_pa=scale,
        length_scale_m=length,
        h_m=by_branch(0, complex),
        k_gap=by_branch(1, complex),
        bypass_per_m=by_branch(2, complex),
        leak_per_m_pa=by_branch(3, complex),
        mean_square_v2=by_branch(4, float),
        crest_square=by_branch(7, float),
        gap_shift_m=shift,
        load_pa=load,
        added_pa=added,
        field_limit_v_per_m=limit,
    )
    return PreparedTouch(circuit, by_branch(5, float), np.sqrt(by_branch(6, float)), friction, shape)


def touch_friction(
    law: FrictionLaw,
    parameters: TouchParameters,
    touch: PreparedTouch,
    electrostatic_pressure_pa: Array,
    load_n: Values,
) -> Array:
    """Coefficient of friction of every condition, in the shape of the conditions."""
    attraction_n = (electrostatic_pressure_pa + touch.circuit.added_pa).reshape(
        touch.shape
    ) * parameters.contact_area_m2
    return friction_stage.cof(law, parameters.cof_off, attraction_n, np.asarray(load_n), touch.friction)
