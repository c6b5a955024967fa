"""What compiles the stages: `kernel`, numba's njit with the options that all of them share.

numba's own cache notices a change in the file of a kernel, not in the kernels, constants and records that it uses from
other files. So the cache lives in a folder named by the hash of all these sources: whatever is edited, no stale machine
code runs.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.core import event

from haptic_driver.signals import Array

F = TypeVar("F", bound=Callable[..., object])

_kernels: list[Any] = []


def _cache_folder() -> Path:
    """A folder of its own for each state of the sources, in `HAPTIC_CACHE_DIR` or else the user's cache."""
    here = Path(__file__).parent
    digest = hashlib.sha256()
    for path in (*sorted(here.glob("*.py")), here.parent / "signals.py"):
        digest.update(path.read_bytes())
    users = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "haptic-driver"
    return Path(os.environ.get("HAPTIC_CACHE_DIR") or users) / "kernels" / digest.hexdigest()[:16]


_FOLDER = str(_cache_folder())


def kernel(function: F) -> F:
    """Compile `function` at its first call with arguments of these types, and keep the machine code on disk.

    `nogil`: other threads go on meanwhile. `error_model`: x / 0 is inf or NaN, as in numpy, and never an exception.
    """
    config: Any = numba.config
    before, config.CACHE_DIR = config.CACHE_DIR, _FOLDER
    try:
        compiled = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    finally:
        config.CACHE_DIR = before
    _kernels.append(compiled)
    return cast(F, compiled)


def refuse_to_compile() -> None:
    """From here on a kernel in use raises TypeError for arguments it was not compiled for: compiling takes seconds."""
    for each in _kernels:
        if each.signatures:
            each.disable_compile()


def laid_out(values: Array) -> Array:
    """The same numbers laid out as kernels get them everywhere: another layout would be compiled for anew."""
    return np.require(values, np.float64, ["C", "A", "W"])


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
    """Call `tell` with the kernel that numba compiles, or None when there is no more, and how many it has compiled."""
    with event.install_listener("numba:compile", _Compilation(tell)):
        yield


@contextmanager
def compilation_said(process: str) -> Iterator[None]:
    """A line on stderr for each kernel that is waited for, from a process that is looked at through its log."""
    waiting = False

    def say(kernel: str | None, _: int) -> None:
        nonlocal waiting
        if kernel is not None and not waiting:
            print(f"{process}: compiling {kernel}, this once", file=sys.stderr, flush=True)
        waiting = kernel is not None

    with compilation(say):
        yield
