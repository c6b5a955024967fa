"""How a stage holds the load of a finger: readings -> orders to the stage.

Pure: no clock, no device. Every order is one short move that ends by itself. So a stage whose
driver has died finishes at most `step_m`, or up to three times that on a softer finger, and rests.
Depth is the stage's position towards the finger, m.

A move has two terms. The first is the share `gain` of the way that the finger's stiffness asks for
(feed-forward). The second is the drift of place that keeps the load. It is the integral of the
error, for a plate that is not level and tissue that relaxes. The stiffness rises with the load as
for a sphere on a plane (Hertz, load over indentation with exponent 1.5). How much stiffer or softer
this finger is than the settings say shows while its load rises: by how far the stage had to go.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace
from typing import NamedTuple

STIFFNESS_AT_N = 0.5  # the load at which a finger's stiffness is given
OVERLOAD = 1.5  # times the target
RISEN = 0.8  # of the target: from then on the pulse tells more than the way
MARGIN = (
    1.2  # some fingers stiffen more than a sphere on a plane, and all are stiffer in an instant
)
STIFFER = 3.0  # times stiffer or softer than the settings say, at most
LEAST_WAY_M = 0.15e-3  # ten times what a tremor moves
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
    that it brings the same load. A sensor that gives one number for `repeats_s` is not believed: a
    finger's load is never so still, and no sensor is without noise. `retracts`: whether the stage
    lifts off or stays where it is when something is wrong.
    """

    target_n: float
    stiffness_n_per_m: float = 700.0
    gain: float = 0.45
    drift_per_s: float = 2.0
    drift_limit_m_s: float = 1e-3
    rate_m_s: float = 5e-3
    step_m: float = 0.35e-3
    depth_m: float = 3e-3
    reach_m: float = 10e-3
    approach_m_s: float = 1e-3
    approach_step_m: float = 0.15e-3
    touch_n: float = 0.05
    load_limit_n: float = 3.0
    silent_s: float = 0.1
    repeats_s: float = 0.2
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
    start_m: float | None = None  # where the approach began
    touch_m: float | None = None  # where the finger was first felt
    touch_n: float = 0.0  # with so much
    risen: bool = False  # most of the load has been there
    stiffer: float = 1.0  # than the settings say, as seen while the load rose
    drift_m_s: float = 0.0
    moved_s: float | None = None  # when the last move was ordered
    sent_m: float | None = None  # where to
    followed_m: float = math.nan  # where the stage was when it last went on, or had arrived
    followed_s: float = math.nan  # and when


def step(settings: LoadSettings, state: LoadState, seen: Seen) -> tuple[LoadState, Order]:
    """One look at sensor and stage: the new state, and the order to the stage."""
    if state.phase is Phase.ENDED:
        return state, NOTHING
    if wrong := wrong_load(settings, seen) or _wrong_place(settings, state, seen):
        act = Act.RETRACT if settings.retracts else Act.STOP
        return replace(state, phase=Phase.ENDED, reason=wrong), Order(act)
    assert seen.load_n is not None  # or something is wrong
    assert seen.depth_m is not None
    state = _followed(state, seen.time_s, seen.depth_m)
    if seen.moving:
        return state, NOTHING
    follow = _approach if state.phase is Phase.APPROACH else _hold
    state, order = follow(settings, state, seen, seen.load_n, seen.depth_m)
    return replace(state, sent_m=order.depth_m), order


def wrong_load(settings: LoadSettings, seen: Seen) -> str:
    """Why the stage has to let go by what the sensor says; empty while nothing is wrong."""
    if seen.load_n is None:
        return "the force sensor does not answer"
    if seen.saturated or not math.isfinite(seen.load_n):
        return "the force sensor is saturated"
    if not seen.load_age_s <= settings.silent_s:
        return f"the force sensor is silent, its newest reading is {seen.load_age_s:.2f} s old"
    if seen.same_s >= settings.repeats_s:
        return f"the force sensor is frozen, it repeats {seen.load_n:.4g} N"
    if seen.load_n >= settings.trip_n:
        return f"the load is {seen.load_n:.2f} N, its limit {settings.trip_n:.2f} N"
    return ""


