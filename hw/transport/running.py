"""What works between `start` and `close`, and so inside a `with` block."""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import AbstractContextManager, ExitStack
from typing import Self


class Running(ABC):
    """Something with a life of its own: a thread, a process, a server."""

    @abstractmethod
    def start(self) -> None:
        """Begin."""

    @abstractmethod
    def close(self) -> object:
        """End; also what never began."""

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *reason: object) -> None:
        """Close, whatever the reason."""
        self.close()


class RunningTogether(Running):
    """Starts several one after the other, and closes them in reverse; also those before one that
    does not start.
    """

    def __init__(self, *parts: AbstractContextManager[object]) -> None:
        self._parts = parts
        self._started = ExitStack()

    def start(self) -> None:
        with ExitStack() as started:
            for part in self._parts:
                started.enter_context(part)
            self._started = started.pop_all()

    def close(self) -> None:
        self._started.close()
