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

from model.between import SMOOTH, Between, between, fill_between, rough_places, twice
from model.chain import PreparedTouch
from model.compiled import copy, kernel, uncounted
from model.contact import area_ratio
from model.current import density_per_v
from model.dielectrics import Array
from model.equilibria import (
    ANSWER,
    FEW_STEPS,
    LEAP,
    Spacing,
    at,
    cell_of,
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
    Flags,
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
from model.gap_table import GapTable
from model.pressure import MAX_ITERATIONS, divider

ROW_STRIDE, VOLTAGE_STRIDE = 2, 4  # from one that is solved first to the next
LED = 4  # voltages that lead to the next: a cubic
NODES_PER_ROW = 2  # of the table: pressures on a curve; of fourth order between them


class Integrals(NamedTuple):
    """What single conditions need of a `GapTable`."""

    flat: Array
    mass: Array
    mass_below: Array


class Remaining(NamedTuple):
    """What is left to solve of columns [c] at places on an axis: `wanted` [k, c], the `places` with any, and `uneven`.

    Work arrays of `between.py`, see there.
    """

    wanted: Flags
    places: Integers
    uneven: Flags


class Work(NamedTuple):
    """Work arrays of one row.

    `gain` [j] at one voltage; `end`, `end_gain`: fold per load; `answer` [n] as in `search`. Of each equilibrium [v, n]
    `per_root`, 1/sqrt(gain), and `per_admittance`, which change most evenly with the voltage; before that a guess, or
    NaN. `remaining` is what is left to solve.
    """

    gain: Array
    end: Array
    end_gain: Array
    answer: Array
    per_root: Array
    per_admittance: Array
    remaining: Remaining


@dataclass(frozen=True)
class GridSolution:
    """A solved surface [frequency, voltage, load].

    `electrostatic_pressure_pa` in Pa, NaN where there is no equilibrium in range; `admittance_per_m` is
    |current density/(j w eps0 V)|; `pulled_in` marks points past the fold of V(p_e), where the contact pulls in.
    """

    electrostatic_pressure_pa: Array
    admittance_per_m: Array
    pulled_in: Flags


def solve_grid(table: GapTable, touch: PreparedTouch, load_pa: Array, smooth: float = SMOOTH) -> GridSolution:
    """Every frequency and voltage of `touch`, of shape (..., r, v) with voltage rising, under all of rising `load_pa`.

    The rows r are frequencies, or speeds at each frequency before them. For touches without bias and of one roughness;
    their own loads are ignored. Answers are [..., r, v, n]. `smooth`: see `between`, along the rows.
    """
    circuit, by_row = touch.circuit, (-1, touch.shape[-1])
    square, crest, added, limit, p_scale = (
        x.reshape(by_row)
        for x in (
            circuit.mean_square_v2, circuit.crest_square, circuit.added_pa, circuit.field_limit_v_per_m,
            circuit.pressure_scale_pa,
        )
    )  # fmt: skip
    h, k_gap, bypass, leak = (
        x.reshape(by_row) for x in (circuit.h_m, circuit.k_gap, circuit.bypass_per_m, circuit.leak_per_m_pa)
    )
    stacks = Stack(h, k_gap, bypass, leak, circuit.gap_shift_m.reshape(by_row))
    refined, h_scale, has_cap = table.refined(NODES_PER_ROW), circuit.length_scale_m[0], bool(np.isfinite(limit).any())
    p_hat = refined.p_hat
    p, q, per_q = np.empty((3, p_hat.size))
    nodes = Nodes(p_hat, p, q, per_q, 1.0 - area_ratio(table.shape, p_hat), refined.flat, h_scale)
    shape = (*square.shape, load_pa.size)
    (pressure, admittance), pulled_in = np.empty((2, *shape)), np.zeros(shape, dtype=np.bool_)
    along_r, along_v = between(touch.shape[-2], ROW_STRIDE, smooth), twice(touch.shape[-1], VOLTAGE_STRIDE)
    _solve_grid(
        stacks, nodes, make_curve(p_hat.size), make_gap_sums(refined),
        Integrals(table.flat, table.mass, table.mass_below), bends(stacks), to_series(np.sqrt(p_hat)), along_r, along_v,
        _make_remaining(along_r, pressure[0].size), _make_work(p_hat.size, along_v[1], load_pa.size), square,
        crest * np.abs(square) / limit**2, added, p_scale[:, 0], has_cap, load_pa, pressure, admittance, pulled_in,
    )  # fmt: skip
    whole = (*touch.shape, load_pa.size)
    return GridSolution(pressure.reshape(whole), admittance.reshape(whole), pulled_in.reshape(whole))


def bends(stacks: Stack) -> Flags:
    """Whether the stack changes with the voltage, in each row [r]."""
    return np.asarray(np.any([np.any(x != x[:, :1], axis=1) for x in stacks], axis=0))


def _make_remaining(along: Between, columns: int) -> Remaining:
    """Empty work arrays."""
    places = along.weight.shape[0]
    wanted, uneven = (np.empty((count, columns), dtype=np.bool_) for count in (places, len(along.miss)))
    return Remaining(wanted, np.empty(places, dtype=np.int64), uneven)


def _make_work(pressures: int, along_v: Between, loads: int) -> Work:
    """Empty work arrays; an answer's last cell is asked for before there is one."""
    per_root, per_admittance = np.empty((2, along_v.weight.shape[0], loads))
    return Work(
        np.empty(pressures), np.empty(loads), np.empty(loads), np.zeros((loads, ANSWER)), per_root, per_admittance,
        _make_remaining(along_v, loads),
    )  # fmt: skip


@uncounted
def _solve_grid(
    stacks: Stack, nodes: Nodes, curve: Curve, sums: GapSums, integrals: Integrals, bent: Flags, spacing: Spacing,
    along_r: Between, along_v: tuple[Between, Between], remaining: Remaining, work: Work, square: Array,
    crest_square: Array, added: Array, p_scale: Array, has_cap: bool, load: Array, pressure: Array, admittance: Array,
    pulled_in: Flags,
) -> None:  # fmt: skip
    """Some rows of each axis of them, those between, and from gains to pressures.

    `bent` [r] as of `bends`; `crest_square` [r, v]: (peak voltage over the field's cap)^2, m^2. Until the end pressure
    and admittance hold `Work.per_root` and `Work.per_admittance`.
    """
    rows, voltages, loads = pressure.shape
    length, columns, scale = remaining.places.size, voltages * loads, 0.0
    for start in range(0, rows, length):
        which = along_r.solved
        for attempt in range(2):
            for r in which:
                i = start + r
                if p_scale[i] != scale:
                    scale = p_scale[i]
                    _lay_nodes(nodes, scale)
                guessed = attempt > 0 and bent[i]  # else a curve answers for the whole row
                if guessed:
                    copy(pressure[i], work.per_root)
                    copy(admittance[i], work.per_admittance)
                    copy(remaining.wanted[r], work.remaining.wanted)
                _solve_row(
                    stacks, i, nodes, curve, sums, integrals, bent[i], guessed, work, spacing, along_v, square[i],
                    crest_square[i], added[i], scale, has_cap, load, pulled_in[i],
                )  # fmt: skip
                copy(work.per_root, pressure[i])
                copy(work.per_admittance, admittance[i])
            if attempt == 0:
                axis = slice(start, start + length)
                values = pressure[axis].reshape(length, columns), admittance[axis].reshape(length, columns)
                which = remaining.places[: _fill(along_r, *values, remaining)]
    for i in range(rows):
        for v in range(voltages):
            for n in range(loads):
                pressure[i, v, n] = square[i, v] / (pressure[i, v, n] * pressure[i, v, n])
                admittance[i, v, n] = 1.0 / admittance[i, v, n]


@kernel
def _fill(way: Between, per_root: Array, per_admittance: Array, remaining: Remaining) -> int:
    """Fill in what is between, list the places that remain to be solved, and count them."""
    uneven = remaining.uneven[: way.miss.shape[0]]
    uneven[:] = False
    fill_between(way, per_root, uneven)
    fill_between(way, per_admittance, uneven)
    return rough_places(way, uneven, remaining.wanted, remaining.places)


@kernel
def _solve_row(
    stacks: Stack, i: int, nodes: Nodes, curve: Curve, sums: GapSums, integrals: Integrals, bent: bool, guessed: bool,
    work: Work, spacing: Spacing, along_v: tuple[Between, Between], square: Array, crest_square: Array, added: Array,
    p_scale: float, has_cap: bool, load: Array, pulled_in: Flags,
) -> None:  # fmt: skip
    """Some voltages of one row under every load, and those between; where all is `guessed`, what is wanted only."""
    (least, most), (_, most_square), (_, most_crest) = _range(added), _range(square), _range(crest_square)
    highest = load[-1] + most
    first = node_below(nodes.q, math.sqrt(load[0] + least))
    last, met, start, level = nodes.q.size - 1, np.inf, 0, 0
    if not bent:
        last = fill_curve(stacks, i, 0, nodes, first, most_square, highest, curve)
        if has_cap:
            met, start = meet_cap(curve, sums, first, last, most_crest)
    which = along_v[0].solved
    if guessed:
        level, which = len(along_v), work.remaining.places[: _any_wanted(work.remaining)]
    else:
        work.remaining.wanted[:] = True
    while which.size > 0:
        if bent:
            _follow_voltages(
                stacks, i, integrals, nodes, curve, sums, work, spacing, first, which, level > 0, square, most_square,
                crest_square, added, p_scale, load, highest, pulled_in,
            )  # fmt: skip
        else:
            _solve_voltages(
                nodes, curve, sums, work, spacing, first, last, which, level > 0, square, crest_square, added, least,
                has_cap, met, start, load, pulled_in,
            )  # fmt: skip
        if level == len(along_v):
            break
        which = work.remaining.places[: _fill(along_v[level], work.per_root, work.per_admittance, work.remaining)]
        level += 1


@kernel
def _range(values: Array) -> tuple[float, float]:
    """The least and the greatest."""
    low = high = values[0]
    for value in values:
        low, high = min(low, value), max(high, value)
    return low, high


@kernel
def _any_wanted(remaining: Remaining) -> int:
    """List the places at which something is wanted, and count them."""
    count = 0
    for v in range(remaining.places.size):
        found = False
        for n in range(remaining.wanted.shape[1]):
            found |= remaining.wanted[v, n]
        if found:
            remaining.places[count] = v
            count += 1
    return count


@kernel
def _lay_nodes(nodes: Nodes, p_scale: float) -> None:
    """The pressures of the curves for another stiffness."""
    for j in range(nodes.p.size):
        nodes.p[j] = nodes.p_hat[j] * p_scale
        nodes.q[j] = math.sqrt(nodes.p[j])
    for j in range(nodes.p.size - 1):
        nodes.per_q[j] = 1.0 / (nodes.q[j + 1] - nodes.q[j])


@kernel
def _lead_on(turn: int, voltages: Integers, even: Array) -> None:
    """A guess of what is `even` [v, n] at the voltage of a turn, from the last ones; NaN where there are too few."""
    v = voltages[turn]
    even[v] = np.nan
    if turn >= LED and v - voltages[turn - LED] == LED * (v - voltages[turn - 1]):  # evenly spaced
        v1, v2, v3, v4 = voltages[turn - 1], voltages[turn - 2], voltages[turn - 3], voltages[turn - 4]
        for n in range(even.shape[1]):
            even[v, n] = 4.0 * (even[v1, n] + even[v3, n]) - 6.0 * even[v2, n] - even[v4, n]


@kernel
def _start_from_guesses(
    v: int, per_root: Array, square: Array, added: Array, load: Array, q_node: Array, answer: Array
) -> None:
    """As the last answers of every load those that the guesses around the voltage `v` stand for; none without."""
    before, after = max(v - 1, 0), min(v + 1, square.size - 1)
    for n in range(load.size):
        base = load[n] + added[v]
        q, gain = guess_q(per_root[v, n], base, square[v]), 1.0 / (per_root[v, n] * per_root[v, n])
        q_before = guess_q(per_root[before, n], load[n] + added[before], square[before])
        q_after = guess_q(per_root[after, n], load[n] + added[after], square[after])
        compliance = (q_after - q_before) / (gain * (square[after] - square[before]))
        answer[n, 0], answer[n, 1], answer[n, 2] = q if q > 0.0 else -1.0, base, square[v]
        answer[n, 3], answer[n, 4] = gain, compliance if compliance > 0.0 else 0.5 / q
        answer[n, 5], answer[n, 6] = 0.0, cell_of(q_node, q, int(answer[n, 6]), 0, q_node.size - 1)


@kernel
def _begin(
    turn: int, voltages: Integers, guessed: bool, work: Work, square: Array, added: Array, load: Array, q_node: Array
) -> int:
    """The voltage of a turn, with guesses, and the answers that it starts from."""
    v = int(voltages[turn])
    if guessed:
        _start_from_guesses(v, work.per_root, square, added, load, q_node, work.answer)
        return v
    if v == 0:
        for n in range(load.size):
            base, answer = load[n] + added[0], work.answer[n]
            q = math.sqrt(base)
            answer[0], answer[1], answer[2], answer[3], answer[4], answer[5] = q, base, 0.0, 0.0, 0.5 / q, 0.0
            answer[6] = cell_of(q_node, q, 0, 0, q_node.size - 1)
    _lead_on(turn, voltages, work.per_root)
    return v


@kernel
def _solve_voltages(  # noqa: PLR0912, PLR0915 (one visible algorithm)
    nodes: Nodes, curve: Curve, sums: GapSums, work: Work, spacing: Spacing, first: int, last: int, voltages: Integers,
    guessed: bool, square: Array, crest_square: Array, added: Array, least: float, has_cap: bool, met: float,
    start: int, load: Array, pulled_in: Flags,
) -> None:  # fmt: skip
    """<V^2>(p_e) = <V^2> at some `voltages` of one frequency, inverted by Newton's method within the rising part.

    `guessed`: from guesses, and what is wanted only. The cap is met where `crest_square` [v] is above `met`, in gaps
    from number `start` on. `least` of the pressure `added`.
    """
    gain, end, end_gain, answer, per_root, per_admittance, remaining = work
    uncapped, current, x, y_square, openness, _ = curve
    q_node, per_q, wanted = nodes.q, nodes.per_q, remaining.wanted
    gap, mass, mass_below, lost, per_whole = sums
    p_low, p_high, reach, was_capped = q_node[0] ** 2, q_node[-1] ** 2, start, False
    for turn in range(voltages.size):
        v = _begin(turn, voltages, guessed, work, square, added, load, q_node)
        is_capped = has_cap and crest_square[v] > met
        low, high, fresh = first, last, turn > 0 and not is_capped and not was_capped
        was_capped = is_capped
        if is_capped:
            low, high = _needed(answer, first, last)
        n, alone, guess = 0, -1, 0.0
        while n < load.size:
            if not wanted[v, n]:
                n += 1
                continue
            if not fresh:
                if is_capped:
                    reach = cap_gains(
                        uncapped, x, y_square, openness, gap, mass, mass_below, lost, per_whole, start, reach,
                        crest_square[v], low, high, gain,
                    )  # fmt: skip
                else:
                    copy(uncapped, gain)
                fresh = True
            base, before = load[n] + added[v], answer[n, 0]
            if alone != n:
                guess = guess_q(per_root[v, n], base, square[v])
                per_root[v, n] = per_admittance[v, n] = np.nan
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
            per_root[v, n] = 1.0 / math.sqrt(answer[n, 3])
            per_admittance[v, n] = 1.0 / at(power_series(spacing, current, j), there)[0]
            n += 1


@kernel
def _follow_voltages(
    stacks: Stack, i: int, integrals: Integrals, nodes: Nodes, curve: Curve, sums: GapSums, work: Work,
    spacing: Spacing, first: int, voltages: Integers, guessed: bool, square: Array, most_square: float,
    crest_square: Array, added: Array, p_scale: float, load: Array, highest: float, pulled_in: Flags,
) -> None:  # fmt: skip
    """The same where the stack changes with the voltage: each answer leads to the next voltage's, without a curve.

    Only where none is near, the curve of that voltage says where V(p_e) turns back.
    """
    h, k_gap, bypass, leak, shift = stacks
    flat, mass, mass_below = integrals
    gain, _, _, answer, per_root, per_admittance, remaining = work
    q_node, per_q, wanted = nodes.q, nodes.per_q, remaining.wanted
    gap, apart, current, h_scale, out = sums.gap, nodes.apart, curve.admittance, nodes.h_scale, curve.looked_up
    p_low, p_high = q_node[0] ** 2, q_node[-1] ** 2
    for turn in range(voltages.size):
        v = _begin(turn, voltages, guessed, work, square, added, load, q_node)
        last, reach = -1, math.sqrt(crest_square[v])
        for n in range(load.size):
            if not wanted[v, n]:
                continue
            base = load[n] + added[v]
            guess = guess_q(per_root[v, n], base, square[v])
            per_root[v, n] = per_admittance[v, n] = np.nan
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
            per_root[v, n], per_admittance[v, n] = 1.0 / math.sqrt(answer[n, 3]), 1.0 / density


@kernel
def _cap_curve(curve: Curve, sums: GapSums, first: int, last: int, crest_square: float, gain: Array) -> None:
    """The gain that a cap leaves of a whole curve."""
    copy(curve.gain, gain)
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
