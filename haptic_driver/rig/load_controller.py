"""How a stage holds the load of a finger: readings -> orders to the stage.

Pure: no clock, no device. Every order is one short move that ends by itself. So a stage whose
driver has died finishes at most `step_m`, or up to three times that on a softer finger, and rests.
Depth is the stage's position towards the finger, m.

A move has two terms. The first is the share `gain` of the way that the finger's stiffness asks for
(feed-forward). The second is the drift of place that keeps the load. It is the integral of the
error, for a plate that is not level and tissue that relaxes. The stiffness rises with the load as
for a sphere on a plane (Hertz, load over indentation with exponent 1.5). How much stiffer or softer
this finger is than the settings say shows while its load rises: by how far the stage had to go.

The sensor is believed by its answers, for a dead one may say anything. While the load rises, the
stage is never ahead of the softest finger's answers by more than `unanswered_m`. Once it has risen,
the stage goes on by `drift_m` at most. In the air nothing answers, so the way to the first touch is
bounded.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from hw.health import REPEATS_S

STIFFNESS_AT_N = 0.5  # the load at which a finger's stiffness is given
OVERLOAD = 1.5  # times the target
RISEN = 0.8  # of the target: from then on the pulse tells more than the way
# Some fingers stiffen more than a sphere on a plane, and all are stiffer in an instant.
MARGIN = 1.2
STIFFER = 3.0  # times stiffer or softer than the settings say, at most
LEAST_WAY_M = 0.15e-3  # ten times what a tremor moves
SHOWN = 0.1  # of the load: what is left of a sensor that lost its gain
ROUNDING_M = 1e-6  # a stage stands within a few counts of where it was sent
ARRIVED_M = 10e-6  # a stage so near is where it was sent
STALLED_S = 0.5  # without a step on its way, which no stage needs to gather speed


class Phase(enum.Enum):
    """What the load stage is doing."""

    APPROACH = "approach"
    HOLD = "hold"
    ENDED = "ended"


class Act(enum.Enum):
    """The orders to the stage."""

    NOTHING = "nothing"
    MOVE = "move"
    STOP = "stop"
    RETRACT = "retract"


@dataclass(frozen=True)
class LoadSettings:
    """How the load is held; the gains are those that `haptic load tune` finds. ValueError for
    numbers that make no loop.

    `drift_per_s` is the integral gain. `depth_m` bounds the way after the first touch, `reach_m`
    the way until it, `step_m` and `rate_m_s` each move. On a softer finger `step_m` is more, so
    that it brings the same load. `softest_n_per_m` is the stiffness of the softest finger that is
    pressed here. `drift_m` is how far tissue and plate may carry a finger, while it is held or from
    one touch to the next. A sensor that gives one number for `repeats_s` is not believed: a
    finger's load is never so still, and no sensor is without noise. `retracts`: whether the stage
    lifts off or stays where it is when something is wrong.
    """

    target_n: float
    stiffness_n_per_m: float = 700.0
    softest_n_per_m: float = 700.0
    gain: float = 0.45
    drift_per_s: float = 2.0
    drift_limit_m_s: float = 1e-3
    rate_m_s: float = 5e-3
    step_m: float = 0.35e-3
    depth_m: float = 3e-3
    drift_m: float = 0.8e-3
    reach_m: float = 3e-3
    approach_m_s: float = 1e-3
    approach_step_m: float = 0.15e-3
    touch_n: float = 0.05
    load_limit_n: float = 3.0
    silent_s: float = 0.1
    repeats_s: float = REPEATS_S
    retracts: bool = True

    def __post_init__(self) -> None:
        """Refuse what cannot be a loop."""
        for name, value in vars(self).items():
            if name != "retracts" and not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"load {name} must be a finite number > 0, not {value!r}")
        if not self.touch_n < self.target_n < self.load_limit_n:
            raise ValueError(
                f"a load of {self.target_n:g} N must be above the first touch,"
                f" {self.touch_n:g} N, and below the limit, {self.load_limit_n:g} N"
            )
        if self.gain > 1.0:
            raise ValueError(f"load gain must be at most 1, not {self.gain:g}")

    @property
    def trip_n(self) -> float:
        """The load at which the stage lets go."""
        return min(OVERLOAD * self.target_n, self.load_limit_n)

    def way_m(self, from_n: float, to_n: float, stiffer: float = 1.0) -> float:
        """How much deeper a finger so many times as stiff has to be for `to_n` than for
        `from_n`.
        """
        soft_m = 1.5 * STIFFNESS_AT_N / (stiffer * self.stiffness_n_per_m)

        def depth_m(load_n: float) -> float:
            return soft_m * math.pow(max(load_n, 0.0) / STIFFNESS_AT_N, 2.0 / 3.0)

        return depth_m(to_n) - depth_m(from_n)

    @property
    def softest(self) -> float:
        """The softest finger's stiffness as a share of the usual one."""
        return self.softest_n_per_m / self.stiffness_n_per_m

    @property
    def unanswered_m(self) -> float:
        """How far the stage may be ahead of the softest finger's answers.

        So far that the stiffest finger bears the limit when a sensor shows `SHOWN` of it. But no
        less than the least way that tells something.
        """
        pressed_m = self.way_m(self.touch_n / SHOWN, self.load_limit_n, STIFFER)
        answered_m = self.way_m(self.touch_n, SHOWN * self.load_limit_n, self.softest)
        return max(pressed_m - answered_m, LEAST_WAY_M)


