"""Whoever was started ends when the process that started it is killed."""

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.haptic_driver.daemon.waiting import until_ready
from tests.waiting import HANG_S, exists, until

HAPTIC = "from haptic_driver.cli.main import run; run()"
# Starts a command, says its process id and first line, and waits to be killed.
STARTER = """
import subprocess, sys, signal
signal.signal(signal.SIGHUP, signal.SIG_DFL)
if sys.argv[1] == "nohup":
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
child = subprocess.Popen([sys.executable, "-c", *sys.argv[2:]], stdout=subprocess.PIPE)
print(child.pid, child.stdout.readline(), flush=True)
child.wait()
"""


def started(*arguments):
    """The one that starts `haptic simulate`, and the process id of that."""
    command = [sys.executable, "-c", STARTER, *arguments, HAPTIC, "simulate", "--json"]
    starter = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    return starter, int(starter.stdout.readline().split()[0])


def killed(starter):
    starter.kill()
    starter.wait()
    starter.stdout.close()


@pytest.mark.process
def test_simulated_instruments_of_a_shell_that_is_killed_end():
    starter, pid = started("plain")
    killed(starter)
    until(lambda: not exists(pid))


@pytest.mark.process
def test_nohup_keeps_simulated_instruments():
    starter, pid = started("nohup")
    killed(starter)
    try:
        until(lambda: parent_of(pid) != starter.pid)
        assert exists(pid)
    finally:
        os.kill(pid, signal.SIGTERM)
    until(lambda: not exists(pid))


@pytest.mark.process
def test_the_command_ends_with_the_output_off_and_a_killed_one_is_replaced(tmp_path):
    path = tmp_path / "run" / "daemon.sock"
    command = [Path(sys.executable).with_name("haptic"), "daemon", "run", "--socket", str(path)]

    def start():
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        until_ready(process)
        return process

    killed = start()
    killed.kill()
    killed.wait()
    killed.stderr.close()
    assert path.exists()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(HANG_S)
        command += ["--osc", f"127.0.0.1:{receiver.getsockname()[1]}"]
        process = start()
        assert receiver.recv(2048).startswith(b"/haptic/sample\0")
    assert oct(path.stat().st_mode & 0o777) == "0o600"
    os.kill(process.pid, signal.SIGHUP)  # as a closed terminal does; SIGTERM and Ctrl-C do the same
    said = process.stderr.read()
    process.stderr.close()
    assert process.wait(HANG_S) == 0
    assert "the output was off" in said
    assert not path.exists()


@pytest.mark.process
def test_everything_that_a_daemon_started_ends_when_it_is_killed(killable_daemon):
    daemon = killable_daemon("simulated-envelope")
    control = daemon.await_output()["control"]
    family = descendants(control)
    names = " ".join(command_of(pid) for pid in family)
    for module in ("render_process", "envelope_process", "simulation.process", "observer"):
        assert module in names
    for module in ("loader", "watchdog"):
        assert module in names
    os.kill(control, signal.SIGKILL)
    until(lambda: not any(map(exists, family)), lambda: list(map(command_of, family)))


def parent_of(pid):
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


def command_of(pid):
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except OSError:
        return ""


def descendants(pid):
    parents = {int(p.name): parent_of(p.name) for p in Path("/proc").glob("[0-9]*") if p.exists()}
    found = [pid]
    for each in found:
        found += [child for child, parent in parents.items() if parent == each]
    return found[1:]
