"""How the output of a rig comes on and goes off, who may raise the voltage, and what trips.

What moves the output from state to state is the table in states.py.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from haptic_driver.errors import HapticError
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.evidence import NOTHING_KNOWN, Clock, OffEvidence, switch_off, tried
from haptic_driver.rig.monitor import MonitorCheck, line_contradiction
from haptic_driver.rig.states import Happening, OutputStates, RigEvent, Withdrawals
from hw.amplifier.analog import AmplifierState, AnalogAmplifier
from hw.analog.lines import Heartbeat
from hw.errors import BadReply
from hw.generator.contract import Generator
from hw.generator.settings import ExternalModulation, Shape


class OutputSwitch:
    """Generator and amplifier as one switch, with the evidence of what it did.

    `on` and `set_point` are for the thread that is `energising`. They end with Withdrawn as soon as
    anybody calls `off`, which may come from any thread at any time. `heartbeats` rest once the
    output is shown to be off.
    """

    def __init__(
        self,
        config: RigConfig,
        generator: Generator,
        amplifier: AnalogAmplifier,
        heartbeats: Sequence[Heartbeat],
        *,
        modulated: bool,
        on_event: Callable[[RigEvent], None],
        clock: Clock,
    ) -> None:
        self.states = OutputStates(on_event)
        self.known = NOTHING_KNOWN  # of an output that may not be on
        self._generator = generator
        self._amplifier = amplifier
        self._heartbeats = tuple(heartbeats)
        self._modulation = ExternalModulation() if modulated else None
        self._clock = clock
        self._settle_s = config.safety.settle_s
        self._lock_timeout_s = 4.0 * config.waveform_generator.reply_timeout_s
        self._monitors = MonitorCheck(config.safety, config.operating_limits(), modulated)
        self._checked_s = -math.inf
        self._lock = threading.RLock()  # held by whoever may raise the voltage
        self._withdrawals = Withdrawals()
        self._permit = self._withdrawals.permit()  # of the thread that holds the lock

    @property
    def may_be_on(self) -> bool:
        """Whether it has been switched on, or begun to be, and not off since."""
        return self.states.output.may_be_on

    @property
    def is_switching_off(self) -> bool:
        """Whether any thread is on the way off."""
        return self._withdrawals.under_way

    @contextmanager
    def energising(self, wait: bool = True) -> Iterator[bool]:
        """This thread alone may raise the voltage, until anybody switches off; False where it did
        not wait for that.
        """
        free = self._lock.acquire(blocking=wait)
        try:
            if free:
                self._permit = self._withdrawals.permit()
            yield free
        finally:
            if free:
                self._lock.release()

    def on(self, frequency_hz: float) -> None:
        """Output on at the generator's minimum, then the amplifier enabled."""
        if self._amplifier.fault:
            self._trip("the amplifier's fault line says fault")
        self._monitors.comes_on(self._amplifier.monitor_current_a())
        self.known = NOTHING_KNOWN
        self.states.happens(Happening.STARTS, "commanded")
        self.set_point(frequency_hz, self._generator.minimum_voltage_v)
        self._generator.set_output(True)
        self._permit.check()
        amplifier = self._amplifier.enable()
        self._permit.check()
        if amplifier is AmplifierState.TRIPPED:
            self._trip("the amplifier tripped when it was enabled")
        if amplifier is AmplifierState.DISABLED:
            raise BadReply(
                "amplifier: its enable line reads low after being raised",
                "check the line, the interlock, the E-stop",
            )
        self.states.happens(Happening.CAME_ON, f"commanded, {frequency_hz:g} Hz")

    def set_point(
        self,
        frequency_hz: float,
        voltage_v: float,
        voltage_offset_v: float = 0.0,
        shape: Shape = Shape.SINE,
    ) -> None:
        self._permit.check()
        peak_v = voltage_v + abs(voltage_offset_v)
        self._monitors.commanded(frequency_hz, peak_v, shape is Shape.SINE)
        self._generator.set_point(
            frequency_hz, voltage_v, voltage_offset_v, shape=shape, modulation=self._modulation
        )
        self._permit.check()

    def check(self, time_s: float) -> None:
        """Trip when amplifier or monitors contradict what was commanded."""
        self._checked_s = self._clock.now_s()
        on, amplifier = self.may_be_on, self._amplifier
        contradiction = line_contradiction(amplifier) if on else None
        contradiction = contradiction or self._monitors.contradiction(
            time_s, amplifier.monitor_voltage_v(), amplifier.seen_current_a if on else None
        )
        if contradiction:
            self._trip(contradiction)

    def look(self, ask_generator: bool) -> OffEvidence:
        """After a `check`, see whether an output that was switched off still is; trip when the
        generator says ON: somebody else drives it.
        """
        is_on = tried(self._generator.is_on, None) if ask_generator else None
        if is_on:
            self._trip(
                "the generator's output is on, though it was switched off: somebody else switched"
                " it on"
            )
        evidence = OffEvidence(
            None if is_on is None else not is_on,
            self._amplifier.state,
            self._amplifier.seen_voltage_v,
            self._checked_s,
        )
        self._permit.check()
        self.known = evidence
        return evidence

    def off(self) -> OffEvidence:
        """Off at once, from any thread, and what is known of it. Never raises, and always
        concludes.
        """
        free, evidence = False, NOTHING_KNOWN
        self._withdrawals.begin()
        try:
            free = self._lock.acquire(blocking=False)
            seen = self._switch_off()
            if not free:
                # Another thread was switching on; what it did after us is undone once it has
                # noticed.
                free = self._lock.acquire(timeout=self._lock_timeout_s)
                seen = self._switch_off()
            evidence = (
                seen
                if free
                else replace(seen, generator_off=None, amplifier=AmplifierState.UNKNOWN)
            )
        finally:  # Ctrl-C in the middle concludes too: with nothing known
            try:
                self._conclude(evidence)
            finally:
                self._withdrawals.end()
                if free:
                    self._lock.release()
        return evidence

    def reset_trip(self) -> None:
        """Allow it to come on again; raises HapticError while the reason may still be there."""
        evidence = self.off()
        output = evidence.at(self._clock.now_s())
        reasons = [] if output.on is False else [f"the output is {output}"]
        reasons += ["the amplifier's fault line says fault"] if self._amplifier.fault else []
        if reasons:
            tripped = f"the rig stays tripped ({self.states.trip_reason})"
            raise HapticError(
                "trip_remains", f"{tripped}: {'; '.join(reasons)}", "remove the cause first"
            )
        self.states.happens(Happening.RESET, "trip reset")

    def _trip(self, reason: str) -> None:
        """Latch, switch off, and raise; not for what an `off` has done, whose own evidence
        counts.
        """
        self._permit.check()
        self.states.happens(Happening.TRIPS, reason)
        evidence = self.off()
        raise HapticError(
            "tripped",
            f"the rig tripped: {reason}; output {evidence.at(self._clock.now_s())}",
            "remove the cause, then reset",
        )

    def _switch_off(self) -> OffEvidence:
        return switch_off(self._generator, self._amplifier, self._settle_s, self._clock)

    def _conclude(self, evidence: OffEvidence) -> None:
        """Believe the evidence, and no more."""
        self.known = evidence
        on = evidence.at(self._clock.now_s()).on
        shown = on is False
        self._monitors.switched_off(shown)
        if shown:
            for heartbeat in self._heartbeats:
                tried(heartbeat.rest, None)
        elif on:
            self.states.happens(
                Happening.TRIPS, f"the output is on after being switched off: {evidence}"
            )
        self.states.happens(
            Happening.SHOWN_OFF if shown else Happening.NOT_SHOWN_OFF, str(evidence)
        )
