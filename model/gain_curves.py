"""The pressure per mean square volt, the gain, and the admittance at one frequency, as curves over the total pressure.

Most touches have one curve per frequency. Where an effect bends the stack with the voltage there is a family of them,
computed at some of the voltages (the knots) and cubic between; where the field is capped, the curves lose what the cap
takes at each voltage. A curve is an array over the nodes j of pressure; a family has an axis k of knots before it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.compiled import inlined, kernel, kernel_of_sums
from model.current import density_per_v
from model.dielectrics import EPS0, Array, ComplexArray
from model.gap_table import LOG_U_AXIS, gap_nodes, lookup, mass_at
from model.pressure import edge_of_cap, jump_of_slope

KNOT_STEP = 0.3  # by how much of itself the stack may change from one knot to the next
STRAIGHT = 1e-5  # of a curve: what a line through 2 knots may miss, or a parabola through 3, by the stack's change
NEGLIGIBLE = 1e-7  # of the stack's length: smaller gaps carry this share of the pressure
KNOTS_AROUND = 4  # of a voltage, that its curve comes from: cubic

Integers = NDArray[np.int64]


class Stack(NamedTuple):
    """What the gain depends on beside the pressure [f, v]; see `GapCircuit`."""

    h: ComplexArray
    k_gap: ComplexArray
    bypass: ComplexArray
    leak: ComplexArray
    shift: Array


class Nodes(NamedTuple):
    """The contact at the pressures of a curve: p [j], the share out of contact [j], the gap table and its units."""

    p: Array
    apart: Array
    table: Array
    p_scale: float
    h_scale: float


class Family(NamedTuple):
    """Curves per knot and pressure [k, j], work arrays that one frequency leaves to the next.

    `straight`: 1/sqrt(gain), which changes most evenly with the stack; `capped`: the gains that a cap leaves; `z`: the
    stack's length over h_rms; `openness`: (|a| h_rms)^2, by which the gap's field is weaker than V/h_rms.
    """

    gain: Array
    admittance: Array
    straight: Array
    capped: Array
    z: ComplexArray
    openness: Array


class GapSums(NamedTuple):
    """Sums over gaps behind a cap, per knot and pressure: P(u) du and what is summed of it over all smaller gaps.

    `mass`, `mass_below` [j, u]; `per_whole` [k, j]: 1/K^, 0 where nothing is summed yet; `reach`, `lost` [k, j]: the
    first gap beyond the cap at the last voltage, and K^ of all smaller gaps; `step` [c, k, j]: see `FROM`.
    """

    gap: Array
    mass: Array
    mass_below: Array
    per_whole: Array
    reach: Integers
    lost: Array
    step: Array


# Rows of `GapSums.step`, the step between two gaps in which the cap ended last. It holds between two squared drives
# (peak voltage over the cap)^2 c in m^2, and leaves LEFT + (HELD + edge/c)/c of the gain, the edge being that of
# `edge_of_cap` from BELOW to ABOVE at the share (c - FROM) PER_SPAN of the step.
FROM, UNTIL, PER_SPAN, LEFT, HELD, BELOW, ABOVE = range(7)


def make_family(knots: int, pressures: int) -> Family:
    """Empty work arrays."""
    shape = knots, pressures
    real = (np.empty(shape) for _ in range(5))
    gain, admittance, straight, capped, openness = real
    return Family(gain, admittance, straight, capped, np.empty(shape, dtype=np.complex128), openness)


def make_gap_sums(table_mass: Array, p_hat: Array, knots: int) -> GapSums:
    """The distribution of gaps at each pressure, and nothing summed yet."""
    mass, below = masses(table_mass, p_hat)
    shape = knots, p_hat.size
    return GapSums(
        gap_nodes(),
        mass,
        below,
        np.zeros(shape),
        np.zeros(shape, dtype=np.int64),
        np.zeros(shape),
        np.zeros((7, *shape)),
    )


@kernel
def masses(table_mass: Array, p_hat: Array) -> tuple[Array, Array]:
    """P(u) du [j, u] at each pressure, and its sum over all smaller gaps."""
    gaps = table_mass.shape[1]
    mass, below = np.zeros((p_hat.size, gaps)), np.zeros((p_hat.size, gaps))
    for j in range(p_hat.size):
        row, weights = mass_at(p_hat[j])
        for m in range(gaps):
            for b in range(4):
                mass[j, m] += weights[b] * table_mass[row + b, m]
            if m > 0:
                below[j, m] = below[j, m - 1] + mass[j, m - 1]
    return mass, below


@kernel
def divider(
    h: complex, k_gap: complex, bypass: complex, leak: complex, shift: float, p: float
) -> tuple[complex, complex, complex]:
    """Leak beside the gap, a = 1 + leak h, and the complex length z of the stack at the total pressure `p`."""
    beta = bypass + leak * p
    a = 1.0 + beta * h
    return beta, a, k_gap * h / a + shift


@kernel
def travel(stacks: Stack, least: Array, most: Array, h_scale: float) -> Array:
    """How far the stack has changed since the first voltage [f, v], in shares of itself, at both ends of the pressures.

    The leak's share is taken of itself and of what crosses a gap of h_rms: below that no current shows it.
    """
    h, k_gap, bypass, leak, shift = stacks
    place = np.zeros(h.shape)
    for i in range(h.shape[0]):
        for p in (least[i], most[i]):
            beta_before, a_before, z_before = divider(h[i, 0], k_gap[i, 0], bypass[i, 0], leak[i, 0], shift[i, 0], p)
            travelled = 0.0
            for v in range(1, h.shape[1]):
                beta, a, z = divider(h[i, v], k_gap[i, v], bypass[i, v], leak[i, v], shift[i, v], p)
                if beta != beta_before or z != z_before:
                    travelled += _size(a - a_before) / _size(a) + _size(z - z_before) / _size(z)
                    travelled += _size(beta - beta_before) / (_size(beta) + 1.0 / h_scale)
                place[i, v] += travelled
                beta_before, a_before, z_before = beta, a, z
    return place


@kernel
def _size(x: complex) -> float:
    """|x| for numbers far from the ends of floating point: numpy's abs guards against those at a cost."""
    return math.sqrt(x.real * x.real + x.imag * x.imag)


