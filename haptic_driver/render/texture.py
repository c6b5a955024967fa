"""Texture stage: where the finger is -> the coefficient of friction that belongs there.

Textures are records that can be asked for friction at one position or at arrays of them. A script
plays textures by the clock. Where nothing is asked for, the answer is NaN.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import import_module
from types import ModuleType
from typing import Any, Literal, NamedTuple, Self, overload

import numpy as np
from numpy.typing import NDArray

from haptic_driver.errors import BadInputError
from haptic_driver.signals import FingerState, TargetFriction

FloatArray = NDArray[np.float64]

# No screen is larger than this: positions beyond, like NaN, lie on no texture.
FARTHEST_M = 1000.0
# No period or pixel is smaller than this.
SHORTEST_LENGTH_M = 1e-6

NO_TARGET = TargetFriction(cof=math.nan, active=False)

# beyond its ends a texture has nothing, its edge, or itself again
Outside = Literal["nothing", "clamp", "tile"]
Interpolation = Literal["hold", "linear", "cosine"]


class Target(ABC):
    """What a tick asks for the friction under the finger.

    `wave_m`: the finest of waves that need no place of their own, only their length; inf where
    places count.
    """

    wave_m: float = math.inf

    @abstractmethod
    def cof_under(self, finger: FingerState) -> float:
        """Friction for a finger in contact, or NaN where nothing is asked for."""

    @abstractmethod
    def cof_along(self, finger: FingerState, ahead_s: FloatArray) -> FloatArray:
        """The same on the finger's way, at times ahead of now [n]; a script goes on meanwhile, up
        to its next step.
        """

    @abstractmethod
    def bounds(self) -> tuple[float, float]:
        """The lowest and the highest friction ever asked for."""

    @property
    @abstractmethod
    def detail_m(self) -> float:
        """The least distance over which friction may be quite another; inf where it is the same
        everywhere.
        """

    def of_waves(self, wave_m: float) -> Self:
        """The same, with that `wave_m`."""
        other = copy(self)
        object.__setattr__(other, "wave_m", wave_m)  # which frozen ones do not allow
        return other

    def is_finer_than(self, off_m: float) -> bool:
        """Whether half a wave is less than how far off a place is: where it lies is chance then."""
        return 0.5 * self.wave_m < off_m


class Texture(Target):
    """A coefficient of friction for every position, or NaN where nothing is asked for."""

    def under(self, speed_m_s: float, normal_force_n: float) -> Texture:
        """The texture as a finger of this speed and load meets it, wherever it is asked."""
        return self

    def cof_under(self, finger: FingerState) -> float:
        """Friction at the finger's position."""
        return self.cof_at(finger.position_x_m, finger.position_y_m)

    def cof_along(self, finger: FingerState, ahead_s: FloatArray) -> FloatArray:
        """Friction where the finger will be."""
        places: tuple[FloatArray, FloatArray] = _lookup().places_ahead(finger[1:5], ahead_s)
        last_s = ahead_s.item(-1)
        farthest_x_m = abs(finger.position_x_m) + abs(finger.velocity_x_m_s) * last_s
        farthest_y_m = abs(finger.position_y_m) + abs(finger.velocity_y_m_s) * last_s
        if farthest_x_m < FARTHEST_M and farthest_y_m < FARTHEST_M:  # not for NaN
            return self._cof_at_points(*places)
        return self.cof_at(*places)

    @overload
    def cof_at(self, x_m: float, y_m: float) -> float: ...
    @overload
    def cof_at(self, x_m: FloatArray, y_m: FloatArray) -> FloatArray: ...

    def cof_at(self, x_m: float | FloatArray, y_m: float | FloatArray) -> float | FloatArray:
        """Friction at one position, or at arrays of positions that broadcast."""
        if isinstance(x_m, (float, int)) and isinstance(y_m, (float, int)):
            if abs(x_m) < FARTHEST_M and abs(y_m) < FARTHEST_M:
                return self._cof_at_point(x_m, y_m)
            return math.nan
        x_m, y_m = np.broadcast_arrays(np.asarray(x_m, dtype=float), np.asarray(y_m, dtype=float))
        on_screen = (np.abs(x_m) < FARTHEST_M) & (np.abs(y_m) < FARTHEST_M)
        cof = self._cof_at_points(np.where(on_screen, x_m, 0.0), np.where(on_screen, y_m, 0.0))
        return np.where(on_screen, cof, math.nan)

    @abstractmethod
    def _cof_at_point(self, x_m: float, y_m: float) -> float: ...

    @abstractmethod
    def _cof_at_points(self, x_m: FloatArray, y_m: FloatArray) -> FloatArray: ...


