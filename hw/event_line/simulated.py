"""A trigger box that exists only as bytes, behind a pseudo-terminal; it writes down its edges."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from hw.event_line.trigger_box import TriggerBox
from hw.serving.serial import SerialServer
from hw.transport.serial import SerialTransport

EDGES_KEPT = 10_000


class Edge(NamedTuple):
    """A change of the eight wires, and when the byte for it had come to the box."""

    time_s: float
    code: int


class SimulatedTriggerBox:
    """The box, by the protocol of `trigger_box.py`."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._edges: deque[Edge] = deque(maxlen=EDGES_KEPT)
        self._clock = clock
        self._code = 0

    @property
    def edges(self) -> list[Edge]:
        """The last changes of its wires, oldest first."""
        return list(self._edges)

    def handle(self, data: bytes) -> bytes:
        """Each byte is the new state; nothing is answered."""
        for code in data:
            if code != self._code:
                self._edges.append(Edge(self._clock(), code))
                self._code = code
        return b""


class SimulatedEventLine:
    """The driver of a trigger box on a simulated one, which is served while the line is open."""

    resource = "simulated event line"

    def __init__(self, box: SimulatedTriggerBox | None = None) -> None:
        self.box = SimulatedTriggerBox() if box is None else box
        self._server: SerialServer | None = None
        self._driver: TriggerBox | None = None

    def open(self) -> None:
        self._server = SerialServer(self.box, framed=False)
        self._server.start()
        self._driver = TriggerBox(SerialTransport(self._server.path))
        self._driver.open()

    def put(self, code: int) -> None:
        assert self._driver is not None  # it is open
        self._driver.put(code)

    def close(self) -> None:
        if self._driver is not None:
            self._driver.close()
        if self._server is not None:
            self._server.close()
        self._driver = self._server = None
