"""Entry point of the `haptic` script: Ctrl-C ends it quietly while it still imports.

Until a command begins nothing is open, so that the process can simply go. From then on an
interrupt is a KeyboardInterrupt, by which everything that is open is closed.
"""

from __future__ import annotations

import os
import signal

INTERRUPTED = 130  # as shells have it: 128 and the number of the signal


def run() -> None:
    """Import the command line and run it. Exit status: see `haptic_driver.cli.main`."""
    is_heeded = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if is_heeded:  # not where a shell has it ignored
        signal.signal(signal.SIGINT, _leave)

    from haptic_driver.cli.main import run as run_command  # noqa: PLC0415  (takes seconds)

    def begin() -> None:
        if is_heeded:
            signal.signal(signal.SIGINT, signal.default_int_handler)

    run_command(begin)


def _leave(_number: int, _frame: object) -> None:
    os.write(2, b"\nerror: interrupted; nothing was begun\n")
    os._exit(INTERRUPTED)
