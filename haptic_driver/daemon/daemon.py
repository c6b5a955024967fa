"""The control process: state, lease, targets and events; what the API asks of the daemon.

Whatever goes wrong with a device or a process takes the output to zero first and is then a fault; what died is started
again (`supervision.py`), and the daemon stays in fault until somebody resets it.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_driver.config import texture_dirs
from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.instruments import Instruments
from haptic_driver.daemon.messages import DaemonState, Lease, RefusedError, Status
from haptic_driver.daemon.output_pump import OUTPUT_STALE_S, PUMP_PERIOD_S, OutputPump
from haptic_driver.daemon.set_up import DaemonSettings
from haptic_driver.daemon.state_machine import StateMachine
from haptic_driver.daemon.supervision import Supervisor
from haptic_driver.daemon.web import drawings
from haptic_driver.errors import HapticError
from haptic_driver.processes.samples import Flag
from haptic_driver.processes.shared_memory import NO_ORDER, RING_SAMPLES, Output, SharedState
from haptic_driver.recording.event import Event
from haptic_driver.recording.process import Recorder
from haptic_driver.recording.writer import RunHeader
from haptic_driver.render.texture import Script, Target, Uniform
from haptic_driver.rig.actuator import actuator_name
from haptic_driver.rig.devices import calibration_ids
from haptic_driver.rig.states import RigEvent, RigState
from haptic_driver.textures.library import load, texture_names
from hw.errors import DeviceError

WATCH_PERIOD_S = 0.02
TAKE_OVER_S = 0.5  # render takes up a target within a tick; a stalled one never
MEASURED_SAMPLES = 100
UNDERRUN_TOLD_S = 1.0  # at most so often: a machine that is too slow makes many
DRIFT = 0.2  # a change of the finger's gain, relative, that is worth an event


class Daemon:
    """Everything that `Control` promises; starts in `__enter__`, ends with the output off in `close`."""

    def __init__(self, settings: DaemonSettings, clock: Callable[[], float] = time.monotonic) -> None:
        self.settings = settings
        self._calibration_ids = calibration_ids(settings.config)  # may fail, and holds nothing yet
        self.shared = SharedState()
        self._clock = clock
        self._machine = StateMachine()
        self._lock = threading.RLock()  # of the machine, the order and the events; never held over I/O
        self._recording = threading.Lock()  # of whoever starts or stops a recording
        self._choosing = threading.Lock()  # of whoever hands a target over
        self._order = NO_ORDER
        self._armed_at = 0  # the first order of the present arming
        self._flags = Flag(0)
        self._told = Flag(0)
        self._target: Target | None = None
        self._target_name: str | None = None
        self._marked_s = -math.inf  # up to when markers of the script were told
        self._told_gain = 1.0  # of the finger
        self._told_underruns, self._told_underrun_s = 0, -math.inf
        self._recorder: Recorder | None = None
        self._events = EventLog(self._record_event)
        self._pump = OutputPump(
            self.shared, settings.config.output.setpoint_interval_s, settings.render.period_s, self._fail, clock
        )
        self._supervisor = Supervisor(
            settings, self.shared, self._pump,
            failed=self._fail, tell=self._events.tell, rig_says=self._rig_says, clock=clock,
        )  # fmt: skip
        self._ending = threading.Event()
        self._threads: list[threading.Thread] = []

    # --- life --------------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Start everything; idle when it returns. Raises HapticError and DeviceError, with nothing left running."""
        try:
            self._order_now()
            self._supervisor.start()
            self._start_threads()
            self._supervisor.await_all()
        except BaseException:
            self.close()
            raise
        with self._lock:
            self._machine.connected()
            self._events.tell("state", "idle: connected, output off")

    def close(self) -> bool | None:
        """Switch off and end everything; whether the output is on (None: unknown). Never raises."""
        with suppress(HapticError):
            self.disarm()
        self._ending.set()
        for thread in self._threads:
            thread.join()
        self._supervisor.end()
        output_on = self._supervisor.close()
        self._stop_recording()
        self.shared.close()
        return output_on

    def __enter__(self) -> Daemon:
        """Start."""
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Close."""
        self.close()

    @property
    def pids(self) -> dict[str, int]:
        """Process ids by name, for whoever supervises or tests."""
        return self._supervisor.pids | ({"recorder": self._recorder.pid} if self._recorder is not None else {})

    @property
    def endpoints(self) -> dict[str, str]:
        """Where simulated instruments are; empty for a real rig."""
        return self._supervisor.endpoints

    @property
    def instruments(self) -> Instruments | None:
        """The devices; None while they are being connected."""
        return self._supervisor.instruments

    def tell(self, kind: str, message: str) -> None:
        """Add to the events what somebody beside the daemon has to say."""
        self._events.tell(kind, message)

    def _start_threads(self) -> None:
        for work in (self._watch, self._bring_out, self._play):
            thread = threading.Thread(target=work, name=work.__name__.strip("_"), daemon=True)
            self._threads.append(thread)
            thread.start()

    # --- threads -----------------------------------------------------------------------------------------------

    def _bring_out(self) -> None:
        """Shared memory -> instruments."""
        self._pump.run(self._ending)

    def _play(self) -> None:
        """The same for what is faster than a dialogue with the generator."""
        self._pump.play(self._ending)

    def _watch(self) -> None:
        """Processes, instruments, lease, flags; says every time that control is alive."""
        while not self._ending.is_set():
            now_s = self._clock()
            try:
                with self._lock:
                    self._order_now()
                self._watch_lease(now_s)
                self._watch_render(now_s)
                self._watch_underruns(now_s)
                self._watch_script(now_s)
                self._watch_drift()
                self._watch_recorder()
                self._supervisor.watch(now_s, self._machine.state is DaemonState.RENDERING)
            except (HapticError, DeviceError) as error:
                self._fail(error.message)
            self._ending.wait(WATCH_PERIOD_S)

    def _watch_lease(self, now_s: float) -> None:
        """After render has ramped down for a lost lease: off, idle."""
        with self._lock:
            over = self._machine.armed and now_s > self._machine.lease_until_s + self.settings.render.ramp_s
        if over:
            self._flags |= Flag.LEASE_LOST
            self._withdraw(self._machine.disarm)
            self._events.tell("lease", "the lease ran out; output off")

    def _watch_render(self, now_s: float) -> None:
        output = self.shared.output.read()
        with self._lock:
            rendering = self._machine.state is DaemonState.RENDERING
            new = self._flags_of(output) & ~self._told
            self._told |= new
        for name in new.names():
            self._events.tell("flag", name)
        if rendering and Flag.FAULT in self._flags_of(output):
            self._fail(f"render missed {self.settings.render.most_missed} ticks in a row")
        if rendering and now_s - output.time_s > OUTPUT_STALE_S:
            self._fail(f"render has said nothing for {now_s - output.time_s:.2g} s")

    def _watch_underruns(self, now_s: float) -> None:
        underruns = self._pump.underruns
        if underruns > self._told_underruns and now_s - self._told_underrun_s >= UNDERRUN_TOLD_S:
            self._told_underruns, self._told_underrun_s = underruns, now_s
            with self._lock:
                self._flags |= Flag.UNDERRUN
            self._events.tell("flag", "underrun", underruns=underruns)

    def _watch_script(self, now_s: float) -> None:
        """Markers of a script, when they pass."""
        with self._lock:
            rendering = self._machine.state is DaemonState.RENDERING
            target, since_s, self._marked_s = self._target, self._marked_s, now_s
        if rendering and isinstance(target, Script):
            for marker in target.markers(since_s, now_s):
                self._events.tell("marker", marker.label, due_s=marker.time_s)

    def _watch_drift(self) -> None:
        """The finger's estimated gain, each time that it is far from what was told last."""
        newest = self.shared.ring.read(max(self.shared.ring.position - 1, 0)).samples
        if self._machine.state is not DaemonState.RENDERING or not newest.size or not newest["in_contact"][-1]:
            return
        gain = float(newest["feedback_gain"][-1])
        if abs(gain / self._told_gain - 1.0) > DRIFT:
            self._told_gain = gain
            self._events.tell("drift", f"the finger's gain is {gain:.2f}", gain=gain)

    # --- what the API asks -------------------------------------------------------------------------------------

    def status(self) -> Status:
        """The present state."""
        output, now_s, recorder = self.shared.output.read(), self._clock(), self._recorder
        with self._lock:
            machine = self._machine
            flags = self._flags | self._flags_of(output)
            left_s = machine.lease_until_s - now_s
            rendering = machine.state is DaemonState.RENDERING
            return Status(
                state=machine.state,
                simulated=self.settings.config.simulated,
                rig=self.settings.config.name,
                model=self.settings.model,
                texture=self._target_name if rendering else None,
                target_cof=self._asked_cof(output) if rendering else None,
                measured_cof=self._measured_cof(),
                frequency_hz=output.frequency_hz if rendering and self._pump.output_on else None,
                voltage_v=output.voltage_v if rendering else 0.0,
                output_on=self._pump.output_on,
                ticks=output.tick,
                overruns=output.overruns,
                underruns=self._pump.underruns,
                flags=flags.names(),
                fault=machine.fault_reason,
                lease_left_s=max(left_s, 0.0) if machine.armed else None,
                actuator=actuator_name(self.settings.config),
                real_time=self._supervisor.real_time,
                latency_budget_s=self.settings.latency_budget_s,
                surface_hash=self.settings.surface.content_hash,
                recording=str(recorder.path) if recorder is not None else None,
            )

    def arm(self, lease_s: float) -> Lease:
        """Idle -> armed."""
        with self._lock:
            self._refuse_if_not_ready()
            lease = self._machine.arm(self._clock(), lease_s)
            self._flags = self._told = Flag(0)
            self._target = self._target_name = None
            self._told_gain = 1.0
            self._order_now()
            self._armed_at = self._order.number
            self._events.tell("state", f"armed, lease {lease_s:g} s")
        return lease

    def renew(self, token: str) -> Lease:
        """Keep the lease alive."""
        with self._lock:
            lease = self._machine.renew(token, self._clock())
            self._order_now()
        return lease

    def set_target(self, token: str, cof: float) -> Status:
        """Ask for one friction everywhere."""
        self._render(token, Uniform(cof), None)
        self._events.tell("target", f"friction {cof:g}", cof=cof)
        return self.status()

    def play(self, token: str, texture: str) -> Status:
        """Ask for a texture, or begin a script."""
        target = load(texture, texture_dirs()).target
        self._render(token, target.started(self._clock()) if isinstance(target, Script) else target, texture)
        self._events.tell("texture", texture)
        return self.status()

    def off(self) -> Status:
        """Output to zero at once."""
        self._withdraw(self._machine.off)
        self._events.tell("state", f"off; the daemon is {self._machine.state}")
        return self.status()

    def disarm(self) -> Status:
        """Off, and the lease is gone."""
        self._withdraw(self._machine.disarm)
        self._events.tell("state", f"disarmed; the daemon is {self._machine.state}")
        return self.status()

    def reset(self) -> Status:
        """Acknowledge a fault or trip whose cause is gone."""
        if self._machine.state is not DaemonState.FAULT:
            raise RefusedError("no_fault", f"the daemon is {self._machine.state}, not in fault", "nothing to reset")
        instruments = self._supervisor.instruments
        if self._supervisor.missing or instruments is None:
            raise RefusedError("cause_remains", self._supervisor.missing, "try again when it is back")
        rig = instruments.rig
        rig.reset_trip()
        if rig.state is not RigState.OFF and rig.off().output_on is not False:
            raise RefusedError("not_off", "the output cannot be shown to be off", "switch the amplifier off by hand")
        with self._lock:
            self._machine.reset()
            self._flags = Flag(0)
            self._events.tell("state", "fault acknowledged; idle")
        return self.status()

    def use_model(self, name: str) -> Status:
        """Solve its surface and let render begin anew with it."""
        settings = self.settings.with_model(name)
        with self._recording, self._choosing:
            with self._lock:
                if self._machine.state is not DaemonState.IDLE:
                    raise RefusedError("not_idle", f"the daemon is {self._machine.state}", "disarm, or reset, first")
                if self._recorder is not None:
                    raise RefusedError("recording", "a run keeps its surface", "stop the recording first")
                self._supervisor.claim_render()
                self.settings = settings
            self._supervisor.render_anew(settings)
        self._events.tell("model", name, surface_hash=settings.surface.content_hash)
        return self.status()

    def record(self, path: str | None) -> Status:
        """Start or stop a recording."""
        with self._recording:
            if path is None:
                self._stop_recording()
            elif self._recorder is not None:
                raise RefusedError("recording", f"already recording into {self._recorder.path}", "stop that first")
            else:
                self._recorder = Recorder(Path(path), self._run_header(), self.shared)
                self._events.tell("recording", f"into {self._recorder.path}")
        return self.status()

    def textures(self) -> list[str]:
        """Names that `play` knows."""
        return texture_names(texture_dirs())

    def samples(self, since_tick: int, most: int) -> NDArray[np.void]:
        """Records after `since_tick`, the newest `most`."""
        taken = self.shared.ring.read(max(self.shared.ring.position - min(most, RING_SAMPLES), 0)).samples
        return taken[taken["tick"] > since_tick]

    def events(self, since: int) -> Sequence[Event]:
        """Events above `since`."""
        return self._events.since(since)

    def surface_map(self) -> dict[str, Any]:
        """Friction over frequency and voltage at the usual load."""
        return drawings.surface_map(self.settings.surface)

    def texture_map(self) -> dict[str, Any]:
        """Friction asked for on the screen."""
        return drawings.texture_map(self._target, self._clock())

    # --- inside ------------------------------------------------------------------------------------------------

    def _render(self, token: str, target: Target, name: str | None) -> None:
        """Hand a target to render, which takes it up between two ticks."""
        with self._choosing:
            with self._lock:
                self._machine.renew(token, self._clock())  # whoever asks is alive
                number = self._order.target
            self._await_target(number)
            self.shared.targets.write(number + 1, target)
            with self._lock:
                self._machine.render(token, self._clock())
                self._order_now(number + 1)
                self._pump.open(self._order.number)
                self._target, self._target_name = target, name
                self._marked_s = -math.inf

    def _await_target(self, number: int) -> None:
        """Until render uses the target before, since the next one takes the place of the one before that."""
        until_s = self._clock() + TAKE_OVER_S
        while self.shared.output.read().target != number:
            if self._clock() > until_s:
                raise RefusedError("render_stalls", "render does not take up targets", "look at the status")
            time.sleep(PUMP_PERIOD_S)

    def _withdraw(self, move: Callable[[], object]) -> None:
        """Off now; then the state says so, and a command that was on its way meanwhile is undone."""
        self._pump.off()
        with self._lock:
            move()
            self._pump.close()
            self._order_now()
        self._pump.undo_late_command()

    def _fail(self, reason: str) -> None:
        """Off, and fault."""
        if self._machine.state is DaemonState.FAULT:
            return
        news = False

        def move() -> None:
            nonlocal news
            news = self._machine.fault(reason)
            self._flags |= Flag.FAULT

        self._withdraw(move)
        if news:
            self._events.tell("fault", reason)

    def _refuse_if_not_ready(self) -> None:
        settings, supervisor = self.settings, self._supervisor
        if supervisor.missing and self._machine.state is not DaemonState.FAULT:
            raise RefusedError("not_ready", supervisor.missing, "wait until it is back")
        if silent := supervisor.silent():
            raise RefusedError("not_ready", silent, "check the sensors; look at the events")
        if open_facts := settings.config.unverified:
            raise RefusedError(
                "unverified", f"the file of rig {settings.config.name} leaves open: {'; '.join(open_facts)}",
                "measure them, write them down with who measured them and when, and start the daemon again",
            )  # fmt: skip
        if not (settings.config.simulated or supervisor.real_time or settings.allow_no_rt):
            raise RefusedError(
                "no_real_time", "render was not granted real-time scheduling, and this rig is real",
                "allow it (LimitRTPRIO, LimitMEMLOCK), or start the daemon with --allow-no-rt",
            )  # fmt: skip

    def _run_header(self) -> RunHeader:
        settings = self.settings
        return RunHeader(
            rig=settings.config.name,
            simulated=settings.config.simulated,
            model=settings.model,
            surface_hash=settings.surface.content_hash,
            calibration_ids=self._calibration_ids,
            software_version=version("haptic-driver"),
            actuator=actuator_name(settings.config),
            latency_budget_s=settings.latency_budget_s,
            config=settings.config.model_dump(mode="json"),
        )

    def _stop_recording(self) -> None:
        recorder, self._recorder = self._recorder, None
        if recorder is not None:
            why = recorder.stop()
            self._events.tell("recording", f"ended: {recorder.path}" if why is None else f"ended badly: {why}")

    def _record_event(self, event: Event) -> None:
        if self._recorder is not None:
            self._recorder.note(event)

    def _watch_recorder(self) -> None:
        """A recording that ends by itself is told of; rendering goes on without it."""
        recorder = self._recorder
        if recorder is not None and self._recording.acquire(blocking=False):
            try:
                if recorder is self._recorder and (why := recorder.ended()) is not None:
                    self._recorder = None
                    self._events.tell("recording", why)
            finally:
                self._recording.release()

    def _order_now(self, target: int | None = None) -> None:
        """Tell render what holds now; a new number when it is something else than before."""
        machine = self._machine
        order = self._order._replace(
            arming=machine.arming,
            rendering=machine.state is DaemonState.RENDERING,
            target=self._order.target if target is None else target,
        )
        if order != self._order:
            order = order._replace(number=order.number + 1)
        self._order = order._replace(lease_until_s=machine.lease_until_s, beat_s=self._clock())
        self.shared.order.write(self._order)

    def _rig_says(self, event: RigEvent) -> None:
        if event.state is RigState.TRIPPED:
            self._flags |= Flag.TRIPPED
            self._events.tell("trip", event.reason)

    def _asked_cof(self, output: Output) -> float | None:
        """What was asked for, also before render has taken it up; for a texture what it asks under the finger."""
        if isinstance(self._target, Uniform):
            return self._target.cof
        return _finite(output.target_cof) if output.target == self._order.target else None

    def _flags_of(self, output: Output) -> Flag:
        """What render flags, unless it has not heard of the present arming yet."""
        return Flag(output.flags) if output.order >= self._armed_at else Flag(0)

    def _measured_cof(self) -> float | None:
        """Mean over the last samples; None without sliding contact."""
        ring = self.shared.ring
        measured = ring.read(max(ring.position - MEASURED_SAMPLES, 0)).samples["measured_cof"]
        sliding = measured[np.isfinite(measured)]
        return float(sliding.mean()) if sliding.size else None


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
