"""A transport to something in this process, e.g. a simulated instrument: no sockets, no waiting."""

from __future__ import annotations

from collections.abc import Callable

from hw.errors import DeviceDisconnected, DeviceTimeout
from hw.serving.responder import Responder
from hw.transport.contract import NO_OTHER_BOUNDS, Bounds, Transport


def _standing() -> float:
    return 0.0


class MemoryTransport(Transport):
    """Transport that calls a responder in the caller's own thread.

    What the responder returns in time is the answer; what it returns later is a late answer. What
    it never returns is a timeout at once, without waiting. Time stands still unless a `clock` is
    given: on a busy machine no answer is late by accident.
    """

    def __init__(
        self,
        responder: Responder,
        *,
        resource: str = "MEMORY::0",
        bounds: Bounds = NO_OTHER_BOUNDS,
        clock: Callable[[], float] = _standing,
    ) -> None:
        super().__init__(resource, bounds=bounds, clock=clock)
        self._responder = responder
        self._answers = bytearray()
        self._hung_up = True

    def _connect(self, deadline_s: float) -> None:
        self._answers.clear()
        self._hung_up = False

    def _disconnect(self) -> None:
        self._hung_up = True

    def _send(self, data: bytes, deadline_s: float) -> None:
        self._check_connected()
        try:
            self._answers += self._responder.handle(data)
        except ConnectionError:
            self._hung_up = True

    def _receive(self, deadline_s: float, count: int) -> bytes:
        self._check_connected()
        if not self._answers or self._clock() > deadline_s:
            raise DeviceTimeout(
                f"{self.resource} did not answer in time", "check the simulated instrument"
            )
        data = bytes(self._answers)
        self._answers.clear()
        return data

    def _discard_input(self) -> None:
        self._check_connected()
        self._answers.clear()

    def _check_connected(self) -> None:
        if self._hung_up:
            raise DeviceDisconnected(f"{self.resource} closed the connection", "open it again")
