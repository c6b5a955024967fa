"""Measured strokes over a surface -> friction over position: what a texture's profile is made
of.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_driver.errors import BadInputError, require_range
from haptic_driver.fidelity.sliding import since, turns
from haptic_driver.files import bad_input
from haptic_driver.lab.force_signal import FEWEST, SLIDES, ZERO, clipped, count_of, frozen, outliers
from haptic_driver.lab.importers import Asked, Made, profiled
from haptic_driver.signals import SETTLED_M, SLIDING_M_S, Array
from haptic_driver.textures.description import LONGEST_TABLE_ROWS
from haptic_driver.textures.objects import TEXTURE_COF
from model.support.tables import NO_NAMES, Named, Table, read_table

LONGEST_STROKE_ROWS = 300_000  # five minutes at 1 kHz
LEAST_LOAD_N = 0.02  # below, friction would be the ratio of two noises
LEAST_PLACES = 10
PITCH_MM = (0.02, 10.0)
SPEED_WINDOW_S = 0.020  # as wide as a touch screen's two samples
POSITIONS_M = {
    "position_m": 1.0,
    "position_mm": 1e-3,
    "position_um": 1e-6,
}  # columns, and their unit
COLUMNS = [*POSITIONS_M, "normal_force_n", "lateral_force_n", "time_s"]
SEVERAL = "Give each stroke a file of its own, or times that go on from one to the next"
MOSTLY = 0.5  # of the rows
BOTH_WAYS = 0.2  # of the rows that slide: to either side at least
ONE_SIDED = 0.1  # of the lateral force: a zero that strokes to either side show
WANTED = (
    "Columns: position_mm (or position_m), normal_force_n, lateral_force_n, and time_s if there is"
    " one; where they have other names: --column position_mm=NAME"
)


class Strokes(NamedTuple):
    """A finger's strokes: arrays [n]. `lateral_force_n` of either sign, NaN where unknown;
    `speed_m_s` if known. `doubts`: what the file leaves in doubt.
    """

    position_m: Array
    normal_force_n: Array
    lateral_force_n: Array
    speed_m_s: Array | None
    doubts: tuple[str, ...] = ()


class FrictionAlong(NamedTuple):
    """Friction [n] over increasing positions.

    `share_used`: of the rows, those that slide in contact; `widest_gap_m`: the longest way without
    any of them; `speed_m_s`: the median of theirs, NaN where unknown. `doubts`: what the forces
    leave in doubt.
    """

    position_m: Array
    cof: Array
    share_used: float
    widest_gap_m: float
    speed_m_s: float
    doubts: tuple[str, ...]


def read_strokes(path: Path, named: Mapping[str, Named] = NO_NAMES) -> Strokes:
    """The strokes in a CSV file; `named` says what its columns are called there, by our names."""
    known = [*COLUMNS, *(one.column for one in named.values())]
    table = read_table(path, [], WANTED, LONGEST_STROKE_ROWS, known, named=named)
    if not table.rows:
        raise BadInputError("bad_strokes", f"{path}: has no rows", WANTED)
    position = next((column for column in POSITIONS_M if column in named), None)
    if position is None:
        given = [column for column in POSITIONS_M if column in table.columns]
        position = given[0] if given else "position_mm"
    position_m, normal_n, lateral_n = (
        _column(table, column) for column in (position, "normal_force_n", "lateral_force_n")
    )
    time_s = _column(table, "time_s") if "time_s" in table.columns else None
    position_m *= POSITIONS_M[position]
    if time_s is None:
        return Strokes(position_m, normal_n, lateral_n, None)
    with bad_input("bad_strokes"):
        table.require_rising("time_s", time_s, SEVERAL)
    return Strokes(position_m, normal_n, lateral_n, speed_over(time_s, position_m))


def made(source: Path, asked: Asked) -> Made:
    """See `importers`."""
    return over_position(read_strokes(source, asked.named), source, asked)


def over_position(strokes: Strokes, source: Path, asked: Asked, direction_deg: float = 0.0) -> Made:
    """The texture of strokes along a direction; raises as `friction_over_position`."""
    require_range("--pitch-mm", 1e3 * asked.pitch_m, *PITCH_MM, unit=" mm")
    felt = friction_over_position(strokes, asked.pitch_m, str(source))
    doubts = [*strokes.doubts, *felt.doubts]
    found = {
        "share_used": felt.share_used,
        "widest_gap_mm": 1e3 * felt.widest_gap_m,
        "speed_m_s": felt.speed_m_s,
        "length_mm": 1e3 * float(felt.position_m[-1] - felt.position_m[0]),
        "doubts": doubts,
    }
    used = (
        f"{felt.share_used:.1%} of the rows count: they slide in contact; longest way without any"
        f" {found['widest_gap_mm']:.3g} mm"
    )
    words = "; ".join([used, *doubts])
    how: dict[str, Any] = {"direction_deg": direction_deg, "outside": "nothing"}
    how["perceptual_gain"] = asked.perceptual_gain
    return profiled(felt.position_m, felt.cof, words, found, **how)


def _column(table: Table, column: str) -> Array:
    table.require(column)
    return table.numbers(column)


def speed_over(time_s: Array, position_m: Array) -> Array:
    """Speed [n] over a window.

    From row to row, a position in steps would be at rest and then jump.
    """
    before_s, after_s = (
        np.clip(time_s + s, time_s[0], time_s[-1])
        for s in (-SPEED_WINDOW_S / 2, SPEED_WINDOW_S / 2)
    )
    way_m = np.interp(after_s, time_s, position_m) - np.interp(before_s, time_s, position_m)
    return way_m / np.maximum(after_s - before_s, 1e-9)


def friction_over_position(strokes: Strokes, pitch_m: float, where: str) -> FrictionAlong:
    """Friction of sliding contact in places `pitch_m` wide: the sum of lateral forces over the sum
    of loads.

    Strokes to either side count alike, so that a sensor's offset cancels where there are as many of
    both. Where no speed is known, every row in contact counts. Places where nobody slid are left
    out, and where a stroke begins or turns the way over which the skin only stretches. `where`
    names the source in errors. BadInputError where too little slides, where a force is clipped or
    stands still, or what they give is no friction.
    """
    _check_sign(strokes.normal_force_n, where)
    usable = (strokes.normal_force_n >= LEAST_LOAD_N) & np.isfinite(
        strokes.lateral_force_n + strokes.position_m
    )
    if strokes.speed_m_s is not None:
        usable &= np.abs(strokes.speed_m_s) >= SLIDING_M_S
    usable, doubts = _looked(strokes, usable, where)
    usable &= _settled(strokes, usable)
    doubts += _zero(strokes, usable)
    position_m, load_n, lateral_n = (column[usable] for column in strokes[:3])
    places = _places(
        position_m, pitch_m, f"{where}: {position_m.size} of {usable.size} rows slide in contact"
    )
    count = np.bincount(places)
    felt = count > 0
    along_m = np.bincount(places, position_m)[felt] / count[felt]
    cof = np.bincount(places, np.abs(lateral_n))[felt] / np.bincount(places, load_n)[felt]
    for place in np.flatnonzero(~((cof >= TEXTURE_COF[0]) & (cof <= TEXTURE_COF[1]))).tolist():
        said = (
            f"{where}: friction is {cof[place]:.3g} at {1e3 * along_m[place]:.4g} mm, outside"
            f" {TEXTURE_COF}"
        )
        raise BadInputError("bad_strokes", said, "Are both forces in N, and their zeros right?")
    speed_m_s = (
        np.nan if strokes.speed_m_s is None else float(np.median(np.abs(strokes.speed_m_s[usable])))
    )
    gap_m = float(np.diff(along_m).max())
    return FrictionAlong(along_m, cof, float(usable.mean()), gap_m, speed_m_s, tuple(doubts))


def _check_sign(load_n: Array, where: str) -> None:
    """BadInputError where the sensor counts what presses as negative."""
    negative = load_n <= -LEAST_LOAD_N
    if load_n.size and negative.mean() > MOSTLY:
        count = "all" if negative.all() else f"{int(negative.sum())} of {load_n.size}"
        said = f"{where}: {count} loads are negative, {np.median(load_n):.3g} N in the median"
        hint = "Give the force that presses on the surface as positive: change its sign"
        raise BadInputError("bad_strokes", said, hint)


def _looked(
    strokes: Strokes, usable: NDArray[np.bool_], where: str
) -> tuple[NDArray[np.bool_], list[str]]:
    """Rows [n] in which both forces are alive, and what that leaves in doubt.

    BadInputError for a force that is clipped, far outside its own noise, or still for long.
    """
    alive, doubts = usable.copy(), list[str]()
    if not usable.any():
        return alive, doubts
    for name in ("normal_force_n", "lateral_force_n"):
        force_n = getattr(strokes, name)
        if (end := clipped(force_n, usable)) is not None:
            said = f"is clipped at {force_n[end.at]:.4g} N in {end.share:.0%} of its sliding rows"
            raise _refused(strokes, where, name, end.at, said, "Measure again in a wider range")
        still = frozen(force_n) & usable
        at, share = int(np.argmax(still)), float(still.sum() / usable.sum())
        stands = f"stands still at {force_n[at]:.4g} N in {share:.0%} of its sliding rows"
        if share > 1.0 - SLIDES:
            hint = "Leave these rows out, or measure again"
            raise _refused(strokes, where, name, at, stands, hint)
        wrong = np.flatnonzero(usable)[outliers(force_n[usable], count_of(force_n))]
        if wrong.size:
            said = f"is {force_n[wrong[0]]:.4g} N, far outside its own noise"
            raise _refused(strokes, where, name, int(wrong[0]), said, "Leave such rows out")
        if still.any():
            doubts.append(f"{name} {stands}: left out")
            alive &= ~still
    return alive, doubts


def _refused(
    strokes: Strokes, where: str, name: str, row: int, said: str, hint: str
) -> BadInputError:
    place = f"at {1e3 * strokes.position_m[row]:.4g} mm, row {row + 1}"
    return BadInputError("bad_strokes", f"{where}: {name} {said}, {place}", hint)


def _zero(strokes: Strokes, usable: NDArray[np.bool_]) -> list[str]:
    """What the forces say of their zeros: by rows without load, and by strokes to either side."""
    lateral_n, told = strokes.lateral_force_n, list[str]()
    sides = [lateral_n[usable & (sign * lateral_n > 0.0)] for sign in (1.0, -1.0)]
    size_n = float(np.mean(np.abs(lateral_n[usable]))) if usable.any() else 0.0
    free_n = lateral_n[(strokes.normal_force_n < LEAST_LOAD_N) & np.isfinite(lateral_n)]
    if free_n.size >= FEWEST and abs(zero_n := float(np.median(free_n))) > ZERO * size_n:
        told.append(f"without load the lateral force reads {1e3 * zero_n:.3g} mN")
    if usable.any() and min(side.size for side in sides) >= BOTH_WAYS * usable.sum():
        one_n, other_n = (abs(float(np.median(side))) for side in sides)
        if abs(one_n - other_n) > 2.0 * ONE_SIDED * size_n:
            told.append(
                f"the lateral force is {one_n:.3g} N one way and {other_n:.3g} N the other: is its"
                " zero wrong?"
            )
    elif free_n.size < FEWEST:
        told.append("nothing shows the zeros of the forces: no row without load, no way back")
    return told


def _settled(strokes: Strokes, usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Rows [n] that lie a little beyond where the finger set out or turned, as the lateral force
    shows.
    """
    begins = turns(np.where(usable, strokes.lateral_force_n, 0.0))
    return np.asarray(since(strokes.position_m, begins) >= SETTLED_M)


def _places(position_m: Array, pitch_m: float, said: str) -> NDArray[np.intp]:
    """The place of each row, from 0; `said` begins the error where there are too few of them, or
    too many.
    """
    length_m = float(np.ptp(position_m)) if position_m.size else 0.0
    if length_m < LEAST_PLACES * pitch_m:
        hint = (
            f"Record strokes of at least {1e3 * LEAST_PLACES * pitch_m:g} mm, pressed with more"
            f" than {LEAST_LOAD_N:g} N and faster than {1e3 * SLIDING_M_S:g} mm/s"
        )
        raise BadInputError("bad_strokes", f"{said}, over {1e3 * length_m:.3g} mm", hint)
    if length_m > (LONGEST_TABLE_ROWS - 2) * pitch_m:  # and a header
        hint = (
            "Are positions in the unit that their column says? Or give a --pitch-mm above"
            f" {1e3 * pitch_m:g}"
        )
        raise BadInputError("bad_strokes", f"{said}, over {1e3 * length_m:.4g} mm", hint)
    places: NDArray[np.intp] = np.floor((position_m - position_m.min()) / pitch_m).astype(np.intp)
    return places
