"""Where a daemon is found: at its socket, or, from another system or machine, at the address of its
page.
"""

from __future__ import annotations

import getpass
import os
import socket
import stat
import struct
import tempfile
from pathlib import Path
from typing import NamedTuple, Self
from urllib.parse import parse_qs, urlsplit

from haptic_driver.errors import BadInputError, HapticError

SOCKET_NAME = "daemon.sock"
LOOPBACK = "127.0.0.1"
_PEER = struct.Struct("3i")  # process, user and group of whoever listens


def default_folder() -> Path:
    """A folder that this user alone needs."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    user = os.getuid() if hasattr(os, "getuid") else getpass.getuser()
    return Path(runtime) / "haptic" if runtime else Path(tempfile.gettempdir()) / f"haptic-{user}"


class Address(NamedTuple):
    """One daemon: `path` is that of its socket, None where it is reached over TCP, with its page's
    token.
    """

    path: Path | None
    host: str = "haptic"  # HTTP wants a name also where the socket says where
    port: int = 0
    token: str = ""

    @classmethod
    def of(cls, said: Path | str | None) -> Self:
        """A socket's path, or the page's address as the daemon printed it; None: as `HAPTIC_SOCKET`
        says, or as usual.

        BadInputError for an address without port or token.
        """
        text = str(said or os.environ.get("HAPTIC_SOCKET") or default_folder() / SOCKET_NAME)
        if not text.startswith("http:"):
            return cls(Path(text))
        try:
            parts = urlsplit(text)
            (token,) = parse_qs(parts.query)["token"]
            return cls(None, parts.hostname or "", int(parts.port or 0), token)
        except (ValueError, KeyError) as error:
            hint = (
                "Give it as haptic daemon run --port printed it:"
                " http://127.0.0.1:8470/page/?token=..."
            )
            raise BadInputError(
                "bad_address", f"{text}: no address of a daemon's page", hint
            ) from error

    def __str__(self) -> str:
        return str(self.path) if self.path is not None else f"http://{self.authority}"

    @property
    def authority(self) -> str:
        """What HTTP calls host."""
        return f"{self.host}:{self.port}" if self.port else self.host

    @property
    def lease_file(self) -> Path:
        """Where `haptic arm` leaves its lease for other commands."""
        if self.path is not None:
            return self.path.with_name(self.path.name + ".lease")
        return default_folder() / f"{self.host}-{self.port}.lease"

    def connected(self, timeout_s: float) -> socket.socket:
        """A line to it. Raises OSError."""
        if self.path is None:
            return socket.create_connection((self.host, self.port), timeout_s)
        if not hasattr(socket, "AF_UNIX"):
            raise OSError("Python has no Unix sockets on this system")
        line = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        line.settimeout(timeout_s)
        try:
            line.connect(str(self.path))
            _require_own(line, self.path)
        except BaseException:
            line.close()
            raise
        return line


def _require_own(line: socket.socket, path: Path) -> None:
    """Refuse a program of another user at a socket: it could say "off" of an output that is on.

    Root's own programs are believed. Root also believes the user to whom a socket's folder was
    given, where nobody else can have made it. Elsewhere than on Linux the folder's rights have to
    do.
    """
    if not hasattr(socket, "SO_PEERCRED"):
        return
    _, user, _ = _PEER.unpack(line.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size))
    own = os.getuid()
    if user not in {0, own, _owner_alone(path.parent) if own == 0 else own}:
        said = f"{path}: a program of user {user} listens there, not one of yours"
        raise HapticError(
            "not_yours", said, "give the socket of your own daemon, or the address of its page"
        )


def _owner_alone(folder: Path) -> int:
    """The user of a folder that only root or this user can have put there; root where others
    could.
    """
    folders = [folder.resolve(), *folder.resolve().parents]
    user = folders[0].stat().st_uid
    others = stat.S_IWGRP | stat.S_IWOTH
    alone = all(
        found.st_uid in (0, user) and not found.st_mode & others
        for found in (one.stat() for one in folders)
    )
    return user if alone else 0


def listen(port: int) -> socket.socket:
    """A loopback socket at a port, 0: any that is free. Raises HapticError when it cannot be
    had.
    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((LOOPBACK, port))
    except OSError as error:
        listener.close()
        raise HapticError(
            "no_port", f"{LOOPBACK} port {port}: {error.strerror}", "choose another --port"
        ) from error
    return listener
