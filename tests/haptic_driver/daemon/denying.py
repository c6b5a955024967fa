"""A daemon from which a test takes what a machine may refuse, as seen from outside."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from haptic_driver.client import HapticClient
from tests.haptic_driver.daemon.electrode import history
from tests.traps import set_traps
from tests.waiting import HANG_S, until

DENIED = Path(__file__).with_name("denied_daemon.py")
DENIALS = ("threads", "fork", "memory", "disk", "stderr", "stdout", "names", "folder")
EVERYTHING = "+".join(DENIALS)


class DeniedDaemon:
    """`denied_daemon.py`, rendering; `deny` takes what it was started for."""

    def __init__(self, folder: Path, what: str) -> None:
        self.what = what
        self.path, self.record = folder / "d.sock", folder / "amplifier.txt"
        self.foreign = folder / "foreign"
        self.foreign.mkdir()
        set_traps(self.foreign)
        self._said, self._saying = os.pipe()
        self._unread, self._log = os.pipe()
        self.process = subprocess.Popen(
            [
                sys.executable,
                str(DENIED),
                str(self.path),
                str(self.record),
                what,
                str(self._saying),
            ],
            cwd=self.foreign if "folder" in what else None,
            pass_fds=[self._saying],
            stdout=self._log if "stdout" in what else subprocess.DEVNULL,
            stderr=self._log if "stderr" in what else None,
        )
        os.close(self._saying)  # what has ended says nothing more

    def render(self) -> None:
        """Wait until it is there, and until there is voltage."""
        assert os.read(self._said, 1) == b"r"
        with HapticClient(self.path) as client:
            client.set(client.arm(60.0).token, 0.65)
        until(lambda: (changes := history(self.record)) and changes[-1][1] > 10.0)

    def deny(self) -> None:
        if "std" in self.what:
            _fill(self._log)
        self.process.send_signal(signal.SIGUSR1)
        assert os.read(self._said, 1) == b"d"

    def off(self) -> bytes:
        """What it answers to OFF, from a connection that is made now; without memory that may be
        nothing.
        """
        answer = b""
        with socket.socket(socket.AF_UNIX) as connection, suppress(OSError):
            connection.settimeout(HANG_S)
            connection.connect(str(self.path))
            connection.sendall(b"POST /off HTTP/1.1\r\nhost: rig\r\ncontent-length: 0\r\n\r\n")
            while received := connection.recv(4096):
                answer += received
        return answer

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        for descriptor in (self._said, self._unread, self._log):
            os.close(descriptor)


@pytest.fixture
def denied_daemon(tmp_path_factory):
    """Starts one that renders; all end with the test."""
    daemons = []

    def start(what):
        daemons.append(DeniedDaemon(tmp_path_factory.mktemp("denied"), what))
        daemons[-1].render()
        return daemons[-1]

    yield start
    for daemon in daemons:
        daemon.close()


def _fill(descriptor: int) -> None:
    """Leave no room in a pipe."""
    os.set_blocking(descriptor, False)
    with suppress(BlockingIOError):
        while True:
            os.write(descriptor, bytes(4096))
    os.set_blocking(descriptor, True)
