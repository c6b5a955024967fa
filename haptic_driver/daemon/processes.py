"""Child processes of the daemon and the place where it lives: start, say ready, watch, end; one daemon per place."""

from __future__ import annotations

import fcntl
import json
import os
import queue
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from haptic_driver.errors import HapticError

SOCKET_NAME = "daemon.sock"
STOP_TIMEOUT_S = 5.0


class Child:
    """One process, run as a module of this program; it says one JSON line when it is ready.

    It is in a session of its own, so that what interrupts the daemon does not end it before the output is off.
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
        self._process = subprocess.Popen(
            [sys.executable, "-m", module, *map(str, arguments)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=descriptors,
            start_new_session=True,
        )
        self._said: queue.Queue[bytes] = queue.Queue()
        self._threads = [
            threading.Thread(target=self._listen, daemon=True),
            threading.Thread(target=self._give, args=(given,), daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    @property
    def ended(self) -> str | None:
        """How it ended, in words; None while it runs."""
        status = self._process.poll()
        if status is None:
            return None
        how = f"killed by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"
        return f"the {self.name} process was {how}" if status < 0 else f"the {self.name} process {how}"

    def ready(self, timeout_s: float) -> dict[str, Any]:
        """What it said when it was ready. Raises HapticError when it does not get there."""
        with suppress(queue.Empty, json.JSONDecodeError):
            said: dict[str, Any] = json.loads(self._said.get(timeout=timeout_s))
            return said
        why = self.ended or f"the {self.name} process said nothing for {timeout_s:g} s"
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
        for thread in self._threads:
            thread.join()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            with suppress(OSError):
                pipe.close()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        self._said.put(self._process.stdout.readline())

    def _give(self, given: bytes) -> None:
        """Its standard input stays open afterwards: its end tells a child that we are gone."""
        assert self._process.stdin is not None
        with suppress(OSError):
            self._process.stdin.write(given)
            self._process.stdin.flush()


def default_socket() -> Path:
    """Where the daemon listens when nobody says otherwise: in a private folder of this user."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    folder = Path(runtime) / "haptic" if runtime else Path(tempfile.gettempdir()) / f"haptic-{os.getuid()}"
    return folder / SOCKET_NAME


class Place:
    """A socket that only this user can reach, and the right to be the only daemon there.

    The right is a file lock, which ends with its process however that ended; so a socket that a killed daemon left
    behind is known to be nobody's and is replaced.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        _private_folder(path.parent)
        try:
            self._lock = os.open(path.with_name(path.name + ".lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError as error:
            raise _no_socket(path, error) from error
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._lock)
            raise HapticError(
                "already_running", f"a daemon is running at {path}", "use it, end it, or choose another --socket"
            ) from None
        self.listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._listen()
        except BaseException:
            self._release()
            raise

    def close(self) -> None:
        """Free the place."""
        with suppress(OSError):
            self.path.unlink()
        self._release()

    def _release(self) -> None:
        self.listener.close()
        os.close(self._lock)

    def _listen(self) -> None:
        try:
            if self.path.exists() and not stat.S_ISSOCK(self.path.lstat().st_mode):
                raise HapticError("not_a_socket", f"{self.path} exists and is no socket", "choose another --socket")
            self.path.unlink(missing_ok=True)
            before = os.umask(0o177)
            try:
                self.listener.bind(str(self.path))
            finally:
                os.umask(before)
            self.listener.listen(128)
        except OSError as error:
            raise _no_socket(self.path, error) from error


def _no_socket(path: Path, error: OSError) -> HapticError:
    return HapticError("no_socket", f"{path}: cannot listen there ({error})", "choose another --socket, a short path")


def _private_folder(folder: Path) -> None:
    """Make it with mode 0700; refuse the folder of somebody else, who could replace what is in it."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        owner = folder.stat()
    except OSError as error:
        raise HapticError("no_folder", f"{folder}: cannot be made ({error})", "choose another --socket") from error
    shared_by_others = owner.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not owner.st_mode & stat.S_ISVTX
    if owner.st_uid not in (os.getuid(), 0) or shared_by_others:
        raise HapticError(
            "folder_not_private", f"{folder}: others may write there", f"chmod 700 {folder}, or choose another --socket"
        )
