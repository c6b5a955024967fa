"""What switches off, however a request writes it: `/off`, `/off/`, `/off?why`,
`http://host/off`; and the threads that do it and nothing else.
"""

from __future__ import annotations

import re
from concurrent.futures import Future
from contextlib import suppress
from queue import SimpleQueue
from typing import Any, NamedTuple

from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.verbs import Empty, Verb, all_verbs
from haptic_driver.daemon.web.security import refusal
from haptic_driver.errors import HapticError, message_of
from haptic_driver.processes.started import start_thread

OFF_THREADS = 8  # for switching off alone: it never waits for a thread that another request holds
OFF_VERBS = {name: verb for name, verb in all_verbs().items() if verb.switches_off}

_PATHS = {verb.path: verb for verb in OFF_VERBS.values()}
_LINE = re.compile(rb"(?:\r?\n)*([A-Z]+) (?:(?i:https?)://[^/?#\s]*)?(/[^/?#\s]*)/?[?#\s]")
_SAID = {200: "OK", 409: "Conflict", 500: "Internal Server Error"}


class Answered(NamedTuple):
    """The status of an HTTP response, and its body of JSON."""

    status: int
    body: bytes


def begins_off(data: bytes) -> Verb[..., Any, Any] | None:
    """The verb, where a request that begins with `data` switches off."""
    line = _LINE.match(data)
    verb = _PATHS.get(line[2].decode("latin-1")) if line else None
    return verb if verb and line and verb.method.encode() == line[1] else None


class OffThreads:
    """Switch off, in threads that are there before anybody asks.

    A machine that has no thread, no process and no memory left has these.
    """

    def __init__(self, daemon: Daemon) -> None:
        self._daemon = daemon
        self._asked: SimpleQueue[tuple[Verb[..., Any, Any], Future[Answered]] | None] = (
            SimpleQueue()
        )
        for _ in range(OFF_THREADS):
            start_thread("off", self._work)

    def ask(self, verb: Verb[..., Any, Any]) -> Future[Answered]:
        """The answer to come; it never fails."""
        answer: Future[Answered] = Future()
        self._asked.put((verb, answer))
        return answer

    def close(self) -> None:
        """Begin nothing any more."""
        for _ in range(OFF_THREADS):
            self._asked.put(None)

    def _work(self) -> None:
        while (asked := self._asked.get()) is not None:
            verb, answer = asked
            with suppress(MemoryError):  # the output is off by then; no answer goes out
                answer.set_result(self._answer(verb))

    def _answer(self, verb: Verb[..., Any, Any]) -> Answered:
        try:
            return Answered(200, verb.said_json(self._daemon, Empty(), "").encode())
        except HapticError as error:
            return Answered(409, bytes(refusal(409, error).body))
        except BaseException as error:  # of a plug-in, too
            said = HapticError("internal", message_of(error), "a fault of the program")
            return Answered(500, bytes(refusal(500, said).body))


def as_http(answer: Answered) -> bytes:
    """The whole HTTP response; its connection is closed after it."""
    status, body = answer
    head = (
        f"HTTP/1.1 {status} {_SAID[status]}\r\ncontent-type: application/json\r\n"
        f"content-length: {len(body)}\r\nconnection: close\r\n\r\n"
    )
    return head.encode() + body
