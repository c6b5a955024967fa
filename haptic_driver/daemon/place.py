"""The place where a daemon lives: a socket that its user alone can reach, and one daemon at
each.
"""

from __future__ import annotations

import fcntl
import os
import socket
import stat
from contextlib import suppress
from pathlib import Path

from haptic_driver.daemon.private_file import private_folder
from haptic_driver.errors import HapticError


class Place:
    """A socket that only this user can reach, and the right to be the only daemon there.

    The right is a file lock, which ends with its process however that ended. So a socket that a
    killed daemon left behind is known to be nobody's and is replaced.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._bound = path.with_name(f".{path.name}")  # a second name: the first may be deleted
        private_folder(path.parent)
        try:
            # no link of somebody else's
            flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
            self._lock = os.open(path.with_name(path.name + ".lock"), flags, 0o600)
        except OSError as error:
            raise _no_socket(path, error) from error
        if os.fstat(self._lock).st_uid != os.getuid():
            os.close(self._lock)
            raise HapticError(
                "not_yours", f"{path}.lock belongs to another user", "choose another --socket"
            )
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._lock)
            said = f"a daemon is running at {path}"
            raise HapticError(
                "already_running", said, "use it, end it, or choose another --socket"
            ) from None
        self.listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._listen()
        except BaseException:
            self._release()
            raise

    def keep(self) -> None:
        """Make the socket's name again where somebody has deleted it. Raises OSError."""
        with suppress(FileExistsError):
            os.link(self._bound, self.path)

    def close(self) -> None:
        for name in (self.path, self._bound):
            with suppress(OSError):
                name.unlink()
        self._release()

    def _release(self) -> None:
        self.listener.close()
        os.close(self._lock)

    def _listen(self) -> None:
        try:
            if self.path.exists() and not stat.S_ISSOCK(self.path.lstat().st_mode):
                raise HapticError(
                    "not_a_socket",
                    f"{self.path} exists and is no socket",
                    "choose another --socket",
                )
            for left in (self.path, self._bound):
                left.unlink(missing_ok=True)
            before = os.umask(0o177)
            try:
                self.listener.bind(str(self._bound))
            finally:
                os.umask(before)
            self.listener.listen(128)
            self.keep()
        except OSError as error:
            raise _no_socket(self.path, error) from error


def _no_socket(path: Path, error: OSError) -> HapticError:
    return HapticError(
        "no_socket",
        f"{path}: cannot listen there ({error})",
        "choose another --socket, a short path",
    )
