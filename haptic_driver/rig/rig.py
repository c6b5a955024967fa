"""A rig: the one place where device words become signals and back.

Safety in hardware terms has four parts. `Rig` says when the output may come on and for how long,
and `OutputSwitch` (switch.py) how it comes on and goes off. evidence.py says what it takes to call
it off, and monitor.py what trips.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

from haptic_driver.errors import HapticError
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.evidence import (
    COMMANDED_ON,
    FRESH_S,
    MONITOR_QUIET_V,
    REAL_TIME,
    Clock,
    KnownOutput,
    tried,
)
from haptic_driver.rig.states import Happening, RigEvent, RigState, Withdrawn
from haptic_driver.rig.switch import OutputSwitch
from haptic_driver.signals import DriveCommand
from hw.amplifier.analog import AnalogAmplifier
from hw.analog.lines import Heartbeat
from hw.errors import DeviceError, LimitExceeded, SwitchedOff
from hw.force.sensor import ForceReading, ForceSensor, KeepsReadings
from hw.generator.contract import Generator
from hw.generator.settings import Shape
from hw.safety.watchdog import NOT_BEATEN

ROUNDING = 1.0 + 1e-6
# Between looks at an output that is off: twice as often as their evidence gets old.
LOOK_S = 0.5 * FRESH_S
# Between questions to a generator that does not answer, where the amplifier's line says off.
UNANSWERED_S = 30.0


class _SetPoint(NamedTuple):
    """The last one that was written."""

    time_s: float
    voltage_v: float
    frequency_hz: float


def require_verified(config: RigConfig) -> None:
    """Raise HapticError while a rig's file leaves a safety figure unset; until then nothing comes
    on.
    """
    if missing := config.unverified:
        raise HapticError(
            "unverified",
            f"the file of rig {config.name} leaves open {'; '.join(missing)}",
            "measure them, write them down with who measured them and when, then start again",
        )


class Rig:
    """The devices of one rig behind the words that rendering needs: `command`, `hold`,
    `read_force`, `off`.

    Amplitudes go out over SCPI, which is slow: at most one set point per `setpoint_interval_s`, the
    newest. The output comes on at the generator's minimum and rises by at most
    `voltage_rise_v_per_s` times that interval per set point; down it goes at once. Times are the
    caller's clock, one clock for all methods of a rig.

    Every failure of a device switches off first and is then raised as HapticError. Three more
    events trip the rig: a monitor that contradicts the command, a fault line, and an output that is
    on after being switched off. Until `reset_trip` it refuses to come on. `off` may be called from
    any thread at any time, and waits for no queue. It waits at most four reply timeouts for the
    lock of a thread that is switching on. For each device it waits at most that device's own
    timeouts. `heartbeats` are beaten while the output is on and the caller refreshes it, and never
    otherwise. Every change of state is logged, kept in `events` (the last 1000), and passed to
    `on_event`.

    `modulated`: the amplitude follows the generator's Modulation In; set points are its highest
    then, and the monitor may show less but never more.
    """

    def __init__(
        self,
        config: RigConfig,
        generator: Generator,
        amplifier: AnalogAmplifier,
        force_sensor: ForceSensor,
        *,
        modulated: bool = False,
        heartbeats: Sequence[Heartbeat] = (),
        on_event: Callable[[RigEvent], None] = lambda event: None,
        clock: Clock = REAL_TIME,
    ) -> None:
        self._config, self._safety, self._clock = config, config.safety, clock
        self._is_verified = not config.unverified  # asked once: commands come each millisecond
        self._generator = generator
        self._amplifier = amplifier
        self._force_sensor = force_sensor
        self._heartbeats = tuple(heartbeats)
        self._switch = OutputSwitch(
            config,
            generator,
            amplifier,
            heartbeats,
            modulated=modulated,
            on_event=on_event,
            clock=clock,
        )
        self._states = self._switch.states
        self._interval_s = config.output.setpoint_interval_s
        self._step_v = config.output.voltage_rise_v_per_s * self._interval_s
        self._written: _SetPoint | None = None
        self._times_off_at_last_write = 0
        self._refreshed_s = self._beaten_s = self._rested_s = self._tried_off_s = self._looked_s = (
            self._asked_s
        ) = -math.inf

    @property
    def generator(self) -> Generator:
        """Its driver; whoever steps simulated time lets it write ahead."""
        return self._generator

    @property
    def state(self) -> RigState:
        """What is known of the output now; a trip outlasts everything but `reset_trip`.

        OFF becomes UNKNOWN where nobody has looked for longer than evidence counts.
        """
        shown = self._states.shown
        is_old = shown is RigState.OFF and self.output.on is not False
        return RigState.UNKNOWN if is_old else shown

    @property
    def answers_nothing(self) -> bool:
        """Whether instruments that were asked could not show the output to be off, nor on."""
        return self._states.shown is RigState.UNKNOWN

    @property
    def output(self) -> KnownOutput:
        """Whether there is output, by its commands while it is on and by fresh evidence while it is
        not.
        """
        if self._states.shown is RigState.ON:
            return COMMANDED_ON
        return self._switch.known.at(self._clock.now_s())

    @property
    def minimum_voltage_v(self) -> float:
        """The lowest voltage that the generator can set while its output is on."""
        return self._generator.minimum_voltage_v

    @property
    def carrier(self) -> tuple[float, float]:
        """Frequency and peak voltage that were written last; NaN and 0 while the output is not
        on.
        """
        if self._written is None or self.state is not RigState.ON:
            return math.nan, 0.0
        return self._written.frequency_hz, self._written.voltage_v

    @property
    def events(self) -> Sequence[RigEvent]:
        """The last changes of state, oldest first."""
        return tuple(self._states.events)

    def connect(self) -> None:
        """Identify and set up the generator with its output off and the amplifier disabled."""
        with self._safe():
            self._amplifier.disable()
            self._generator.connect()
        output = self.off()
        if output.on is not False:
            raise HapticError(
                "not_off",
                f"connected, but the output is {output}",
                "find what drives the electrode",
            )

    def command(
        self,
        time_s: float,
        command: DriveCommand,
        voltage_offset_v: float = 0.0,
        shape: Shape = Shape.SINE,
    ) -> None:
        """Bring `command` to the electrode, now or with the next set points; refreshes the lease.

        A bias rises with the amplitude; for Shape.DC the amplitude is the direct voltage. Raises
        HapticError: a device failed, a limit is exceeded, the rig is tripped, or it cannot be shown
        to be off.
        """
        self._states.now_s = time_s
        if not command.output_on or command.voltage_v < self._generator.minimum_voltage_v:
            self._stay_off(time_s)
            self._rest(time_s)
            return
        if self.state is RigState.TRIPPED:
            self._stay_off(time_s)
            raise HapticError(
                "tripped",
                f"the rig is tripped: {self._states.trip_reason}",
                "remove the cause, then reset the trip",
            )
        if not self._is_verified:
            require_verified(self._config)
        with self._safe():
            self._check_limits(command, voltage_offset_v, shape)
            self._lapse(time_s)
            with self._switch.energising():
                self._refresh(time_s)
                if not self._switch.may_be_on or self._due(time_s):
                    self._write(time_s, command, voltage_offset_v, shape)

    def hold(self, time_s: float) -> None:
        """The caller is alive and wants the output as it is: refreshes the lease, beats, and does
        what `watch` does.
        """
        self.watch(time_s)
        with self._safe():
            if self._switch.may_be_on:
                self._refresh(time_s)

    def watch(self, time_s: float) -> None:
        """Switch off what is not refreshed, compare monitor and command, look at the fault line,
        retry a failed off.

        An output that is off is asked about twice a second: somebody may have switched it on by
        hand.

        For whoever watches over the caller; refreshes nothing. Raises HapticError when the rig
        trips or the output cannot be shown to be off.
        """
        self._states.now_s = time_s
        # another thread, which concludes; silent instruments answer no sooner twice
        if self._switch.is_switching_off:
            return
        self._lapse(time_s)
        if not self._switch.may_be_on:
            self._stay_off(time_s)
        with self._switch.energising(wait=False) as free, self._safe():
            if free:  # else another thread is at it, and checks by itself
                self._switch.check(time_s)
                self._look(time_s)

    def read_force(self) -> ForceReading:
        """The force sensor's present reading."""
        with self._safe():
            return self._force_sensor.read()

    def take_forces(self) -> list[ForceReading]:
        """Every force reading since the last call, where the sensor keeps them; else none."""
        sensor = self._force_sensor
        with self._safe():
            return sensor.take_readings() if isinstance(sensor, KeepsReadings) else []

    def read_monitors(self) -> tuple[float | None, float | None]:
        """Voltage and current by the amplifier's monitors, V and A; None where there is none.
        Never raises.
        """
        return self._amplifier.monitor_voltage_v(), self._amplifier.monitor_current_a()

    @property
    def seen_monitors(self) -> tuple[float | None, float | None]:
        """The same as somebody read them last; None where nobody has."""
        return self._amplifier.seen_voltage_v, self._amplifier.seen_current_a

    def off(self) -> KnownOutput:
        """Off at once: amplifier disabled first, since its line is fast; then the generator.

        Never raises; says what is known.
        """
        return self._switch.off().at(self._clock.now_s())

    def reset_trip(self) -> None:
        """Allow the output to come on again; raises HapticError while the reason may still be
        there.
        """
        if self.state is RigState.TRIPPED:
            self._switch.reset_trip()

    def close(self) -> KnownOutput:
        """Switch off at once, hang up, and return what is known about the output. Never raises."""
        output = self.off()
        tried(self._generator.close, None)
        return output

    # --- on

    def _check_limits(self, command: DriveCommand, voltage_offset_v: float, shape: Shape) -> None:
        """The rig's own limits for what was asked, before any ramp makes less of it; all are judged
        by the peak.
        """
        limits, frequency_hz = self._config.limits, command.frequency_hz
        direct_v = abs(voltage_offset_v) + (command.voltage_v if shape is Shape.DC else 0.0)
        if direct_v > limits.direct_voltage_v:
            raise LimitExceeded(
                f"rig: a direct voltage of {direct_v:g} V is beyond {limits.direct_voltage_v:g} V",
                "measure what the electrode and a finger bear, and write it down as"
                " limits.direct_voltage_v",
            )
        voltage_v = command.voltage_v + abs(voltage_offset_v)
        low_hz, high_hz = limits.frequency_hz
        if not (low_hz <= frequency_hz <= high_hz and voltage_v <= limits.voltage_v):
            raise LimitExceeded(
                f"rig: {voltage_v:g} V at {frequency_hz:g} Hz is beyond {limits.voltage_v:g} V "
                f"or outside {low_hz:g}..{high_hz:g} Hz",
                "stay within the rig's limits",
            )
        reach_hz = self._config.monitor_reach_hz
        if frequency_hz > reach_hz and voltage_v > MONITOR_QUIET_V:
            raise LimitExceeded(
                f"rig: the monitors alias {frequency_hz:g} Hz: {voltage_v:g} V there might read as"
                " nothing",
                f"stay at or below {reach_hz:g} Hz, or {MONITOR_QUIET_V:g} V, or raise"
                " analog_inputs.sample_rate_hz",
            )
        panel_current_a = 2.0 * math.pi * frequency_hz * voltage_v * limits.panel_capacitance_f
        self._amplifier.check_drive(frequency_hz, voltage_v, panel_current_a)

    def _due(self, time_s: float) -> bool:
        written = self._written
        return written is None or not 0.0 <= time_s - written.time_s < self._interval_s / ROUNDING

    def _write(
        self, time_s: float, command: DriveCommand, voltage_offset_v: float, shape: Shape
    ) -> None:
        """One set point, a bounded step up from the last or from the minimum."""
        if self._switch.may_be_on:
            self._switch.check(time_s)
        else:
            self._written = None
            self._switch.on(command.frequency_hz)
        before_v = (
            self._generator.minimum_voltage_v if self._written is None else self._written.voltage_v
        )
        voltage_v = min(command.voltage_v, before_v + self._step_v)
        offset_v = voltage_offset_v * voltage_v / command.voltage_v
        self._switch.set_point(command.frequency_hz, voltage_v, offset_v, shape)
        self._written = _SetPoint(time_s, voltage_v, command.frequency_hz)
        self._times_off_at_last_write = self._times_off()

    def _refresh(self, time_s: float) -> None:
        self._refreshed_s = time_s
        if not 0.0 <= time_s - self._beaten_s < self._safety.beat_interval_s:
            self._beaten_s = time_s
            for heartbeat in self._heartbeats:
                heartbeat.beat()

    # --- off

    def _lapse(self, time_s: float) -> None:
        """Off when nobody refreshed the output for a lease; the next command starts again from the
        minimum.
        """
        silent_s = time_s - self._refreshed_s
        if self._switch.may_be_on and not silent_s <= self._safety.lease_s * ROUNDING:
            self._states.happens(Happening.LAPSED, f"not refreshed for {silent_s:.3g} s")
            self._off_for_certain(time_s)

    def _stay_off(self, time_s: float) -> None:
        """Switch off what is on; try again, not too often, what did not say off."""
        retry = not 0.0 <= time_s - self._tried_off_s < self._safety.off_retry_s
        if self._switch.may_be_on or (retry and not self._states.output.shown_off):
            self._off_for_certain(time_s)

    def _look(self, time_s: float) -> None:
        """See that an output that was switched off still is; what was true once is no evidence for
        long.

        A generator that does not answer is switched off for the night, maybe: the amplifier's line
        is evidence as well. Whatever it answers, also to `off`, has it asked with every look again.
        """
        if self._switch.may_be_on:
            self._looked_s = self._asked_s = -math.inf
            return
        if 0.0 <= time_s - self._looked_s < LOOK_S:
            return
        silent = self._switch.known.generator_off is None
        asks = not (silent and 0.0 <= time_s - self._asked_s < UNANSWERED_S)
        self._looked_s = time_s
        self._asked_s = time_s if asks else self._asked_s
        found = self._switch.look(asks)
        if (asks and found.generator_off is None) or self.output.on is not False:
            self._off_for_certain(time_s)

    def _rest(self, time_s: float) -> None:
        """Have heartbeats hear from us between two touches, too: one that has stopped is known
        within its period.
        """
        if (
            self._states.output.shown_off
            and not 0.0 <= time_s - self._rested_s < self._safety.beat_interval_s
        ):
            self._rested_s = time_s
            for heartbeat in self._heartbeats:
                tried(heartbeat.rest, None)

    def _off_for_certain(self, time_s: float) -> None:
        self._tried_off_s = time_s
        output = self.off()
        if output.on is not False:
            raise HapticError(
                "not_off",
                f"the output may still be on: {output}",
                "switch the amplifier off by hand",
            )

    def _cause(self) -> str:
        """Why a device may fail that works: one with a single owner is the watchdog's once that
        has switched it off.
        """
        taken = self._times_off() > self._times_off_at_last_write
        return f"; watchdog: {NOT_BEATEN}" if taken else ""

    def _times_off(self) -> int:
        return sum(heartbeat.times_off() for heartbeat in self._heartbeats)

    @contextmanager
    def _safe(self) -> Iterator[None]:
        """Whatever goes wrong inside, the output goes off first."""
        try:
            yield
        except Withdrawn:
            self.off()
        except SwitchedOff as error:  # the next command starts again from the minimum
            self._states.happens(Happening.LAPSED, error.message)
            self.off()
        except DeviceError as error:
            cause = self._cause()
            said = f"{error.message}{cause}; output {self.off()}"
            raise HapticError(error.code, said, error.hint) from error
        except HapticError:
            if self.state is not RigState.TRIPPED:  # a trip has switched off already
                self.off()
            raise
        except Exception as error:  # of a library that has errors of its own
            said = f"{type(error).__name__}: {error}; output {self.off()}"
            raise HapticError(
                "device_error", said, "a fault of the program; look at the log"
            ) from error
        except BaseException:
            self.off()
            raise
