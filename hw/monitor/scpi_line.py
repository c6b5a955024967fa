"""Lines to an instrument that only reads, and answers from it: text, numbers, and blocks of bytes
(IEEE 488.2).
"""

from __future__ import annotations

import re

from hw.errors import BadReply, InstrumentRejected
from hw.transport.contract import Transport, longer_if_slow

_MOST_ERRORS = 30


class ScpiLine:
    """One instrument's dialogue, of one thread at a time; raises DeviceError, nothing else."""

    def __init__(self, transport: Transport, timeout_s: float) -> None:
        self._transport = transport
        self._timeout_s = timeout_s

    def open(self, model: re.Pattern[str]) -> None:
        """Connect, check who answers, and forget its old errors."""
        self.identify(model)
        self.tell("*CLS")

    def identify(self, model: re.Pattern[str]) -> str:
        """Connect, and only ask who answers: BadReply for another instrument."""
        self._transport.open()
        identity = self.ask("*IDN?")
        if not model.fullmatch((identity + ",,").split(",")[1].strip()):
            raise self._bad(
                f"is {identity!r}, not a {model.pattern}",
                "check address and kind in the rig's file",
            )
        return identity

    def close(self) -> None:
        self._transport.close()

    def clear(self) -> None:
        """Have the interface forget what is under way: a device clear where it has one."""
        self._transport.clear()

    def tell(self, *lines: str) -> None:
        """Send commands, then ask whether the instrument took them all; InstrumentRejected says
        what it did not.
        """
        for line in lines:
            self._transport.write(line.encode("ascii") + b"\n")
        errors: list[str] = []
        while len(errors) < _MOST_ERRORS and not re.match(
            r"[+-]?0,", error := self.ask(":SYST:ERR?")
        ):
            errors.append(error)
        if errors:
            said = f"{self._transport.resource} refused {'; '.join(lines)}: {', '.join(errors)}"
            raise InstrumentRejected(
                said, "look at the instrument; is it the model of the rig's file?"
            )

    def ask(self, line: str) -> str:
        """The line that answers."""
        with longer_if_slow(self._timeout_s):
            answer = self._transport.query(line.encode("ascii") + b"\n", self._timeout_s)
        return answer.decode("ascii", errors="replace").strip()

    def numbers(self, line: str, count: int) -> list[float]:
        """`count` numbers, comma-separated."""
        answer = self.ask(line)
        try:
            found = [float(text) for text in answer.split(",")]
        except ValueError:
            found = []
        if len(found) != count:
            raise self._bad(
                f"answered {answer[:60]!r} to {line}, not {count} numbers", "connect again"
            )
        return found

    def block(self, line: str) -> bytes:
        """A definite-length block: # d and d digits of length, then so many bytes."""
        with self._transport.exchange(self._timeout_s), longer_if_slow(self._timeout_s):
            self._transport.write(line.encode("ascii") + b"\n")
            head = self._transport.read_exactly(2, self._timeout_s)
            if not re.fullmatch(rb"#[1-9]", head):
                raise self._bad(f"answered {head!r} to {line}, no block", "connect again")
            digits = self._transport.read_exactly(int(head[1:]), self._timeout_s)
            if not digits.isdigit():
                raise self._bad(f"gave {digits!r} as the length of a block", "connect again")
            data = self._transport.read_exactly(int(digits), self._timeout_s)
            self._transport.read_until(b"\n", self._timeout_s)
        return data

    def _bad(self, what: str, hint: str) -> BadReply:
        self._transport.mark_dirty()
        return BadReply(f"{self._transport.resource} {what}", hint)
