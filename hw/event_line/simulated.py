"""A trigger box that exists only as bytes, behind a pseudo-terminal; it writes down its edges, and
sends bytes as another would.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

from hw.event_line.trigger_box import TriggerBox, TriggerBoxIn
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
        self._driver = TriggerBox(SerialTransport(self._server.path), settle_s=0.0)
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


class SimulatedLineIn:
    """The driver of a trigger box's input on a simulated one, which is served while it is open.

    `pulse` is what another instrument would do; with `every_s` above 0 it comes by itself too.
    """

    resource = "simulated line in"

    def __init__(
        self, code: int = 0, every_s: float = 0.0, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._code, self._every_s, self._clock = code, every_s, clock
        self._server: SerialServer | None = None
        self._driver: TriggerBoxIn | None = None
        self._due_s = 0.0

    def open(self) -> None:
        self._server = SerialServer(SimulatedTriggerBox(self._clock), framed=False)
        self._server.start()
        self._driver = TriggerBoxIn(SerialTransport(self._server.path), self._code, 0.0)
        self._driver.open()
        self._due_s = self._clock() + self._every_s

    def pulse(self) -> float:
        """Have the box send its code, then 0; when that began, by the clock."""
        assert self._server is not None  # it is open
        now_s = self._clock()
        self._server.send(bytes([self._code or 1, 0]))
        return now_s

    def unplug(self) -> None:
        """The box is gone until the line is opened again; from any thread."""
        server, self._server = self._server, None  # who reads may close the line meanwhile
        if server is not None:
            server.close()

    def levels(self) -> Sequence[bool]:
        if self._every_s and self._clock() >= self._due_s:
            self._due_s += self._every_s
            self.pulse()
        assert self._driver is not None  # it is open
        return self._driver.levels()

    def close(self) -> None:
        driver, self._driver = self._driver, None
        if driver is not None:
            driver.close()
        self.unplug()
