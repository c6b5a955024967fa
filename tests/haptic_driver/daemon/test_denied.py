"""What a machine may refuse after arming: threads, processes, memory, disk, and anybody who reads what is logged."""

import os
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from haptic_driver.client import HapticClient
from haptic_driver.daemon.messages import DaemonState
from tests.haptic_driver.daemon.electrode import history
from tests.waiting import HANG_S, until

DENIED = Path(__file__).with_name("denied_daemon.py")
DENIALS = ["threads", "fork", "memory", "disk", "stderr", "stdout"]


def fill(descriptor):
    """Leave no room in a pipe."""
    os.set_blocking(descriptor, False)
    with suppress(BlockingIOError):
        while True:
            os.write(descriptor, bytes(4096))
    os.set_blocking(descriptor, True)


def said_to_off(path):
    """What a daemon answers to OFF, from a connection that is made now."""
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(HANG_S)
        connection.connect(str(path))
        connection.sendall(b"POST /off HTTP/1.1\r\nhost: rig\r\ncontent-length: 0\r\n\r\n")
        answer = b""
        while received := connection.recv(4096):
            answer += received
    return answer


@pytest.fixture
def start(tmp_path):
    """A daemon that renders, from which so much is taken; its process and its socket."""
    running = []

    def begin(what):
        said, saying = os.pipe()
        unread, log = os.pipe()
        path, record = tmp_path / "d.sock", tmp_path / "amplifier.txt"
        process = subprocess.Popen(
            [sys.executable, str(DENIED), str(path), str(record), what, str(saying)],
            pass_fds=[saying],
            stdout=log if "stdout" in what else subprocess.DEVNULL,
            stderr=log if "stderr" in what else None,
        )
        running.append((process, said, saying, unread, log))
        assert os.read(said, 1) == b"r"
        client = HapticClient(path)
        client.set(client.arm(60.0).token, 0.65)
        until(lambda: record.exists() and history(record) and history(record)[-1][1] > 10.0)
        if "std" in what:
            fill(log)
        process.send_signal(signal.SIGUSR1)
        assert os.read(said, 1) == b"d"
        return process, path, record

    yield begin
    for process, *descriptors in running:
        process.kill()
        process.wait()
        for descriptor in descriptors:
            os.close(descriptor)


@pytest.mark.parametrize("what", [*DENIALS, "+".join(DENIALS)])
def test_whatever_is_denied_after_arming_off_is_off(start, what):
    """The first OFF of a daemon once started a thread for it, and was dropped without one."""
    _, path, record = start(what)
    with suppress(OSError):  # without memory it may have nothing to answer with
        answer = said_to_off(path)
        assert "memory" in what or answer.startswith(b"HTTP/1.1 200 OK"), answer
    until(lambda: history(record)[-1][1] == 0.0)


def test_a_log_that_nobody_reads_stops_nothing(start):
    """With a terminal stopped by Ctrl-S control once hung in its first log line: no answer to OFF, none to SIGTERM."""
    process, path, record = start("stderr+stdout")
    client = HapticClient(path)
    for _ in range(5):  # each tells an event
        assert b"200 OK" in said_to_off(path)
        client.disarm()
        assert client.status().state is DaemonState.IDLE
        client.set(client.arm(60.0).token, 0.65)
        assert client.status().state is DaemonState.RENDERING
    process.send_signal(signal.SIGTERM)
    assert process.wait(HANG_S) == 0
    assert history(record)[-1][1] == 0.0