class Seen(NamedTuple):
    """The newest load with its age, and where the stage is. `load_n` is None where the sensor
    failed, `depth_m` where the stage did.
    """

    time_s: float
    load_n: float | None
    load_age_s: float
    saturated: bool
    depth_m: float | None
    moving: bool
    same_s: float = 0.0  # for so long the load has been the same to the last digit


class Felt(NamedTuple):
    """A load that the sensor felt where the stage was."""

    depth_m: float
    load_n: float


class Order(NamedTuple):
    """An order to the stage; for a MOVE, where to and how fast at most."""

    act: Act
    depth_m: float = math.nan
    speed_m_s: float = math.nan


NOTHING = Order(Act.NOTHING)


@dataclass(frozen=True)
class LoadState:
    """What the controller remembers; `reason` says why it ended."""

    phase: Phase = Phase.APPROACH
    reason: str = ""
    clear_s: float = -math.inf  # since when the stage stands clear: older readings tell nothing
    last_m: float | None = None  # where the finger was felt the last time
    start_m: float | None = None  # where the approach began, with nothing felt
    touch: Felt | None = None  # the first touch
    risen: Felt | None = None  # most of the load
    stiffer: float = 1.0  # than the settings say, as seen while the load rose
    drift_m_s: float = 0.0
    moved_s: float | None = None  # when the last move was ordered
    sent_m: float | None = None  # where to
    doubted_s: float | None = None  # since when the stage rests where it wants an answer
    followed_m: float = math.nan  # where the stage was when it last went on, or had arrived
    followed_s: float = math.nan  # and when
    # When anybody last looked, which decides nothing by itself.
    seen_s: float | None = field(default=None, compare=False)


Step = tuple[LoadState, Order]


def step(settings: LoadSettings, state: LoadState, seen: Seen) -> Step:
    """One look at sensor and stage: the new state, and the order to the stage."""
    if state.phase is Phase.ENDED:
        return state, NOTHING
    state = _looked(settings, state, seen)
    if wrong := wrong_load(settings, seen) or _wrong_place(settings, state, seen):
        return _ended(settings, state, wrong)
    assert seen.load_n is not None  # or something is wrong
    assert seen.depth_m is not None
    state = _followed(state, seen, seen.depth_m)
    if seen.moving:
        return state, NOTHING
    follow = _approach if state.phase is Phase.APPROACH else _hold
    return follow(settings, state, seen, Felt(seen.depth_m, seen.load_n))


