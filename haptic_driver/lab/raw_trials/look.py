"""One look at every trial: what in its signals a window cannot mean is told, or refused."""

from __future__ import annotations

from collections.abc import Iterator
from math import log2
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_driver.errors import BadInputError
from haptic_driver.lab.force_signal import (
    FAR,
    FEWEST,
    SLIDES,
    ZERO,
    clipped,
    count_of,
    frozen,
    noise_of,
    outliers,
)
from haptic_driver.lab.raw_trials.quantities import Quantities, given_roles
from haptic_driver.lab.raw_trials.trial_map import TrialMap
from haptic_driver.signals import Array, Mask

TURNED = 0.05  # of the way
FORCES = ("lateral_force", "normal_force")


class Span(NamedTuple):
    """A stretch of a trial's own time."""

    name: str
    start_s: float
    end_s: float


class Doubt(NamedTuple):
    """What a trial's signals leave in doubt: its kind, and where and how much."""

    kind: str
    said: str


class Look(NamedTuple):
    """What is left of a trial after the look: samples [n] that count, and what is to be told."""

    usable: Mask
    doubts: tuple[Doubt, ...]


def look_at(
    found: Quantities, spans: tuple[Span, ...], moving: Mask, said: TrialMap, *, may_turn: bool
) -> Look:
    """Look at the stretches that are used, where the finger moves; BadInputError says what in one
    refuses the trial.
    """
    usable = np.ones(moving.size, bool)
    doubts = list[Doubt]()
    for span in spans:
        inside = within(found, span) & moving
        if inside.sum() < FEWEST:
            continue
        for role in FORCES:
            if role in found.columns:
                _refuse_clipped(found, role, inside, span)  # what is not clipped is no outlier
                still, told = _frozen(found, role, inside, span)
                usable &= _without_outliers(found, role, inside, said, doubts)
                doubts += [Doubt("frozen", f"{told}: left out")] if (still & usable).any() else []
                usable &= ~still
                doubts += _resting(found, role, inside & usable, span)
        doubts += _gaps(found, span)
        _refuse_jump(found, inside, span)
        doubts += [] if may_turn else _turns(found, inside & usable, span, said)
    doubts += _zero(found, spans)
    return Look(usable, tuple(doubts))


def within(found: Quantities, span: Span) -> Mask:
    """The samples [n] of a stretch."""
    time_s = found.columns["time"]
    return np.asarray((time_s >= span.start_s) & (time_s <= span.end_s))


def _refused(found: Quantities, said: str, hint: str) -> BadInputError:
    return BadInputError("doubtful_trial", f"{found.path}: {said}", hint)


# --- samples that are none of the signal


def _without_outliers(
    found: Quantities, role: str, inside: Mask, said: TrialMap, doubts: list[Doubt]
) -> Mask:
    wrong = np.zeros(inside.size, bool)
    whole = found.columns[role]
    wrong[inside] = outliers(whole[inside], count_of(whole))
    if not wrong.any():
        return ~wrong
    at = int(np.argmax(wrong))
    value = found.raw[role][at]
    what = f"{value:g}" if np.isfinite(value) else "no number"
    count = int(wrong.sum())
    told = f"{role} is {what} at {found.place(at)}, far outside its own noise"
    told += f"; {count} samples of {int(inside.sum())} in the window" if count > 1 else ""
    if given_roles(said)[role].outliers == "refuse":
        raise _refused(found, told, f'To go on without them: columns.{role}.outliers = "leave_out"')
    doubts.append(Doubt("outliers", f"{told}: left out"))
    return ~wrong


def _refuse_clipped(found: Quantities, role: str, inside: Mask, span: Span) -> None:
    end = clipped(found.raw[role], inside)
    if end is not None:
        level = f"{found.columns[role][end.at]:.4g} N"
        told = f"{role} is clipped at {level} for {end.share:.0%} of {span.name}"
        hint = "Measure again in a wider range, or choose another window"
        raise _refused(found, f"{told}, from {found.place(end.at)}", hint)


def _frozen(found: Quantities, role: str, inside: Mask, span: Span) -> tuple[Mask, str]:
    """The samples [n] in which a sensor stood still, and in words; BadInputError for too many.

    Where it did throughout, see `_resting`.
    """
    still = frozen(found.raw[role]) & inside
    if still[inside].all():
        return np.zeros(inside.size, bool), ""
    at, share = int(np.argmax(still)), float(still.sum() / inside.sum())
    told = f"{role} stands still at {found.columns[role][at]:.4g} N for {share:.0%} of {span.name}"
    told += f", from {found.place(at)}"
    if share > 1.0 - SLIDES:
        raise _refused(found, told, "Choose another window, or measure again")
    return still, told


def _resting(found: Quantities, role: str, chosen: Mask, span: Span) -> Iterator[Doubt]:
    """What a signal that hardly moves leaves in doubt."""
    whole = found.raw[role]
    values = whole[chosen]
    if values.size < FEWEST:
        return
    noise, elsewhere = noise_of(values), noise_of(whole[~chosen])
    ends = np.array([np.nanmin(whole), np.nanmax(whole)])
    told = f"{role} is {found.columns[role][chosen][0]:.4g} N"
    if np.all(values == values[0]):
        yield Doubt("flat", f"{told} throughout {span.name}: is it measured, or clipped?")
    elif noise < elsewhere / FAR and float(np.abs(ends - np.median(values)).min()) < 5.0 * noise:
        yield Doubt("clipped", f"{told} in {span.name}, with less than 1/{FAR:g} of its noise")


