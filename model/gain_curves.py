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

from model.compiled import inlined, kernel, span
from model.current import density_per_v
from model.dielectrics import EPS0, Array, ComplexArray
from model.gap_table import gap_nodes, lookup_row, mass_at
from model.pressure import divider, edge_of_cap, jump_of_slope

KNOT_STEP = 0.3  # by how much of itself the stack may change from one knot to the next
STRAIGHT = 1e-5  # of a curve: what a line through 2 knots may miss, or a parabola through 3, by the stack's change
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
    """The contact at the pressures of a curve, p^ and p in Pa: the share out of contact [j], gap table [j], h_rms."""

    p_hat: Array
    p: Array
    apart: Array
    table: Array
    h_scale: float


class Family(NamedTuple):
    """Curves per knot and pressure [k, j], work arrays that one frequency leaves to the next.

    `straight`: 1/sqrt(gain), which changes most evenly with the stack; `kept`: the share of the gain that a cap leaves;
    `x`, `y_square`: of the stack's length z over h_rms; `openness`: (|a| h_rms)^2, by which the gap's field is weaker
    than V/h_rms.
    """

    straight: Array
    admittance: Array
    kept: Array
    x: Array
    y_square: Array
    openness: Array


class GapSums(NamedTuple):
    """Sums over gaps [u] behind a cap, per pressure and knot.

    `mass`, `mass_below` [u, j]: P(u) du, and its sum over all smaller gaps; `lost` [k, u, j]: K^ of all smaller gaps;
    `per_whole` [k, j]: 1/K^; `reach` [k]: the first gap beyond the cap, where it was last looked for.
    """

    gap: Array
    mass: Array
    mass_below: Array
    lost: Array
    per_whole: Array
    reach: Integers


def make_family(knots: int, pressures: int) -> Family:
    """Empty work arrays."""
    return Family(*(np.empty((knots, pressures)) for _ in Family._fields))


def make_gap_sums(table_mass: Array, p_hat: Array, knots: int) -> GapSums:
    """The distribution of gaps at each pressure, and nothing summed yet."""
    mass, below = masses(table_mass, p_hat)
    return GapSums(
        gap_nodes(),
        mass,
        below,
        np.empty((knots, *mass.shape)),
        np.empty((knots, p_hat.size)),
        np.zeros(knots, dtype=np.int64),
    )


@kernel
def masses(table_mass: Array, p_hat: Array) -> tuple[Array, Array]:
    """P(u) du [u, j] at each pressure, and its sum over all smaller gaps."""
    gaps = table_mass.shape[1]
    mass, below = np.zeros((gaps, p_hat.size)), np.zeros((gaps, p_hat.size))
    for j in range(p_hat.size):
        row, weights = mass_at(p_hat[j])
        for m in range(gaps):
            for b in range(4):
                mass[m, j] += weights[b] * table_mass[row + b, m]
    for m in range(1, gaps):
        for j in range(p_hat.size):
            below[m, j] = below[m - 1, j] + mass[m - 1, j]
    return mass, below


@kernel
def travel(stacks: Stack, least: Array, most: Array, h_scale: float) -> Array:
    """How far the stack has changed since the first voltage [f, v], in shares of itself, at both ends of the pressures.

    The leak's share is taken of itself and of what crosses a gap of h_rms: below that no current shows it.
    """
    h, k_gap, bypass, leak, shift = stacks
    place = np.zeros(h.shape)
    for i in range(h.shape[0]):
        for p in (least[i], most[i]):
            beta_0, per_a_0, z_0 = divider(h[i, 0], k_gap[i, 0], bypass[i, 0], leak[i, 0], shift[i, 0], p)
            travelled = 0.0
            for v in range(1, h.shape[1]):
                same = h[i, v] == h[i, v - 1] and k_gap[i, v] == k_gap[i, v - 1] and shift[i, v] == shift[i, v - 1]
                if not (same and bypass[i, v] == bypass[i, v - 1] and leak[i, v] == leak[i, v - 1]):
                    beta, per_a, z = divider(h[i, v], k_gap[i, v], bypass[i, v], leak[i, v], shift[i, v], p)
                    travelled += _size(per_a - per_a_0) / _size(per_a) + _size(z - z_0) / _size(z)
                    travelled += _size(beta - beta_0) / (_size(beta) + 1.0 / h_scale)
                    beta_0, per_a_0, z_0 = beta, per_a, z
                place[i, v] += travelled
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
    _, p, apart, table, h_scale = nodes
    straight, admittances, _, x, y_square, openness = family
    out = np.empty(3)
    last = p.size - 1
    for j in range(first, p.size):
        enough = True
        for k in range(count):
            v = knots[i, k]
            beta, per_a, z = divider(h[i, v], k_gap[i, v], bypass[i, v], leak[i, v], shift[i, v], p[j])
            z_hat = z / h_scale
            lookup_row(table, j, z_hat, out)
            openness[k, j] = h_scale * h_scale / (per_a.real * per_a.real + per_a.imag * per_a.imag)
            x[k, j], y_square[k, j] = z_hat.real, z_hat.imag * z_hat.imag
            gain = 0.5 * EPS0 * out[0] / openness[k, j]
            straight[k, j] = 1.0 / math.sqrt(gain)
            admittances[k, j] = density_per_v(beta, per_a, k_gap[i, v], apart[j], out, h_scale)
            enough = enough and p[j] - base > square * gain
        if last == p.size - 1 and enough:
            last = max(j + 3, first + 4)
        if j >= last:
            return j
    return p.size - 1


