"""Wire logs: what went over a link, written while it happens, and played back byte for byte.

A log is a text file of JSON objects, one per line: first `{"wire_log": 1, "resource": ...}`, then
events in order. An event has `t_s`, seconds since the log began, and `event`: `connect` or `reset`;
`sent` or `received` with `data`, bytes as the Unicode characters 0 to 255; `disconnect`; or
`failed` with `during` (the step), `code`, `message` and `hint`.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hw.errors import BadReply, DeviceDisconnected, DeviceError, DeviceTimeout
from hw.transport.contract import NO_OTHER_BOUNDS, Bounds, Transport
from tests.hw.testing.decorator import TransportDecorator

_VERSION = 1
_FAILURES: dict[str, type[DeviceError]] = {
    kind.code: kind for kind in (DeviceTimeout, DeviceDisconnected, BadReply)
}
_SHOWN_BYTES = 40


class ReplayMismatch(DeviceError):  # noqa: N818 - as in hw.errors
    """The program does not do what the wire log holds."""

    code = "replay_mismatch"


class Recording(TransportDecorator):
    """Transport that writes every step of `inner` to a wire log.

    The file is private (0600), only ever appended to, and each event reaches the system before the
    next step begins, so a crash of the program loses nothing. Raises FileExistsError at
    construction: a log is never written over. When the disk fails afterwards, recording ends and
    the dialogue goes on; `log_error` says why.
    """

    def __init__(self, inner: Transport, path: Path) -> None:
        super().__init__(inner)
        self.log_error: OSError | None = None
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o600)
        self._began_s = self._clock()
        self._write_line({"wire_log": _VERSION, "resource": inner.resource})

    def finish(self) -> None:
        """Close the log, after `close`; what goes over the link later is not in it."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _connect(self, deadline_s: float) -> None:
        self._log("connect")
        with self._failures("connect"):
            super()._connect(deadline_s)

    def _disconnect(self) -> None:
        super()._disconnect()
        self._log("disconnect")

    def _reset(self, deadline_s: float) -> None:
        self._log("reset")
        with self._failures("reset"):
            super()._reset(deadline_s)

    def _send(self, data: bytes, deadline_s: float) -> None:
        self._log("sent", data=data.decode("latin-1"))
        with self._failures("send"):
            super()._send(data, deadline_s)

    def _receive(self, deadline_s: float, count: int) -> bytes:
        with self._failures("receive"):
            data = super()._receive(deadline_s, count)
        self._log("received", data=data.decode("latin-1"))
        return data

    def _discard_input(self) -> None:
        with self._failures("discard"):
            super()._discard_input()

    @contextmanager
    def _failures(self, during: str) -> Iterator[None]:
        try:
            yield
        except DeviceError as error:
            self._log(
                "failed", during=during, code=error.code, message=error.message, hint=error.hint
            )
            raise

    def _log(self, event: str, **details: str) -> None:
        self._write_line(
            {"t_s": round(self._clock() - self._began_s, 6), "event": event, **details}
        )

    def _write_line(self, record: dict[str, Any]) -> None:
        if self.log_error is not None or self._file < 0:
            return
        line = memoryview(json.dumps(record).encode() + b"\n")
        try:
            while line:
                line = line[os.write(self._file, line) :]
        except OSError as error:  # switching off must not depend on a disk
            self.log_error = error