# --- samples that are not there


def _gaps(found: Quantities, span: Span) -> Iterator[Doubt]:
    time_s = found.columns["time"]
    steps_s = np.diff(time_s)
    wide = steps_s > FEWEST * float(np.median(steps_s))
    lost_s = np.minimum(time_s[1:], span.end_s) - np.maximum(time_s[:-1], span.start_s)
    lost_s = np.where(wide, np.maximum(lost_s, 0.0), 0.0)
    share = float(lost_s.sum()) / (span.end_s - span.start_s)
    if not share:
        return
    told = f"{share:.0%} of {span.name} has no samples, from {found.place(int(np.argmax(lost_s)))}"
    if share > 1.0 - SLIDES:
        raise _refused(found, told, "Choose another window, or measure again")
    yield Doubt("gap", told)


# --- the finger's way


def _refuse_jump(found: Quantities, inside: Mask, span: Span) -> None:
    """BadInputError where the position jumps: a counter that wraps, or a lost one."""
    if "position" not in found.columns:
        return
    at = np.flatnonzero(inside)
    steps = np.diff(found.columns["position"][at])
    speed = np.abs(steps) / np.diff(found.columns["time"][at])
    others = speed[speed < 0.5 * speed.max()]
    if not others.size or speed.max() <= FAR * others.max() or not others.max():
        return
    place = int(at[np.argmax(speed) + 1])
    raw = abs(float(found.raw["position"][place] - found.raw["position"][place - 1]))
    told = f"position jumps by {raw:g} (as in the file) in {span.name}, at {found.place(place)}"
    hint = "Choose another window, or measure again"
    if raw > 2.0 and abs(log2(raw) - round(log2(raw))) < 0.1:
        hint = f"A counter that wraps? Say columns.position.unwrap = {2 ** round(log2(raw))}"
    raise _refused(found, told, hint)


def _turns(found: Quantities, chosen: Mask, span: Span, said: TrialMap) -> Iterator[Doubt]:
    at = _turn(found, chosen)
    if at is None:
        return
    told = f"the finger turns in {span.name}, at {found.place(at)}"
    if said.motion is None or said.motion.turns == "refuse":
        hint = "Choose a window within one stroke"
        known = {"position", "speed"} & set(found.columns)
        hint += ', or say motion.turns = "sign" to count both ways' if known else ""
        raise _refused(found, told, hint)
    yield Doubt("turn", f"{told}: lateral force counts against its way")


def _turn(found: Quantities, chosen: Mask) -> int | None:
    """The sample at which the finger turns, by its way; without one, by the sign of its force."""
    places = np.flatnonzero(chosen)
    way = _way(found, chosen)
    if way is None:
        return _turn_by_force(found.columns["lateral_force"], places)
    noise = float(np.median(np.abs(np.diff(way, 2)))) if way.size > 2 else 0.0
    backs = [np.maximum.accumulate(each) - each for each in (way, -way)]
    back = min(backs, key=np.max)
    if back.max() <= max(TURNED * float(np.ptp(way)), FAR * noise):
        return None
    return int(places[np.flatnonzero(back[: np.argmax(back)] == 0.0)[-1]])


def _way(found: Quantities, chosen: Mask) -> Array | None:
    if "position" in found.columns:
        return found.columns["position"][chosen]
    if "speed" in found.columns:
        step_s = np.gradient(found.columns["time"])
        return np.asarray(np.cumsum(found.columns["speed"] * step_s)[chosen])
    return None


def _turn_by_force(lateral_n: Array, places: NDArray[np.intp]) -> int | None:
    """Where steady lateral force changes its sign, both signs being as strong as each other."""
    blocks = np.array_split(places, FEWEST)
    means = np.array([np.mean(lateral_n[block]) for block in blocks])
    if -means.min() * means.max() <= 0.0 or min(-means.min(), means.max()) < 0.25 * np.ptp(means):
        return None
    changed = np.flatnonzero(np.diff(np.sign(means)))
    return int(blocks[changed[0] + 1][0])


# --- zero


def without_load(load_n: Array) -> Mask:
    """Samples [n] at which the load is nearer to none than to that of the touch."""
    return np.asarray(load_n < 0.5 * np.nanpercentile(load_n, 95.0))


def _zero(found: Quantities, spans: tuple[Span, ...]) -> Iterator[Doubt]:
    """What the lateral force reads before and after the touch, where the load tells that."""
    if "normal_force" not in found.columns or not spans:
        return
    load_n, lateral_n = (found.columns[role] for role in ("normal_force", "lateral_force"))
    touches = np.flatnonzero(~without_load(load_n))
    if not touches.size:
        return
    before, after = lateral_n[: touches[0]], lateral_n[touches[-1] + 1 :]
    levels = [float(np.nanmedian(part)) for part in (before, after) if part.size >= FEWEST]
    used = np.any([within(found, span) for span in spans], axis=0)
    force_n = float(np.nanmean(np.abs(lateral_n[used]))) if used.any() else 0.0
    if not levels or max(map(abs, levels)) <= ZERO * force_n:
        return
    said = " and ".join(f"{1e3 * level:.3g}" for level in levels)
    when = "before and after" if len(levels) == 2 else "before" if before.size else "after"
    yield Doubt("zero", f"without load the lateral force reads {said} mN, {when} the touch")