@kernel
def choose_knots(place: Array) -> tuple[Integers, Integers]:
    """Voltages about evenly spread over `place` [f, k], and how many [f]; one where nothing changes with voltage."""
    knots, counts = np.zeros(place.shape, dtype=np.int64), np.ones(place.shape[0], dtype=np.int64)
    end = place.shape[1] - 1
    for i in range(place.shape[0]):
        whole = place[i, end]
        intervals = 1
        while intervals < KNOTS_AROUND - 1 and (whole / intervals) ** (intervals + 1) > STRAIGHT:
            intervals += 1
        # a tenth more, for knots lie on voltages, short of their places
        step = 1.1 * whole / max(intervals, math.ceil(whole / KNOT_STEP))
        v = 0
        while whole > 0.0 and v < end:
            before = place[i, v]
            v += 1
            while v < end and (place[i, v + 1] <= before + step or place[i, v] <= before + 1e-2 * step):
                v += 1
            knots[i, counts[i]] = v
            counts[i] += 1
    return knots, counts


@kernel
def fill_family(
    stacks: Stack, i: int, knots: Integers, count: int, nodes: Nodes, first: int, square: float, base: float,
    family: Family,
) -> int:  # fmt: skip
    """The curves of every knot of frequency `i`, from node `first` to the returned one.

    That is three beyond the first where every curve takes more than `square` under the load `base`, or the table's end.
    """
    h, k_gap, bypass, leak, shift = stacks
    p, apart, table, p_scale, h_scale = nodes
    gains, admittances, straight, _, lengths, openness = family
    out = np.empty(3)
    last = p.size - 1
    for j in range(first, p.size):
        enough = True
        for k in range(count):
            v = knots[i, k]
            beta, a, z = divider(h[i, v], k_gap[i, v], bypass[i, v], leak[i, v], shift[i, v], p[j])
            z_hat, share = z / h_scale, (h_scale * abs(a)) ** 2
            lookup(table, p[j] / p_scale, z_hat, out)
            gain = 0.5 * EPS0 * out[0] / share
            gains[k, j], straight[k, j], lengths[k, j], openness[k, j] = gain, 1.0 / math.sqrt(gain), z_hat, share
            admittances[k, j] = density_per_v(beta, a, k_gap[i, v], apart[j], out, h_scale)
            enough = enough and p[j] - base > square * gain
        if last == p.size - 1 and enough:
            last = max(j + 3, first + 4)
        if j >= last:
            return j
    return p.size - 1


@inlined
def copy_curve(curves: Array, low: int, high: int, curve: Array) -> None:
    """The only curve there is, from node `low` to `high`."""
    for j in range(low, high + 1):
        curve[j] = curves[0, j]


@inlined
def straighten(gains: Array, knots: int, low: int, high: int, straight: Array) -> None:
    """1/sqrt(gain) of the first knots, from node `low` to `high`."""
    for k in range(knots):
        for j in range(low, high + 1):
            straight[k, j] = 1.0 / math.sqrt(gains[k, j])


