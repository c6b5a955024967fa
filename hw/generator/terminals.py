"""From what a simulated generator holds to what is at its terminals: latency, Modulation In, the
output's switch.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

from hw.generator.contract import GeneratorLatency, Listener, TerminalOutput
from hw.generator.settings import Shape

_made = count(1)
_MODULATION_FULL_SCALE_V = 5.0


def simulated_serial_number() -> str:
    """Another for each simulated instrument of this machine, as with real ones."""
    return f"SIM{os.getpid()}-{next(_made)}"


@dataclass(frozen=True)
class Signal:
    """What a generator holds; levels are the source's electromotive force, whatever load is
    programmed.

    `modulated`: the amplitude follows Modulation In, by `depth`; `silent`: only the offset goes
    out.
    """

    function: str
    frequency_hz: float
    emf_vpp: float
    emf_offset_v: float = 0.0
    modulated: bool = False
    depth: float = 1.0
    silent: bool = False
    on: bool = False


class Terminals:
    """Brings a signal to open terminals.

    Settings arrive after `latency` of simulated time, in the order in which they were sent;
    switching off does not queue behind the others. `listener` is called at each change.
    `am_full_scale` is the amplitude at + full scale of Modulation In and full depth, as a multiple
    of the one programmed. Whether it is 1 or 2 is to be measured on a real instrument. Not
    thread-safe: the instrument holds its lock.
    """

    def __init__(
        self,
        signal: Signal,
        latency: GeneratorLatency,
        peak_v: float,
        *,
        listener: Listener | None = None,
        am_full_scale: float = 1.0,
    ) -> None:
        self._latency_s = {
            **dict.fromkeys(("function", "silent", "modulated"), latency.function_s),
            **dict.fromkeys(("emf_vpp", "emf_offset_v", "depth"), latency.amplitude_s),
            "frequency_hz": latency.frequency_s,
            "on": latency.output_s,
        }
        self._peak_v = peak_v
        self._listener = listener
        self._am_full_scale = am_full_scale
        self._modulation_in_v = 0.0
        self._clock_s = 0.0
        self._sent = self._there = signal
        self._seen = self.output()
        self._under_way: list[tuple[float, dict[str, Any]]] = []

    def put(self, signal: Signal) -> None:
        """Send on its way, as one change, what differs from the signal before."""
        names = [
            name for name in self._latency_s if getattr(signal, name) != getattr(self._sent, name)
        ]
        changed = {name: getattr(signal, name) for name in names}
        self._sent = signal
        if changed.get("on") is False:
            for _, change in self._under_way:
                change.pop("on", None)
            self._under_way.append((self._clock_s + self._latency_s["on"], {"on": False}))
            self._under_way.sort(key=lambda change: change[0])
            del changed["on"]
        if changed:
            due_s = self._clock_s + max(self._latency_s[name] for name in changed)
            self._under_way.append((max([due_s, *(due for due, _ in self._under_way)]), changed))
        self._arrive()

    def advance(self, dt_s: float) -> None:
        """Let simulated time pass."""
        self._clock_s += dt_s
        self._arrive()

    def set_modulation_input(self, voltage_v: float) -> None:
        """Put a voltage on Modulation In; it acts at once. Open, it is at 0 V."""
        self._modulation_in_v = voltage_v
        self._notify()

    def output(self) -> TerminalOutput:
        """What is there now."""
        signal = self._there
        if not signal.on:
            return TerminalOutput(signal.frequency_hz, 0.0, 0.0, False)
        half_v = 0.0 if signal.silent else 0.5 * signal.emf_vpp * self._envelope(signal)
        high_v, low_v = (
            min(max(signal.emf_offset_v + v, -self._peak_v), self._peak_v)
            for v in (half_v, -half_v)
        )
        return TerminalOutput(
            signal.frequency_hz,
            0.5 * (high_v - low_v),
            0.5 * (high_v + low_v),
            True,
            _shape(signal),
        )

    def _envelope(self, signal: Signal) -> float:
        """Share of the programmed amplitude that is there now."""
        if not signal.modulated:
            return 1.0
        share = self._modulation_in_v / _MODULATION_FULL_SCALE_V
        return 0.5 * self._am_full_scale * abs(1.0 + signal.depth * share)

    def _arrive(self) -> None:
        while self._under_way and self._under_way[0][0] <= self._clock_s + 1e-9:
            _, change = self._under_way.pop(0)
            self._there = replace(self._there, **change)
            self._notify()

    def _notify(self) -> None:
        now = self.output()
        if self._listener is not None and now != self._seen:
            self._listener(now)
        self._seen = now


def _shape(signal: Signal) -> Shape:
    """What goes out, by the function's name; what is neither square nor direct counts as a sine."""
    if signal.silent or signal.function == "DC":
        return Shape.DC
    return Shape.SQUARE if signal.function.startswith("SQU") else Shape.SINE
