"""From render's newest output to the generator, and the gate that only the daemon's state machine
opens.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

from haptic_driver.errors import HapticError
from haptic_driver.processes.shared_memory import CLOSED, Driven, Output, SharedState
from haptic_driver.rig.actuator import Actuator
from haptic_driver.rig.evidence import COMMANDED_ON, NOBODY_ASKED, KnownOutput
from haptic_driver.rig.states import RigState
from haptic_driver.signals import DriveCommand

PUMP_PERIOD_S = 0.001
PUMP_TIMEOUT_S = 5.0  # more than all timeouts of the devices together
OUTPUT_STALE_S = 0.2  # what render said so long ago is not brought out any more
# how long an output takes to come up: a 33220A sets up a modulation in 0.11 s (unverified)
START_S = 0.15
OFF = DriveCommand(0.0, 0.0, False)
GOING_OFF = KnownOutput(None, "being switched off")


class OutputPump:
    """Brings out what render decides for orders from `open` on, and nothing while the gate is
    closed.

    Tells render and the writer of an envelope in `driven` what may go out, and since when it does.
    `run` is for one thread. `actuator` is None while there is none. `failed` gets a device's error,
    after the output has been switched off for it. `linger_s`: see the rig's file.
    """

    def __init__(
        self,
        shared: SharedState,
        interval_s: float,
        linger_s: float,
        failed: Callable[[BaseException], object],
        clock: Callable[[], float],
    ) -> None:
        self.actuator: Actuator | None = None
        self._switched = 0  # by actuators that are gone
        self._shared = shared
        self._interval_s = interval_s
        self._linger_s = linger_s
        self._failed = failed
        self._clock = clock
        self._gate: int | None = None  # the first order whose output may go out; None: none may
        self._pumping = threading.RLock()  # held while a command goes out
        self._wanted_s = -math.inf  # when there was last something to bring out
        self._written_s, self._written = -math.inf, OFF
        self._up_s = math.inf  # when the output is up; inf while it is off
        self._told: Driven | None = None
        self._telling = threading.Lock()  # the record has one writer at a time

    @property
    def output(self) -> KnownOutput:
        """What is known of the output; nothing from when the gate closes until it is shown off."""
        known = NOBODY_ASKED if self.actuator is None else self.actuator.rig.output
        return GOING_OFF if known is COMMANDED_ON and self._gate is None else known

    @property
    def switched(self) -> int:
        """How often the output has come on, on all actuators."""
        return self._switched + (self.actuator.switched if self.actuator is not None else 0)

    def exchange(self, actuator: Actuator | None) -> None:
        """Another way to the generator from here on; None: there is none."""
        self._switched, self.actuator = self.switched, actuator

    def open(self, order: int) -> None:
        """Let out what render decides for this order and later ones; what is let out already goes
        on without a gap.
        """
        self._wanted_s = self._clock()
        if self._gate is None:
            self._gate = order

    def close(self) -> None:
        """Let nothing out any more; what is out is switched off with the next turn at the
        latest.
        """
        self._gate = None
        self._tell()

    def off(self) -> None:
        """Close, and switch off now; waits for no command that is going out."""
        self.close()
        if self.actuator is not None:
            self.actuator.off()

    def undo_late_command(self) -> None:
        """Off again if a command that was going out while the gate closed has come through."""
        free = self._pumping.acquire(timeout=PUMP_TIMEOUT_S)
        try:
            if (
                self.actuator is not None
                and self._gate is None
                and self.actuator.rig.state is RigState.ON
            ):
                self.actuator.off()
        finally:
            if free:
                self._pumping.release()

    def run(self, ending: threading.Event) -> None:
        """Pump until the end."""
        while not ending.is_set():
            self.turn(self._clock())
            time.sleep(PUMP_PERIOD_S)

    def turn(self, now_s: float) -> None:
        """One turn of `run`."""
        with self._pumping:
            output = self._shared.output.read()
            command = self._command(now_s, output)
            if command.output_on and (output.in_contact or command.voltage_v > 0.0):
                self._wanted_s = now_s
            if now_s - self._wanted_s > self._linger_s:
                command = OFF
            # Without a change once per interval: it refreshes the rig's lease and goes on with its
            # rise.
            if command != self._written or now_s - self._written_s >= self._interval_s:
                self._written_s, self._written = now_s, command
                self._bring_out(now_s, command)
            if not self.output.on:
                self._up_s = math.inf
            self._tell()
            if failure := self._shared.played.read().failure:
                self._failed(HapticError("envelope_failed", failure, "look at the analog output"))

    def _tell(self) -> None:
        """What may go out now; also while a command is going out, which must not keep an envelope
        from its end.
        """
        with self._telling:
            gate, actuator = self._gate, self.actuator
            carrier_hz = math.nan if actuator is None else actuator.carrier_hz
            full_scale_v = 0.0 if actuator is None else actuator.full_scale_v
            driven = Driven(CLOSED if gate is None else gate, self._up_s, carrier_hz, full_scale_v)
            if driven != self._told:
                self._told = driven
                self._shared.driven.write(driven)

    def _command(self, now_s: float, output: Output) -> DriveCommand:
        """What render wants, if it may go out: on while it renders, at 0 V too; not with an
        envelope left alone.
        """
        written_s = self._shared.played.read().time_s
        if (
            not may_go_out(self._gate, output, now_s)
            or -math.inf < written_s < now_s - OUTPUT_STALE_S
        ):
            return OFF
        return DriveCommand(output.frequency_hz, output.voltage_v, True, output.full_scale_v)

    def _bring_out(self, now_s: float, command: DriveCommand) -> None:
        actuator = self.actuator
        if actuator is None:
            return
        if not command.output_on and actuator.rig.state in (RigState.OFF, RigState.TRIPPED):
            return
        was_on = self.output.on
        try:
            actuator.command(now_s, command)
        except BaseException as error:  # the pump goes on, whatever a plug-in raises
            self._failed(error)
        if self.output.on and not was_on:
            # after the dialogue, which takes as long as it likes
            self._up_s = self._clock() + START_S


def may_go_out(gate: int | None, output: Output, now_s: float) -> bool:
    """Whether what render said last is for an order that is let out, and not of long ago."""
    return (
        gate is not None
        and gate != CLOSED
        and output.order >= gate
        and now_s - output.time_s <= OUTPUT_STALE_S
    )
