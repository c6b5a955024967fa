"""One child process: started, ready, watched, ended."""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from haptic_driver.base.interpreter import module_command
from haptic_driver.errors import HapticError
from haptic_driver.processes.started import start_process, start_thread

STOP_TIMEOUT_S = 5.0
# Another thread of the linear algebra library has no precedence of its own: a killed process is
# gone only when that thread has had its turn.
ENVIRONMENT = {"OPENBLAS_NUM_THREADS": "1"}


class Child:
    """One process, run as a module of this program; it says one JSON line when it is ready.

    What it says it is doing before, such as compiling, is waited for.

    It is in a group of its own, so that what interrupts the daemon does not end it before the
    output is off. It stays in the daemon's session, among which Linux shares a busy processor
    before it looks at niceness.
    """

    def __init__(
        self,
        name: str,
        module: str,
        arguments: Sequence[object],
        *,
        given: bytes = b"",
        descriptors: Sequence[int] = (),
    ) -> None:
        self.name = name
        self._process = start_process(
            name,
            [*module_command(module), *map(str, arguments)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | ENVIRONMENT,
            pass_fds=descriptors,
            process_group=0,
        )
        self._said: queue.Queue[bytes] = queue.Queue()
        self._talking = start_thread("child", self._talk, given)

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def ended(self) -> str | None:
        """How it ended, in words; None while it runs."""
        status = self._process.poll()
        if status is None:
            return None
        how = (
            f"killed by {signal.Signals(-status).name}"
            if status < 0
            else f"ended with status {status}"
        )
        return (
            f"the {self.name} process was {how}" if status < 0 else f"the {self.name} process {how}"
        )

    def ready(self, timeout_s: float) -> dict[str, Any]:
        """What it said when it was ready. Raises HapticError when it falls silent for so long
        before.
        """
        doing = ""
        with suppress(queue.Empty, json.JSONDecodeError):
            while True:
                said: dict[str, Any] = json.loads(self._said.get(timeout=timeout_s))
                if "doing" not in said:
                    return said
                doing = f" while {said['doing']}"
        why = self.ended or f"the {self.name} process said nothing for {timeout_s:g} s{doing}"
        self.kill()
        raise HapticError("not_started", why, "what it wrote to standard error says more")

    def stop(self) -> None:
        """Ask it to end, and make it; does nothing more when it has ended."""
        self._process.terminate()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(STOP_TIMEOUT_S)
        self.kill()

    def kill(self) -> None:
        """End it without asking."""
        self._process.kill()
        self._process.wait()
        self._talking.join()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            with suppress(OSError):
                pipe.close()

    def _talk(self, given: bytes) -> None:
        """Its standard input stays open: the end of input means that the parent is gone."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with suppress(OSError):
            self._process.stdin.write(given)
            self._process.stdin.flush()
        while line := self._process.stdout.readline():
            self._said.put(line)
        self._said.put(b"")  # it has ended
