"""The right to an instrument: one program of this machine at a time, whoever runs it.

Two daemons on one rig would each know of its own commands alone, and one would call dead what the
other holds at 95 V. So who opens a rig claims the address of each of its instruments first.
"""

from __future__ import annotations

import hashlib
import os
import re
import socket
import struct
import sys
from collections.abc import Iterable
from pathlib import Path

from haptic_driver.errors import HapticError

_VISA_HOST = re.compile(r"TCPIP\d*::(?P<host>\[[^]]+\]|[^:]+)::(?P<rest>.*)", re.IGNORECASE)
_PLAIN_HOST = re.compile(r"(?P<host>\[[^]]+\]|[^:/\s]+):(?P<rest>\d+)")
_SERIAL = re.compile(r"(ASRL)?(?P<port>/[^:]+)(::INSTR)?", re.IGNORECASE)
_BOARD = re.compile(r"^(GPIB|USB|ASRL)::", re.IGNORECASE)
_HEX = re.compile(r"0x[0-9a-f]+", re.IGNORECASE)
_PEER = struct.Struct("3i")  # process, user and group of whoever listens
WAITING = 4096  # who asks for a holder is never let in, and must not be turned away


def same_place(address: str) -> str:
    """One spelling of an address.

    A host on the network is one instrument, by whatever port; on this machine each port is one.
    Names of hosts and links of devices lead to where they lead.
    """
    name = address.strip().removeprefix("visa:")
    if (serial := _SERIAL.fullmatch(name)) and os.path.exists(
        serial["port"]
    ):  # else a channel of a card
        return os.path.realpath(serial["port"])
    if found := _VISA_HOST.fullmatch(name) or _PLAIN_HOST.fullmatch(name):
        host = _resolved(found["host"].strip("[]"))
        is_here = host == "::1" or host.startswith("127.")
        port = "".join(re.findall(r"\d+", found["rest"])[:1])
        return f"{host}:{port}" if is_here else host
    name = _BOARD.sub(lambda board: f"{board[1]}0::", name)
    name = _HEX.sub(lambda number: str(int(number[0], 16)), name)
    return name.lstrip("/").lower()


def _resolved(host: str) -> str:
    try:
        return str(socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)[0][4][0])
    except OSError:
        return host.lower()


class Claims:
    """The right to some addresses, from `take` to `release` or the end of the process, however that
    comes.

    Each is a name of the machine's in Linux' abstract name space, where no file is left behind and
    none may be deleted. Elsewhere nothing is claimed.
    """

    def __init__(self, addresses: Iterable[str]) -> None:
        self._addresses = sorted(set(map(same_place, addresses)))
        self._held: list[socket.socket] = []

    def take(self) -> None:
        """All or none; HapticError says who has one."""
        if not sys.platform.startswith("linux"):
            return
        self.release()
        for address in self._addresses:
            claim = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            self._held.append(claim)
            try:
                claim.bind(_name(address))
                claim.listen(WAITING)
            except OSError as error:
                self.release()
                said = f"{address} is in use by {_holder(address)}"
                raise HapticError("in_use", said, "end that program, or use another rig") from error

    def release(self) -> None:
        """Let others have them."""
        while self._held:
            self._held.pop().close()


def _name(address: str) -> str:
    return f"\0haptic-driver/{hashlib.sha256(address.encode()).hexdigest()}"


def _holder(address: str) -> str:
    """Who holds an address, for a person."""
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asking:
            asking.settimeout(1.0)
            asking.connect(_name(address))
            pid, user, _ = _PEER.unpack(
                asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size)
            )
        command = (
            Path(f"/proc/{pid}/cmdline")
            .read_bytes()
            .replace(b"\0", b" ")
            .decode(errors="replace")
            .strip()
        )
    except OSError:
        return "another program"
    whose = "" if user == os.getuid() else f" of user {user}"
    return f"process {pid}{whose} ({command[:100]})"
