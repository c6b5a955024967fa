"""What a machine may refuse after arming: threads, processes, memory, disk, and anybody who reads
what is logged.
"""

import os
import pty
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from haptic_driver.client import HapticClient, NoDaemonError
from haptic_driver.daemon.messages import DaemonState
from tests.haptic_driver.daemon import denying
from tests.haptic_driver.daemon.denying import DENIALS, EVERYTHING
from tests.haptic_driver.daemon.electrode import history
from tests.traps import sprung
from tests.waiting import HANG_S, until

denied_daemon = denying.denied_daemon


@pytest.mark.process
@pytest.mark.parametrize(
    "what", [*(pytest.param(one, marks=pytest.mark.soak) for one in DENIALS), EVERYTHING]
)
def test_whatever_is_denied_after_arming_off_is_off(denied_daemon, what):
    """The first OFF of a daemon once started a thread for it, and was dropped without one."""
    daemon = denied_daemon(what)
    daemon.deny()
    answer = daemon.off()
    assert "memory" in what or answer.startswith(b"HTTP/1.1 200 OK"), answer
    until(lambda: history(daemon.record)[-1][1] == 0.0)
    assert sprung(daemon.foreign) == []


@pytest.mark.process
def test_a_log_that_nobody_reads_stops_nothing(denied_daemon):
    """With a terminal stopped by Ctrl-S control once hung in its first log line: no answer to OFF,
    none to SIGTERM. A search for garbage of all that a daemon imports took 0.2 to 0.5 s, at any
    moment.
    """
    daemon = denied_daemon("garbage+stderr+stdout")
    daemon.deny()
    client = HapticClient(daemon.path)
    for _ in range(2):  # each tells an event
        assert b"200 OK" in daemon.off()
        client.disarm()
        assert client.status().state is DaemonState.IDLE
        client.set(client.arm(60.0).token, 0.65)
        assert client.status().state is DaemonState.RENDERING
    daemon.process.send_signal(signal.SIGTERM)
    assert daemon.process.wait(HANG_S) == 0
    assert history(daemon.record)[-1][1] == 0.0


STOP = b"\x13"  # Ctrl-S


def answers(path):
    """Whether the daemon there has started: it listens before that."""
    with suppress(NoDaemonError), HapticClient(path) as client:
        return client.status()


@pytest.mark.process
def test_a_stopped_terminal_keeps_nobody_from_the_end(tmp_path):
    """It was stopped before the daemon said that it was ready: SIGTERM once left the output on."""
    path = tmp_path / "d.sock"
    person, terminal = pty.openpty()
    os.write(person, STOP)
    command = [Path(sys.executable).with_name("haptic"), "daemon", "run", "--socket", path]
    with subprocess.Popen(
        command, stdin=terminal, stdout=terminal, stderr=terminal, start_new_session=True
    ) as process:
        try:
            until(lambda: answers(path))
            with HapticClient(path) as client:
                client.set(client.arm(60.0).token, 0.65)
                until(lambda: client.status().output_on)
            process.send_signal(signal.SIGTERM)
            assert process.wait(HANG_S) == 0  # the output is known to be off
        finally:
            process.kill()
            for descriptor in (person, terminal):
                with suppress(OSError):
                    os.close(descriptor)