@inlined
def blend(
    place: Array, knots: Integers, count: int, v: int, low: int, high: int, straight: Array, admittance: Array,
    gain: Array, current: Array,
) -> None:  # fmt: skip
    """Gain and admittance at the voltage `v`, from node `low` to `high`, by a cubic through the knots around it."""
    before = 0
    while before < count - 2 and knots[before + 1] <= v:
        before += 1
    start = max(min(before - 1, count - KNOTS_AROUND), 0)
    end = min(start + KNOTS_AROUND, count)
    for j in range(low, high + 1):
        gain[j] = current[j] = 0.0
    for k in range(start, end):
        weight = 1.0
        for other in range(start, end):
            if other != k:
                there = place[knots[other]]
                weight *= (place[v] - there) / (place[knots[k]] - there)
        for j in range(low, high + 1):
            gain[j] += weight * straight[k, j]
        for j in range(low, high + 1):
            current[j] += weight * admittance[k, j]
    for j in range(low, high + 1):
        gain[j] = 1.0 / (gain[j] * gain[j])


@kernel
def start_caps(
    z: ComplexArray, openness: Array, count: int, first: int, last: int, per_whole: Array, step: Array
) -> float:
    """Nothing summed and no cap met yet; returns the squared drive, m^2, from which one is under some pressure."""
    per_whole[:] = 0.0
    step[:] = 0.0
    least = np.inf
    for k in range(count):
        for j in range(first, last + 1):
            step[LEFT, k, j] = 1.0
            step[UNTIL, k, j] = openness[k, j] * (z[k, j].real ** 2 + z[k, j].imag ** 2)
            least = min(least, step[UNTIL, k, j])
    return least


@kernel
def first_gap(z_hat: complex) -> int:
    """The first gap that matters beside the length `z_hat`."""
    return max(int((math.log(NEGLIGIBLE * abs(z_hat)) - LOG_U_AXIS[0]) / LOG_U_AXIS[2]), 0)


@inlined
def cap_gains(
    gain: Array, z: ComplexArray, openness: Array, mass: Array, mass_below: Array, gap: Array, per_whole: Array,
    reach: Integers, lost: Array, step: Array, k: int, start: int, crest_square: float, low: int, high: int,
    capped: Array,
) -> None:  # fmt: skip
    """Gains of knot `k` from node `low` to `high` that are left where the local field stops at the cap.

    `crest_square`: (peak voltage over the cap)^2, m^2. The integral over gaps is that of `pressure.py` from the gap
    `start` on, with the sums carried from one voltage to the next, and only where the cap is met.
    """
    for j in range(low, high + 1):
        if step[FROM, k, j] <= crest_square <= step[UNTIL, k, j]:
            continue
        x, y_square, wide = z[k, j].real, z[k, j].imag ** 2, openness[k, j]
        if per_whole[k, j] == 0.0:
            per_whole[k, j] = 1.0 / _sum_gaps(gap, mass, j, x, y_square, start)
            reach[k, j], lost[k, j] = start, 0.0
        closest_square = crest_square / wide
        r = reach[k, j]
        below, above = (gap[r - 1] + x) ** 2 + y_square, (gap[r] + x) ** 2 + y_square
        while r < gap.size - 1 and above < closest_square:
            lost[k, j] += mass[j, r] / above
            r += 1  # the last gap of all, which no contact has, need not be reached
            below, above = above, (gap[r] + x) ** 2 + y_square
        while r > start and below >= closest_square:
            r -= 1
            lost[k, j] -= mass[j, r] / below
            below, above = (gap[r - 1] + x) ** 2 + y_square, below
        reach[k, j] = r
        step[FROM, k, j], step[UNTIL, k, j] = 0.0, wide * above if r < gap.size - 1 else np.inf
        step[PER_SPAN, k, j] = step[HELD, k, j] = step[BELOW, k, j] = step[ABOVE, k, j] = 0.0
        step[LEFT, k, j] = 1.0
        if r > start:
            share = per_whole[k, j] * wide
            step[FROM, k, j], step[PER_SPAN, k, j] = wide * below, 1.0 / (wide * (above - below))
            step[LEFT, k, j], step[HELD, k, j] = 1.0 - lost[k, j] * per_whole[k, j], mass_below[j, r] * share
            step[BELOW, k, j] = share * wide * jump_of_slope(gap[r - 1], mass[j, r - 1], x)
            step[ABOVE, k, j] = share * wide * jump_of_slope(gap[r], mass[j, r], x)
    per_crest = 1.0 / crest_square if crest_square > 0.0 else 0.0
    for j in range(low, high + 1):
        t = (crest_square - step[FROM, k, j]) * step[PER_SPAN, k, j]
        edge = edge_of_cap(t, step[BELOW, k, j], step[ABOVE, k, j])
        capped[k, j] = gain[k, j] * (step[LEFT, k, j] + (step[HELD, k, j] + edge * per_crest) * per_crest)


@kernel_of_sums
def _sum_gaps(gap: Array, mass: Array, j: int, x: float, y_square: float, start: int) -> float:
    """K^ of one pressure and stack, z = x + iy, from the gap `start` on."""
    whole = 0.0
    for m in range(start, gap.size):
        whole += mass[j, m] / ((gap[m] + x) ** 2 + y_square)
    return whole