def _looked(settings: LoadSettings, state: LoadState, seen: Seen) -> LoadState:
    """Time in which a late machine let nobody look tells nothing of the stage."""
    since_s = 0.0 if state.seen_s is None else seen.time_s - state.seen_s
    unseen_s = max(since_s - settings.silent_s, 0.0)
    return replace(state, seen_s=seen.time_s, followed_s=state.followed_s + unseen_s)


def _ended(settings: LoadSettings, state: LoadState, wrong: str) -> Step:
    act = Act.RETRACT if settings.retracts else Act.STOP
    return replace(state, phase=Phase.ENDED, reason=wrong), Order(act)


def wrong_load(settings: LoadSettings, seen: Seen) -> str:
    """Why the stage has to let go by what the sensor says; empty while nothing is wrong."""
    if seen.load_n is None:
        return "the force sensor is silent"
    if seen.saturated or not math.isfinite(seen.load_n):
        return "the force sensor is saturated"
    if not seen.load_age_s <= settings.silent_s:
        return f"the force sensor is silent (its newest reading is {seen.load_age_s:.2f} s old)"
    if seen.same_s >= settings.repeats_s:
        return f"the force sensor is frozen, it repeats {seen.load_n:.4g} N"
    return _wrong_force(settings, seen.load_n)


def _wrong_force(settings: LoadSettings, load_n: float) -> str:
    if load_n <= -settings.touch_n:
        return f"the force sensor reads {load_n:.2f} N, its zero or its sign is wrong"
    if load_n >= settings.trip_n:
        return f"the load is {load_n:.2f} N, its limit {settings.trip_n:.2f} N"
    return ""


def _wrong_place(settings: LoadSettings, state: LoadState, seen: Seen) -> str:
    """The same by where the stage is."""
    if seen.depth_m is None:
        return "the load stage does not answer"
    if state.touch is not None:
        if seen.depth_m - state.touch.depth_m >= settings.depth_m - ROUNDING_M:
            return f"the load is not reached within {1e3 * settings.depth_m:.1f} mm"
    elif state.start_m is not None:
        way_m = _reach_m(settings, state, state.start_m) - state.start_m
        if seen.depth_m - state.start_m >= way_m - ROUNDING_M:
            return f"no finger is felt within {1e3 * way_m:.1f} mm"
    if _goes(state, seen, seen.depth_m) or seen.time_s - state.followed_s <= STALLED_S:
        return ""
    if seen.moving or state.sent_m is None:
        return "the load stage says that it moves, and rests"
    return f"the load stage rests {1e3 * abs(seen.depth_m - state.sent_m):.2f} mm from its target"


def _reach_m(settings: LoadSettings, state: LoadState, start_m: float) -> float:
    """So deep a finger is looked for: nothing answers in the air."""
    reach_m = start_m + settings.reach_m
    return reach_m if state.last_m is None else min(reach_m, state.last_m + settings.drift_m)


def _goes(state: LoadState, seen: Seen, depth_m: float) -> bool:
    """Whether the stage rests where it was sent, or has come on since it last was seen to."""
    if not seen.moving and (state.sent_m is None or abs(depth_m - state.sent_m) <= ARRIVED_M):
        return True
    return not abs(depth_m - state.followed_m) <= ROUNDING_M


def _followed(state: LoadState, seen: Seen, depth_m: float) -> LoadState:
    if not _goes(state, seen, depth_m):
        return state
    return replace(state, followed_m=depth_m, followed_s=seen.time_s)


def _approach(settings: LoadSettings, state: LoadState, seen: Seen, felt: Felt) -> Step:
    if seen.time_s - seen.load_age_s < state.clear_s:
        return state, NOTHING
    if felt.load_n >= settings.touch_n:
        if state.start_m is None:
            return _ended(settings, state, f"{felt.load_n:.2f} N are felt where the finger is free")
        held = replace(state, phase=Phase.HOLD, touch=felt, moved_s=None)
        return _hold(settings, held, seen, felt)
    start_m = felt.depth_m if state.start_m is None else state.start_m
    to_m = min(felt.depth_m + settings.approach_step_m, _reach_m(settings, state, start_m))
    state = replace(state, start_m=start_m, moved_s=seen.time_s, sent_m=to_m)
    return state, Order(Act.MOVE, to_m, settings.approach_m_s)