def target(texture: Target, finger: FingerState) -> TargetFriction:
    """The friction asked for under the finger: none without contact, and none where the texture has
    none.
    """
    if not finger.in_contact:
        return NO_TARGET
    cof = texture.cof_under(finger)
    return NO_TARGET if math.isnan(cof) else TargetFriction(float(cof), active=True)


@dataclass(frozen=True)
class Uniform(Texture):
    """The same friction everywhere."""

    cof: float

    def __post_init__(self) -> None:
        """Refuse what is not a number."""
        _require_finite(cof=self.cof)

    def bounds(self) -> tuple[float, float]:
        """The one friction, twice."""
        return self.cof, self.cof

    @property
    def detail_m(self) -> float:
        return math.inf

    def _cof_at_point(self, x_m: float, y_m: float) -> float:
        return self.cof

    def _cof_at_points(self, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
        return np.full(x_m.shape, self.cof, dtype=float)


@dataclass(frozen=True)
class Grating(Texture):
    """Mean plus a sine that varies along `direction_rad` (from +x towards +y); `phase_rad` is its
    phase at 0, 0.
    """

    mean_cof: float
    amplitude_cof: float
    period_m: float
    direction_rad: float = 0.0
    phase_rad: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a period that is none and what is not a number."""
        _require_finite(
            mean_cof=self.mean_cof,
            amplitude_cof=self.amplitude_cof,
            direction_rad=self.direction_rad,
            phase_rad=self.phase_rad,
        )
        _require_length(period_m=self.period_m)

    def bounds(self) -> tuple[float, float]:
        """Mean minus and plus the amplitude."""
        return self.mean_cof - abs(self.amplitude_cof), self.mean_cof + abs(self.amplitude_cof)

    @property
    def detail_m(self) -> float:
        """From ridge to groove."""
        return 0.5 * self.period_m

    def _cof_at_point(self, x_m: float, y_m: float) -> float:
        along_m = x_m * math.cos(self.direction_rad) + y_m * math.sin(self.direction_rad)
        return self.mean_cof + self.amplitude_cof * math.sin(
            math.tau * along_m / self.period_m + self.phase_rad
        )

    def _cof_at_points(self, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
        rad_per_m = math.tau / self.period_m
        across, along = (
            rad_per_m * math.cos(self.direction_rad),
            rad_per_m * math.sin(self.direction_rad),
        )
        wave: FloatArray = np.sin(across * x_m + along * y_m + self.phase_rad)
        return self.mean_cof + self.amplitude_cof * wave


@dataclass(frozen=True)
class Profile(Texture):
    """Friction along x, linear between its points, the same for every y.

    Positions increase strictly; there are at least two. Tiled, it repeats after the distance from
    first to last point.
    """

    position_m: Sequence[float]
    cof: Sequence[float]
    outside: Outside = "nothing"
    # for many places at once
    _points: tuple[FloatArray, FloatArray] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Keep the points as tuples of floats; refuse points out of order or not finite."""
        object.__setattr__(self, "position_m", tuple(map(float, self.position_m)))
        object.__setattr__(self, "cof", tuple(map(float, self.cof)))
        if len(self.position_m) != len(self.cof) or len(self.cof) < 2:
            raise BadInputError(
                "bad_texture",
                f"a profile of {len(self.position_m)} positions and {len(self.cof)} frictions",
                "give at least two points, each with a position and a friction",
            )
        if not np.all(np.isfinite(self.position_m)) or not np.all(np.isfinite(self.cof)):
            raise BadInputError(
                "bad_texture", "a profile has a point that is not finite", "give numbers only"
            )
        if not np.all(np.diff(self.position_m) > 0.0):
            raise BadInputError(
                "bad_texture", "positions of a profile do not increase", "sort them; no two alike"
            )
        object.__setattr__(self, "_points", (np.array(self.position_m), np.array(self.cof)))

    def bounds(self) -> tuple[float, float]:
        """The lowest and the highest point."""
        return min(self.cof), max(self.cof)

    @property
    def detail_m(self) -> float:
        """From point to point."""
        return float(np.diff(self.position_m).min())

    def _cof_at_point(self, x_m: float, y_m: float) -> float:
        position_m = self.position_m
        first_m, last_m = position_m[0], position_m[-1]
        if not first_m <= x_m <= last_m:
            if self.outside == "nothing":
                return math.nan
            if self.outside == "clamp":
                return self.cof[0] if x_m < first_m else self.cof[-1]
            x_m = min(first_m + (x_m - first_m) % (last_m - first_m), last_m)
        right = min(bisect_right(position_m, x_m), len(position_m) - 1)
        left = right - 1
        share = (x_m - position_m[left]) / (position_m[right] - position_m[left])
        return _between(self.cof[left], self.cof[right], share)

    def _cof_at_points(self, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
        tile, ends = self.outside == "tile", self.outside == "nothing"
        cof: FloatArray = _lookup().profile_at_points(*self._points, x_m.ravel(), tile, ends)
        return cof.reshape(x_m.shape)


@dataclass(frozen=True, eq=False)
class Waves(Texture):
    """Friction along a direction that changes with the finger's speed and load, and repeats after
    `length_m`.

    `cof[speed, load, place]`, places evenly spaced from 0 on; linear between all three, and beyond
    the first and last speed and load as there. `usual`: the speed in m/s and the load in N where no
    finger says its own.
    """

    cof: FloatArray
    speed_m_s: FloatArray
    normal_force_n: FloatArray
    length_m: float
    direction_rad: float
    usual: tuple[float, float]

    def under(self, speed_m_s: float, normal_force_n: float) -> Texture:
        """With another usual speed and load."""
        return replace(self, usual=(speed_m_s, normal_force_n))

    def cof_under(self, finger: FingerState) -> float:
        """Friction at the finger's position, at its speed and load."""
        return self._met_by(finger).cof_at(finger.position_x_m, finger.position_y_m)

    def cof_along(self, finger: FingerState, ahead_s: FloatArray) -> FloatArray:
        """Friction where the finger will be, at its speed and load."""
        return Texture.cof_along(self._met_by(finger), finger, ahead_s)

    def bounds(self) -> tuple[float, float]:
        """The lowest and the highest of all places."""
        return float(self.cof.min()), float(self.cof.max())

    @property
    def detail_m(self) -> float:
        """From place to place."""
        return float(self.length_m / self.cof.shape[2])

    def _met_by(self, finger: FingerState) -> Texture:
        speed_m_s = finger.met_m_s
        if math.isnan(speed_m_s):
            speed_m_s = math.hypot(finger.velocity_x_m_s, finger.velocity_y_m_s)
        return self.under(speed_m_s, finger.normal_force_n)

    def _cof_at_point(self, x_m: float, y_m: float) -> float:
        return float(self._cof_at_points(np.array([x_m]), np.array([y_m]))[0])

    def _cof_at_points(self, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
        along_m = x_m * math.cos(self.direction_rad) + y_m * math.sin(self.direction_rad)
        along, nodes = along_m.ravel() / self.detail_m, (self.speed_m_s, self.normal_force_n)
        cof: FloatArray = _lookup().waves_at_points(self.cof, *nodes, self.usual, along)
        return cof.reshape(x_m.shape)


@dataclass(frozen=True, eq=False)
class FrictionMap(Texture):
    """A picture of friction, `cof[row, column]`: columns along +x, rows along +y, bilinear between
    pixel centres.

    The map's corner lies at 0, 0 and the first pixel's centre half a pitch inside it; `Placed` puts
    it elsewhere. The outer half pixel holds the value of its edge.
    """

    cof: FloatArray
    pitch_x_m: float
    pitch_y_m: float
    outside: Outside = "nothing"

    def __post_init__(self) -> None:
        """Keep a read-only copy; refuse an empty map, a pitch that is none and what is not a
        number.
        """
        cof = np.array(self.cof, dtype=float, order="C")
        cof.setflags(write=False)
        object.__setattr__(self, "cof", cof)
        if cof.ndim != 2 or cof.size == 0:
            raise BadInputError(
                "bad_texture", f"a map of shape {cof.shape}", "give rows and columns of friction"
            )
        if not np.all(np.isfinite(cof)):
            raise BadInputError(
                "bad_texture", "a map has a friction that is not finite", "give numbers only"
            )
        _require_length(pitch_x_m=self.pitch_x_m, pitch_y_m=self.pitch_y_m)
        object.__setattr__(self, "pitch_x_m", float(self.pitch_x_m))
        object.__setattr__(self, "pitch_y_m", float(self.pitch_y_m))

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Nobody can change what comes out of a pickle either."""
        self.__dict__.update(state)
        self.cof.setflags(write=False)

    def bounds(self) -> tuple[float, float]:
        """The lowest and the highest pixel."""
        return float(self.cof.min()), float(self.cof.max())

    @property
    def detail_m(self) -> float:
        return min(self.pitch_x_m, self.pitch_y_m)

    def _cof_at_point(self, x_m: float, y_m: float) -> float:
        cof: float = _lookup().picture_at(self.cof, x_m, y_m, *self._laid)
        return cof

    def _cof_at_points(self, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
        places = x_m.ravel(), y_m.ravel()
        cof: FloatArray = _lookup().picture_at_points(self.cof, *places, *self._laid)
        return cof.reshape(x_m.shape)

    @property
    def _laid(self) -> tuple[float, float, bool, bool]:
        """Pitches, and whether it begins again or ends beyond."""
        return self.pitch_x_m, self.pitch_y_m, self.outside == "tile", self.outside == "nothing"


@dataclass(frozen=True)
class Placed(Texture):
    """Another texture, its point 0, 0 moved to the origin given and turned about it (from +x
    towards +y).
    """

    texture: Texture
    origin_x_m: float = 0.0
    origin_y_m: float = 0.0
    rotation_rad: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is not a number."""
        _require_finite(
            origin_x_m=self.origin_x_m, origin_y_m=self.origin_y_m, rotation_rad=self.rotation_rad
        )

    def bounds(self) -> tuple[float, float]:
        """Those of the texture that is placed."""
        return self.texture.bounds()

    @property
    def detail_m(self) -> float:
        """That of the texture that is placed."""
        return self.texture.detail_m

    def _cof_at_point(self, x_m: float, y_m: float) -> float:
        x_m, y_m = x_m - self.origin_x_m, y_m - self.origin_y_m
        c, s = math.cos(self.rotation_rad), math.sin(self.rotation_rad)
        return self.texture._cof_at_point(c * x_m + s * y_m, c * y_m - s * x_m)

    def _cof_at_points(self, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
        x_m, y_m = x_m - self.origin_x_m, y_m - self.origin_y_m
        c, s = math.cos(self.rotation_rad), math.sin(self.rotation_rad)
        return self.texture._cof_at_points(c * x_m + s * y_m, c * y_m - s * x_m)


class Step(NamedTuple):
    """From `time_s` of a script on: a texture, and how to get from it to the next step's. A label
    makes a marker.
    """

    time_s: float
    texture: Texture
    interpolation: Interpolation = "hold"
    label: str = ""


class Marker(NamedTuple):
    """A label of a script and when it is due, on the clock of the finger's samples."""

    time_s: float
    label: str


@dataclass(frozen=True)
class Script(Target):
    """Textures by the clock, begun at `start_s`: at least two steps whose times increase strictly.

    Before the first step and from the last one on nothing is asked for; the last is where the one
    before leads to. Between two textures one fades into the other, position by position.
    """

    steps: tuple[Step, ...]
    start_s: float = 0.0
    _times_s: tuple[float, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Refuse steps out of order or not finite."""
        object.__setattr__(self, "_times_s", tuple(step.time_s for step in self.steps))
        _require_finite(
            start_s=self.start_s,
            **{f"time_s of step {i + 1}": t for i, t in enumerate(self._times_s)},
        )
        if len(self.steps) < 2 or not np.all(np.diff(self._times_s) > 0.0):
            raise BadInputError(
                "bad_script",
                "times of a script do not increase, or it has no two steps",
                "give two steps, in order",
            )

    def started(self, time_s: float) -> Script:
        """The same script with its time 0 at `time_s` of the finger's clock."""
        return replace(self, start_s=time_s)

    @property
    def end_s(self) -> float:
        """When the script is over, on the finger's clock."""
        return self.start_s + self._times_s[-1]

    def bounds(self) -> tuple[float, float]:
        """The lowest and the highest friction of all steps."""
        lows, highs = zip(*(step.texture.bounds() for step in self.steps), strict=True)
        return min(lows), max(highs)

    @property
    def detail_m(self) -> float:
        """The finest of all steps."""
        return min(step.texture.detail_m for step in self.steps)

    def cof_under(self, finger: FingerState) -> float:
        """Friction at the finger's time and position."""
        first, second, share = self._at(finger.time_s - self.start_s)
        if first is None:
            return math.nan
        cof = first.cof_under(finger)
        return cof if second is None else _between(cof, second.cof_under(finger), share)

    def cof_along(self, finger: FingerState, ahead_s: FloatArray) -> FloatArray:
        """Friction where the finger will be. Fades go on, one into the next. What a step jumps to
        is a matter of the next tick, which limits how fast voltage rises.
        """
        now_s = finger.time_s - self.start_s
        if not self._times_s[0] <= now_s < self._times_s[-1]:
            return np.full(ahead_s.shape, math.nan)
        index, time_s = self._index(now_s), now_s + ahead_s
        cof = self._cof_of(index, finger, ahead_s, time_s)
        while self._leads_on(index, time_s.item(-1)):
            index += 1
            later = time_s >= self._times_s[index]
            cof = np.where(later, self._cof_of(index, finger, ahead_s, time_s), cof)
        return cof

    def _cof_of(
        self, index: int, finger: FingerState, ahead_s: FloatArray, time_s: FloatArray
    ) -> FloatArray:
        """What one step asks for, and for however long."""
        step, following = self.steps[index], self.steps[index + 1]
        cof = step.texture.cof_along(finger, ahead_s)
        if step.interpolation == "hold":
            return cof
        share = self._share(index, np.maximum(time_s, step.time_s))
        return cof + share * (following.texture.cof_along(finger, ahead_s) - cof)

    def _leads_on(self, index: int, until_s: float) -> bool:
        """Whether a step fades into another that begins by then; the last is none."""
        following = index + 1
        fades = self.steps[index].interpolation != "hold"
        return fades and following < len(self.steps) - 1 and self._times_s[following] <= until_s

    def _at(self, time_s: float) -> tuple[Texture | None, Texture | None, float]:
        """What is played at a time of the script: nothing, one texture, or a share of the way from
        it to another.
        """
        if not self._times_s[0] <= time_s < self._times_s[-1]:
            return None, None, 0.0
        index = self._index(time_s)
        step, following = self.steps[index], self.steps[index + 1]
        if step.interpolation == "hold":
            return step.texture, None, 0.0
        return step.texture, following.texture, float(self._share(index, np.float64(time_s)))

    def _index(self, time_s: float) -> int:
        """The step of a time between the first and the last."""
        return bisect_right(self._times_s, time_s) - 1

    def _share(self, index: int, time_s: FloatArray | np.float64) -> FloatArray | np.float64:
        """Of the way from a step to the next, at times from its own on."""
        step, following = self.steps[index], self.steps[index + 1]
        share = np.minimum((time_s - step.time_s) / (following.time_s - step.time_s), 1.0)
        if step.interpolation == "cosine":
            share = 0.5 - 0.5 * np.cos(math.pi * share)
        return share

    def markers(self, after_s: float, until_s: float) -> tuple[Marker, ...]:
        """The markers due after one tick's time and up to another's; at their own times, in
        order.
        """
        first = bisect_right(self._times_s, after_s - self.start_s)
        stop = bisect_right(self._times_s, until_s - self.start_s)
        return tuple(
            Marker(self.start_s + s.time_s, s.label) for s in self.steps[first:stop] if s.label
        )


@cache
def _lookup() -> ModuleType:
    """Its functions are compiled: who lists textures does not wait for that."""
    return import_module("haptic_driver.render.lookup")


def _between(first: float, second: float, share: float) -> float:
    return first + share * (second - first)


def _require_finite(**values: float) -> None:
    for name, value in values.items():
        if not math.isfinite(value):
            raise BadInputError(
                "bad_texture", f"{name} of a texture is {value}", "give a finite number"
            )


def _require_length(**values: float) -> None:
    for name, value in values.items():
        if not SHORTEST_LENGTH_M <= value < math.inf:
            raise BadInputError(
                "bad_texture", f"{name} of a texture is {value}", "give at least 1e-6 m, finite"
            )
