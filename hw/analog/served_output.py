"""A simulated card's analog output over a transport, and the driver's end of that dialogue.

LEVEL v               put out a constant level, V
START rate samples    begin a stream; samples are 4-byte floats, V, as hexadecimal digits
APPEND samples        add to it
WAITING?

Each is answered with the number of samples that are still to be played; any other line with ERROR, and nothing happens.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from hw.analog.output import AnalogOutput, AnalogOutputSettings, Array
from hw.analog.simulated_output import SimulatedCard
from hw.errors import BadReply
from hw.transport.contract import Transport

_SAMPLE = np.dtype("<f4")


class AnalogOutputServer:
    """The card's end: bytes in, bytes out."""

    def __init__(self, card: SimulatedCard) -> None:
        self._card = card

    def handle(self, data: bytes) -> bytes:
        """Carry out one line and answer it."""
        try:
            self._carry_out(data.split())
        except ValueError:  # what is no number, too
            return b"ERROR\n"
        return b"%d\n" % self._card.waiting

    def _carry_out(self, words: list[bytes]) -> None:
        match words:
            case [b"LEVEL", level]:
                self._card.set_level(float(level))
            case [b"START", rate, samples]:
                self._card.start(_decoded(samples), float(rate))
            case [b"APPEND", samples]:
                self._card.append(_decoded(samples))
            case [b"WAITING?"]:
                pass
            case _:
                raise ValueError(words)


class ServedAnalogOutput(AnalogOutput):
    """The analog output at the other end of `transport`, which plays in real time.

    Between two answers it reckons by the clock how many samples are waiting; before it says that the stream ran dry it
    asks.
    """

    def __init__(
        self, transport: Transport, settings: AnalogOutputSettings, *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__(transport.resource, settings, clock=clock)
        self._transport = transport
        self._told, self._told_s, self._playing_hz = 0, 0.0, 0.0

    def _connect(self) -> None:
        self._transport.open()

    def _disconnect(self) -> None:
        self._transport.close()

    def _set_level(self, level_v: float) -> None:
        self._ask(b"LEVEL %.9g" % level_v)

    def _start(self, block_v: Array, sample_rate_hz: float) -> None:
        self._playing_hz = sample_rate_hz
        self._ask(b"START %.9g %s" % (sample_rate_hz, _encoded(block_v)))

    def _append(self, block_v: Array) -> None:
        self._ask(b"APPEND %s" % _encoded(block_v))

    def _buffered_samples(self) -> int:
        waiting = int(self._told - (self._clock() - self._told_s) * self._playing_hz)
        if waiting <= 0:
            self._ask(b"WAITING?")
            waiting = self._told
        return waiting

    def _ask(self, line: bytes) -> None:
        reply = self._transport.query(line + b"\n", self.settings.timeout_s)
        if not reply.isdigit():
            self._transport.mark_dirty()
            raise BadReply(f"{self.resource} answered {reply[:40]!r} to {line[:20]!r}", "restart the simulation")
        self._told, self._told_s = int(reply), self._clock()


def _encoded(block_v: Array) -> bytes:
    return block_v.astype(_SAMPLE).tobytes().hex().encode()


def _decoded(samples: bytes) -> Array:
    return np.frombuffer(bytes.fromhex(samples.decode()), _SAMPLE).astype(np.float64)