@inlined
def weigh_knots(place: Array, knots: Integers, count: int, v: int, weights: Array) -> tuple[int, int]:
    """The knots [start, end) around the voltage `v` that its curves come from, and their `weights` of a polynomial."""
    before = 0
    while before < count - 2 and knots[before + 1] <= v:
        before += 1
    start = max(min(before - 1, count - KNOTS_AROUND), 0)
    end = min(start + KNOTS_AROUND, count)
    for k in range(start, end):
        weight = 1.0
        for other in range(start, end):
            if other != k:
                there = place[knots[other]]
                weight *= (place[v] - there) / (place[knots[k]] - there)
        weights[k - start] = weight
    return start, end


@inlined
def mix(curves: Array, weights: Array, start: int, end: int, low: int, high: int, mixed: Array) -> None:
    """The weighted sum of the knots' curves from node `low` to `high`."""
    for j in span(low, high + 1):
        mixed[j] = weights[0] * curves[start, j]
    for k in range(start + 1, end):
        weight = weights[k - start]
        for j in span(low, high + 1):
            mixed[j] += weight * curves[k, j]


@kernel
def least_drive(x: Array, y_square: Array, openness: Array, count: int, first: int, last: int) -> float:
    """The squared drive, m^2, from which the cap is met under some pressure, in gaps of no width."""
    least = np.inf
    for k in range(count):
        for j in span(first, last + 1):
            least = min(least, openness[k, j] * (x[k, j] * x[k, j] + y_square[k, j]))
    return least


@kernel
def sum_gaps(
    x: Array, y_square: Array, gap: Array, mass: Array, mass_below: Array, lost: Array, per_whole: Array,
    reach: Integers, k: int, first: int, last: int, start: int,
) -> None:  # fmt: skip
    """K^ of knot `k` at each pressure, and on the way over all smaller gaps, from the gap `start` on."""
    reach[k] = start
    for j in span(first, last + 1):
        lost[k, start, j] = mass_below[start, j] / (x[k, j] * x[k, j] + y_square[k, j])
    for m in range(start, gap.size - 1):
        for j in span(first, last + 1):
            u = gap[m] + x[k, j]
            lost[k, m + 1, j] = lost[k, m, j] + mass[m, j] / (u * u + y_square[k, j])
    for j in span(first, last + 1):
        per_whole[k, j] = 1.0 / lost[k, gap.size - 1, j]  # no contact has the last gap of all


@inlined
def keep_shares(
    x: Array, y_square: Array, openness: Array, gap: Array, mass: Array, mass_below: Array, lost: Array,
    per_whole: Array, reach: Integers, k: int, start: int, crest_square: float, low: int, high: int, kept: Array,
) -> None:  # fmt: skip
    """Shares of the gains of knot `k`, from node `low` to `high`, that are left where the local field stops at the cap.

    `crest_square`: (peak voltage over the cap)^2, m^2. The integral over gaps is that of `pressure.py`, with the sums
    over gaps that have been made; pressures whose cap ends in the same step between two gaps are done at once.
    """
    per_crest, r, j = 1.0 / crest_square, reach[k], low
    while j <= high:
        while r < gap.size - 1 and ((gap[r] + x[k, j]) ** 2 + y_square[k, j]) * openness[k, j] < crest_square:
            r += 1
        while r > start and ((gap[r - 1] + x[k, j]) ** 2 + y_square[k, j]) * openness[k, j] >= crest_square:
            r -= 1
        end = j + 1
        while end <= high:
            if r > start and ((gap[r - 1] + x[k, end]) ** 2 + y_square[k, end]) * openness[k, end] >= crest_square:
                break
            if r < gap.size - 1 and ((gap[r] + x[k, end]) ** 2 + y_square[k, end]) * openness[k, end] < crest_square:
                break
            end += 1
        if r == start:
            for i in span(j, end):
                kept[k, i] = 1.0
        else:
            u, v = gap[r - 1], gap[r]
            for i in span(j, end):
                below, above = (u + x[k, i]) ** 2 + y_square[k, i], (v + x[k, i]) ** 2 + y_square[k, i]
                per_closest = openness[k, i] * per_crest
                t = (1.0 / per_closest - below) / (above - below)
                edge = edge_of_cap(t, jump_of_slope(u, mass[r - 1, i], x[k, i]), jump_of_slope(v, mass[r, i], x[k, i]))
                held = (mass_below[r, i] + edge * per_closest) * per_closest
                kept[k, i] = 1.0 - per_whole[k, i] * (lost[k, r, i] - held)
        j = end
    reach[k] = r
