"""Electrostatic pressure and the closed loop that it forms with the contact: the one solver.

p_e = (eps0/2) sum over drive branches of <V^2> K(p, z)/|a|^2, with p = p0 + p_e + p_added. Pressure
closes the gaps, which raises the pressure. `equilibrium` finds the lowest pressure at which one
touch rests.
"""

from __future__ import annotations

import math

import numpy as np

from model.contact.gap_integrals import TableArrays, k_hat, kept_share
from model.contact.gap_table import GapTable
from model.contact.resolution import LOG_P_AXIS
from model.electric.circuit import GapCircuit, divider, squared
from model.electric.dielectrics import EPS0
from model.support.arrays import Array, Mask
from model.support.compiled import in_slices, kernel

TOLERANCE = 1e-10  # of the total pressure
# of the attraction: what such a step of the secant method leaves is of the order of 1e-10
CLOSE = 1e-6
# Of the pressure per step, less than from row to row of the table: a turn that lies within one is
# below 1e-3 of V^2.
MOST_GROWTH = 1.15
# A step much longer than what attraction exceeds the pressure by may pass a shallow turn of V(p_e);
# none is shorter than this share of the pressure, or a turn would never be passed.
STEEPEST, FINEST = 20.0, 1e-5
# pass the whole table; about five are taken
MOST_STEPS = round((LOG_P_AXIS[1] - LOG_P_AXIS[0]) / FINEST)
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
SUMMIT_STEPS = 30  # leave 1e-7 of the pressure, where the summit is flat to 1e-13


def solve(table: GapTable, circuit: GapCircuit) -> tuple[Array, Mask]:
    """Electrostatic pressure in Pa of each touch [n], and where the contact has pulled in.

    The pressure is NaN there, and where an equilibrium would lie outside the pressures of the
    table.
    """
    pressure, pulled_in = (
        np.empty_like(circuit.load_pa),
        np.empty(circuit.load_pa.shape, dtype=np.bool_),
    )

    def work(which: slice) -> None:
        _solve(table.arrays, circuit.rows(which), pressure[which], pulled_in[which])

    in_slices(work, pressure.size)
    return pressure, pulled_in


def solve_near(table: GapTable, circuit: GapCircuit, near_pa: Array) -> Array:
    """The same pressure of touches that hardly differ from ones with the pressures `near_pa` [n]:
    a third of the work.
    """
    pressure = np.empty_like(circuit.load_pa)

    def work(which: slice) -> None:
        _solve_near(table.arrays, circuit.rows(which), near_pa[which], pressure[which])

    in_slices(work, pressure.size)
    return pressure


@kernel
def _solve(table: TableArrays, circuit: GapCircuit, pressure: Array, pulled_in: Mask) -> None:
    for i in range(pressure.size):
        pressure[i], pulled_in[i] = equilibrium(table, circuit, i)


@kernel
def _solve_near(table: TableArrays, circuit: GapCircuit, near_pa: Array, pressure: Array) -> None:
    for i in range(pressure.size):
        pressure[i] = _close_by(table, circuit, i, near_pa[i])
        if not math.isfinite(pressure[i]):
            pressure[i] = equilibrium(table, circuit, i)[0]


@kernel
def _close_by(table: TableArrays, circuit: GapCircuit, i: int, near_pa: float) -> float:
    """The electrostatic pressure two secants from `near_pa`, NaN where these do not come close."""
    base = circuit.load_pa[i] + circuit.added_pa[i]
    p_max = circuit.pressure_scale_pa[i] * math.exp(LOG_P_AXIS[1])
    last = base + near_pa
    attracted = attraction(table, circuit, i, last)
    before = base + attracted - last
    if abs(before) <= TOLERANCE * last:
        return attracted
    p = last + before
    for _ in range(2):
        if not base < p < p_max:
            return math.nan
        attracted = attraction(table, circuit, i, p)
        excess = base + attracted - p
        step = excess * (p - last) / (before - excess)
        if before * (p - last) <= excess * (p - last):  # attraction outgrows the pressure
            return math.nan
        if abs(step) <= CLOSE * attracted:
            return float(attracted - excess + step)
        before, last, p = excess, p, p + step
    return math.nan