def _wrong_place(settings: LoadSettings, state: LoadState, seen: Seen) -> str:
    """The same by where the stage is."""
    if seen.depth_m is None:
        return "the load stage does not answer"
    begun_m = state.touch_m if state.touch_m is not None else state.start_m
    bound_m = settings.depth_m if state.touch_m is not None else settings.reach_m
    if begun_m is not None and seen.depth_m - begun_m >= bound_m - ROUNDING_M:
        met = "the load is not reached" if state.touch_m is not None else "no finger is felt"
        return f"{met} within {1e3 * bound_m:.1f} mm"
    if _goes(state, seen.depth_m) or seen.time_s - state.followed_s <= STALLED_S:
        return ""
    assert state.sent_m is not None  # or it goes
    return f"the load stage rests {1e3 * abs(seen.depth_m - state.sent_m):.2f} mm from its target"


def _goes(state: LoadState, depth_m: float) -> bool:
    """Whether the stage is where it was sent, or has come on since it last was seen to."""
    if state.sent_m is None or abs(depth_m - state.sent_m) <= ARRIVED_M:
        return True
    return not abs(depth_m - state.followed_m) <= ROUNDING_M


def _followed(state: LoadState, time_s: float, depth_m: float) -> LoadState:
    if state.sent_m is None or not _goes(state, depth_m):
        return state
    return replace(state, followed_m=depth_m, followed_s=time_s)


def _approach(
    settings: LoadSettings, state: LoadState, seen: Seen, load_n: float, depth_m: float
) -> tuple[LoadState, Order]:
    if load_n >= settings.touch_n:
        felt = replace(state, phase=Phase.HOLD, touch_m=depth_m, touch_n=load_n, moved_s=None)
        return _hold(settings, felt, seen, load_n, depth_m)
    start_m = depth_m if state.start_m is None else state.start_m
    to_m = min(depth_m + settings.approach_step_m, start_m + settings.reach_m)
    order = Order(Act.MOVE, to_m, settings.approach_m_s)
    return replace(state, start_m=start_m, moved_s=seen.time_s), order


def _hold(
    settings: LoadSettings, state: LoadState, seen: Seen, load_n: float, depth_m: float
) -> tuple[LoadState, Order]:
    dt_s = 0.0 if state.moved_s is None else seen.time_s - state.moved_s
    touch_m = depth_m if state.touch_m is None else state.touch_m
    state = _risen(settings, state, load_n, depth_m - touch_m)
    missing_m = settings.way_m(load_n, settings.target_n, state.stiffer)
    drift_m_s = state.drift_m_s + settings.gain * settings.drift_per_s * missing_m * dt_s
    drift_m_s = _within(drift_m_s, settings.drift_limit_m_s)
    wanted_m = settings.gain * missing_m + drift_m_s * dt_s
    bounded_m = _within(wanted_m, settings.step_m / min(state.stiffer, 1.0))
    to_m = min(depth_m + bounded_m, touch_m + settings.depth_m)
    if bounded_m != wanted_m or to_m != depth_m + bounded_m:
        drift_m_s = state.drift_m_s  # what a bound takes away is not added up
    told = replace(state, drift_m_s=drift_m_s, moved_s=seen.time_s)
    return told, Order(Act.MOVE, to_m, settings.rate_m_s)


def _risen(settings: LoadSettings, state: LoadState, load_n: float, moved_m: float) -> LoadState:
    """The finger's stiffness from how far the stage went for the load so far, until most of the
    load is there.
    """
    if state.risen or moved_m < LEAST_WAY_M or load_n <= state.touch_n:
        return state
    seen = MARGIN * settings.way_m(state.touch_n, load_n) / moved_m
    stiffer = min(max(seen, 1.0 / STIFFER), STIFFER)
    return replace(state, stiffer=stiffer, risen=load_n >= RISEN * settings.target_n)


def _within(value: float, bound: float) -> float:
    return min(max(value, -bound), bound)
