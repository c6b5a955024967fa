"""The render process: alone in its interpreter, the only clock. Finger in, tick, output out, one sample per tick.

    python -m haptic_driver.daemon.render_process DESCRIPTOR PARENT < settings

takes pickled `RenderSettings` from standard input, compiles, and says on standard output what real-time scheduling it
was granted, as one JSON line; from then on it runs until its parent is gone. It takes the output to zero by itself
when the lease runs out, the sensors or control fall silent, or too many instants in a row were missed.
"""

from __future__ import annotations

import json
import math
import os
import pickle
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from haptic_driver.daemon import real_time
from haptic_driver.daemon.real_time import Due
from haptic_driver.daemon.records import Flag
from haptic_driver.daemon.shared_state import NO_ORDER, Order, Output, Sensed, SharedState
from haptic_driver.render.texture import Target, Uniform
from haptic_driver.render.tick import Tick, TickSettings, TickState, tick
from haptic_driver.signals import FingerSample, FingerState

SLIDING_M_S = 0.002  # below, a finger rests and kinetic friction is not defined
WARM_UP_TICKS = 200


@dataclass(frozen=True)
class RenderSettings:
    """How to tick and when to stop trusting.

    `stale_s`: sensors, `silence_s`: control, not heard for so long. `ramp_s`: how long a ramp to zero takes.
    `most_missed`: so many instants missed in a row are a fault.
    """

    tick: TickSettings
    period_s: float = 0.001
    stale_s: float = 0.1
    silence_s: float = 0.25
    ramp_s: float = 0.05
    most_missed: int = 100


class Nothing(Target):
    """Asks for nothing anywhere."""

    def cof_under(self, finger: FingerState) -> float:
        """NaN."""
        return math.nan

    def bounds(self) -> tuple[float, float]:
        """NaN, twice."""
        return math.nan, math.nan


class Ramp:
    """Voltage that follows what is wanted while it may, and goes to zero in `ramp_s` from wherever it was else."""

    def __init__(self, ramp_s: float) -> None:
        self._ramp_s = ramp_s
        self._from_v = 0.0
        self._since_s: float | None = None

    def limit(self, time_s: float, voltage_v: float, trusted: bool) -> float:
        """The voltage for this instant."""
        if trusted:
            self._since_s, self._from_v = None, voltage_v
            return voltage_v
        if self._since_s is None:
            self._since_s = time_s
        share = max(1.0 - (time_s - self._since_s) / self._ramp_s, 0.0)
        return min(voltage_v, share * self._from_v)


