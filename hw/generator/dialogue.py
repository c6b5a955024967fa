"""Lines to a generator and answers from it: every message passes the last gate, every answer is
checked.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from hw.errors import BadReply, InstrumentRejected
from hw.generator.gate import OutputGate
from hw.transport.contract import Transport, longer_if_slow

_ERROR_QUEUE_LENGTH = 20
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_ERROR = re.compile(r'(?P<code>[+-]?\d{1,5}),".*"')
_FIELD = re.compile(r'(?:[^;"]|"[^"]*")+')
NOT_WHOLE = "the answer is garbled or the settings were changed at the front panel; connect again"

# By code only: the texts differ between firmwares.
_HINTS = {
    -211: "set the trigger source and arm the burst before triggering",
    -221: (
        "two settings contradict each other and the instrument moved one; ask for less, or in"
        " another order"
    ),
    -222: "a value was out of range and the instrument clipped it; check the requested values",
    -350: "more errors came than the instrument can keep; send *CLS and look for the first one",
}
_HINTS_BY_CLASS = {
    1: "the instrument does not know the command; check its model and firmware",
    2: "check the requested values against the instrument's ranges",
    4: "the dialogue is out of step; connect again",
}


class GeneratorDialogue:
    """The dialogue with one instrument, line by line; raises DeviceError, nothing else.

    Whatever fails, `gate` forgets what it believed. No other thread comes between the exchanges of
    one method; `undisturbed` lends the transport for several.
    """

    def __init__(self, transport: Transport, gate: OutputGate, reply_timeout_s: float) -> None:
        self._transport = transport
        self._gate = gate
        self._reply_timeout_s = reply_timeout_s

    @property
    def resource(self) -> str:
        """Where the instrument is."""
        return self._transport.resource

    def open(self) -> None:
        self._transport.open()

    def close(self) -> None:
        self._transport.close()

    @contextmanager
    def undisturbed(self, timeout_s: float | None = None) -> Iterator[None]:
        """Hold the transport; after any failure the gate knows nothing."""
        with self._transport.exchange(timeout_s):
            try:
                yield
            except BaseException:
                self._gate.forget()
                raise

    def query(self, line: str) -> str:
        """Send one line and return the line that answers it."""
        message = line.encode("ascii") + b"\n"
        with self.undisturbed():
            self._gate.check(message)
            with longer_if_slow(self._reply_timeout_s):
                reply = self._transport.query(message, self._reply_timeout_s)
        return reply.decode("ascii", errors="replace").strip()

    def send(self, line: str) -> None:
        """Send one line that asks nothing."""
        message = line.encode("ascii") + b"\n"
        with self.undisturbed():
            self._gate.check(message)
            self._transport.write(message)

    def number(self, text: str) -> float:
        """Return a decimal number, of any length; finite."""
        if not _NUMBER.fullmatch(text) or not math.isfinite(float(text)):
            raise self.bad_reply(f"answered {text!r} where a number was expected", NOT_WHOLE)
        return float(text)

    def bad_reply(self, what: str, hint: str) -> BadReply:
        """Make the error for an answer that is wrong, and distrust the dialogue so far."""
        self._transport.mark_dirty()
        self._gate.forget()
        return BadReply(f"{self.resource} {what}", hint)


class ScpiDialogue(GeneratorDialogue):
    """The dialogue where one line holds several commands, and errors wait in a queue
    (`SYST:ERR?`).
    """

    def ask(self, commands: Sequence[str], count: int) -> list[str]:
        """Send commands as one line and return the `count` fields of its one answer line."""
        line = _line(commands)
        with self.undisturbed():
            reply = self.query(line)
            fields: list[str] = _FIELD.findall(reply)
            if len(fields) != count:
                raise self.bad_reply(f"answered {reply[:80]!r} to {line!r}", NOT_WHOLE)
        return fields

    def command(self, commands: Sequence[str], queries: Sequence[str]) -> list[str]:
        """Send commands, queries and the question for errors as one line; return the answers to the
        queries.

        Raises InstrumentRejected with all errors in the instrument's queue, a clipped value (-222)
        among them.
        """
        with self.undisturbed():
            *answers, error = self.ask([*commands, *queries, "SYST:ERR?"], len(queries) + 1)
            code = self._error_code(error)
            if code != 0:
                raise InstrumentRejected(
                    f"{self.resource} rejected {';'.join(commands)!r}:"
                    f" {', '.join(self._errors(error))}",
                    _HINTS.get(code)
                    or _HINTS_BY_CLASS.get(
                        -code // 100, "look at the instrument: it reports a fault"
                    ),
                )
        return answers

    def boolean(self, text: str) -> bool:
        """Return what `0` or `1` says."""
        if text not in ("0", "1"):
            raise self.bad_reply(f"answered {text!r} where 0 or 1 was expected", NOT_WHOLE)
        return text == "1"

    def _errors(self, first: str) -> list[str]:
        """Return `first` and empty the instrument's queue behind it, so that no later command is
        blamed.
        """
        errors = [first]
        while len(errors) <= _ERROR_QUEUE_LENGTH:
            (error,) = self.ask(["SYST:ERR?"], 1)
            if self._error_code(error) == 0:
                break
            errors.append(error)
        return errors

    def _error_code(self, text: str) -> int:
        match = _ERROR.match(text)
        if match is None:
            raise self.bad_reply(f"answered {text!r} where an error was asked for", NOT_WHOLE)
        return int(match["code"])


def _line(commands: Sequence[str]) -> str:
    """Join commands so that each is looked up from the root of the command tree."""
    first, *others = commands
    return first + "".join(
        f";{command}" if command.startswith("*") else f";:{command}" for command in others
    )
