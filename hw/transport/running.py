"""What works between `start` and `close`, and so inside a `with` block."""

from __future__ import annotations

from abc import ABC, abstractmethod
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
        """Start."""
        self.start()
        return self

    def __exit__(self, *reason: object) -> None:
        """Close, whatever the reason."""
        self.close()
