"""A stateful Agilent 33220A: its dialogue, its couplings and traps, and what is at its terminals.

Settings and couplings are in `generator_state`, its limits in `generator_limits`, its commands in
`generator_commands`. FM, PM, FSK, PWM and sweep are dialogue only: they do not change the peak at the terminals.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from hw.generator.agilent_33220a.commands import GeneratorCommands
from hw.generator.agilent_33220a.limits import EMF_PEAK_V
from hw.generator.agilent_33220a.state import GeneratorState, Signal
from hw.generator.scpi import ScpiEngine, ScpiError

_MODULATION_FULL_SCALE_V = 5.0
_OVERLOAD = 720  # the real code is not known; the class (device error) is


@dataclass(frozen=True)
class GeneratorLatency:
    """Simulated time from a command to its effect at the terminals, by what the command changes.

    The defaults are of the size in the 33220A's data sheet (5988-8544EN, from memory: low confidence).
    """

    amplitude_s: float = 0.030
    frequency_s: float = 0.003
    function_s: float = 0.111
    output_s: float = 0.0


class TerminalOutput(NamedTuple):
    """What is at the open terminals; both voltages are 0 while the output is off.

    `amplitude_v` is half the peak-to-peak value and `offset_v` the middle between the extremes, so that
    `amplitude_v + abs(offset_v)` is the peak of any waveform. Both are of the loudest part of an internal
    modulation, and of a burst while it runs.
    """

    frequency_hz: float
    amplitude_v: float
    offset_v: float
    on: bool


class Simulated33220A:
    """A 33220A as bytes in, bytes out, with its own clock.

    Settings reach the terminals after `latency` of simulated time, in the order in which they were sent;
    switching off does not queue behind the others. `listener` is called, under the instrument's lock, at each
    change at the terminals. `am_full_scale` is the amplitude at + full scale of Modulation In and 100 % depth, as a
    multiple of the one programmed (whether it is 1 or 2 is to be measured on the real instrument). Thread-safe.
    """

    def __init__(
        self,
        latency: GeneratorLatency | None = None,
        *,
        listener: Callable[[TerminalOutput], object] | None = None,
        am_full_scale: float = 1.0,
    ) -> None:
        latency = latency or GeneratorLatency()
        self._latency_s = {
            **dict.fromkeys(("function", "low", "high", "modulation"), latency.function_s),
            **dict.fromkeys(("emf_vpp", "emf_offset_v", "depth"), latency.amplitude_s),
            "frequency_hz": latency.frequency_s,
            "gated": 0.0,
            "on": latency.output_s,
        }
        self._listener = listener
        self._am_full_scale = am_full_scale
        self._modulation_in_v = 0.0
        self._clock_s = 0.0
        self._burst_end_s = math.inf
        self._sent = self._terminal = Signal()
        self._seen = self._at_terminals()
        self._under_way: list[tuple[float, dict[str, Any]]] = []
        self.range_switches = 0
        self._scpi = ScpiEngine(
            "Agilent Technologies,33220A,SIM00001,2.02-2.02-22-2",
            reset=self._reset,
            trigger=self._bus_trigger,
            executed=self._propagate,
        )
        self._state = GeneratorState(self._scpi.post)
        GeneratorCommands(self._scpi, self._state, self._bus_trigger)

    def handle(self, data: bytes) -> bytes:
        """Carry out complete SCPI messages and return their answers."""
        return self._scpi.handle(data)

    def advance(self, dt_s: float) -> None:
        """Let simulated time pass."""
        with self._scpi.lock:
            until_s = self._clock_s + dt_s
            if self._burst_end_s <= until_s:
                self._clock_s = max(self._clock_s, self._burst_end_s)
                self._arrive()
                self._burst_end_s = math.inf
                self._state.end_burst()
                self._propagate()
            self._clock_s = until_s
            self._arrive()

    def output(self) -> TerminalOutput:
        """What is at the open terminals now."""
        with self._scpi.lock:
            return self._at_terminals()

    def set_modulation_input(self, voltage_v: float) -> None:
        """Put a voltage on the rear panel's Modulation In; it acts at once. Open, it is at 0 V."""
        with self._scpi.lock:
            self._modulation_in_v = voltage_v
            self._notify()

    def external_trigger(self) -> None:
        """An edge at the rear panel's trigger input."""
        with self._scpi.lock:
            if self._state.settings.stored["TRIGger:SOURce"] == "EXT":
                self._start_burst()
                self._propagate()

    def overload(self) -> None:
        """A voltage from outside at the terminals: the output switches itself off and says so in the error queue."""
        with self._scpi.lock:
            self._state.set_output(False)
            self._scpi.post(_OVERLOAD)
            self._propagate()

    def _reset(self) -> None:
        self._state.reset()

    # --- settings to terminals -----------------------------------------------------------------------------

    def _at_terminals(self) -> TerminalOutput:
        signal = self._terminal
        if not signal.on:
            return TerminalOutput(signal.frequency_hz, 0.0, 0.0, False)
        silent = signal.function == "DC" or signal.gated
        vpp = 0.0 if silent else signal.emf_vpp * self._envelope(signal)
        high_v = signal.emf_offset_v + signal.high * vpp
        low_v = signal.emf_offset_v + signal.low * vpp
        high_v, low_v = (min(max(v, -EMF_PEAK_V), EMF_PEAK_V) for v in (high_v, low_v))
        return TerminalOutput(signal.frequency_hz, 0.5 * (high_v - low_v), 0.5 * (high_v + low_v), True)

    def _envelope(self, signal: Signal) -> float:
        """Share of the programmed amplitude that is there now; the loudest of an internal modulation."""
        modulating = {"AM INT": 1.0, "AM EXT": self._modulation_in_v / _MODULATION_FULL_SCALE_V}.get(signal.modulation)
        return 1.0 if modulating is None else 0.5 * self._am_full_scale * abs(1.0 + signal.depth * modulating)

    def _propagate(self) -> None:
        """Send on its way, as one change, what the last command changed."""
        signal, sent = self._state.signal, self._sent
        changed: dict[str, Any] = {}
        if signal != sent:
            self.range_switches += self._state.follow_range()
            names = [name for name in self._latency_s if getattr(signal, name) != getattr(sent, name)]
            changed = {name: getattr(signal, name) for name in names}
        self._sent = signal
        if changed.get("on") is False:
            self._switch_off()
            del changed["on"]
        if changed:
            due_s = self._clock_s + max(self._latency_s[name] for name in changed)
            self._under_way.append((max([due_s, *(due for due, _ in self._under_way)]), changed))
        self._arrive()

    def _switch_off(self) -> None:
        for _, change in self._under_way:
            change.pop("on", None)
        self._under_way.append((self._clock_s + self._latency_s["on"], {"on": False}))
        self._under_way.sort(key=lambda change: change[0])

    def _arrive(self) -> None:
        while self._under_way and self._under_way[0][0] <= self._clock_s + 1e-9:
            _, change = self._under_way.pop(0)
            self._terminal = replace(self._terminal, **change)
            self._notify()

    def _notify(self) -> None:
        now = self._at_terminals()
        if self._listener is not None and now != self._seen:
            self._listener(now)
        self._seen = now

    # --- triggers ------------------------------------------------------------------------------------------

    def _bus_trigger(self) -> None:
        if self._state.settings.stored["TRIGger:SOURce"] != "BUS":
            raise ScpiError(-211)
        self._start_burst()

    def _start_burst(self) -> None:
        if self._state.awaits_trigger():
            self._burst_end_s = self._clock_s + self._state.start_burst()
