"""What the daemon consists of besides control: started, watched over, and brought back when it died
or fell silent.

The same for real and simulated rigs; only `_connect_instruments` knows the difference. Whoever
supervises never decides that output may come on: it says what is missing, and what failed.
"""

from __future__ import annotations

import logging
import math
import os
import pickle
import threading
import time
from collections.abc import Callable
from functools import partial

from haptic_driver.daemon.envelope_process import EnvelopeSettings
from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.instruments import Instruments, connect
from haptic_driver.daemon.load import HeldLoad
from haptic_driver.daemon.messages import DaemonState, RefusedError
from haptic_driver.daemon.orders import Orders
from haptic_driver.daemon.output_pump import OUTPUT_STALE_S
from haptic_driver.daemon.set_up import DaemonSettings
from haptic_driver.errors import HapticError, message_of
from haptic_driver.live.current_sensor import Carried
from haptic_driver.processes.child import Child
from haptic_driver.processes.patience import join_within
from haptic_driver.processes.shared_memory import SharedState
from haptic_driver.processes.started import start_thread
from haptic_driver.rig.devices import modulation_input
from haptic_driver.rig.evidence import KnownOutput
from haptic_driver.rig.load_loop import LoadSensor
from haptic_driver.rig.part import NoPart
from haptic_driver.rig.rig import require_verified
from haptic_driver.rig.states import RigState
from haptic_driver.signals import SLIDING_M_S
from haptic_driver.simulation.twin import reached
from hw.errors import DeviceError, NotBelieved
from hw.health import Health

START_TIMEOUT_S = 240.0  # compiling all kernels, on a busy machine
HEARD_S = 30.0  # from ready until readings and ticks come, on a busy machine
END_S = 5.0  # at most for threads in which a device may hang, with the output off
LOOK_PERIOD_S = 0.2  # between looks at the rig and its watchdog
SENSOR_RETRY_S = 0.02
# so long: a silent render is started anew; sensors that fail or an unknown output: all connected
# anew
LOST_S = 2.0
# between attempts at that: twice as long each time, up to the most
RETRY_S, MOST_RETRY_S = 1.0, 30.0
SILENCE_POLL_S = 0.005

RENDER, INSTRUMENTS, ENVELOPE, WATCHDOG = "render", "instruments", "envelope", "watchdog"

LIFT_HINT = "lift what is too much"
_log = logging.getLogger(__name__)


