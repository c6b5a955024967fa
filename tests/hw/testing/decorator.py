"""What transports around another transport have in common."""

from __future__ import annotations

from hw.transport.contract import Transport


class TransportDecorator(Transport):
    """Transport that hands every step to the link of `inner`; subclasses look at the steps or spoil
    them.

    Lock, deadlines and dirtiness are the decorator's own: use `inner` through it only.
    """

    def __init__(self, inner: Transport) -> None:
        super().__init__(inner.resource, bounds=inner._bounds, clock=inner._clock)
        self._inner = inner

    def _connect(self, deadline_s: float) -> None:
        self._inner._connect(deadline_s)

    def _disconnect(self) -> None:
        self._inner._disconnect()

    def _reset(self, deadline_s: float) -> None:
        self._inner._reset(deadline_s)

    def _send(self, data: bytes, deadline_s: float) -> None:
        self._inner._send(data, deadline_s)

    def _receive(self, deadline_s: float, count: int) -> bytes:
        return self._inner._receive(deadline_s, count)

    def _discard_input(self) -> None:
        self._inner._discard_input()
