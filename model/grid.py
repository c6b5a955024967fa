"""Whole surfaces: the closed loop and the current at every combination of frequency, voltage and load.

At one frequency the pressure per mean square volt, the gain, depends on the total pressure p alone: a curve of a few
nodes (`gain_curves.py`), quartic between them in q = sqrt(p), over which it is as straight as over the logarithm. On it
<V^2>(p_e) = p_e/gain(p0 + p_e) is explicit; it is inverted for every load at some frequencies and voltages, from which
the others follow (`between.py`). Where the stack changes with the voltage, each answer is sought where the last leads.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.between import Between, between, fill_between, rough_places
from model.chain import PreparedTouch
from model.compiled import kernel
from model.contact import area_ratio
from model.current import density_per_v
from model.dielectrics import Array
from model.equilibria import (
    ANSWER,
    FEW_STEPS,
    LEAP,
    Spacing,
    at,
    fold,
    follow,
    guess_q,
    node_below,
    power_series,
    search,
    stencil,
    to_series,
)
from model.gain_curves import (
    Curve,
    GapSums,
    Integers,
    Nodes,
    Stack,
    cap_gains,
    fill_curve,
    make_curve,
    make_gap_sums,
    meet_cap,
)
from model.gap_table import LOOKED_UP, GapTable
from model.pressure import MAX_ITERATIONS, divider

FREQUENCY_STRIDE, VOLTAGE_STRIDE = 2, 4  # from one that is solved first to the next
NODES_PER_ROW = 2  # of the table: pressures on a curve; of fourth order between them


class Integrals(NamedTuple):
    """What single conditions need of a `GapTable`."""

    flat: Array
    mass: Array
    mass_below: Array


class Work(NamedTuple):
    """Work arrays of one frequency.

    `gain` [j] at one voltage; `end`, `end_gain`: fold per load; `answer` [n] as in `search`; `stored` [k], those of the
    voltages solved first, from which the ones after them start. `even` [v, 2n]: of each equilibrium 1/sqrt(gain), then
    one over its admittance, which change most evenly with the voltage; before that a guess, or NaN.
    """

    gain: Array
    end: Array
    end_gain: Array
    answer: Array
    stored: Array
    even: Array


@dataclass(frozen=True)
class GridSolution:
    """A solved surface [frequency, voltage, load].

    `electrostatic_pressure_pa` in Pa, NaN where there is no equilibrium in range; `admittance_per_m` is
    |current density/(j w eps0 V)|; `pulled_in` marks points past the fold of V(p_e), where the contact pulls in.
    """

    electrostatic_pressure_pa: Array
    admittance_per_m: Array
    pulled_in: NDArray[np.bool_]


def solve_grid(table: GapTable, touch: PreparedTouch, load_pa: Array) -> GridSolution:
    """Every frequency and voltage of `touch`, of shape (..., f, v) with voltage rising, under all of rising `load_pa`.

    For touches without bias and of one roughness; their own loads are ignored. Answers are [..., f, v, n].
    """
    circuit, rows = touch.circuit, (-1, touch.shape[-1])
    square, crest, added, limit, p_scale = (
        x.reshape(rows)
        for x in (
            circuit.mean_square_v2, circuit.crest_square, circuit.added_pa, circuit.field_limit_v_per_m,
            circuit.pressure_scale_pa,
        )
    )  # fmt: skip
    h, k_gap, bypass, leak = (
        x.reshape(rows) for x in (circuit.h_m, circuit.k_gap, circuit.bypass_per_m, circuit.leak_per_m_pa)
    )
    stacks = Stack(h, k_gap, bypass, leak, circuit.gap_shift_m.reshape(rows))
    refined, h_scale, has_cap = table.refined(NODES_PER_ROW), circuit.length_scale_m[0], bool(np.isfinite(limit).any())
    p_hat = refined.p_hat
    nodes = Nodes(p_hat, np.empty_like(p_hat), 1.0 - area_ratio(table.shape, p_hat), refined.flat, h_scale)
    shape = (*square.shape, load_pa.size)
    frequency_stride = FREQUENCY_STRIDE if len(touch.shape) == 2 else 1  # else rows are not on one axis
    (pressure, admittance), pulled_in = np.empty((2, *shape)), np.zeros(shape, dtype=np.bool_)
    _solve_grid(
        stacks, nodes, make_curve(p_hat.size), make_gap_sums(refined),
        Integrals(table.flat, table.mass, table.mass_below), bends(stacks), to_series(np.sqrt(p_hat)),
        between(shape[0], frequency_stride), between(shape[1], VOLTAGE_STRIDE), square,
        crest * np.abs(square) / limit**2, added, p_scale[:, 0], has_cap, load_pa, pressure, admittance, pulled_in,
    )  # fmt: skip
    whole = (*touch.shape, load_pa.size)
    return GridSolution(pressure.reshape(whole), admittance.reshape(whole), pulled_in.reshape(whole))


def bends(stacks: Stack) -> NDArray[np.bool_]:
    """Whether the stack changes with the voltage, at each frequency [f]."""
    return np.asarray(np.any([np.any(x != x[:, :1], axis=1) for x in stacks], axis=0))


@kernel
def _solve_grid(
    stacks: Stack, nodes: Nodes, curve: Curve, sums: GapSums, integrals: Integrals, bent: NDArray[np.bool_],
    spacing: Spacing, along_f: Between, along_v: Between, square: Array, crest_square: Array, added: Array,
    p_scale: Array, has_cap: bool, load: Array, pressure: Array, admittance: Array, pulled_in: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Some frequencies, those between, and from gains to pressures.

    `bent` [f] as of `bends`; `crest_square` [f, v]: (peak voltage over the field's cap)^2, m^2. Until the end pressure
    and admittance hold what `Work.even` does.
    """
    frequencies, voltages, loads = pressure.shape
    q_node, per_q, scale = np.empty(nodes.p.size), np.empty(nodes.p.size - 1), 0.0
    work = _make_work(q_node.size, along_v.solved.size, voltages, loads)
    rough, uneven = np.empty(frequencies, dtype=np.int64), np.zeros(len(along_f.miss), dtype=np.int64)
    which = along_f.solved
    for attempt in range(2):
        for i in which:
            if p_scale[i] != scale:
                scale = p_scale[i]
                _lay_nodes(nodes, scale, q_node, per_q)
            _solve_frequency(
                stacks, i, nodes, curve, sums, integrals, bent[i], work, q_node, per_q, spacing, along_v, square[i],
                crest_square[i], added[i], scale, has_cap, load, pulled_in[i],
            )  # fmt: skip
            for v in range(voltages):
                for n in range(loads):
                    pressure[i, v, n], admittance[i, v, n] = work.even[v, n], work.even[v, loads + n]
        if attempt == 0:
            for values in (pressure, admittance):
                fill_between(along_f, values.reshape(frequencies, voltages * loads), uneven)
            which = rough[: rough_places(along_f, uneven, rough)]
    for i in range(frequencies):
        for v in range(voltages):
            for n in range(loads):
                pressure[i, v, n] = square[i, v] / (pressure[i, v, n] * pressure[i, v, n])
                admittance[i, v, n] = 1.0 / admittance[i, v, n]


