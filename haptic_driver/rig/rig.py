"""A rig: configuration -> devices, and the one place where device words become signals and back.

Safety in hardware terms lives here: how the output comes on and goes off, what it takes to call it off, and what trips.
"""

from __future__ import annotations

import enum
import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import NamedTuple

from haptic_driver.errors import HapticError
from haptic_driver.rig.config import RigConfig, SafetySettings
from haptic_driver.signals import DriveCommand
from hw.amplifier.analog import AmplifierState, AnalogAmplifier
from hw.analog.lines import Heartbeat
from hw.errors import BadReply, DeviceError, LimitExceeded
from hw.force.sensor import ForceReading, ForceSensor
from hw.generator.contract import Generator
from hw.generator.settings import ExternalModulation

MONITOR_QUIET_V = 5.0  # at the electrode; what a monitor may read without anything being on
MONITOR_POLL_S = 0.01
EVENTS_KEPT = 1000
ROUNDING = 1.0 + 1e-6

_log = logging.getLogger(__name__)


class RigState(enum.Enum):
    """What is known of the output; UNKNOWN is never to be shown as off."""

    OFF = "off"
    ON = "on"
    TRIPPED = "tripped"
    UNKNOWN = "unknown"


class RigEvent(NamedTuple):
    """One change of state, on the caller's clock (NaN before its first command), and why."""

    time_s: float
    state: RigState
    reason: str


@dataclass(frozen=True)
class OffEvidence:
    """What is known about the output after switching it off; None where nothing could be learnt."""

    generator_off: bool | None
    amplifier: AmplifierState
    monitor_v: float | None

    @property
    def output_on(self) -> bool | None:
        """False only with evidence: generator or enable line say off, and the monitor does not see a voltage."""
        if self.monitor_v is not None and abs(self.monitor_v) > MONITOR_QUIET_V:
            return True
        if self.generator_off or self.amplifier is AmplifierState.DISABLED:
            return False
        return None if self.generator_off is None else True

    def __str__(self) -> str:
        """For a person."""
        generator = {True: "generator says off", False: "generator says ON", None: "generator does not answer"}
        monitor = "no monitor" if self.monitor_v is None else f"monitor reads {self.monitor_v:.3g} V"
        return f"{generator[self.generator_off]}, amplifier {self.amplifier.value}, {monitor}"


def require_verified(unverified: Sequence[str]) -> None:
    """Raise HapticError with what `RigConfig.unverified` lists, unless that is nothing."""
    if unverified:
        raise HapticError(
            "unverified",
            f"this rig's file leaves open {'; '.join(unverified)}",
            "measure them, write them down with who measured them and when, then start again",
        )


class _Withdrawn(Exception):  # noqa: N818 - an event: somebody switched off while this thread was switching on
    pass


