"""A log that keeps nobody waiting: a thread of its own writes it, and what it cannot take is
dropped.

A terminal that somebody has stopped with Ctrl-S, or a pipe that nobody reads, stops whoever writes
to it. Code on the way to zero volts must not be stopped.
"""

from __future__ import annotations

import logging
import os
import queue
import threading
from contextlib import suppress

MOST_WAITING = 1000
FLUSH_S = 1.0  # at the end
STDERR = 2


class DroppingHandler(logging.Handler):
    """Writes records to standard error in a thread that begins now and ends with the process.

    What there is no room for is lost. Nothing else writes there: what a stream
    or another handler holds back, it would wait for at the end of the process.
    """

    def __init__(self) -> None:
        super().__init__()
        self._waiting: queue.Queue[logging.LogRecord] = queue.Queue(MOST_WAITING)
        threading.Thread(target=self._write, name="log", daemon=True).start()

    def emit(self, record: logging.LogRecord) -> None:
        """Leave it for the thread; whatever is in the way, nobody waits for it and nothing is
        raised.
        """
        with suppress(Exception):  # full, or no memory
            self._waiting.put_nowait(record)

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - logging's name
        """Say nothing: to say it on standard error would wait for that."""

    def flush(self) -> None:
        """Give the thread a moment to write what is waiting."""
        with self._waiting.all_tasks_done:
            self._waiting.all_tasks_done.wait_for(
                lambda: not self._waiting.unfinished_tasks, FLUSH_S
            )

    def _write(self) -> None:
        while True:
            record = self._waiting.get()
            with suppress(Exception):
                said = f"{self.format(record)}\n".encode(errors="replace")
                while said:
                    said = said[os.write(STDERR, said) :]
            self._waiting.task_done()
