"""Entry point of the `haptic` script: Ctrl-C ends it with a message while it still imports.

Until a command begins nothing is open, so that the process can simply go. From then on an
interrupt is a KeyboardInterrupt, by which everything that is open is closed.
"""

from __future__ import annotations

import json
import os
import signal
import sys

from haptic_driver.errors import HapticError


def run() -> None:
    """Import the command line and run it. Exit status: see `haptic_driver.cli.main`."""
    # not where a shell has it ignored
    is_heeded = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if is_heeded:
        signal.signal(signal.SIGINT, _leave)

    from haptic_driver.cli.main import run as run_command  # noqa: PLC0415  (takes seconds)

    def begin() -> None:
        if is_heeded:
            signal.signal(signal.SIGINT, signal.default_int_handler)

    run_command(begin)


def _leave(_number: int, _frame: object) -> None:
    failure = HapticError("interrupted", "interrupted; nothing was begun")
    os.write(2, f"\nerror: {failure.message}\n".encode())
    if "--json" in sys.argv:
        os.write(1, (json.dumps({"error": failure.content}) + "\n").encode())
    os._exit(failure.exit_status)