def _hold(settings: LoadSettings, state: LoadState, seen: Seen, felt: Felt) -> Step:
    dt_s = 0.0 if state.moved_s is None else seen.time_s - state.moved_s
    touch = state.touch or felt
    state = _risen(settings, state, touch, felt)
    bound_m = min(_answered_m(settings, state, touch, felt), touch.depth_m + settings.depth_m)
    if felt.depth_m >= bound_m - ROUNDING_M:
        return _doubted(settings, state, seen, touch, felt)
    if state.start_m is not None and felt.depth_m < state.start_m - ROUNDING_M:
        return _ended(settings, state, f"{felt.load_n:.2f} N are felt where the finger was free")
    missing_m = settings.way_m(felt.load_n, settings.target_n, state.stiffer)
    drift_m_s = state.drift_m_s + settings.gain * settings.drift_per_s * missing_m * dt_s
    drift_m_s = _within(drift_m_s, settings.drift_limit_m_s)
    wanted_m = settings.gain * missing_m + drift_m_s * dt_s
    bounded_m = _within(wanted_m, settings.step_m / min(state.stiffer, 1.0))
    to_m = min(felt.depth_m + bounded_m, bound_m)
    if bounded_m != wanted_m or to_m != felt.depth_m + bounded_m:
        drift_m_s = state.drift_m_s  # what a bound takes away is not added up
    told = replace(state, drift_m_s=drift_m_s, moved_s=seen.time_s, sent_m=to_m, doubted_s=None)
    return told, Order(Act.MOVE, to_m, settings.rate_m_s)


def _answered_m(settings: LoadSettings, state: LoadState, touch: Felt, felt: Felt) -> float:
    """So deep the stage may go on what the sensor has answered.

    While the load rises: a little ahead of the softest finger. Then: as far as tissue and plate
    drift, but not to where this finger would bear the limit.
    """
    if state.risen is None:
        needed_m = settings.way_m(touch.load_n, felt.load_n, settings.softest)
        return touch.depth_m + needed_m + settings.unanswered_m
    drift_m = settings.way_m(settings.target_n, settings.load_limit_n, state.stiffer)
    needed_m = settings.way_m(state.risen.load_n, felt.load_n, state.stiffer)
    return state.risen.depth_m + needed_m + min(settings.drift_m, drift_m)


def _doubted(settings: LoadSettings, state: LoadState, seen: Seen, touch: Felt, felt: Felt) -> Step:
    """End where the stage has gone too far for its answers, by a reading taken since it rests."""
    if state.doubted_s is None or seen.time_s - seen.load_age_s <= state.doubted_s:
        doubted_s = seen.time_s if state.doubted_s is None else state.doubted_s
        return replace(state, doubted_s=doubted_s), NOTHING
    since, key = (touch, "softest_n_per_m") if state.risen is None else (state.risen, "drift_m")
    gone_mm = 1e3 * (felt.depth_m - since.depth_m)
    said = f"{felt.load_n:.2f} N are too little {gone_mm:.2f} mm deeper"
    why = f"the force sensor does not answer, or the finger is soft or gone; see {key}"
    return _ended(settings, state, f"{said}: {why}")


def _risen(settings: LoadSettings, state: LoadState, touch: Felt, felt: Felt) -> LoadState:
    """The finger's stiffness from how far the stage went for the load so far, until most of the
    load is there.
    """
    moved_m = felt.depth_m - touch.depth_m
    if state.risen is not None or moved_m < LEAST_WAY_M or felt.load_n <= touch.load_n:
        return state
    seen = MARGIN * settings.way_m(touch.load_n, felt.load_n) / moved_m
    stiffer = min(max(seen, 1.0 / STIFFER), STIFFER)
    risen = felt if felt.load_n >= RISEN * settings.target_n else None
    return replace(state, stiffer=stiffer, risen=risen)


def _within(value: float, bound: float) -> float:
    return min(max(value, -bound), bound)
