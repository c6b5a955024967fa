"""What a finger does for a rig's data sheet, and what is asked for under it meanwhile.

A pass is one touch: the finger presses, slides back and forth at one speed, and lifts. A simulated
finger does so in simulated time, by the daemon's own parts; a person is guided (`sheet_person.py`).
"""

from __future__ import annotations

from collections.abc import Iterator
from math import floor
from typing import NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from haptic_driver.daemon.set_up import render_settings
from haptic_driver.daemon.stepped import UP_TICKS, SteppedDaemon
from haptic_driver.lookup.build import build_surface
from haptic_driver.lookup.models import load_model
from haptic_driver.render.texture import Interpolation, Profile, Script, Step, Target, Uniform
from haptic_driver.rig.config import RigConfig
from haptic_driver.signals import TICK_S
from haptic_driver.simulation.finger_model import finger_of, surface_friction
from haptic_driver.simulation.rig import SimulatedRig
from haptic_driver.textures.objects import TEXTURE_COF
from model.description import ModelDescription
from model.touch_model import TouchModel

FROM_M, STROKE_M = 0.010, 0.090  # where strokes begin, and how long they are
LIFTED_S = 0.1
LOADS_N = (0.25, 0.5, 1.0)
SPEEDS_M_S = (0.02, 0.05, 0.1)
LOAD_N, SPEED_M_S, SLOW_M_S = 0.5, 0.05, 0.01  # of all but the range, and of what friction lags
RANGE_S = 0.8
NEVER, ALWAYS = TEXTURE_COF  # that no finger reaches: the nearest is rendered
STEPS, STEP_S, STEP_MORE_S = 28, 0.12, 0.03  # times between steps differ, or they meet set points
EDGE_SPEEDS_M_S = (0.02, 0.1)
HALF_M, EDGE_M = 0.010, 1e-4  # between edges of the pattern, and over one
EDGES = 14
LINES_HZ = (2.0, 4.0, 8.0, 16.0, 22.0, 32.0, 45.0, 64.0, 90.0, 128.0, 180.0, 256.0)
LINE_S = 1.2
REST_S = 0.05
SWING = 0.05  # of what is asked at a line, a share of the range; larger ones meet the rise limit
LEAST = 0.05  # of the range, where steps begin: a voltage is there before and after
TOUCHES, TOUCH_S = 8, 0.6
MIDDLE = 0.25  # of the range; a voltage rises so far within one set point


class Pass(NamedTuple):
    """One touch. `what` names the part of the sheet, `target` is asked for meanwhile."""

    what: str
    target: Target
    normal_force_n: float
    speed_m_s: float
    duration_s: float


class Slider(Protocol):
    """Who slides."""

    def slide(self, asked: Pass) -> NDArray[np.void]:
        """Samples [n] of dtype SAMPLE, of the whole touch. Raises HapticError, DeviceError."""


def range_passes() -> list[Pass]:
    """The lowest and the highest friction, over loads and speeds."""
    return list(_range_passes())


def other_passes(low: float, high: float) -> list[Pass]:
    """Steps in time, edges in space, lines of frequency, touches; within the range found."""
    return list(_other_passes(low, high))


def _range_passes() -> Iterator[Pass]:
    for load_n in LOADS_N:
        for speed_m_s in SPEEDS_M_S:
            for what, cof in (("low", NEVER), ("high", ALWAYS)):
                yield Pass(what, Uniform(cof), load_n, speed_m_s, RANGE_S)


def _other_passes(low: float, high: float) -> Iterator[Pass]:
    middle = middle_of(low, high)
    duration_s = STEPS * (STEP_S + 0.5 * STEP_MORE_S) + 2.0 * STEP_S
    for speed_m_s in (SLOW_M_S, SPEED_M_S):
        yield Pass(
            "steps", steps(low + LEAST * (high - low), ALWAYS), LOAD_N, speed_m_s, duration_s
        )
    pattern = edges(low, middle)
    for speed_m_s in EDGE_SPEEDS_M_S:
        yield Pass("edges", pattern, LOAD_N, speed_m_s, EDGES * HALF_M / speed_m_s)
    waves = lines(middle, SWING * (high - low))
    yield Pass("lines", waves, LOAD_N, SLOW_M_S, waves.end_s)
    for _ in range(TOUCHES):
        yield Pass("touch", Uniform(middle), LOAD_N, SPEED_M_S, TOUCH_S)


