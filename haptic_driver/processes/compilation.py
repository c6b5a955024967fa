"""Telling of compilations: machine code that is made at first use takes seconds, and says so."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event


class _Compilation(event.Listener):
    def __init__(self, tell: Callable[[str | None, int], None]) -> None:
        self._tell = tell
        self._running: list[str] = []  # a kernel waits for those that it calls
        self._done = 0

    def on_start(self, event: Any) -> None:
        if kernel := _own(event):
            self._running.append(kernel)
            self._tell(kernel, self._done)

    def on_end(self, event: Any) -> None:
        if kernel := _own(event):
            self._running.remove(kernel)
            self._done += 1
            self._tell(self._running[-1] if self._running else None, self._done)


def _own(event: Any) -> str | None:
    """The kernel's name, if it is one of this program and not of numba."""
    function = event.data["dispatcher"].py_func
    return None if function.__module__.startswith("numba.") else str(function.__name__)


@contextmanager
def compilation(tell: Callable[[str | None, int], None]) -> Iterator[None]:
    """Call `tell` with the kernel that numba compiles, or None when there is no more, and how many
    it has compiled.
    """
    with event.install_listener("numba:compile", _Compilation(tell)):
        yield


@contextmanager
def compilation_said(
    process: str, still: Callable[[str], object] = lambda doing: None
) -> Iterator[None]:
    """A line on stderr for each kernel that is waited for, from a process that is looked at through
    its log.

    `still` is called for every kernel, so that whoever waits for this process knows that it is at
    work.
    """
    waiting = False

    def say(kernel: str | None, _: int) -> None:
        nonlocal waiting
        if kernel is not None:
            still(f"compiling {kernel}")
            if not waiting:
                print(f"{process}: compiling {kernel}, this once", file=sys.stderr, flush=True)
        waiting = kernel is not None

    with compilation(say):
        yield
