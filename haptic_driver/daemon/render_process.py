"""The render process: alone in its interpreter, the only clock. Finger in, tick, output out, one
sample per tick.

    python -m haptic_driver.daemon.render_process DESCRIPTOR PARENT < settings

takes pickled `RenderSettings` from standard input and compiles. It prints the real-time scheduling
that it was granted, as one JSON line. From then on it runs until its parent is gone. It takes the
output to zero by itself when the lease runs out, or the sensors or control fall silent. Missed
instants are counted and reported. An error in a tick ends it, which leaves zero and a fault behind;
so does anything that would have to be compiled now.
"""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

from haptic_driver.daemon.asked_for import Asked, AskedFor
from haptic_driver.processes import parent, real_time
from haptic_driver.processes.compilation import compilation_said
from haptic_driver.processes.real_time import Due
from haptic_driver.processes.samples import Flag
from haptic_driver.processes.shared_memory import (
    NO_ORDER,
    Order,
    Output,
    Sensed,
    SharedState,
    practice_slot,
)
from haptic_driver.render import envelope
from haptic_driver.render.compiled import refuse_to_compile
from haptic_driver.render.controller import Controller, ControllerSettings
from haptic_driver.render.finger import FingerTracking
from haptic_driver.render.scene import Objects, Scene, of_every_kind
from haptic_driver.render.texture import FloatArray, Target
from haptic_driver.render.tick import Tick, TickSettings, TickState, tick
from haptic_driver.signals import SLIDING_M_S, Array, FingerSample, FingerState
from haptic_driver.textures.bands import FINGER_LAG_M

WARM_UP_TICKS = 200
# As plain numbers: faster in a tick.
_OVERRUN = int(Flag.OVERRUN)
_SATURATED_SENSOR = int(Flag.SATURATED_SENSOR)
_STALE_SENSOR = int(Flag.STALE_SENSOR)
_UNREACHABLE = int(Flag.UNREACHABLE)
_OUTSIDE_SURFACE = int(Flag.OUTSIDE_SURFACE)
_REJECTED = int(Flag.REJECTED)
_LEASE_LOST = int(Flag.LEASE_LOST)
_FEEDBACK_LIMIT = int(Flag.FEEDBACK_LIMIT)
_BY_TIME = int(Flag.BY_TIME)
_CONTROL_SILENT = int(Flag.CONTROL_SILENT)
_ELECTRODE_AT = Sensed._fields.index("electrode_time_s")  # from there on as samples have them


@dataclass(frozen=True)
class RenderSettings:
    """How to tick and when to stop trusting.

    `stale_s`: sensors, `silence_s`: control, not heard for so long. `usual_s`: so old a position
    may be, and further by the texture's finest detail at the finger's speed. `ramp_s`: how long a
    ramp to zero takes. `envelope`: an analog output makes the amplitude, and gets its course from
    tick to tick. The latencies of `tick` reckon with a lead of `lead_s`. `surface`: the number that
    the controller's has among orders. `standing_flags` are up whenever something is rendered.
    `model_std`: of friction by the model alone, relative, where no force sensor measures it; 0
    where one does. `off_m`: how far a place is off half of the time, by a finger of usual speed.
    """

    tick: TickSettings
    envelope: bool = False
    lead_s: float = 0.0
    period_s: float = 0.001
    stale_s: float = 0.1
    usual_s: float = 0.01
    silence_s: float = 0.25
    ramp_s: float = 0.05
    surface: int = 0
    standing_flags: int = 0
    model_std: float = 0.0
    off_m: float = 0.0


class Nothing(Target):
    """Asks for nothing anywhere."""

    def cof_under(self, finger: FingerState) -> float:
        return math.nan

    def cof_along(self, finger: FingerState, ahead_s: FloatArray) -> FloatArray:
        return ahead_s * math.nan

    def bounds(self) -> tuple[float, float]:
        return math.nan, math.nan

    @property
    def detail_m(self) -> float:
        return math.inf