def middle_of(low: float, high: float) -> float:
    """What edges go up to, and what lines and touches are at."""
    return low + MIDDLE * (high - low)


def steps(low: float, high: float) -> Script:
    """Friction up and down by the clock, at times that share no period with anything."""
    golden = 0.5 * (5.0**0.5 - 1.0)
    times_s = [2.0 * STEP_S]
    for i in range(STEPS):
        times_s.append(times_s[-1] + STEP_S + STEP_MORE_S * (golden * i % 1.0))
    levels = [(low, high)[i % 2] for i in range(STEPS)]
    first = Step(0.0, Uniform(high), "hold")
    later = [Step(t, Uniform(cof), "hold") for t, cof in zip(times_s, [*levels, low], strict=True)]
    return Script((first, *later))


def edges(low: float, high: float) -> Profile:
    """Friction up and down along x, every `HALF_M`."""
    x_m: list[float] = []
    for i in range(round((2.0 * FROM_M + STROKE_M) / HALF_M) + 2):
        middle_m = (i - 0.5) * HALF_M
        x_m += [middle_m - 0.5 * EDGE_M, middle_m + 0.5 * EDGE_M]
    levels = [low, *(cof for _ in x_m for cof in (high, high, low, low))][: len(x_m)]
    return Profile(x_m, levels, "clamp")


def lines(middle: float, swing: float) -> Script:
    """A sine of each frequency after the other, by the clock: half periods that fade."""
    times: list[Step] = []
    start_s = REST_S
    fade: Interpolation = "cosine"
    for hz in LINES_HZ:
        halves = round(2.0 * hz * LINE_S)
        times += [
            Step(start_s + i * 0.5 / hz, Uniform(middle + swing * (-1.0) ** i), fade)
            for i in range(halves)
        ]
        start_s = times[-1].time_s + 0.5 / hz + REST_S
        times.append(Step(start_s - REST_S, Uniform(middle), "hold"))
    return Script((Step(0.0, Uniform(middle), "hold"), *times, Step(start_s, Uniform(middle))))


class SimulatedSlider:
    """A finger of a model on a simulated rig, in simulated time.

    Feedback is off, which separates the rig's own output from what it has learnt of a finger.
    """

    def __init__(self, config: RigConfig, description: ModelDescription) -> None:
        simulation, limits = config.simulation, config.operating_limits()
        named = description if simulation.model is None else load_model(simulation.model)
        finger = finger_of(TouchModel(named), simulation)
        friction = surface_friction(build_surface(finger.description, limits), limits)
        surface = build_surface(description, limits)
        self._settings = render_settings(config, surface, feedback=False)
        self.bench = SimulatedRig(config, finger, friction=friction, envelope=True)

    def __enter__(self) -> Self:
        """Connect the rig and let its renderer come up."""
        self.bench.__enter__()
        try:
            self._daemon = SteppedDaemon(self._settings, self.bench, Uniform(NEVER))
            self._daemon.connect()
            self._rest(UP_TICKS)
        except BaseException:
            self.bench.__exit__(None, None, None)
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Switch off and hang up."""
        try:
            self.bench.rig.off()
            self._daemon.close()
        finally:
            self.bench.__exit__(None, None, None)

    def slide(self, asked: Pass) -> NDArray[np.void]:
        """See `Slider`. Turns take no time."""
        daemon, speed_m_s = self._daemon, asked.speed_m_s
        self._rest(round(LIFTED_S / TICK_S))
        target = asked.target
        now_s = self.bench.instruments.time_s
        daemon.play(target.started(now_s) if isinstance(target, Script) else target)
        samples = []
        for i in range(round(asked.duration_s / TICK_S)):
            way_m = speed_m_s * i * TICK_S
            stroke = floor(way_m / STROKE_M)
            along_m = way_m - stroke * STROKE_M
            x_m = FROM_M + (along_m if stroke % 2 == 0 else STROKE_M - along_m)
            daemon.tick(x_m, asked.normal_force_n, speed_m_s)
            samples.append(daemon.shared.ring.newest(1))
        return np.concatenate(samples)

    def _rest(self, ticks: int) -> None:
        for _ in range(ticks):
            self._daemon.tick(FROM_M, 0.0, 0.0)
