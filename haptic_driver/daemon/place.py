"""The place where a daemon lives: a socket that its user alone can reach, and one daemon at each."""

from __future__ import annotations

import fcntl
import os
import socket
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

from haptic_driver.errors import HapticError

SOCKET_NAME = "daemon.sock"


def default_socket() -> Path:
    """Where the daemon listens: as `HAPTIC_SOCKET` says, else in a private folder of this user."""
    if named := os.environ.get("HAPTIC_SOCKET"):
        return Path(named)
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
        self._bound = path.with_name(f".{path.name}")  # a second name: the first may be deleted
        _private_folder(path.parent)
        try:
            flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW  # no link of somebody else's
            self._lock = os.open(path.with_name(path.name + ".lock"), flags, 0o600)
        except OSError as error:
            raise _no_socket(path, error) from error
        if os.fstat(self._lock).st_uid != os.getuid():
            os.close(self._lock)
            raise HapticError("not_yours", f"{path}.lock belongs to another user", "choose another --socket")
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._lock)
            said = f"a daemon is running at {path}"
            raise HapticError("already_running", said, "use it, end it, or choose another --socket") from None
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
        """Free the place."""
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
                raise HapticError("not_a_socket", f"{self.path} exists and is no socket", "choose another --socket")
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
        said = f"{folder}: others may write there"
        raise HapticError("folder_not_private", said, f"chmod 700 {folder}, or choose another --socket")
