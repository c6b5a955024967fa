"""A daemon with its API on a socket from which a signal takes what a machine may refuse; not a
test.

    python denied_daemon.py SOCKET AMPLIFIER_RECORD WHAT DESCRIPTOR

says on DESCRIPTOR when it serves, and when SIGUSR1 has taken WHAT ("threads+memory"). It ends with
SIGTERM, as the command does.
"""

from __future__ import annotations

import _thread
import ctypes
import gc
import os
import resource
import signal
import socket
import sys
import threading
from pathlib import Path
from typing import Any, NoReturn

from haptic_driver.cli import daemon as command
from haptic_driver.daemon import run
from haptic_driver.daemon.set_up import daemon_settings
from hw.transport import resource as transports
from hw.transport import tcp
from hw.transport.tcp import TcpTransport

PR_SET_PDEATHSIG = 1  # linux/prctl.h
A_SEARCH = 50_000  # objects: it takes about 0.03 s, and every thread waits
NAMED: list[TcpTransport] = []


class Named(TcpTransport):
    """Reaches an instrument of this machine by a host's name."""

    def __init__(self, host: str, port: int, **bounds: Any) -> None:
        super().__init__("localhost", port, **bounds)
        NAMED.append(self)


def refuse(*_: object, **__: object) -> NoReturn:
    raise RuntimeError("can't start new thread")


def deny(what: list[str]) -> None:
    if "garbage" in what:
        assert len(gc.get_objects()) < A_SEARCH
    reached = [one._socket for one in NAMED if one._socket is not None]
    assert reached or "names" not in what, "nothing is reached by a name"
    if "threads" in what:
        _thread.start_new_thread = threading._start_new_thread = refuse
        resource.setrlimit(resource.RLIMIT_NPROC, (0, 0))
    if "fork" in what:
        os.fork = os.posix_spawn = refuse
    if "memory" in what:
        resource.setrlimit(resource.RLIMIT_AS, (1 << 20, 1 << 20))
    if "disk" in what:
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    if "names" in what:
        socket.getaddrinfo = lambda *_, **__: threading.Event().wait()
        # and every connection is lost; without memory none could be made anew, by any address
        for connection in () if "memory" in what else reached:
            connection.shutdown(socket.SHUT_RDWR)


def main() -> None:
    path, record, what, descriptor = (
        sys.argv[1],
        Path(sys.argv[2]),
        sys.argv[3].split("+"),
        int(sys.argv[4]),
    )

    def denying(number: int, frame: object) -> None:
        deny(what)
        os.write(descriptor, b"d")

    def settings(rig: str, model: str, **kept: object) -> object:
        return daemon_settings(rig, model, amplifier_record=record)

    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)  # a test that was killed leaves none
    if "names" in what:
        tcp.TcpTransport = transports.TcpTransport = Named
    signal.signal(signal.SIGUSR1, denying)
    run.daemon_settings = settings
    command.report = lambda *_: os.write(descriptor, b"r")
    sys.exit(command.run("simulated", path))


if __name__ == "__main__":
    main()