class Rig:
    """The devices of one rig behind the words that rendering needs: `command`, `hold`, `read_force`, `off`.

    Amplitudes go out over SCPI, which is slow: at most one set point per `setpoint_interval_s`, the newest. The output
    comes on at the generator's minimum and rises by at most `voltage_rise_v_per_s` times that interval per set point;
    down it goes at once. Times are the caller's clock, one clock for all methods of a rig.

    Every failure of a device switches off first and is then raised as HapticError. A monitor that contradicts the
    command, a fault line, and an output that is on after being switched off also trip the rig: until `reset_trip` it
    refuses to come on. `off` may be called from any thread at any time: it waits for no queue, for the lock of a thread
    that is switching on at most four reply timeouts, and for each device at most that device's own timeouts.
    `heartbeats` are beaten while the output is on and the caller refreshes it, and never otherwise. Every change of
    state is logged, kept in `events` (the last 1000), and told to `on_event`.

    `modulated`: the amplitude follows the generator's Modulation In; set points are its highest then, and the monitor
    may show less but never more.
    """

    def __init__(
        self,
        config: RigConfig,
        generator: Generator,
        amplifier: AnalogAmplifier,
        force_sensor: ForceSensor,
        *,
        modulated: bool = False,
        safety: SafetySettings | None = None,
        heartbeats: Sequence[Heartbeat] = (),
        on_event: Callable[[RigEvent], None] = lambda event: None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.safety = safety or config.safety
        self.events: deque[RigEvent] = deque(maxlen=EVENTS_KEPT)
        self._generator = generator
        self._modulation = ExternalModulation() if modulated else None
        self._amplifier = amplifier
        self._force_sensor = force_sensor
        self._heartbeats = tuple(heartbeats)
        self._on_event = on_event
        self._sleep = sleep
        self._limits = config.limits
        self._unverified = config.unverified
        self._interval_s = config.output.setpoint_interval_s
        self._step_v = config.output.voltage_rise_v_per_s * self._interval_s
        self._lock_timeout_s = 4.0 * config.waveform_generator.reply_timeout_s
        self._energising = threading.RLock()  # held by whoever may raise the voltage
        self._withdrawals = self._concluded = 0  # calls of `off`, begun and ended; see `_go_on`
        self._counting = threading.Lock()
        self._state = RigState.UNKNOWN
        self._trip: str | None = None
        self._on = False
        self._now_s = math.nan
        self._written: _Written | None = None
        self._refreshed_s = self._beaten_s = self._tried_off_s = -math.inf
        self._commanded = [_ZERO]  # as far back as the monitor may lag
        self._too_low_s: float | None = None  # since when the monitor has read less than was commanded

    @property
    def state(self) -> RigState:
        """What is known of the output now; a trip outlasts everything but `reset_trip`."""
        return RigState.TRIPPED if self._trip is not None else self._state

    @property
    def trip_reason(self) -> str | None:
        """Why the rig is tripped; None when it is not."""
        return self._trip

    def check_verified(self) -> None:
        """Raise HapticError while the rig's file leaves a safety figure unset; until then nothing comes on."""
        require_verified(self._unverified)

    def connect(self) -> None:
        """Identify and set up the generator with its output off and the amplifier disabled."""
        with self._safe():
            self._amplifier.disable()
            self._generator.connect()
        evidence = self.off()
        if evidence.output_on is not False:
            raise HapticError("not_off", f"connected, but {evidence}", "find what drives the electrode")

    def command(self, time_s: float, command: DriveCommand) -> None:
        """Bring `command` to the electrode, now or with the next set points; refreshes the lease.

        Raises HapticError: a device failed, a limit is exceeded, the rig is tripped, or it cannot be shown to be off.
        """
        self._now_s = time_s
        if not command.output_on or command.voltage_v < self._generator.minimum_voltage_v:
            self._stay_off(time_s)
            return
        self._refuse_if_tripped(time_s)
        self.check_verified()
        with self._safe():
            self._check_limits(command)
            self._lapse(time_s)
            with self._energising:
                withdrawals = self._concluded
                self._refresh(time_s)
                if not self._on or self._due(time_s):
                    self._write(time_s, command, withdrawals)

    def hold(self, time_s: float) -> None:
        """The caller is alive and wants the output as it is: refreshes the lease, beats, and does what `watch` does."""
        self.watch(time_s)
        with self._safe():
            if self._on:
                self._refresh(time_s)

    def watch(self, time_s: float) -> None:
        """Switch off what is not refreshed, compare monitor and command, look at the fault line, retry a failed off.

        For whoever watches over the caller; refreshes nothing. Raises HapticError when the rig trips
        or the output cannot be shown to be off.
        """
        self._now_s = time_s
        self._lapse(time_s)
        if not self._on:
            self._stay_off(time_s)
        if self._energising.acquire(blocking=False):  # else another thread is at it, and checks by itself
            try:
                with self._safe():
                    withdrawals = self._concluded
                    if self._on:
                        self._check_lines(withdrawals)
                    self._check_voltage(time_s, withdrawals)
            finally:
                self._energising.release()

    def read_force(self) -> ForceReading:
        """The force sensor's present reading."""
        with self._safe():
            return self._force_sensor.read()

    def off(self) -> OffEvidence:
        """Off at once: amplifier disabled first, since its line is fast; then the generator.

        Never raises; says what is known.
        """
        with self._counting:
            self._withdrawals += 1
        free = self._energising.acquire(blocking=False)
        evidence = self._switch_off()
        if not free:
            # Another thread was switching on; what it did after us is undone once it has noticed.
            free = self._energising.acquire(timeout=self._lock_timeout_s)
            evidence = self._switch_off()
            if not free:
                evidence = replace(evidence, generator_off=None, amplifier=AmplifierState.UNKNOWN)
        try:
            self._conclude(evidence)
        finally:
            with self._counting:
                self._concluded += 1
            if free:
                self._energising.release()
        return evidence

    def stop(self) -> OffEvidence:
        """A planned end: the voltage ramps down, then the generator goes off, then the amplifier is disabled.

        Takes at most `ramp_down_s` and the reply timeouts; whatever goes wrong on the way ends in `off`. Never raises.
        """
        if not self._energising.acquire(timeout=self._lock_timeout_s):
            return self.off()
        try:
            self._ramp_down(self._concluded)
            self._generator.off()
        except (DeviceError, _Withdrawn) as error:
            _log.warning("ramping down: %s", error)
        finally:
            evidence = self.off()  # drops the enable line, and looks for evidence
            self._energising.release()
        return evidence

    def reset_trip(self) -> None:
        """Allow the output to come on again; raises HapticError while the reason may still be there."""
        if self._trip is None:
            return
        evidence = self.off()
        reasons = [f"{evidence}"] if evidence.output_on is not False else []
        reasons += ["the amplifier's fault line says fault"] if self._amplifier.fault else []
        if reasons:
            raise HapticError(
                "trip_remains", f"the rig stays tripped ({self._trip}): {'; '.join(reasons)}", "remove the cause first"
            )
        self._trip = None
        self._set_state(RigState.OFF, "trip reset")

    def close(self) -> OffEvidence:
        """Switch off at once, hang up, and return what is known about the output."""
        evidence = self.off()
        self._generator.close()
        return evidence

    # --- on --------------------------------------------------------------------------------------------------------

    def _check_limits(self, command: DriveCommand) -> None:
        """The rig's own limits for what was asked, before any ramp makes less of it."""
        frequency_hz, voltage_v = command.frequency_hz, command.voltage_v
        low_hz, high_hz = self._limits.frequency_hz
        if not (low_hz <= frequency_hz <= high_hz and voltage_v <= self._limits.voltage_v):
            raise LimitExceeded(
                f"rig: {voltage_v:g} V at {frequency_hz:g} Hz is beyond {self._limits.voltage_v:g} V "
                f"or outside {low_hz:g}..{high_hz:g} Hz",
                "stay within the rig's limits",
            )
        panel_current_a = 2.0 * math.pi * frequency_hz * voltage_v * self._limits.panel_capacitance_f
        self._amplifier.check_drive(frequency_hz, voltage_v, panel_current_a)

    def _due(self, time_s: float) -> bool:
        written = self._written
        return written is None or not 0.0 <= time_s - written.time_s < self._interval_s / ROUNDING

    def _write(self, time_s: float, command: DriveCommand, withdrawals: int) -> None:
        """One set point, a bounded step up from the last or from the minimum."""
        if self._on:
            self._check_lines(withdrawals)
            self._check_voltage(time_s, withdrawals)
        else:
            self._switch_on(command.frequency_hz, withdrawals)
        written = self._written
        before_v = self._generator.minimum_voltage_v if written is None else written.voltage_v
        voltage_v = min(command.voltage_v, before_v + self._step_v)
        self._go_on(withdrawals)
        self._commanded.append(_Commanded(voltage_v))
        self._generator.set_point(command.frequency_hz, voltage_v, modulation=self._modulation)
        self._go_on(withdrawals)
        self._written = _Written(time_s, command.frequency_hz, voltage_v)

    def _switch_on(self, frequency_hz: float, withdrawals: int) -> None:
        """Output on at the generator's minimum, then the amplifier enabled; anybody's `off` in between ends it."""
        if self._amplifier.fault:
            self._trip_now("the amplifier's fault line says fault", withdrawals)
        self._on = True  # from here on it may be
        self._generator.set_point(frequency_hz, self._generator.minimum_voltage_v, modulation=self._modulation)
        self._go_on(withdrawals)
        self._generator.set_output(True)
        self._go_on(withdrawals)
        self._enable(withdrawals)
        self._set_state(RigState.ON, f"commanded, {frequency_hz:g} Hz")

    def _enable(self, withdrawals: int) -> None:
        state = self._amplifier.enable()
        self._go_on(withdrawals)
        if state is AmplifierState.TRIPPED:
            self._trip_now("the amplifier tripped when it was enabled", withdrawals)
        if state is AmplifierState.DISABLED:
            raise BadReply(
                "amplifier: its enable line reads low after being raised", "check the line, the interlock, the E-stop"
            )

    def _go_on(self, withdrawals: int) -> None:
        """Stop when somebody has called `off` since there had been so many, or is at it: who calls it does not wait."""
        if withdrawals != self._withdrawals:
            raise _Withdrawn

    def _refresh(self, time_s: float) -> None:
        self._refreshed_s = time_s
        if not 0.0 <= time_s - self._beaten_s < self.safety.beat_interval_s:
            self._beaten_s = time_s
            for heartbeat in self._heartbeats:
                heartbeat.beat()

    def _refuse_if_tripped(self, time_s: float) -> None:
        if self._trip is not None:
            self._stay_off(time_s)
            raise HapticError("tripped", f"the rig is tripped: {self._trip}", "remove the cause, then reset the trip")

    # --- watching --------------------------------------------------------------------------------------------------

    def _lapse(self, time_s: float) -> None:
        """Off when nobody refreshed the output for a lease; the next command starts again from the minimum."""
        silent_s = time_s - self._refreshed_s
        if self._on and not silent_s <= self.safety.lease_s * ROUNDING:
            self._set_state(RigState.UNKNOWN, f"not refreshed for {silent_s:.3g} s")
            self.off()

    def _check_lines(self, withdrawals: int) -> None:
        """Trip when the amplifier does not say that it is on, or gives more current than it may."""
        state = self._amplifier.state
        if state is AmplifierState.TRIPPED:
            self._trip_now("the amplifier's fault line says fault", withdrawals)
        if state is AmplifierState.DISABLED:
            self._trip_now("the amplifier's enable line reads low: interlock or E-stop", withdrawals)
        current_a = self._amplifier.monitor_current_a()
        if current_a is not None and abs(current_a) > self._amplifier.settings.current_limit_a:
            self._trip_now(
                f"the current monitor reads {current_a:.3g} A, the limit is "
                f"{self._amplifier.settings.current_limit_a:g} A",
                withdrawals,
            )

    def _check_voltage(self, time_s: float, withdrawals: int) -> None:
        """Trip when the monitor contradicts what was commanded: at once when it reads too much.

        Too little must last, since nobody is hurt by it and a busy computer or instrument may be late with a voltage.
        """
        voltage_v = self._amplifier.monitor_voltage_v()
        low_v, high_v = self._commanded_range_v(time_s)
        if voltage_v is None:
            return
        low_v = low_v if self._modulation is None else 0.0
        tolerance_v = max(self.safety.monitor_tolerance_v, self.safety.monitor_tolerance * high_v)
        reads = f"the monitor reads {abs(voltage_v):.3g} V where {low_v:.3g}..{high_v:.3g} V were commanded"
        if abs(voltage_v) > high_v + tolerance_v:
            self._trip_now(reads, withdrawals)
        if abs(voltage_v) >= low_v - tolerance_v:
            self._too_low_s = None
        elif self._too_low_s is None:
            self._too_low_s = time_s
        elif time_s - self._too_low_s >= self.safety.settle_s:
            self._trip_now(f"{reads}, for {time_s - self._too_low_s:.2g} s", withdrawals)

    def _commanded_range_v(self, time_s: float) -> tuple[float, float]:
        """Lowest and highest voltage commanded within `settle_s`, that in force at its beginning included."""
        told = [one if one.told_s < math.inf else one._replace(told_s=time_s) for one in self._commanded]
        while len(told) > 1 and told[1].told_s <= time_s - self.safety.settle_s:
            del told[0]
        self._commanded = told
        voltages_v = [one.voltage_v for one in told]
        return min(voltages_v), max(voltages_v)

    def _trip_now(self, reason: str, withdrawals: int) -> None:
        """Latch, switch off, and raise; not for what an `off` has done, whose own evidence counts."""
        self._go_on(withdrawals)
        self._latch(reason)
        evidence = self.off()
        raise HapticError("tripped", f"the rig tripped: {reason} (output: {evidence})", "remove the cause, then reset")

    def _latch(self, reason: str) -> None:
        if self._trip is None:
            self._trip = reason
            self._set_state(self._state, reason)

    # --- off -------------------------------------------------------------------------------------------------------

    def _stay_off(self, time_s: float) -> None:
        """Switch off what is on; try again, not too often, what did not say off."""
        retry = self._state is not RigState.OFF and not 0.0 <= time_s - self._tried_off_s < self.safety.off_retry_s
        if self._on or retry:
            self._tried_off_s = time_s
            evidence = self.off()
            if evidence.output_on is not False:
                raise HapticError(
                    "not_off", f"the output may still be on: {evidence}", "switch the amplifier off by hand"
                )

    def _switch_off(self) -> OffEvidence:
        """No lock, no check: line, generator, line again for those who raised it meanwhile; then look."""
        self._amplifier.disable()
        generator_off = self._generator.off()
        amplifier = self._amplifier.disable()
        return OffEvidence(generator_off, amplifier, self._settled_monitor_v())

    def _settled_monitor_v(self) -> float | None:
        """The monitor once it is quiet, or after `settle_s`: a real electrode takes time to discharge."""
        for _ in range(max(1, round(self.safety.settle_s / MONITOR_POLL_S))):
            voltage_v = self._amplifier.monitor_voltage_v()
            if voltage_v is None or abs(voltage_v) <= MONITOR_QUIET_V:
                return voltage_v
            self._sleep(MONITOR_POLL_S)
        return self._amplifier.monitor_voltage_v()

    def _conclude(self, evidence: OffEvidence) -> None:
        """Believe the evidence, and no more."""
        self._on, self._written, self._too_low_s = False, None, None
        self._commanded.append(_ZERO)
        if evidence.output_on is False:
            self._commanded = [_ZERO]
            for heartbeat in self._heartbeats:
                heartbeat.rest()
        elif evidence.output_on:
            self._latch(f"the output is on after being switched off: {evidence}")
        self._set_state(RigState.OFF if evidence.output_on is False else RigState.UNKNOWN, str(evidence))

    def _ramp_down(self, withdrawals: int) -> None:
        """Set points down to the generator's minimum, in steps of the rate up or larger."""
        if not self._on or self._written is None:
            return
        minimum_v = self._generator.minimum_voltage_v
        frequency_hz, voltage_v = self._written.frequency_hz, self._written.voltage_v
        step_v = max(self._step_v, (voltage_v - minimum_v) * self._interval_s / self.safety.ramp_down_s)
        while voltage_v > minimum_v:
            voltage_v = max(voltage_v - step_v, minimum_v)
            self._go_on(withdrawals)
            self._generator.set_point(frequency_hz, voltage_v, modulation=self._modulation)
            self._sleep(self._interval_s)

    def _set_state(self, state: RigState, reason: str) -> None:
        before, self._state = self.state, state
        if self.state is before and self.events and self.events[-1].state is before:
            return
        event = RigEvent(self._now_s, self.state, reason)
        self.events.append(event)
        _log.log(
            logging.INFO if state in (RigState.ON, RigState.OFF) else logging.WARNING,
            "%s: %s",
            event.state.value,
            reason,
        )
        self._on_event(event)

    @contextmanager
    def _safe(self) -> Iterator[None]:
        """Whatever goes wrong inside, the output goes off first."""
        try:
            yield
        except _Withdrawn:
            self.off()
        except DeviceError as error:
            evidence = self.off()
            raise HapticError(error.code, f"{error.message} (output: {evidence})", error.hint) from error
        except HapticError:
            raise  # a trip, which has switched off
        except BaseException:
            self.off()
            raise


class _Commanded(NamedTuple):
    """A voltage, and when it had certainly been told: at the first look after its dialogue, which may stall."""

    voltage_v: float
    told_s: float = math.inf


_ZERO = _Commanded(0.0, -math.inf)


class _Written(NamedTuple):
    """The last set point."""

    time_s: float
    frequency_hz: float
    voltage_v: float