class Supervisor:
    """The render process, the instruments (in a process of their own where simulated) and their
    sensors' thread.

    `missing` says why nobody can arm; empty when all is there. `orders` get each state that takes
    the output away.
    """

    def __init__(
        self,
        settings: DaemonSettings,
        shared: SharedState,
        orders: Orders,
        events: EventLog,
        clock: Callable[[], float],
        ended: threading.Event | None = None,
    ) -> None:
        self.missing = "the daemon is starting"
        self.instruments: Instruments | None = None
        self.load = HeldLoad(settings.config, shared, orders, events, clock)
        self.endpoints: dict[str, str] = {}  # of simulated instruments
        self._force_sensor: LoadSensor | None = None  # the last one: the next keeps its bias
        self.real_time = False
        self.settings = settings  # of what is started next
        self._reached = settings.config  # as its drivers reach the rig's devices
        self._shared = shared
        self._orders = orders
        self._events = events
        self._clock = clock
        self._children: dict[str, Child] = {}
        self._looked_s = -math.inf
        self._sensors_failed: tuple[float, str] | None = None  # since when, and why
        self._unknown_since_s: float | None = None  # that the output may be on or off
        self._restarting = threading.Lock()
        self._ending = threading.Event() if ended is None else ended
        self._threads: list[threading.Thread] = []

    @property
    def pids(self) -> dict[str, int]:
        """Process ids by name."""
        found = {name: child.pid for name, child in self._children.items()}
        watchdog = self.instruments.watchdog_pid if self.instruments is not None else None
        return found | ({WATCHDOG: watchdog} if watchdog is not None else {})

    @property
    def health(self) -> list[Health]:
        """A record an instrument that is asked; none while they are not connected."""
        instruments = self.instruments
        return [] if instruments is None else instruments.devices.health

    def start(self) -> None:
        """Start and connect everything. Raises HapticError and DeviceError; `close` then ends what
        was started.
        """
        self._begin_instruments()  # both take seconds, at the same time
        self._start_render()
        self._connect_instruments()
        self._threads.append(start_thread("sense", self._sense))
        self._threads += self.load.start(self._ending)

    def await_all(self) -> None:
        """Until sensors and render have been heard; nothing is missing then. Raises HapticError
        when they are not.
        """
        self._await_heard()
        self.missing = ""

    def silent(self, patience_s: float = 0.0) -> str:
        """Who has not been heard lately, and is not heard while one waits; empty when all have."""
        until_s = self._clock() + patience_s
        while True:
            now_s, sensed = self._clock(), self._shared.sensed.read()
            last_s = {
                "the finger tracker": sensed.finger_time_s,
                "the force sensor": sensed.force_time_s,
            }
            last_s["render"] = self._shared.output.read().time_s
            if ENVELOPE in self._children:
                last_s["the envelope's writer"] = self._shared.played.read().time_s
            silent = ", ".join(
                f"{who} is silent"
                for who, time_s in last_s.items()
                if now_s - time_s > OUTPUT_STALE_S
            )
            hopeless = now_s >= until_s or any(map(_has_ended, list(self._children.values())))
            if not silent or hopeless or self._ending.wait(SILENCE_POLL_S):
                failed = self._sensors_failed
                return f"{silent} ({failed[1]})" if silent and failed is not None else silent

    def refuse_unless_ready(self, settings: DaemonSettings, state: DaemonState) -> None:
        """RefusedError with what keeps the output off; of a fault the state machine speaks
        itself.
        """
        if self.missing and state is not DaemonState.FAULT:
            raise RefusedError("not_ready", self.missing, "wait until it is back")
        if silent := self.silent():
            raise RefusedError("not_ready", silent, "check the sensors; look at the events")
        if why := settings.not_covered(self._shared.sensed.read()):
            raise RefusedError("not_covered", why, LIFT_HINT)
        config = settings.config
        require_verified(config)
        if not (config.simulated or self.real_time or settings.allow_no_rt):
            said = "render was not granted real-time scheduling, and this rig is real"
            hint = "allow it (LimitRTPRIO, LimitMEMLOCK), or start the daemon with --allow-no-rt"
            raise RefusedError("no_real_time", said, hint)

    def watch(self, now_s: float) -> None:
        """Look after everything, often; begins to bring back what is gone. Raises HapticError when
        the rig trips.
        """
        self.load.watch()
        for name, child in list(self._children.items()):
            if (ended := child.ended) is not None and not self._ending.is_set():
                self._lose(name, ended)
            elif not self.missing and (silent_s := self._silent_s(name)) > LOST_S:
                self._lose(name, f"{name} has said nothing for {silent_s:.2g} s")
        if now_s - self._looked_s >= LOOK_PERIOD_S:
            self._looked_s = now_s
            if self.instruments is not None:
                self._look_at(self.instruments, now_s)

    def claim_render(self) -> None:
        """Nobody can arm from here on, until `render_anew` or `release_render` has ended. Raises
        RefusedError.
        """
        with self._restarting:
            if self.missing:
                raise RefusedError("not_ready", self.missing, "wait until it is back")
            self.missing = f"{RENDER}: being started again"

    def release_render(self) -> None:
        """Render stays as it is."""
        with self._restarting:
            self.missing = ""

    def render_anew(self, settings: DaemonSettings) -> None:
        """Start render again, with other settings; what fails there is tried again, as after its
        death, and raised.
        """
        self.settings = settings
        self._children.pop(RENDER).kill()  # not one of those any more whose end is a fault
        try:
            self._start_render()
            self.await_all()
        except HapticError:
            self._begin_to_bring_back(RENDER)
            raise

    def end(self) -> None:
        """Begin nothing any more; returns when all threads have ended, but for one that hangs in a
        device.
        """
        self._ending.set()
        join_within(END_S, self._threads)

    def close(self) -> KnownOutput:
        """Switch off and end everything, after `end`; what was known of the output when the
        instruments were let go. Never raises.
        """
        output = (
            self.instruments.close() if self.instruments is not None else self._orders.pump.output
        )
        for child in self._children.values():
            child.stop()
        return output

    # --- starting

    def _start_render(self) -> None:
        self.real_time = self._start(RENDER, "render_process", self.settings.render)

    def _start(self, name: str, module: str, given: object) -> bool:
        """Start a process of ticks; whether it was granted real-time scheduling."""
        child = Child(
            name,
            f"haptic_driver.daemon.{module}",
            [self._shared.descriptor, os.getpid()],
            given=pickle.dumps(given),
            descriptors=[self._shared.descriptor],
        )
        self._children[name] = child
        granted = child.ready(START_TIMEOUT_S)
        if granted["refused"]:
            _log.warning("%s: %s", name, granted["refused"])
        return bool(granted["scheduled"])

    def _start_envelope(self) -> None:
        """Start the writer of an analog output, if the rig has one."""
        config = self._reached
        modulation = modulation_input(config)
        if modulation is None or isinstance(config.analog_output, NoPart):
            return
        settings = EnvelopeSettings(
            config.analog_output, modulation, config.output.voltage_rise_v_per_s
        )
        if ENVELOPE in self._children:
            self._children[ENVELOPE].kill()
        self._start(ENVELOPE, "envelope_process", settings)

    def _begin_instruments(self) -> None:
        """Begin to start simulated instruments; real ones are there already."""
        if (settings := self.settings).config.simulated:
            record = (
                [] if settings.amplifier_record is None else ["--record", settings.amplifier_record]
            )
            finger = [] if settings.finger is None else ["--finger", settings.finger]
            slide = [] if settings.slide is None else ["--slide", settings.slide]
            self._children[INSTRUMENTS] = Child(
                INSTRUMENTS,
                "haptic_driver.simulation.process",
                [settings.rig, settings.model, *record, *finger, *slide],
            )

    def _connect_instruments(self) -> None:
        config = self._reached = self.settings.config
        if INSTRUMENTS in self._children:
            self.endpoints = self._children[INSTRUMENTS].ready(START_TIMEOUT_S)["endpoints"]
            config = self._reached = reached(config, self.endpoints)
        self._start_envelope()  # at zero before there is a carrier
        self.instruments = connect(config, self._orders.rig_says, self._force_sensor)
        self._force_sensor = self.instruments.devices.force_sensor
        self.instruments.watch_electrode(
            partial(carried, self._shared), lambda: self.settings.model
        )
        self.load.exchange(self.instruments.devices)
        self._orders.pump.exchange(self.instruments.actuator)

    def _await_heard(self) -> None:
        if (silent := self.silent(HEARD_S)) and not self._ending.is_set():
            raise HapticError("silent", silent, "check the sensors; look at the log")

    # --- watching

    def _sense(self) -> None:
        """Sensors -> shared memory. What fails here is stale there, and render takes its output to
        zero.
        """
        while not self._ending.is_set():
            instruments, pause_s = self.instruments, SENSOR_RETRY_S
            try:
                if instruments is not None:
                    self._shared.sensed.write(instruments.read())
                    self._sensors_failed, pause_s = None, instruments.sensor_period_s
            except (
                BaseException
            ) as error:  # a plug-in may raise SystemExit, which would end this thread unheard
                self._sensors_fail(error)
            time.sleep(pause_s)

    def _sensors_fail(self, error: BaseException) -> None:
        """A sensor that is late may be back at once; one that says what cannot be is a fault from
        the first time on.
        """
        said = f"sensors: {message_of(error)}"
        if self._sensors_failed is None:
            self._sensors_failed = self._clock(), message_of(error)
            self._events.tell("flag", said)
        if isinstance(error, NotBelieved):
            self._orders.fail(f"{said}: {error.hint}")

    def _look_at(self, instruments: Instruments, now_s: float) -> None:
        """See to the rig's output, always; to the rest while nothing is being brought back."""
        if not self.missing and self._loses(instruments, now_s):
            return
        instruments.rig.watch(self._clock())  # what came before may have waited

    def _loses(self, instruments: Instruments, now_s: float) -> bool:
        """Whether a part of them was found lost just now."""
        if why := self._why_lost(instruments, now_s):
            self._lose(INSTRUMENTS, why)
            return True
        if instruments.rig.state is RigState.OFF and not self._orders.rendering:
            try:
                instruments.check_watchdog()
            except DeviceError as error:
                # a new one has to look at the load stage, whose port its driver holds
                self._lose(INSTRUMENTS if self.load.present else WATCHDOG, error.message)
                return True
        return False

    def _why_lost(self, instruments: Instruments, now_s: float) -> str | None:
        """Why the instruments have to be connected anew; None where they have not."""
        if (failed := self._sensors_failed) and now_s - failed[0] > LOST_S:
            return f"sensors: {failed[1]}"
        unknown = instruments.rig.answers_nothing
        self._unknown_since_s = (self._unknown_since_s or now_s) if unknown else None
        if self._unknown_since_s is not None and now_s - self._unknown_since_s > LOST_S:
            return "nobody knows whether the output is off"
        return None

    # --- bringing back

    def _lose(self, name: str, why: str) -> None:
        """Say so, then bring it back in a thread of its own, one thing at a time; nobody can arm
        meanwhile.
        """
        with self._restarting:
            is_first = not self.missing
            if is_first:
                self.missing = (  # set ahead of the fault's report: nobody resets in between
                    f"{name}: being started again"
                )
        self._orders.fail(why)
        if not is_first:
            return
        try:
            self._begin_to_bring_back(name)
        except RuntimeError:  # no thread is to be had: tried again with the next look
            self.missing = ""
            raise

    def _silent_s(self, name: str) -> float:
        """For how long a process has said nothing, since it was stopped or hangs."""
        if name == RENDER:
            return self._clock() - self._shared.output.read().time_s
        if name == ENVELOPE:
            return self._clock() - self._shared.played.read().time_s
        return 0.0

    def _gone(self, name: str) -> list[str]:
        """That, and each process that has ended or fallen silent meanwhile."""
        others = [
            other
            for other, child in self._children.items()
            if other != name and (_has_ended(child) or self._silent_s(other) > LOST_S)
        ]
        return [name, *others]

    def _bring_back(self, name: str) -> None:
        """Try for ever, more and more seldom, whatever is in the way: descriptors or memory may be
        short.
        """
        pause_s = RETRY_S
        while not self._ending.is_set():
            try:
                for gone in self._gone(name):
                    self._restart(gone)
                self._await_heard()
            except BaseException as error:
                said, before = f"{name}: cannot be started again: {message_of(error)}", self.missing
                self.missing = said
                if said != before:  # one thing once
                    _log.error("%s", said)
                self._ending.wait(pause_s)
                pause_s = min(2.0 * pause_s, MOST_RETRY_S)
            else:
                self._sensors_failed = self._unknown_since_s = None
                self.missing = ""
                self._events.tell("state", f"{name}: back; reset to go on")
                return

    def _restart(self, name: str) -> None:
        if name in self._children:
            self._children[name].kill()
        if name == RENDER:
            self._start_render()
        elif name == ENVELOPE:
            self._start_envelope()
        elif name == WATCHDOG and self.instruments is not None:
            self.instruments.restart_watchdog()
        else:
            instruments, self.instruments = self.instruments, None
            self._orders.pump.exchange(None)
            self.load.exchange(None)
            if instruments is not None:
                instruments.close()
            self._begin_instruments()
            self._connect_instruments()

    def _begin_to_bring_back(self, name: str) -> None:
        self._threads.append(start_thread("bring_back", self._bring_back, name))


def _has_ended(child: Child) -> bool:
    return child.ended is not None


def carried(shared: SharedState) -> Carried | None:
    """The carrier of the newest tick, while there is output and a finger."""
    newest = shared.ring.newest(1)
    if not newest.size or not newest["in_contact"][0] or not newest["output_on"][0]:
        return None
    slides = bool(newest["speed_m_s"][0] >= SLIDING_M_S)
    area_m2 = float(newest["contact_area_m2"][0])
    return Carried(float(newest["frequency_hz"][0]), slides, area_m2)
