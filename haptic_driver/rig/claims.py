"""The right to an instrument: one program of this machine at a time, whoever runs it.

Two daemons on one rig would each know of its own commands alone, and one would call dead what the
other holds at 95 V. So who opens a rig claims the address of each of its instruments first. Then
it claims the instrument as it names itself, since one may have several addresses.
"""

from __future__ import annotations

import hashlib
import os
import re
import socket
import struct
import sys
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from haptic_driver.errors import HapticError

_VISA_HOST = re.compile(r"TCPIP\d*::(?P<host>\[[^]]+\]|[^:]+)::(?P<rest>.*)", re.IGNORECASE)
_PLAIN_HOST = re.compile(r"(?P<host>\[[^]]+\]|[^:/\s]+):(?P<rest>\d+)")
_SERIAL = re.compile(r"(ASRL)?(?P<port>/[^:]+)(::INSTR)?", re.IGNORECASE)
_USB = re.compile(
    r"USB\d*::(?P<maker>\w+)::(?P<model>\w+)(::(?!INSTR)(?P<serial>[^:]+))?(::\d+)?(::INSTR)?",
    re.IGNORECASE,
)
_GPIB = re.compile(r"GPIB(?P<board>\d*)::(?P<place>\d+)(::\d+)?(::INSTR)?", re.IGNORECASE)
_SOUND = re.compile(r"(card:)?(?P<card>sound:.+?)(/\d+)?", re.IGNORECASE | re.DOTALL)
# A folder of this machine's memory that all users and network name spaces share.
_SHARED = Path("/dev/shm")
_PEER = struct.Struct("3i")  # process, user and group of whoever listens
WAITING = 4096  # who asks for a holder is never let in, and must not be turned away


def same_place(address: str) -> str:
    """One spelling of an address.

    A host on the network is one instrument, by whatever port; on this machine each port is one.
    Names of hosts and links of devices lead to where they lead. A sound card is opened with all of
    its channels.
    """
    if found := _SOUND.fullmatch(address.strip()):
        return found["card"].lower()
    name = address.strip().removeprefix("visa:").removeprefix("card:ni:")
    # else a channel of a card
    if (serial := _SERIAL.fullmatch(name)) and os.path.exists(serial["port"]):
        return os.path.realpath(serial["port"])
    if found := _VISA_HOST.fullmatch(name) or _PLAIN_HOST.fullmatch(name):
        host = _resolved(found["host"].strip("[]"))
        is_here = host == "::1" or host.startswith("127.")
        port = "".join(re.findall(r"\d+", found["rest"])[:1])
        return f"{host}:{port}" if is_here else host
    if found := _USB.fullmatch(name):
        ids = [str(_number(found[part])) for part in ("maker", "model")]
        return ":".join(["usb", *ids, (found["serial"] or "").lower()])
    if found := _GPIB.fullmatch(name):
        return f"gpib{found['board'] or 0}:{found['place']}"
    return name.lstrip("/").lower()


def _number(text: str) -> int:
    """As VISA writes them: 0x0957, or 2391."""
    return int(text, 16 if text.lower().startswith("0x") else 10)


def _resolved(host: str) -> str:
    try:
        return str(socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)[0][4][0])
    except OSError:
        return host.lower()


class Claims:
    """The right to some addresses, from `take` to `release` or the end of the process, however that
    comes.

    Each is a name of the machine's in Linux' abstract name space, which nobody can delete. It is
    also a locked file in shared memory, since a network name space has abstract names of its own.
    Elsewhere nothing is claimed.
    """

    def __init__(self, addresses: Iterable[str]) -> None:
        self._addresses = sorted(set(map(same_place, addresses)))
        self._held: list[socket.socket] = []
        self._locked: list[tuple[int, Path]] = []

    def take(self) -> None:
        """All or none; HapticError says who has one."""
        self.release()
        try:
            for address in self._addresses:
                self.add(address)
        except BaseException:
            self.release()
            raise

    def add(self, name: str) -> None:
        """One more, such as what an instrument calls itself. HapticError says who has it."""
        if not sys.platform.startswith("linux"):
            return
        claim = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._held.append(claim)
        try:
            self._lock(name)
            claim.bind(_socket_name(name))
            claim.listen(WAITING)
        except OSError as error:
            said = f"{name} is in use by {_holder(name)}"
            raise HapticError("in_use", said, "end that program, or use another rig") from error

    def release(self) -> None:
        """Let others have them."""
        while self._held:
            self._held.pop().close()
        while self._locked:
            descriptor, path = self._locked.pop()
            with suppress(OSError):  # another user's
                if path.stat().st_ino == os.fstat(descriptor).st_ino:
                    path.unlink()
            os.close(descriptor)

    def _lock(self, name: str) -> None:
        """BlockingIOError where another program has it; nothing is locked where there is no such
        memory.
        """
        import fcntl  # noqa: PLC0415 - Linux has it

        path = _SHARED / f"haptic-driver-{_hash(name)}"
        flags = os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW
        try:
            # not made anew where it is there: another user's file may be opened, but not created
            descriptor = os.open(path, flags | (0 if path.exists() else os.O_CREAT), 0o444)
        except OSError:
            return
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            raise
        self._locked.append((descriptor, path))
        if not path.exists() or path.stat().st_ino != os.fstat(descriptor).st_ino:
            self._lock(name)  # its last holder let go, and took the file away, in between


def _hash(name: str) -> str:
    return hashlib.sha256(name.encode()).hexdigest()


def _socket_name(name: str) -> bytes:
    return f"\0haptic-driver/{_hash(name)}".encode()


def _holder(address: str) -> str:
    """Who holds an address, for a person."""
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asking:
            asking.settimeout(1.0)
            asking.connect(_socket_name(address))
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
