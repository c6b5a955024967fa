"""What a simulated card's samples are at the terminals: amplitude, frequency and what is direct."""

from __future__ import annotations

import threading
from math import acos, ceil, pi

import numpy as np

from hw.analog.output import Array
from hw.analog.simulated_output import CardMemory
from hw.generator.contract import GeneratorLatency, Listener, TerminalOutput

WINDOW = 64  # samples to which a sine is fitted
LONGEST = 600  # that are looked at: half a period of the slowest carrier, and more
SILENT_V = 1e-9
SLOWEST_HZ = 1.0  # as which a level that is held counts: a finger's law knows no direct voltage
NOTHING = TerminalOutput(SLOWEST_HZ, 0.0, 0.0, on=False)


class SimulatedCarrier:
    """A `SimulatedGenerator` without commands: `look` at the card shows what is at the terminals.

    A card that ran dry is at its last sample, which is a direct voltage.
    """

    def __init__(
        self,
        latency: GeneratorLatency,
        *,
        listener: Listener | None = None,
        am_full_scale: float = 1.0,
    ) -> None:
        self._listener = listener
        self._lock = threading.Lock()
        self._there = NOTHING

    def handle(self, data: bytes) -> bytes:
        """Nothing understands words here."""
        return b""

    def advance(self, dt_s: float) -> None:
        """Time passes by looking."""

    def output(self) -> TerminalOutput:
        with self._lock:
            return self._there

    def set_modulation_input(self, voltage_v: float) -> None:
        """There is none."""

    def look(self, card: CardMemory, at_s: float) -> None:
        """Take what the card has at its terminal then."""
        samples_v, rate_hz = card.recent(at_s, LONGEST)
        there = _terminal(samples_v, rate_hz)
        with self._lock:
            changed, self._there = there != self._there, there
        if changed and self._listener is not None:
            self._listener(there)


def _terminal(samples_v: Array, rate_hz: float) -> TerminalOutput:
    """A sine's recursion x[n-1] + x[n+1] = 2 cos(w) x[n] gives its frequency, a fit gives its
    amplitude.
    """
    lately_v, samples_v = samples_v, samples_v[-WINDOW:]
    if np.abs(samples_v).max() <= SILENT_V:
        return NOTHING
    if samples_v.size < 5 or np.ptp(samples_v[-5:]) == 0.0:
        return TerminalOutput(SLOWEST_HZ, abs(float(samples_v[-1])), 0.0, on=True)
    inner = samples_v[1:-1]
    cosine = float(inner @ (samples_v[:-2] + samples_v[2:])) / (2.0 * float(inner @ inner))
    step_rad = acos(min(max(cosine, -1.0), 1.0))
    phase_rad = step_rad * np.arange(samples_v.size)
    basis = np.column_stack([np.cos(phase_rad), np.sin(phase_rad)])
    fitted = np.linalg.lstsq(basis, samples_v, rcond=None)[0] if step_rad > 0.0 else np.zeros(2)
    frequency_hz = max(step_rad * rate_hz / (2.0 * pi), SLOWEST_HZ)
    # An amplitude that falls bends the fit: no more is there than was within half a period.
    half = ceil(pi / step_rad) + 1 if step_rad > 0.0 else lately_v.size
    amplitude_v = min(float(np.hypot(*fitted)), float(np.abs(lately_v[-half:]).max()))
    return TerminalOutput(_digits(frequency_hz), _digits(amplitude_v), 0.0, on=True)


def _digits(value: float) -> float:
    """Four, so that a steady carrier is one condition to a finger's law."""
    return float(f"{value:.4g}")
