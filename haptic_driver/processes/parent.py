"""A child's words with the process that started it, see `child`; where that one is gone it ends,
quietly.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import sys
from collections.abc import Callable, Mapping
from typing import Any


def given() -> Any:
    """What it hands over on standard input, pickled."""
    try:
        return pickle.load(sys.stdin.buffer)
    except (EOFError, pickle.UnpicklingError):  # it was killed before it had said everything
        sys.exit(1)


def still(doing: str) -> None:
    """What takes long before this process is ready; whoever waits for it goes on waiting."""
    tell({"doing": doing})


def tell(said: Mapping[str, Any]) -> None:
    """One JSON line on standard output, such as that this process is ready."""
    try:
        print(json.dumps(said), flush=True)
    except BrokenPipeError:
        sys.stdout = None  # nobody is there for what is left in it
        sys.exit(1)


def outlived() -> Callable[[], bool]:
    """Whether the process that started this one has ended since; never where SIGHUP is ignored,
    as `nohup` asks for.
    """
    started_by = os.getppid()
    hang_up = getattr(signal, "SIGHUP", None)
    if hang_up is not None and signal.getsignal(hang_up) is signal.SIG_IGN:
        return lambda: False
    return lambda: os.getppid() != started_by