class Renderer:
    """All of one tick but the waiting; keeps the flags of the present arming."""

    def __init__(
        self, settings: RenderSettings, shared: SharedState, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._settings = settings
        self._shared = shared
        self._clock = clock
        self._nothing = replace(settings.tick, texture=Nothing())
        self._overruns = shared.output.read().overruns
        self._missed_in_a_row = 0
        self._forget(NO_ORDER)

    def _forget(self, order: Order) -> None:
        """Begin as after arming."""
        self._arming = order.arming
        self._flags = Flag(0)
        self._target = 0
        self._tick_settings = self._nothing
        self._state = TickState()
        self._ramp = Ramp(self._settings.ramp_s)

    def warm_up(self) -> None:
        """Run every compiled path once, far from any output."""
        settings = replace(self._settings.tick, texture=Uniform(0.7))
        state = TickState()
        for i in range(WARM_UP_TICKS):
            time_s = i * self._settings.period_s
            state, _ = tick(settings, state, FingerSample(time_s, 0.05 * time_s, 0.0, 0.5, 0.3))

    def step(self, due: Due) -> Output:
        """One tick: read, decide, write."""
        order = self._shared.order.read()
        if order.arming != self._arming:
            self._forget(order)
        if order.target != self._target:
            self._swap(order.target)
        sensed = self._shared.sensed.read()
        self._count(order, due)
        trusted = self._trusts(order, sensed, due.due_s)
        settings = self._tick_settings if order.rendering else self._nothing
        self._state, done = tick(settings, self._state, _finger_sample(sensed))
        if order.rendering:
            self._note(done)
        voltage_v = self._voltage_v(order, due, done, trusted)
        output = Output(
            order.number, self._target, due.number, self._clock(), done.command.frequency_hz, voltage_v,
            voltage_v > 0.0, self._overruns, int(self._flags), done.target.cof,
        )  # fmt: skip
        self._shared.output.write(output)
        self._record(due, sensed, done, output)
        return output

    def stop(self) -> None:
        """Leave zero behind."""
        last = self._shared.output.read()
        self._shared.output.write(last._replace(voltage_v=0.0, output_on=False, flags=last.flags | Flag.FAULT))

    def _swap(self, number: int) -> None:
        self._target = number
        target = self._shared.targets.read(number) if number else Nothing()
        self._tick_settings = replace(self._settings.tick, texture=target)

    def _count(self, order: Order, due: Due) -> None:
        """Instants that were missed; so many in a row are a fault while output is wanted."""
        self._overruns += due.missed
        self._missed_in_a_row = self._missed_in_a_row + due.missed if due.missed else 0
        if due.missed and order.rendering:
            self._flags |= Flag.OVERRUN
            if self._missed_in_a_row >= self._settings.most_missed:
                self._flags |= Flag.FAULT

    def _trusts(self, order: Order, sensed: Sensed, now_s: float) -> bool:
        """Whether output may go on; notes why not."""
        if not order.rendering:
            return False
        stale = now_s - min(sensed.finger_time_s, sensed.force_time_s) > self._settings.stale_s
        lost = now_s > order.lease_until_s or now_s - order.beat_s > self._settings.silence_s
        for flag, is_up in (
            (Flag.STALE_SENSOR, stale),
            (Flag.LEASE_LOST, lost),
            (Flag.SATURATED_SENSOR, sensed.saturated),
        ):
            if is_up:
                self._flags |= flag
        return not (stale or lost or sensed.saturated)

    def _voltage_v(self, order: Order, due: Due, done: Tick, trusted: bool) -> float:
        wanted_v = done.command.voltage_v if done.command.output_on else 0.0
        voltage_v = self._ramp.limit(due.due_s, wanted_v, trusted)
        if not order.rendering or Flag.FAULT in self._flags:
            voltage_v = 0.0
        if voltage_v < wanted_v:  # what was put out is where the next rise begins and what the finger has felt
            driven = self._state.drive._replace(voltage_v=voltage_v)
            command = done.command._replace(voltage_v=voltage_v, output_on=voltage_v > 0.0)
            self._state = self._state._replace(drive=driven, command=command)
        return voltage_v

    def _note(self, done: Tick) -> None:
        if not done.wanted.reachable:
            self._flags |= Flag.UNREACHABLE
        if done.safe.rejection is not None:
            self._flags |= Flag.REJECTED
        if self._state.controller.estimate.at_limit:
            self._flags |= Flag.FEEDBACK_LIMIT

    def _record(self, due: Due, sensed: Sensed, done: Tick, output: Output) -> None:
        finger = done.finger
        speed_m_s = math.hypot(finger.velocity_x_m_s, finger.velocity_y_m_s)
        sliding = finger.in_contact and speed_m_s >= SLIDING_M_S and sensed.normal_force_n > 0.0
        measured = abs(sensed.lateral_force_n) / sensed.normal_force_n if sliding else math.nan
        self._shared.ring.write(
            (
                due.number, due.due_s, due.lateness_s, self._clock() - due.due_s - due.lateness_s,
                sensed.finger_time_s, sensed.position_x_m, sensed.position_y_m,
                finger.position_x_m, finger.position_y_m, speed_m_s,
                sensed.normal_force_n, sensed.lateral_force_n, finger.in_contact,
                done.target.cof, done.wanted.cof, measured, self._state.controller.estimate.gain,
                output.frequency_hz, output.voltage_v, output.output_on, output.flags,
            )
        )  # fmt: skip


def _finger_sample(sensed: Sensed) -> FingerSample:
    """The finger as the stages want it; one that the screen does not feel presses with 0 N."""
    return FingerSample(
        sensed.finger_time_s, sensed.position_x_m, sensed.position_y_m,
        sensed.normal_force_n if sensed.touching else 0.0,
        math.nan if sensed.saturated else sensed.lateral_force_n,
    )  # fmt: skip


def main() -> None:
    """Run the process until its parent is gone."""
    descriptor, parent = int(sys.argv[1]), int(sys.argv[2])
    settings: RenderSettings = pickle.load(sys.stdin.buffer)
    shared = SharedState(descriptor)
    renderer = Renderer(settings, shared)
    renderer.warm_up()
    granted = real_time.enter()
    real_time.settle_memory()
    print(json.dumps(granted._asdict()), flush=True)
    metronome = granted.metronome(settings.period_s, shared.output.read().tick)
    try:
        while os.getppid() == parent:
            renderer.step(metronome.wait())
    finally:
        renderer.stop()


if __name__ == "__main__":
    main()
