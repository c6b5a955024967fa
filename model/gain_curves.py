"""The pressure per mean square volt, the gain, and the admittance at one frequency, as curves over the total pressure.

Where the stack does not change with the voltage, one curve answers for all voltages; where the field is capped, it
loses what the cap takes at each. A curve is an array over the nodes j of pressure.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.compiled import inlined, kernel, span
from model.current import density_per_v
from model.dielectrics import EPS0, Array, ComplexArray
from model.gap_table import LOOKED_UP, Refined, gap_nodes, lookup_row
from model.pressure import divider, edge_of_cap, first_gap, jump_of_slope

Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]


class Stack(NamedTuple):
    """What the gain depends on beside the pressure [f, v]; see `GapCircuit`."""

    h: ComplexArray
    k_gap: ComplexArray
    bypass: ComplexArray
    leak: ComplexArray
    shift: Array


class Nodes(NamedTuple):
    """The pressures of a curve [j], p^ and p in Pa, and the contact there: share out of contact, gap table, h_rms.

    `q` is sqrt(p), `per_q` one over the distance to the next. `p`, `q` and `per_q` change with the finger's stiffness.
    """

    p_hat: Array
    p: Array
    q: Array
    per_q: Array
    apart: Array
    table: Array
    h_scale: float


class Curve(NamedTuple):
    """Gain and admittance [j], work arrays that one frequency leaves to the next.

    For a cap: `x`, `y_square`, of the stack's length z over h_rms; `openness`, (|a| h_rms)^2, by which the gap's field
    is weaker than V/h_rms. `looked_up`: what `lookup` leaves.
    """

    gain: Array
    admittance: Array
    x: Array
    y_square: Array
    openness: Array
    looked_up: Array


class GapSums(NamedTuple):
    """Sums over gaps [u] behind a cap, per pressure.

    `mass`, `mass_below` [u, j]: P(u) du, and its sum over all smaller gaps; `lost` [u, j]: K^ of all smaller gaps;
    `per_whole` [j]: 1/K^.
    """

    gap: Array
    mass: Array
    mass_below: Array
    lost: Array
    per_whole: Array


def make_curve(pressures: int) -> Curve:
    """Empty work arrays."""
    gain, admittance, x, y_square, openness = np.empty((5, pressures))
    return Curve(gain, admittance, x, y_square, openness, np.empty(LOOKED_UP))


def make_gap_sums(table: Refined) -> GapSums:
    """The distribution of gaps at each pressure, and nothing summed yet."""
    return GapSums(gap_nodes(), table.mass, table.mass_below, np.empty_like(table.mass), np.empty_like(table.p_hat))


@kernel
def fill_curve(
    stacks: Stack, i: int, v: int, nodes: Nodes, first: int, square: float, highest: float, curve: Curve
) -> int:
    """The curve of frequency `i` and voltage `v` without a cap, from node `first` to the returned one.

    That is three beyond the first that takes more than the mean `square` under the load `highest`, or the table's end.
    """
    h, k_gap, bypass, leak, shift = stacks
    _, p, _, _, apart, table, h_scale = nodes
    gains, admittances, x, y_square, openness, out = curve
    last = p.size - 1
    for j in range(first, p.size):
        beta, per_a, z = divider(h[i, v], k_gap[i, v], bypass[i, v], leak[i, v], shift[i, v], p[j])
        z_hat = z / h_scale
        lookup_row(table, j, z_hat, out)
        x[j], y_square[j] = z_hat.real, z_hat.imag * z_hat.imag
        openness[j] = h_scale * h_scale / (per_a.real * per_a.real + per_a.imag * per_a.imag)
        gains[j] = 0.5 * EPS0 * out[0] / openness[j]
        admittances[j] = density_per_v(beta, per_a, k_gap[i, v], apart[j], out, h_scale)
        if last == p.size - 1 and p[j] - highest > square * gains[j]:
            last = max(j + 3, first + 4)
        if j >= last:
            return j
    return p.size - 1


@kernel
def meet_cap(curve: Curve, sums: GapSums, first: int, last: int, crest_square: float) -> tuple[float, int]:
    """The squared drive, m^2, that meets the cap in gaps of no width under some pressure, and the first gap to count.

    Where `crest_square` is above it, the sums over gaps are made: K^ at each pressure, and over all smaller gaps.
    """
    _, _, x, y_square, openness, _ = curve
    gap, mass, mass_below, lost, per_whole = sums
    met = np.inf
    for j in span(first, last + 1):
        met = min(met, openness[j] * (x[j] * x[j] + y_square[j]))
    shortest = 0.5 * math.log(x[last] * x[last] + y_square[last])  # pressure widens the leak
    start = first_gap(shortest)
    if crest_square > met:
        for j in span(first, last + 1):
            lost[start, j] = mass_below[start, j] / (x[j] * x[j] + y_square[j])
        for m in range(start, gap.size - 1):
            for j in span(first, last + 1):
                u = gap[m] + x[j]
                lost[m + 1, j] = lost[m, j] + mass[m, j] / (u * u + y_square[j])
        for j in span(first, last + 1):
            per_whole[j] = 1.0 / lost[gap.size - 1, j]  # no contact has the last gap of all
    return met, start


@inlined
def cap_gains(
    uncapped: Array, x: Array, y_square: Array, openness: Array, gap: Array, mass: Array, mass_below: Array,
    lost: Array, per_whole: Array, start: int, reach: int, crest_square: float, low: int, high: int, gain: Array,
) -> int:  # fmt: skip
    """The gains from node `low` to `high` that are left where the local field stops at the cap.

    `crest_square`: (peak voltage over the cap)^2, m^2. The integral over gaps is that of `pressure.py`, with the sums
    over gaps that have been made; pressures whose cap ends in the same step between two gaps are done at once. The
    first gap beyond the cap is returned, to be looked for from at the next voltage (`reach`).
    """
    per_crest, r, j = 1.0 / crest_square, reach, low
    while j <= high:
        while r < gap.size - 1 and ((gap[r] + x[j]) ** 2 + y_square[j]) * openness[j] < crest_square:
            r += 1
        while r > start and ((gap[r - 1] + x[j]) ** 2 + y_square[j]) * openness[j] >= crest_square:
            r -= 1
        end = j + 1
        while end <= high:
            if r > start and ((gap[r - 1] + x[end]) ** 2 + y_square[end]) * openness[end] >= crest_square:
                break
            if r < gap.size - 1 and ((gap[r] + x[end]) ** 2 + y_square[end]) * openness[end] < crest_square:
                break
            end += 1
        if r == start:
            for i in span(j, end):
                gain[i] = uncapped[i]
        else:
            u, v = gap[r - 1], gap[r]
            for i in span(j, end):
                below, above = (u + x[i]) ** 2 + y_square[i], (v + x[i]) ** 2 + y_square[i]
                per_closest = openness[i] * per_crest
                t = (1.0 / per_closest - below) / (above - below)
                edge = edge_of_cap(t, jump_of_slope(u, mass[r - 1, i], x[i]), jump_of_slope(v, mass[r, i], x[i]))
                held = (mass_below[r, i] + edge * per_closest) * per_closest
                gain[i] = uncapped[i] * (1.0 - per_whole[i] * (lost[r, i] - held))
        j = end
    return r
