"""A thing that a thread opens and serves, and opens again where it is lost."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

from haptic_driver.errors import message_of
from haptic_driver.processes.patience import join_within
from haptic_driver.processes.started import start_thread

RETRY_S = 1.0
END_S = 2.0


class Opened(Protocol):
    """What is kept; its driver may raise whatever it likes."""

    def open(self) -> object: ...

    def close(self) -> object: ...


class KeptOpen:
    """Serves a thing between `start` and `close`, from the thread of that name.

    `serve` ends when `ending` is set, or raises what the thing is lost by. `told` hears why it is,
    each reason once, and None when it is back; `again` is called before each further attempt.
    `lost` is the reason, None while the thing is served.
    """

    def __init__(
        self,
        name: str,
        thing: Opened,
        serve: Callable[[], object],
        told: Callable[[str | None], object],
        again: Callable[[], object] = lambda: None,
    ) -> None:
        self.ending = threading.Event()
        self.lost: str | None = "not open yet"
        self._name, self._thing = name, thing
        self._serve, self._told, self._again = serve, told, again
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        self._thread = start_thread(self._name, self._run)

    def close(self) -> None:
        """Let go of the thing."""
        self.ending.set()
        if self._thread is not None:
            join_within(END_S, [self._thread])

    def _run(self) -> None:
        failure: str | None = None
        while not self.ending.is_set():
            try:
                self._thing.open()
                if failure is not None:
                    self._told(None)
                failure = self.lost = None
                self._serve()
            except BaseException as error:  # whatever a driver raises, all else goes on
                self._let_go()
                self.lost = message_of(error)
                if self.lost != failure:
                    failure = self.lost
                    self._told(failure)
                if not self.ending.wait(RETRY_S):
                    self._again()
        self._let_go()

    def _let_go(self) -> None:
        with suppress(BaseException):  # of a thing that is gone
            self._thing.close()