class Ramp(NamedTuple):
    """The voltage when output was last trusted, and since when it is not; None while it is."""

    from_v: float = 0.0
    since_s: float | None = None

    def limit(
        self, ramp_s: float, time_s: float, voltage_v: float, trusted: bool
    ) -> tuple[Ramp, float]:
        """The voltage for this instant: what is wanted while it may, to zero in `ramp_s` from
        wherever it was else.
        """
        if trusted:
            return Ramp(voltage_v), voltage_v
        since_s = time_s if self.since_s is None else self.since_s
        share = max(1.0 - (time_s - since_s) / ramp_s, 0.0)
        return Ramp(self.from_v, since_s), min(voltage_v, share * self.from_v)


class Heard(NamedTuple):
    """What others say at a tick: control's order, the sensors, and since when what goes out reaches
    the electrode.
    """

    order: Order
    sensed: Sensed
    driven_since_s: float


class Kept(NamedTuple):
    """All that one tick hands on to the next. Flags are those of the present arming, as plain
    numbers: faster.
    """

    state: TickState = TickState()
    course_v2: FloatArray = envelope.ZERO
    ramp: Ramp = Ramp()
    flags: int = 0
    overruns: int = 0


class Renderer:
    """All of one tick but the waiting."""

    def __init__(
        self,
        settings: RenderSettings,
        shared: SharedState,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._settings = settings
        self._shared = shared
        self._clock = clock
        self._surface = settings.surface
        self._nothing = replace(settings.tick, texture=Nothing())
        self._lead_s = settings.lead_s  # as the envelope's writer said last
        # from a tick to the effect of what it decides
        self._latency_s = settings.tick.finger.output_latency_s
        self._asked = AskedFor(settings.period_s)
        self._kept = Kept(overruns=shared.output.read().overruns)
        self._full_scale = (math.nan, settings.tick.controller, 0.0)
        self.rendering = False  # at the last tick
        self._practice = practice_slot()
        self._forget(NO_ORDER)

    def _forget(self, order: Order) -> None:
        """Begin as after arming; instants that were missed stay counted."""
        self._arming = order.arming
        self._target = 0
        self._scene: Scene | None = None
        self._arranged: tuple[Array, ...] = ()  # the tables of objects that it has now
        self._tick_settings = self._nothing
        self._detail_m = math.inf
        self._asked.forget()
        self._kept = Kept(overruns=self._kept.overruns)

    def warm_up(self) -> None:
        """Run every compiled path once, far from any output."""
        stages = [replace(self._settings.tick, texture=texture) for texture in of_every_kind()]
        state = TickState()
        for i in range(WARM_UP_TICKS):
            time_s = i * self._settings.period_s
            settings = stages[i % len(stages)]
            state, done = tick(settings, state, FingerSample(time_s, 0.05 * time_s, 0.0, 0.5, 0.3))
            state, _ = envelope.ahead(settings, state, done, self._settings.period_s)
        controller = self._settings.tick.controller
        _carried(controller, controller, state)

    def step(self, due: Due) -> Output:
        """One tick: read, decide, write."""
        heard = self._read()
        self.rendering = heard.order.rendering
        self._kept, done, output = self._decide(due, heard)
        self._shared.output.write(output)
        if self._settings.envelope:
            self._shared.courses.write((output.order, self._kept.course_v2.tobytes()))
        asked = Asked(done.target.cof, done.wanted.cof, done.wanted.reachable)
        self._asked.add(due.due_s + self._latency_s, asked)
        self._shared.ring.write(self._sample(due, heard, done, output, self._kept))
        return output

    def rehearse(self, due: Due) -> None:
        """The tick that is about to be due, without any effect: what it needs is then in the
        processor's caches.

        After a millisecond in which others had them, a tick takes several times as long.
        """
        heard = self._read()
        kept, done, output = self._decide(due, heard)
        self._practice.write(output)
        self._shared.ring.put(self._sample(due, heard, done, output, kept))

    @property
    def rejections(self) -> int:
        """How often the safety gate said no since arming."""
        return self._kept.state.safety.rejections

    def stop(self) -> None:
        last = self._shared.output.read()
        self._shared.output.write(
            last._replace(voltage_v=0.0, output_on=False, flags=last.flags | Flag.FAULT)
        )

    def _read(self) -> Heard:
        """What others say; a new arming, target, surface or lead is taken up."""
        order, played = self._shared.order.read(), self._shared.played.read()
        if order.surface != self._surface:
            self._take_up(order.surface)
        if played.lead_s not in (0.0, self._lead_s) and self._settings.envelope:
            self._be_ahead(played.lead_s)
        if order.arming != self._arming:
            self._forget(order)
        if order.target != self._target:
            self._target = order.target
            target = self._shared.targets.read(order.target) if order.target else Nothing()
            self._scene = target if isinstance(target, Scene) else None
            self._render(target)
        if self._scene is not None:
            self._rearrange(self._scene)
        since_s = max(self._shared.driven.read().since_s, played.whole_s)
        return Heard(order, self._shared.sensed.read(), since_s)

    def _render(self, target: Target) -> None:
        self._detail_m = target.detail_m
        by_time = target.is_finer_than(self._settings.off_m)
        self._tick_settings = replace(self._tick_settings, texture=target, by_time=by_time)

    def _rearrange(self, scene: Scene) -> None:
        """Take up another table of the present scene's objects, where there is one."""
        number, tables = self._shared.scene.read()
        if number == self._target and tables is not self._arranged:
            self._arranged = tables
            self._render(scene.with_objects(Objects(*tables)))

    def _take_up(self, number: int) -> None:
        """Render by another surface from here on, with the voltage as it is."""
        before = self._nothing.controller
        settings, worst_case = self._shared.surfaces.read(number)
        controller = Controller(later_by(self._lead_s, settings))
        self._surface = number
        self._nothing = replace(self._nothing, controller=controller, worst_case=worst_case)
        self._tick_settings = replace(
            self._tick_settings, controller=controller, worst_case=worst_case
        )
        self._kept = self._kept._replace(state=_carried(controller, before, self._kept.state))

    def _be_ahead(self, lead_s: float) -> None:
        """Render for an envelope that is written so far ahead."""
        more_s, self._lead_s = lead_s - self._lead_s, lead_s
        controller = Controller(later_by(more_s, self._nothing.controller.settings))
        self._latency_s += more_s
        finger = replace(self._nothing.finger, output_latency_s=self._latency_s)
        self._nothing = replace(self._nothing, controller=controller, finger=finger)
        self._tick_settings = replace(self._tick_settings, controller=controller, finger=finger)

    def _decide(self, due: Due, heard: Heard) -> tuple[Kept, Tick, Output]:
        """What to put out; nothing is changed here."""
        kept, (order, sensed, driven_since_s) = self._kept, heard
        overruns = kept.overruns + due.missed
        settings = self._tick_settings if order.rendering else self._nothing
        state, done = tick(settings, kept.state, _finger_sample(sensed, due.due_s))
        flags, trusted = kept.flags, False
        if order.rendering:
            doubts = self._doubts(order, sensed, due.due_s, done.finger)
            trusted = not doubts
            flags |= self._settings.standing_flags | doubts | _noted(settings, due, done, state)
        wanted_v = done.command.voltage_v if done.command.output_on else 0.0
        ramp, voltage_v = kept.ramp.limit(self._settings.ramp_s, due.due_s, wanted_v, trusted)
        if not order.rendering:
            voltage_v = 0.0
        course_v2 = kept.course_v2
        if self._settings.envelope:
            if trusted and voltage_v == done.wanted.voltage_v:
                state, course_v2 = envelope.ahead(settings, state, done, self._settings.period_s)
            else:
                course_v2 = envelope.straight(course_v2.item(-1), voltage_v * voltage_v)
            if state.safety.rejections > kept.state.safety.rejections:
                flags |= _REJECTED
        # what was put out is where the next rise begins and what the finger has felt
        if voltage_v < wanted_v:
            command = done.command._replace(voltage_v=voltage_v, output_on=voltage_v > 0.0)
            state = state._replace(drive=state.drive._replace(voltage_v=voltage_v), command=command)
        # on its way: what the finger feels of it teaches nothing
        if voltage_v > 0.0 and due.due_s < driven_since_s:
            state = state._replace(command=state.command._replace(voltage_v=math.nan))
        output = Output(
            order.number,
            self._target,
            self._surface,
            due.number,
            self._clock(),
            done.command.frequency_hz,
            voltage_v,
            voltage_v > 0.0,
            overruns,
            flags,
            done.target.cof,
            order.rendering and done.finger.in_contact,
            self._full_scale_v(settings, done.command.frequency_hz),
        )
        return Kept(state, course_v2, ramp, flags, overruns), done, output

    def _full_scale_v(self, settings: TickSettings, carrier_hz: float) -> float:
        """Of a carrier under an envelope; worked out anew for another carrier or controller."""
        if not self._settings.envelope:
            return 0.0
        if (carrier_hz, settings.controller) != self._full_scale[:2]:
            most_v = envelope.full_scale_v(settings, carrier_hz)
            self._full_scale = carrier_hz, settings.controller, most_v
        return self._full_scale[2]

    def _doubts(self, order: Order, sensed: Sensed, now_s: float, finger: FingerState) -> int:
        """Flags for why output may not go on; 0 while it may."""
        doubts = _SATURATED_SENSOR if sensed.saturated else 0
        if self._is_stale(sensed, now_s) or self._is_elsewhere(
            finger, now_s - sensed.finger_time_s
        ):
            doubts |= _STALE_SENSOR
        if now_s > order.lease_until_s:
            doubts |= _LEASE_LOST
        if now_s - order.beat_s > self._settings.silence_s:
            doubts |= _CONTROL_SILENT
        return doubts

    def _is_stale(self, sensed: Sensed, now_s: float) -> bool:
        """Whether a reading is not of now: too old, as far ahead, or of no time at all."""
        finger_s, force_s, stale_s = (
            sensed.finger_time_s,
            sensed.force_time_s,
            self._settings.stale_s,
        )
        return not (abs(now_s - finger_s) <= stale_s and abs(now_s - force_s) <= stale_s)

    def _is_elsewhere(self, finger: FingerState, age_s: float) -> bool:
        """Whether the finger may be where the texture asks for quite another friction."""
        return _speed_m_s(finger) * (age_s - self._settings.usual_s) > self._detail_m

    def _sample(
        self, due: Due, heard: Heard, done: Tick, output: Output, kept: Kept
    ) -> tuple[float, ...]:
        """The fields of SAMPLE."""
        finger, sensed = done.finger, heard.sensed
        speed_m_s = _speed_m_s(finger)
        sliding = finger.in_contact and speed_m_s >= SLIDING_M_S and sensed.normal_force_n > 0.0
        known = sliding and not sensed.saturated and not self._is_stale(sensed, due.due_s)
        measures = self._settings.model_std == 0.0
        lateral_n = sensed.lateral_force_n if measures else math.nan
        measured = abs(lateral_n) / sensed.normal_force_n if known else math.nan
        felt_s = sensed.force_time_s
        asked = self._asked.at(felt_s - FINGER_LAG_M / max(speed_m_s, SLIDING_M_S))
        estimated, std = (math.nan, math.nan)
        if known and not measures:
            estimated, std = self._estimated(sensed, asked.expected_cof)
        return (
            due.number,
            due.due_s,
            due.lateness_s,
            self._clock() - due.due_s - due.lateness_s,
            sensed.finger_time_s,
            sensed.position_x_m,
            sensed.position_y_m,
            finger.position_x_m,
            finger.position_y_m,
            speed_m_s,
            sensed.normal_force_n,
            lateral_n,
            finger.in_contact,
            felt_s,
            asked.target_cof,
            asked.reachable,
            asked.expected_cof,
            measured,
            estimated,
            std,
            due.due_s + self._latency_s,
            done.target.cof,
            kept.state.controller.estimate.gain,
            output.frequency_hz,
            output.voltage_v,
            *sensed[_ELECTRODE_AT:],
            heard.order.rendering and due.due_s >= heard.driven_since_s,
            output.flags,
        )

    def _estimated(self, sensed: Sensed, expected_cof: float) -> tuple[float, float]:
        """Friction where nothing measures it, and its standard deviation: by the electrode's
        current, or by the model alone.
        """
        if not math.isnan(sensed.estimated_cof):
            return sensed.estimated_cof, sensed.estimated_cof_std
        return expected_cof, self._settings.model_std * expected_cof


def _speed_m_s(finger: FingerState | FingerTracking) -> float:
    return math.hypot(finger.velocity_x_m_s, finger.velocity_y_m_s)


def _carried(controller: Controller, before: Controller, state: TickState) -> TickState:
    """The state of the same finger on another controller's surface."""
    finger = state.finger
    contact_s = finger.time_s - finger.touched_s if finger.in_contact else 0.0
    now = controller.carried(
        before, state.controller, _speed_m_s(finger), contact_s, state.drive.voltage_v
    )
    return state._replace(controller=now)


def _noted(settings: TickSettings, due: Due, done: Tick, state: TickState) -> int:
    """Flags for instants that were missed, and for what the stages say."""
    noted = _OVERRUN if due.missed else 0
    noted |= 0 if done.wanted.reachable else _UNREACHABLE
    noted |= 0 if settings.controller.knows(done.finger) else _OUTSIDE_SURFACE
    noted |= _BY_TIME if settings.by_time else 0
    if done.safe.rejection is not None:
        noted |= _REJECTED
    if state.controller.estimate.at_limit:
        noted |= _FEEDBACK_LIMIT
    return noted


def _finger_sample(sensed: Sensed, now_s: float) -> FingerSample:
    """The finger as the stages want it; one that the screen does not feel presses with 0 N."""
    return FingerSample(
        sensed.finger_time_s,
        sensed.position_x_m,
        sensed.position_y_m,
        sensed.normal_force_n if sensed.touching else 0.0,
        math.nan if sensed.saturated else sensed.lateral_force_n,
        now_s,
        sensed.contact_area_m2,
    )


def later_by(more_s: float, settings: ControllerSettings) -> ControllerSettings:
    """A controller whose commands take so much longer to be felt."""
    law = settings.feedback
    if law is None or more_s == 0.0:
        return settings
    return replace(settings, feedback=law._replace(latency_s=law.latency_s + more_s))


def main() -> None:
    """Run the process until its parent is gone."""
    descriptor, started_by = int(sys.argv[1]), int(sys.argv[2])
    settings: RenderSettings = parent.given()
    shared = SharedState(descriptor)
    renderer = Renderer(settings, shared)
    with compilation_said("render process", parent.still):
        renderer.warm_up()
    refuse_to_compile()
    granted = real_time.enter()
    real_time.never_collect()
    parent.tell(granted._asdict())
    metronome = granted.metronome(settings.period_s, shared.output.read().tick)
    try:
        while os.getppid() == started_by:
            renderer.step(metronome.wait(renderer.rehearse if renderer.rendering else None))
    finally:
        renderer.stop()


if __name__ == "__main__":
    main()