@kernel
def _solve_frequency(
    stacks: Stack, i: int, nodes: Nodes, curve: Curve, sums: GapSums, integrals: Integrals, bent: bool, work: Work,
    q_node: Array, per_q: Array, spacing: Spacing, along_v: Between, square: Array, crest_square: Array, added: Array,
    p_scale: float, has_cap: bool, load: Array, pulled_in: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Some voltages of one frequency under every load, and those between."""
    least, highest, most_square = added.min(), load[-1] + added.max(), square.max()
    first = node_below(q_node, math.sqrt(load[0] + least))
    last, met, start = q_node.size - 1, np.inf, 0
    if not bent:
        last = fill_curve(stacks, i, 0, nodes, first, most_square, highest, curve)
        if has_cap:
            met, start = meet_cap(curve, sums, first, last, crest_square.max())
    rough, uneven = np.empty(square.size, dtype=np.int64), np.zeros(len(along_v.miss), dtype=np.int64)
    which = along_v.solved
    for attempt in range(2):
        if bent:
            _follow_voltages(
                stacks, i, integrals, nodes, curve, sums, work, q_node, per_q, spacing, first, which, along_v.number,
                square, most_square, crest_square, added, p_scale, load, highest, pulled_in,
            )  # fmt: skip
        else:
            _solve_voltages(
                curve, sums, work, q_node, per_q, spacing, first, last, which, along_v.number, square, crest_square,
                added, least, has_cap, met, start, load, pulled_in,
            )  # fmt: skip
        if attempt == 0:
            fill_between(along_v, work.even, uneven)
            which = rough[: rough_places(along_v, uneven, rough)]


@kernel
def _make_work(pressures: int, stored: int, voltages: int, loads: int) -> Work:
    """Empty work arrays."""
    return Work(
        np.empty(pressures), np.empty(loads), np.empty(loads), np.empty((loads, ANSWER)),
        np.empty((stored, loads, ANSWER)), np.empty((voltages, 2 * loads)),
    )  # fmt: skip


@kernel
def _lay_nodes(nodes: Nodes, p_scale: float, q_node: Array, per_q: Array) -> None:
    """Pressures of the curves and their roots q, and one over the distance to the next."""
    for j in range(q_node.size):
        nodes.p[j] = nodes.p_hat[j] * p_scale
        q_node[j] = math.sqrt(nodes.p[j])
    for j in range(per_q.size):
        per_q[j] = 1.0 / (q_node[j + 1] - q_node[j])


@kernel
def _begin(turn: int, voltages: Integers, number: Integers, answer: Array, stored: Array, even: Array) -> int:
    """The voltage of a turn, with the answers that it starts from, and guesses where it has none yet."""
    v = int(voltages[turn])
    if v == 0:
        answer[:, 0] = -1.0
    elif number[v - 1] >= 0:
        answer[:] = stored[number[v - 1]]
    if number[v] >= 0:
        even[v] = np.nan
        if turn >= 4 and v - voltages[turn - 4] == 4 * (v - voltages[turn - 1]):  # evenly spaced: a cubic leads on
            v1, v2, v3, v4 = voltages[turn - 1], voltages[turn - 2], voltages[turn - 3], voltages[turn - 4]
            for c in range(even.shape[1]):
                even[v, c] = 4.0 * (even[v1, c] + even[v3, c]) - 6.0 * even[v2, c] - even[v4, c]
    return v


@kernel
def _solve_voltages(  # noqa: PLR0912, PLR0915 (one visible algorithm)
    curve: Curve, sums: GapSums, work: Work, q_node: Array, per_q: Array, spacing: Spacing, first: int, last: int,
    voltages: Integers, number: Integers, square: Array, crest_square: Array, added: Array, least: float, has_cap: bool,
    met: float, start: int, load: Array, pulled_in: NDArray[np.bool_],
) -> None:  # fmt: skip
    """<V^2>(p_e) = <V^2> at some `voltages` of one frequency, inverted by Newton's method within the rising part.

    `number` [v]: which of those solved first a voltage is, or -1. The cap is met where `crest_square` [v] is above
    `met`, in gaps from number `start` on. `least` of the pressure `added`.
    """
    gain, end, end_gain, answer, stored, even = work  # numba counts references whenever a record's array is named:
    uncapped, current, x, y_square, openness = curve  # so not in the loops
    gap, mass, mass_below, lost, per_whole = sums
    p_low, p_high, reach, was_capped = q_node[0] ** 2, q_node[-1] ** 2, start, False
    for turn in range(voltages.size):
        v = _begin(turn, voltages, number, answer, stored, even)
        is_capped = has_cap and crest_square[v] > met
        low, high, fresh = first, last, turn > 0 and not is_capped and not was_capped
        was_capped = is_capped
        if is_capped:
            low, high = _needed(answer, first, last)
        n, alone, guess = 0, -1, 0.0
        while n < load.size:
            if not fresh:
                if is_capped:
                    reach = cap_gains(
                        uncapped, x, y_square, openness, gap, mass, mass_below, lost, per_whole, start, reach,
                        crest_square[v], low, high, gain,
                    )  # fmt: skip
                else:
                    gain[:] = uncapped
                fresh = True
            base, before = load[n] + added[v], answer[n, 0]
            if alone != n:
                guess = guess_q(even[v, n], base, square[v])
                even[v, n] = even[v, load.size + n] = np.nan
            if not p_low <= base < p_high:
                n += 1
                continue
            q_low = math.sqrt(base)
            follows = has_cap and before > 0.0 and alone != n
            if follows:  # the curve has moved: an answer near the last one is on its branch
                q_low, q_high, steps = max(before * (1.0 / LEAP), q_low), min(before * LEAP, q_node[last]), FEW_STEPS
            else:
                if v == 0 and not has_cap:  # where the least pressure added does not fold, no greater one does
                    end[n], end_gain[n] = fold(gain, q_node, per_q, spacing, first, last, load[n] + least)
                q_high, gain_there, steps = end[n], end_gain[n], MAX_ITERATIONS
                if has_cap or (q_high < q_node[last] and added[v] > least):
                    q_high, gain_there = fold(gain, q_node, per_q, spacing, first, last, base)
                if square[v] * gain_there > q_high * q_high - base:
                    pulled_in[v, n] = q_high < q_node[last]
                    answer[n, 0] = -1.0
                    n += 1
                    continue
            found = search(
                gain, q_node, per_q, spacing, first, last, low, high, base, square[v], q_low, q_high, guess, steps,
                answer, n,
            )  # fmt: skip
            if follows and not found:  # once more, below the fold of the whole curve
                alone, fresh = n, low == first and high == last
                low, high = first, last
                continue
            j = stencil(int(answer[n, 6]), first, last)
            there = (answer[n, 0] - q_node[j]) * per_q[j]
            even[v, n] = 1.0 / math.sqrt(answer[n, 3])
            even[v, load.size + n] = 1.0 / at(power_series(spacing, current, j), there)[0]
            n += 1
        if number[v] >= 0:
            stored[number[v]] = answer


@kernel
def _follow_voltages(
    stacks: Stack, i: int, integrals: Integrals, nodes: Nodes, curve: Curve, sums: GapSums, work: Work, q_node: Array,
    per_q: Array, spacing: Spacing, first: int, voltages: Integers, number: Integers, square: Array, most_square: float,
    crest_square: Array, added: Array, p_scale: float, load: Array, highest: float, pulled_in: NDArray[np.bool_],
) -> None:  # fmt: skip
    """The same where the stack changes with the voltage: each answer leads to the next voltage's, without a curve.

    Only where none is near, the curve of that voltage says where V(p_e) turns back.
    """
    h, k_gap, bypass, leak, shift = stacks
    flat, mass, mass_below = integrals
    gain, _, _, answer, stored, even = work
    gap, apart, current, h_scale, out = sums.gap, nodes.apart, curve.admittance, nodes.h_scale, np.empty(LOOKED_UP)
    p_low, p_high = q_node[0] ** 2, q_node[-1] ** 2
    for turn in range(voltages.size):
        v = _begin(turn, voltages, number, answer, stored, even)
        last, reach = -1, math.sqrt(crest_square[v])
        for n in range(load.size):
            base = load[n] + added[v]
            guess = guess_q(even[v, n], base, square[v])
            even[v, n] = even[v, load.size + n] = np.nan
            if not p_low <= base < p_high:
                continue
            found = answer[n, 0] > 0.0
            if found:
                found = follow(
                    flat, mass, mass_below, gap, p_scale, h_scale, h[i, v], k_gap[i, v], bypass[i, v], leak[i, v],
                    shift[i, v], reach, base, square[v], q_node, guess, answer, n, out,
                )  # fmt: skip
            if found:
                q = answer[n, 0]
                beta, per_a, _ = divider(h[i, v], k_gap[i, v], bypass[i, v], leak[i, v], shift[i, v], q * q)
                j = stencil(int(answer[n, 6]), 0, q_node.size - 1)
                off_contact = at(power_series(spacing, apart, j), (q - q_node[j]) * per_q[j])[0]
                density = density_per_v(beta, per_a, k_gap[i, v], off_contact, out, h_scale)
            else:
                if last < 0:
                    last = fill_curve(stacks, i, v, nodes, first, most_square, highest, curve)
                    _cap_curve(curve, sums, first, last, crest_square[v], gain)
                q_high, gain_there = fold(gain, q_node, per_q, spacing, first, last, base)
                if square[v] * gain_there > q_high * q_high - base:
                    pulled_in[v, n] = q_high < q_node[last]
                    answer[n, 0] = -1.0
                    continue
                search(
                    gain, q_node, per_q, spacing, first, last, first, last, base, square[v], math.sqrt(base), q_high,
                    guess, MAX_ITERATIONS, answer, n,
                )  # fmt: skip
                j = stencil(int(answer[n, 6]), first, last)
                density = at(power_series(spacing, current, j), (answer[n, 0] - q_node[j]) * per_q[j])[0]
            even[v, n], even[v, load.size + n] = 1.0 / math.sqrt(answer[n, 3]), 1.0 / density
        if number[v] >= 0:
            stored[number[v]] = answer


@kernel
def _cap_curve(curve: Curve, sums: GapSums, first: int, last: int, crest_square: float, gain: Array) -> None:
    """The gain that a cap leaves of a whole curve."""
    gain[:] = curve.gain
    if crest_square > 0.0:
        met, start = meet_cap(curve, sums, first, last, crest_square)
        if crest_square > met:
            cap_gains(
                curve.gain, curve.x, curve.y_square, curve.openness, sums.gap, sums.mass, sums.mass_below, sums.lost,
                sums.per_whole, start, start, crest_square, first, last, gain,
            )  # fmt: skip


@kernel
def _needed(answer: Array, first: int, last: int) -> tuple[int, int]:
    """Nodes that a search of every load should need, which ends in the last answer's cell or one beside it."""
    low, high = last, first
    for n in range(answer.shape[0]):
        if answer[n, 0] < 0.0:
            return first, last
        low, high = min(low, int(answer[n, 6])), max(high, int(answer[n, 6]))
    return stencil(max(low - 1, first), first, last), stencil(min(high + 1, last - 1), first, last) + 4
