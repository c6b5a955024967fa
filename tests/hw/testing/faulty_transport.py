"""A link that fails by a script, around any transport."""

from __future__ import annotations

import enum
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NoReturn

from hw.errors import DeviceDisconnected, DeviceTimeout
from hw.transport.contract import Transport
from tests.hw.testing.decorator import TransportDecorator


class LinkFaultKind(enum.Enum):
    """What happens to one command and its answer."""

    NONE = "none"
    DELAY = (  # the answer comes `delay_s` later; after the reader's deadline it is a late answer
        "delay"
    )
    DROP_COMMAND = "drop_command"  # the instrument never hears it
    DROP_ANSWER = "drop_answer"  # carried out, answer lost
    GARBAGE = "garbage"  # `data` comes instead of the answer
    TRUNCATE = "truncate"  # the first `count` bytes of the answer, then nothing
    DUPLICATE = "duplicate"  # the answer, and once more `delay_s` later
    DISCONNECT = "disconnect"  # the first `count` bytes of the answer, then the link is lost
    DISCONNECT_SENDING = "disconnect_sending"  # the link is lost before the command
    REFUSE = "refuse"  # as DISCONNECT_SENDING, and the next `count` attempts to connect fail


@dataclass(frozen=True)
class LinkFault:
    """One step of a script; see LinkFaultKind for what the fields mean to each kind."""

    kind: LinkFaultKind
    delay_s: float = 0.0
    data: bytes = b""
    count: int = 0


_NO_FAULT = LinkFault(LinkFaultKind.NONE)


class Faulty(TransportDecorator):
    """Transport that spoils the n-th command and its answer by the n-th step of `script`; after
    that, nothing.

    Faults are those of a link: they act on bytes between `inner` and the contract's own checks. A
    command without an answer uses up a step too. Waiting is by `sleep`, which has to move `inner`'s
    clock.
    """

    def __init__(
        self,
        inner: Transport,
        script: Iterable[LinkFault] = (),
        *,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        super().__init__(inner)
        self._script = iter(tuple(script))
        self._sleep = sleep
        self._step = _NO_FAULT
        self._passed = 0  # bytes of the present answer handed over
        self._delayed: tuple[float, bytes] | None = None  # when due, and what
        self._copies: deque[tuple[float, bytes]] = deque()
        self._refusals = 0
        self._lost = False

    def _connect(self, deadline_s: float) -> None:
        if self._refusals > 0:
            self._refusals -= 1
            self._hang_up("refused the connection")
        super()._connect(deadline_s)
        self._forget()

    def _reset(self, deadline_s: float) -> None:
        if self._lost or self._refusals > 0:
            self._disconnect()
            self._connect(deadline_s)
        else:
            super()._reset(deadline_s)
            self._forget()

    def _forget(self) -> None:
        """After a fresh start nothing from before arrives any more."""
        self._lost = False
        self._delayed = None
        self._copies.clear()
        self._step = _NO_FAULT

    def _send(self, data: bytes, deadline_s: float) -> None:
        self._check_link()
        self._step = next(self._script, _NO_FAULT)
        self._passed, self._delayed = 0, None
        match self._step.kind:
            case LinkFaultKind.DISCONNECT_SENDING:
                self._hang_up("was lost while sending")
            case LinkFaultKind.REFUSE:
                self._refusals = self._step.count
                self._hang_up("was lost while sending")
            case LinkFaultKind.DROP_COMMAND:
                return
        super()._send(data, deadline_s)

    def _receive(self, deadline_s: float, count: int) -> bytes:
        self._check_link()
        if self._copies and self._copies[0][0] <= self._clock():
            return self._copies.popleft()[1]
        step = self._step
        match step.kind:
            case LinkFaultKind.DROP_COMMAND | LinkFaultKind.DROP_ANSWER:
                self._swallow(deadline_s)
            case LinkFaultKind.GARBAGE:
                return self._receive_garbage(deadline_s)
            case LinkFaultKind.TRUNCATE | LinkFaultKind.DISCONNECT:
                return self._receive_first(deadline_s, count)
            case LinkFaultKind.DELAY:
                return self._receive_delayed(deadline_s, count)
        data = super()._receive(deadline_s, count)
        if step.kind is LinkFaultKind.DUPLICATE:
            self._copies.append((self._clock() + step.delay_s, data))
        return data

    def _receive_delayed(self, deadline_s: float, count: int) -> bytes:
        if self._delayed is None:
            self._delayed = (
                self._clock() + self._step.delay_s,
                super()._receive(deadline_s, count),
            )
        due_s, data = self._delayed
        self._sleep(max(0.0, min(due_s, deadline_s) - self._clock()))
        if due_s > deadline_s:
            raise DeviceTimeout(f"{self.resource} did not answer in time (scripted)", "try again")
        self._delayed = None
        self._step = _NO_FAULT  # the rest of the answer follows at once
        return data

    def _receive_garbage(self, deadline_s: float) -> bytes:
        """Hand over noise once, when the answer comes, and swallow the answer."""
        if self._passed or not self._step.data:
            self._swallow(deadline_s)
        super()._receive(deadline_s, 1)
        self._passed = len(self._step.data)
        return self._step.data

    def _receive_first(self, deadline_s: float, count: int) -> bytes:
        """Hand over the answer up to the step's `count` bytes."""
        left = self._step.count - self._passed
        if left <= 0:
            if self._step.kind is LinkFaultKind.DISCONNECT:
                self._hang_up("closed the connection")
            self._swallow(deadline_s)
        data = super()._receive(deadline_s, count)[:left]
        self._passed += len(data)
        return data

    def _swallow(self, deadline_s: float) -> NoReturn:
        """Lose what comes, until the inner link says that time is up."""
        while True:
            super()._receive(deadline_s, 1)

    def _discard_input(self) -> None:
        self._check_link()
        super()._discard_input()
        while self._copies and self._copies[0][0] <= self._clock():
            self._copies.popleft()

    def _check_link(self) -> None:
        if self._lost:
            self._hang_up("is not connected")

    def _hang_up(self, what: str) -> NoReturn:
        self._inner._disconnect()
        self._lost = True
        raise DeviceDisconnected(f"{self.resource} {what} (scripted)", "open it again")