class Replay(Transport):
    """Transport that answers from a wire log, at once, as long as the program does what the log
    holds.

    At the first difference it raises ReplayMismatch, and again at every later step: a program that
    swallows DeviceError cannot go on. Ask `check_finished` at the end. Raises ValueError for a file
    that is no wire log.
    """

    def __init__(self, path: Path, *, bounds: Bounds = NO_OTHER_BOUNDS) -> None:
        header, *self._events = _read_log(path)
        super().__init__(header["resource"], bounds=bounds)
        self._path = path
        self._next = 0
        self._mismatch: ReplayMismatch | None = None

    def check_finished(self) -> None:
        """Raise ReplayMismatch when the program differed or stopped before the end of the log."""
        if self._mismatch is None and self._next < len(self._events):
            self._refuse(f"{len(self._events) - self._next} more events", "the end")
        if self._mismatch is not None:
            raise self._mismatch

    def _connect(self, deadline_s: float) -> None:
        self._step("connect")
        self._fail_as_recorded("connect")

    def _disconnect(self) -> None:
        # Never raises, as for every transport; a difference shows in the next step.
        if self._peek().get("event") == "disconnect":
            self._next += 1
        elif self._mismatch is None:
            self._mismatch = self._difference(_shown(self._peek()), "a disconnect")

    def _reset(self, deadline_s: float) -> None:
        self._step("reset")
        self._fail_as_recorded("reset")

    def _send(self, data: bytes, deadline_s: float) -> None:
        recorded = self._peek()
        if recorded.get("event") != "sent":
            self._refuse(_shown(recorded), f"sending {data[:_SHOWN_BYTES]!r}")
        expected = recorded["data"].encode("latin-1")
        if data != expected:
            at = _first_difference(expected, data)
            self._refuse(_around(expected, at), _around(data, at), f" at byte {at} of the command")
        self._step("sent")
        self._fail_as_recorded("send")

    def _receive(self, deadline_s: float, count: int) -> bytes:
        self._fail_as_recorded("receive")
        data: str = self._step("received")["data"]
        return data.encode("latin-1")

    def _discard_input(self) -> None:
        self._fail_as_recorded("discard")

    def _peek(self) -> dict[str, Any]:
        return self._events[self._next] if self._next < len(self._events) else {}

    def _step(self, event: str) -> dict[str, Any]:
        recorded = self._peek()
        if self._mismatch is not None or recorded.get("event") != event:
            self._refuse(_shown(recorded), _STEPS[event])
        self._next += 1
        return recorded

    def _fail_as_recorded(self, during: str) -> None:
        if self._mismatch is not None:
            raise self._mismatch
        recorded = self._peek()
        if recorded.get("event") == "failed" and recorded["during"] == during:
            self._next += 1
            kind = _FAILURES.get(recorded["code"], DeviceError)
            raise kind(recorded["message"], recorded["hint"])

    def _refuse(self, expected: str, got: str, where: str = "") -> None:
        if self._mismatch is None:
            self._mismatch = self._difference(expected, got, where)
        raise self._mismatch

    def _difference(self, expected: str, got: str, where: str = "") -> ReplayMismatch:
        return ReplayMismatch(
            f"{self._path}, line {self._next + 2}: expected {expected}, got {got}{where}",
            "the program or its configuration differs from when the log was recorded; record a new"
            " one if meant",
        )


_FIELDS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("connect", "reset", "disconnect"), ()),
    **dict.fromkeys(("sent", "received"), ("data",)),
    "failed": ("during", "code", "message", "hint"),
}
_STEPS = {
    "connect": "a connect",
    "reset": "a reset",
    "sent": "a command",
    "received": "waiting for an answer",
}


def _read_log(path: Path) -> list[dict[str, Any]]:
    records = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            record = json.loads(line)
        except json.JSONDecodeError:
            record = None
        if not (
            isinstance(record, dict) and (_is_header(record) if number == 1 else _is_event(record))
        ):
            raise ValueError(
                f"{path}, line {number} is not part of a wire log of version {_VERSION}"
            )
        records.append(record)
    if not records:
        raise ValueError(f"{path} is empty, not a wire log of version {_VERSION}")
    return records


def _is_header(record: dict[str, Any]) -> bool:
    return record.get("wire_log") == _VERSION and isinstance(record.get("resource"), str)


def _is_event(record: dict[str, Any]) -> bool:
    fields = _FIELDS.get(str(record.get("event")))
    return fields is not None and all(isinstance(record.get(name), str) for name in fields)


def _first_difference(expected: bytes, got: bytes) -> int:
    pairs = zip(expected, got, strict=False)
    return next((i for i, (a, b) in enumerate(pairs) if a != b), min(len(expected), len(got)))


def _around(data: bytes, at: int) -> str:
    return repr(data[max(0, at - _SHOWN_BYTES // 2) : at + _SHOWN_BYTES])


def _shown(recorded: dict[str, Any]) -> str:
    match recorded.get("event"):
        case None:
            return "the end"
        case "sent" | "received" as event:
            return f"{event} {recorded['data'].encode('latin-1')[:_SHOWN_BYTES]!r}"
        case "failed":
            return f"a failure to {recorded['during']} ({recorded['code']})"
        case event:
            return f"a {event}"
