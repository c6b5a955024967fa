"""What systemd hears, and the unit that starts the daemon."""

import os
import shlex
import socket
from unittest.mock import MagicMock

import pytest

from haptic_driver.cli import daemon as daemon_command
from haptic_driver.daemon import run
from haptic_driver.daemon.service import as_service, notify, watchdog_period_s
from haptic_driver.errors import HapticError
from haptic_driver.processes.real_time import BEFORE_RENDER
from hw.safety.watchdog import STAGE_S, WatchdogSettings
from tests import systemd
from tests.waiting import HANG_S, until


@pytest.fixture
def heard(tmp_path, monkeypatch):
    """The next message to systemd."""
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(str(tmp_path / "notify"))
        receiver.settimeout(HANG_S)
        yield lambda: receiver.recv(100).decode()


def test_ready_and_stopping(heard):
    with as_service(lambda: 1):
        assert heard() == "READY=1"
    assert heard() == "STOPPING=1"


def test_pats_only_while_ticks_advance(heard, monkeypatch):
    monkeypatch.setenv("WATCHDOG_USEC", "20000")
    monkeypatch.setenv("WATCHDOG_PID", str(os.getpid()))
    calls, stalled_at = [], 5

    def ticks():
        calls.append(None)
        return min(len(calls), stalled_at)

    with as_service(ticks):
        said = [heard() for _ in range(stalled_at)]
        until(lambda: len(calls) >= stalled_at + 5)
    assert said == ["READY=1"] + ["WATCHDOG=1"] * (stalled_at - 1)
    assert heard() == "STOPPING=1"


@pytest.mark.parametrize(
    ("microseconds", "pid", "period_s"),
    [("30000000", None, 15.0), ("30000000", "1", None), ("soon", None, None)],
)
def test_the_watchdog_is_patted_twice_as_often_as_asked(monkeypatch, microseconds, pid, period_s):
    monkeypatch.setenv("WATCHDOG_USEC", microseconds)
    monkeypatch.delenv("WATCHDOG_PID", raising=False)
    if pid is not None:
        monkeypatch.setenv("WATCHDOG_PID", pid)
    assert watchdog_period_s() == period_s


@pytest.mark.parametrize("address", [None, "/none/notify"])
def test_without_systemd_nothing_happens(monkeypatch, address):
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    if address is not None:
        monkeypatch.setenv("NOTIFY_SOCKET", address)
    notify("READY=1")


def test_the_unit_asks_for_what_the_daemon_needs():
    service = {key: values[-1] for key, values in systemd.settings().items()}
    assert (service["Type"], service["UMask"], service["PrivateTmp"]) == ("notify", "0077", "yes")
    assert int(service["LimitRTPRIO"]) >= BEFORE_RENDER  # of an envelope, too
    assert service["LimitMEMLOCK"] == "infinity"
    assert int(service["WatchdogSec"]) > 0
    # systemd kills what is left after that: the watchdog has ended by then
    assert service["KillMode"] == "control-group"
    assert int(service["TimeoutStopSec"]) > WatchdogSettings.give_up_s + STAGE_S + 10.0
    assert "CPUSchedulingPolicy" not in service


def test_the_units_command_line_is_one_that_we_know(haptic):
    (line,) = systemd.settings()["ExecStart"]
    words = shlex.split(line)
    options = {word for word in words if word.startswith("--")}
    assert words[1:3] == ["daemon", "run"]
    shown = haptic("daemon", "run", "--help").out
    assert all(option in shown for option in options)


def test_a_port_that_is_taken_is_told_before_anything_is_started(tmp_path, monkeypatch):
    def started(*names, **options):
        pytest.fail("started first")

    monkeypatch.setattr(run, "daemon_settings", started)
    for name in ("signal", "take_precedence"):
        monkeypatch.setattr(run, name, MagicMock())
    with (
        socket.create_server(("127.0.0.1", 0)) as taken,
        pytest.raises(HapticError, match="port") as refused,
    ):
        daemon_command.run(port=taken.getsockname()[1], socket=str(tmp_path / "d.sock"))
    assert refused.value.code == "no_port"
    assert not (tmp_path / "d.sock").exists()
