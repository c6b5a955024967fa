"""The daemon: its parts, how they begin and end, and what the API asks of them.

Any failure of a device or a process takes the output to zero first and is then a fault. What died
is started again (`supervision.py`), and the daemon stays in fault until somebody resets it.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_driver.config import config_names, texture_dirs
from haptic_driver.daemon.basis import Basis
from haptic_driver.daemon.event_line import EventLineWriter
from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.judge import Judged, MeasuredLatency, measured_latency
from haptic_driver.daemon.line_in import LineInWatch
from haptic_driver.daemon.loader import Loader
from haptic_driver.daemon.messages import (
    SOMEBODY,
    DaemonState,
    InstrumentStatus,
    Lease,
    Marked,
    RefusedError,
    Status,
    Tile,
    TileRequest,
)
from haptic_driver.daemon.orders import Orders
from haptic_driver.daemon.recordings import Recordings
from haptic_driver.daemon.set_up import DaemonSettings
from haptic_driver.daemon.supervision import END_S, Supervisor
from haptic_driver.daemon.targets import Targets
from haptic_driver.daemon.timing import advice, timing_of
from haptic_driver.daemon.watchers import WATCHERS, Watched
from haptic_driver.daemon.web import drawings
from haptic_driver.errors import HapticError, message_of, shown
from haptic_driver.processes.patience import join_within
from haptic_driver.processes.samples import Flag
from haptic_driver.processes.shared_memory import RING_SAMPLES, Output, SharedState
from haptic_driver.processes.started import start_thread
from haptic_driver.recording.clock import clock_offsets
from haptic_driver.recording.event import Event
from haptic_driver.rig.actuator import actuator_name
from haptic_driver.rig.devices import calibration_ids
from haptic_driver.rig.evidence import KnownOutput
from haptic_driver.rig.part import NoPart, Wiring
from haptic_driver.rig.parts.event_lines import EventLineSection
from haptic_driver.rig.parts.lines_in import LineInSection
from haptic_driver.rig.roles import ROLES
from haptic_driver.rig.states import RigState
from haptic_driver.textures.library import script_names, texture_names
from hw.event_line.contract import EventLine, LineIn
from hw.health import WithHealth, with_health

WATCH_PERIOD_S = 0.02
ARM_PATIENCE_S = 2.0
MEASURED_SAMPLES = 100
TIMED_SAMPLES = 1000


class Daemon:
    """What a client may ask of a rig, thread-safe; starts in `__enter__`, ends with the output off
    in `close`.

    Once `ended` is set nothing is waited for any more, not even while it starts; `close` is still
    to be called.
    """

    def __init__(
        self,
        settings: DaemonSettings,
        clock: Callable[[], float] = time.monotonic,
        ended: threading.Event | None = None,
    ) -> None:
        identified = calibration_ids(settings.config)  # may fail, and holds nothing yet
        self._clock = clock
        self.shared = shared = SharedState()
        self.event_log = events = EventLog()
        self._orders = orders = Orders(settings, shared, events, clock)
        self._loader = Loader()
        self._painter = Loader("painter")  # begun when somebody looks
        basis = Basis(settings, shared, events, self._loader)
        self.basis: Basis = basis
        screen = settings.config.screen
        targets = Targets(
            shared,
            orders,
            events,
            clock,
            partial(_reachable, basis),
            self._loader,
            (screen.width_m, screen.height_m),
        )
        self.targets: Targets = targets
        self._recordings = Recordings(
            shared,
            events,
            lambda: basis.settings,
            identified,
            orders.machine.is_held_by,
            self._instruments,
            clock,
        )
        self.supervisor = Supervisor(settings, shared, orders, events, clock, ended)
        basis.among(orders, targets, self._recordings, self.supervisor)
        self._watched = Watched(
            shared,
            orders,
            targets,
            events,
            settings.render,
            lambda: advice(self.supervisor.real_time),
            lambda: self._latency(self._judged()),
            settings.not_covered,
        )
        self._apart: list[WithHealth] = []  # devices that are none of the rig's
        self.event_line = self._event_line(settings)
        self.line_in = self._line_in(settings)
        self._ending = threading.Event()
        self._threads: list[threading.Thread] = []

    # --- life

    def start(self) -> None:
        """Start everything; idle when it returns. Raises HapticError and DeviceError, with nothing
        left running.
        """
        try:
            self._orders.beat()
            # compiled before anybody can arm
            _current_a(self.basis.settings, self.shared.output.read(), 0.0)
            self.supervisor.start()
            # while the others come up: on a busy machine it takes seconds, and a texture waits
            self._loader.start()
            self._start_threads()
            if self.event_line is not None:
                self.event_line.start()
            self.basis.start()
            self.supervisor.await_all()
            if self.line_in is not None:  # last: an edge begins a recording of all the rest
                self.line_in.start()
        except BaseException:
            self.close()
            raise
        with self._orders.lock:
            self._orders.machine.connected()
            self.event_log.tell("state", f"idle: connected, output {self._orders.pump.output}")

    def close(self) -> KnownOutput:
        """Switch off and end everything; what was known of the output when the instruments were
        let go. Never raises.
        """
        with suppress(HapticError):
            self.disarm()
        self._ending.set()
        join_within(END_S, self._threads)
        self.supervisor.end()
        self.basis.close()
        self._loader.close()
        self._painter.close()
        output = self.supervisor.close()
        if self.event_line is not None:
            self.event_line.close()
        if self.line_in is not None:
            self.line_in.close()
        with suppress(HapticError):
            self._recordings.stop()
        self.shared.close()
        return output

    def __enter__(self) -> Daemon:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def pids(self) -> dict[str, int]:
        """Process ids by name, for whoever supervises or tests."""
        loaders = self._loader.pids | self._painter.pids
        return self.supervisor.pids | self._recordings.pids | self.basis.pids | loaders

    def _line_in(self, settings: DaemonSettings) -> LineInWatch | None:
        """What hears the rig's line in, if it has one."""
        section = settings.config.line_in
        if isinstance(section, NoPart):
            return None
        line: LineIn = self._alone("line_in", section)
        recordings = self._recordings
        return LineInWatch(line, section, self.record, lambda: recordings.asked, self.event_log)

    def _event_line(self, settings: DaemonSettings) -> EventLineWriter | None:
        """What writes to the rig's event line, if it has one."""
        section, orders = settings.config.event_line, self._orders
        if isinstance(section, NoPart):
            return None
        line: EventLine = self._alone("event_line", section)
        return EventLineWriter(
            line,
            section.pulse_s,
            settings.config.event_codes,
            self.shared.ring,
            lambda: orders.pump.output,
            self.event_log,
            lambda: orders.raise_flag(Flag.EVENT_LINE),
        )

    def _alone(self, key: str, section: EventLineSection | LineInSection) -> Any:
        """A device that is wired to no other, and has a thread of its own."""
        self._apart.append(with_health(section.make(Wiring()).device, key, ROLES[key].asking))
        return self._apart[-1]

    def _start_threads(self) -> None:
        pump = self._orders.pump
        for name, work in (("watch", self._watch), ("bring_out", pump.run)):
            self._threads.append(start_thread(name, work, self._ending))

    def _watch(self, ending: threading.Event) -> None:
        while not ending.is_set():
            now_s = self._clock()
            try:
                self._orders.beat()
                for watch in WATCHERS:
                    watch(self._watched, now_s)
                self._recordings.watch()
                self.supervisor.watch(now_s)
            except BaseException as error:  # whatever it is: watching goes on, with the output off
                self._orders.fail(message_of(error))
            ending.wait(WATCH_PERIOD_S)

    # --- what the API asks

    def status(self) -> Status:
        output, now_s, recording = self.shared.output.read(), self._clock(), self._recordings.path
        orders, targets, settings = self._orders, self.targets, self.basis.settings
        load_n, reachable_cof = targets.reach()
        newest = self.shared.ring.newest(MEASURED_SAMPLES)
        judged = self._judged()
        latency = self._latency(judged)
        with orders.lock:
            machine, rendering, known = orders.machine, orders.rendering, orders.pump.output
            return Status(
                state=machine.state,
                simulated=settings.config.is_computed,
                rig=shown(settings.config.name),
                model=settings.model,
                texture=targets.name if rendering else None,
                target_cof=targets.asked_cof(output, newest) if rendering else None,
                measured_cof=_mean(newest, "measured_cof"),
                estimated_cof=_mean(newest, "estimated_cof"),
                estimated_cof_std=_mean(newest, "estimated_cof_std"),
                **_touch(newest),
                contacts=_count(self.shared.sensed.read().contacts),
                reachable_cof=list(reachable_cof),
                frequency_hz=output.frequency_hz if rendering and known.on else None,
                voltage_v=0.0 if known.on is False else output.voltage_v if rendering else None,
                current_rms_a=(
                    _current_a(settings, output, load_n) if rendering and known.on else None
                ),
                output_on=known.on,
                output_said=str(known),
                output_age_s=known.age_s,
                ticks=output.tick,
                overruns=output.overruns,
                timing=timing_of(self.shared.ring.newest(TIMED_SAMPLES), settings.render.period_s),
                underruns=self.shared.played.read().underruns,
                switched=orders.pump.switched,
                relay_interval_s=settings.config.generator_kind().relay_interval_s,
                flags=orders.flags(output).names(),
                fault=machine.fault_reason,
                lease_left_s=max(machine.lease_until_s - now_s, 0.0) if machine.armed else None,
                lease_holder=None if machine.holder is None else shown(machine.holder),
                actuator=actuator_name(settings.config),
                real_time=self.supervisor.real_time,
                latency_budget_s=settings.latency_budget_s(self.shared.played.read().lead_s),
                latency_measured_s=latency.measured_s,
                latency_error_s=latency.error_s,
                latency_why=latency.why,
                fidelity=judged.fidelity,
                surface_hash=settings.surface.content_hash,
                load=self.supervisor.load.status(_mean(newest, "normal_force_n")),
                feedback=settings.feedback,
                agreement=self.basis.observer.cells,
                disagreement=self.basis.observer.said,
                adaptation=self.basis.observer.swap.said,
                recording=str(recording) if recording is not None else None,
                recording_fault=self._recordings.fault,
                line_in=None if self.line_in is None else self.line_in.status(),
                instruments=self._instruments(),
            )

    def _instruments(self) -> list[InstrumentStatus]:
        now_s = self._clock()
        known = [*self.supervisor.health, *(one.health for one in self._apart)]
        return [InstrumentStatus.of(health, now_s) for health in known]

    def _judged(self) -> Judged:
        """What was found since arming."""
        judged, arming = self.basis.observer.judged, self._orders.machine.arming
        return judged if judged.arming == arming else Judged(arming)

    def _latency(self, judged: Judged) -> MeasuredLatency:
        budget_s = self.basis.settings.latency_budget_s(self.shared.played.read().lead_s)
        return measured_latency(judged.latency, budget_s["total"])

    def arm(self, lease_s: float, holder: str = SOMEBODY) -> Lease:
        """Idle -> armed. Sensors that a busy machine keeps from speaking are given a moment, with
        the lock free.
        """
        self.supervisor.silent(ARM_PATIENCE_S)
        with self._orders.lock:
            self.supervisor.refuse_unless_ready(self.basis.settings, self._orders.machine.state)
            lease = self._orders.arm(lease_s, holder)
            self.targets.forget()
            self.event_log.tell("state", f"armed by {holder}, lease {lease_s:g} s")
        return lease

    def renew(self, token: str) -> Lease:
        """Keep the lease alive."""
        return self._orders.renew(token)

    def hold_load(self, token: str, newtons: float) -> Status:
        """Have the load stage press and hold."""
        self.supervisor.load.hold(token, newtons)
        return self.status()

    def release_load(self) -> Status:
        """Have it let go."""
        self.supervisor.load.release()
        return self.status()

    def off(self) -> Status:
        """Output to zero at once."""
        self._orders.withdraw(self._orders.machine.off)
        self.event_log.tell("state", self._orders.said)
        return self.status()

    def disarm(self) -> Status:
        """Off, and the lease is gone."""
        self._orders.withdraw(self._orders.machine.disarm)
        self.event_log.tell("state", f"disarmed; {self._orders.said}")
        return self.status()

    def reset(self) -> Status:
        """Acknowledge a fault or trip whose cause is gone."""
        orders, supervisor = self._orders, self.supervisor
        if orders.machine.state is not DaemonState.FAULT:
            raise RefusedError(
                "no_fault",
                f"the daemon is {orders.machine.state}, not in fault",
                "nothing to reset",
            )
        instruments = supervisor.instruments
        if supervisor.missing or instruments is None:
            raise RefusedError("cause_remains", supervisor.missing, "try again when it is back")
        rig = instruments.rig
        rig.reset_trip()
        if rig.state is not RigState.OFF and rig.off().on is not False:
            raise RefusedError(
                "not_off",
                f"the output cannot be shown to be off: {rig.output}",
                "switch the amplifier off by hand",
            )
        with orders.lock:
            orders.reset()
            self.event_log.tell("state", "fault acknowledged; idle")
        return self.status()

    def use_model(
        self, name: str, carrier_hz: float | None = None, *, feedback: bool = True
    ) -> Status:
        """Solve its surface and let render begin anew with it, at one carrier, or without
        feedback.
        """
        self.basis.use(name, carrier_hz, feedback=feedback)
        return self.status()

    def adapt(self, on: bool) -> Status:
        """Refit the model while rendering, or restore it."""
        if on and self.basis.settings.config.friction_from_current:
            said = "friction is estimated from the current by the model, and cannot refit it"
            raise RefusedError("no_force_sensor", said, "refit it on a rig with a force sensor")
        self.basis.observer.swap.adapt(on)
        return self.status()

    def record(self, path: str | Path | None, lease: str | None = None) -> Status:
        """Start or stop a recording, which may end with a lease."""
        if path is None:
            self._recordings.stop(lease)
        else:
            with self.targets.changing:  # the scene stays meanwhile: a recorder takes its time
                since_s = time.monotonic()
                self._recordings.start(Path(path), lease)
                self.targets.tell_scene(since_s)
        return self.status()

    def mark(self, label: str, data: Mapping[str, Any]) -> Marked:
        """Somebody's marker among the events."""
        event = self.event_log.add("marker", label, data)
        return Marked(number=event.number, time_s=event.time_s, **dict(clock_offsets()))

    def textures(self) -> list[str]:
        """Names that `play` knows."""
        return texture_names(texture_dirs())

    def scripts(self) -> list[str]:
        """Those of them that are timed scripts."""
        return script_names(texture_dirs())

    def models(self) -> list[str]:
        """Names that `use_model` knows."""
        return config_names("models")

    @property
    def newest_tick(self) -> int:
        """The last one that render has written; it may be computing the next."""
        return self.shared.output.read().tick

    def samples(self, since_tick: int, most: int) -> NDArray[np.void]:
        """Records after `since_tick`, the newest `most`."""
        taken = self.shared.ring.newest(min(most, RING_SAMPLES))
        return taken[taken["tick"] > since_tick]

    def events(self, since: int) -> Sequence[Event]:
        return self.event_log.since(since)

    def surface_map(self) -> dict[str, Any]:
        """Friction over frequency and voltage at the usual load."""
        return drawings.surface_map(
            self.basis.settings.protected, self.basis.settings.config.operating_limits()
        )

    def texture_map(self) -> dict[str, Any]:
        """Friction asked for on the screen."""
        return drawings.texture_map(self.targets.target, self._clock())

    def tile(self, asked: TileRequest) -> Tile:
        """A part of a texture of the library, as a picture."""
        return drawings.tile(self._painter, asked)


def _count(contacts: float) -> int | None:
    return None if math.isnan(contacts) else int(contacts)


def _reachable(basis: Basis, normal_force_n: float) -> tuple[float, float]:
    return basis.settings.render.tick.controller.reachable(normal_force_n)


def _mean(samples: NDArray[np.void], name: str) -> float | None:
    """Over the samples that have it; None without any."""
    known = samples[name][np.isfinite(samples[name])]
    return float(known.mean()) if known.size else None


def _touch(samples: NDArray[np.void]) -> dict[str, float | None]:
    """Load, place, speed and current at the newest of the samples; None without a finger."""
    names = ("normal_force_n", "position_x_m", "position_y_m", "speed_m_s", "current_a")
    newest = samples[-1:]
    if not newest.size or not newest["in_contact"][0]:
        return dict.fromkeys(names)
    return {name: _mean(newest, name) for name in names}


def _current_a(settings: DaemonSettings, output: Output, normal_force_n: float) -> float:
    controller = settings.render.tick.controller
    return controller.current_a(output.frequency_hz, output.voltage_v, normal_force_n)