@kernel
def equilibrium(table: TableArrays, circuit: GapCircuit, i: int) -> tuple[float, bool]:
    """The electrostatic pressure of touch `i`, NaN without one, and whether the contact has pulled
    in.

    The pressure p needs the share (p - base)/attraction of the drive, and rests where that is 1.
    The share rises from 0 at the unattracted contact, less and less, so that the secant method
    comes up to the lowest equilibrium from below. Where it turns back before it has reached 1 the
    contact pulls in: that is the fold of V(p_e).
    """
    base, scale = circuit.load_pa[i] + circuit.added_pa[i], circuit.pressure_scale_pa[i]
    p_min, p_max = scale * math.exp(LOG_P_AXIS[0]), scale * math.exp(LOG_P_AXIS[1])
    attracted = attraction(table, circuit, i, base)
    if not (p_min <= base <= p_max and math.isfinite(attracted)):
        return math.nan, False
    before, last, last_share = base, base, 0.0
    p = base + attracted  # such a step never passes the lowest equilibrium
    for _ in range(MOST_STEPS):
        if last == p_max:
            break  # not within the table
        p = min(p, MOST_GROWTH * last, p_max)
        attracted = attraction(table, circuit, i, p)
        excess = base + attracted - p
        if abs(excess) <= TOLERANCE * p:
            return attracted, False
        share = (p - base) / attracted
        step = (1.0 - share) * (p - last) / (share - last_share)
        if abs(step) <= CLOSE * attracted:
            return attracted - excess + step, False
        if share <= last_share:
            p = _summit(table, circuit, i, before, p)
            share = share_of_drive(table, circuit, i, p)
            if share < 1.0:
                return math.nan, True
        if share >= 1.0:
            return _between(table, circuit, i, before, p), False
        step = min(step, max(STEEPEST * excess, FINEST * p))
        before, last, last_share, p = last, p, share, p + step
    return math.nan, False


@kernel
def share_of_drive(table: TableArrays, circuit: GapCircuit, i: int, p: float) -> float:
    """What share of its mean square voltages holds touch `i` at the total pressure `p`."""
    return float((p - circuit.load_pa[i] - circuit.added_pa[i]) / attraction(table, circuit, i, p))


@kernel
def _between(table: TableArrays, circuit: GapCircuit, i: int, low: float, high: float) -> float:
    """The electrostatic pressure between a total pressure that attraction exceeds and one that it
    does not.

    By the Illinois method: secants, with the excess of an end that stays halved.
    """
    base, kept = circuit.load_pa[i] + circuit.added_pa[i], 0
    excess_low = base + attraction(table, circuit, i, low) - low
    excess_high = base + attraction(table, circuit, i, high) - high
    for _ in range(MOST_STEPS):
        p = (low * excess_high - high * excess_low) / (excess_high - excess_low)
        attracted = attraction(table, circuit, i, p)
        excess = base + attracted - p
        if abs(excess) <= TOLERANCE * p:
            break
        if excess > 0.0:
            low, excess_low = p, excess
            excess_high *= 0.5 if kept == 1 else 1.0
            kept = 1
        else:
            high, excess_high = p, excess
            excess_low *= 0.5 if kept == -1 else 1.0
            kept = -1
    return float(attracted)


@kernel
def _summit(table: TableArrays, circuit: GapCircuit, i: int, low: float, high: float) -> float:
    """The total pressure between two at which the largest share of the drive is needed, by golden
    section.
    """
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    of_left, of_right = (
        share_of_drive(table, circuit, i, left),
        share_of_drive(table, circuit, i, right),
    )
    for _ in range(SUMMIT_STEPS):
        if of_left >= 1.0 or of_right >= 1.0:
            break
        if of_left < of_right:
            low, left, of_left = left, right, of_right
            right = low + GOLDEN * (high - low)
            of_right = share_of_drive(table, circuit, i, right)
        else:
            high, right, of_right = right, left, of_left
            left = high - GOLDEN * (high - low)
            of_left = share_of_drive(table, circuit, i, left)
    return left if of_left > of_right else right


@kernel
def attraction(table: TableArrays, circuit: GapCircuit, i: int, p: float) -> float:
    """Electrostatic pressure of touch `i` at the total pressure `p`."""
    h_rms, p_hat, total = circuit.length_scale_m[i], p / circuit.pressure_scale_pa[i], 0.0
    for c in range(circuit.h_m.shape[1]):
        square = circuit.mean_square_v2[i, c]
        if square != 0.0:
            _, per_a, z = divider(circuit, i, c, p)
            z_hat = z / h_rms
            # over |u + z|^2 in h_rms: the mean square field at u
            field_square = square * squared(per_a) / h_rms**2
            pressure = 0.5 * EPS0 * field_square * k_hat(table, p_hat, z_hat)
            closest_square = (
                circuit.crest_square[i, c] * field_square / circuit.field_limit_v_per_m[i] ** 2
            )
            if closest_square > squared(z_hat):
                pressure *= kept_share(table, p_hat, z_hat, closest_square)
            total += pressure
    return total
