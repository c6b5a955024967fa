"""The Python client: a lease that is kept, and an output that is off whatever ends the block."""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from haptic_driver.client import HapticClient, LeaseLostError, NoDaemonError
from haptic_driver.daemon.processes import Place
from haptic_driver.daemon.records import DaemonState, RefusedError
from haptic_driver.daemon.server import serve
from haptic_driver.errors import BadInputError, HapticError
from tests.haptic_driver.daemon.waiting import HANG_S, until

LONG_S = 5.0  # a lease that a busy machine does not lose


@pytest.fixture
def control():
    path = Path(__file__).with_name("bench_control.py")
    spec = importlib.util.spec_from_file_location("bench_control", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.BenchControl()


@pytest.fixture
def socket(control, tmp_path):
    place = Place(tmp_path / "d.sock")
    with serve(control, place):
        yield place.path
    place.close()


@pytest.fixture
def client(socket):
    with HapticClient(socket) as client:
        yield client


def test_a_session_asks_and_leaves_the_output_off(client, control):
    with client.armed(LONG_S) as session:
        assert session.set(0.6).target_cof == 0.6
        assert session.play("linen").texture == "linen"
        assert client.status().output_on is True
        assert session.off().output_on is False
        session.set(0.7)
    assert control.machine.state is DaemonState.IDLE
    assert ("disarm",) in control.calls
    assert not [thread for thread in threading.enumerate() if thread.name == "lease"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_whatever_ends_the_block_switches_off_and_is_not_hidden(client, control, error):
    def work():
        with client.armed(LONG_S) as session:
            session.set(0.6)
            raise error

    with pytest.raises(error):
        work()
    assert control.machine.state is DaemonState.IDLE


def test_the_lease_is_renewed_for_longer_than_it_lasts(client, control):
    with client.armed(2.0):
        began_s = time.monotonic()
        until(lambda: control.calls.count(("renew",)) >= 3 and time.monotonic() - began_s > 2.5)
        assert client.status().state is DaemonState.ARMED


def test_a_client_that_dies_loses_its_lease(socket, control):
    program = (
        "import sys, time; from pathlib import Path; from haptic_driver.client import HapticClient\n"
        "with HapticClient(Path(sys.argv[1])) as client, client.armed(2.0) as session:\n"
        "    session.set(0.6); print('set', flush=True); time.sleep(600)\n"
    )
    with subprocess.Popen([sys.executable, "-c", program, str(socket)], stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"set\n"
        assert control.status().output_on is True
        os.kill(process.pid, signal.SIGKILL)
    until(lambda: control.status().output_on is False)
    assert ("disarm",) not in control.calls


def test_a_lost_lease_is_told_and_a_new_owner_left_alone(client, control):
    with pytest.raises(LeaseLostError) as lost, client.armed(2.0) as session:  # noqa: PT012
        control.disarm()
        other = control.arm(LONG_S)
        assert session.wait_lost(HANG_S)
    assert lost.value.code == "not_yours"
    assert control.machine.state is DaemonState.ARMED
    assert control.renew(other.token) == other


def test_off_without_evidence_is_an_error(client, control):
    control.shown_off = False
    with pytest.raises(HapticError, match="cannot be shown to be off"):
        client.off()
    with pytest.raises(HapticError, match="cannot be shown to be off"), client.armed(LONG_S):
        pass


@pytest.mark.parametrize(
    ("ask", "kind", "code"),
    [
        (lambda c: c.set("token", 0.6), RefusedError, "not_armed"),
        (lambda c: c.reset(), RefusedError, "no_fault"),
        (lambda c: c.set("token", -1.0), BadInputError, "out_of_range"),
        (lambda c: c.set("token", float("nan")), BadInputError, "out_of_range"),
        (lambda c: c.arm(1e-3), BadInputError, "out_of_range"),
        (lambda c: c.play("token", "linnen"), BadInputError, "unknown_texture"),
        (lambda c: c.samples(most=0), BadInputError, "bad_request"),
    ],
)
def test_refusals_are_typed(client, ask, kind, code):
    with pytest.raises(kind) as refused:
        ask(client)
    assert refused.value.code == code
    assert refused.value.hint


def test_no_daemon(tmp_path):
    with pytest.raises(NoDaemonError, match=r"none\.sock") as refused:
        HapticClient(tmp_path / "none.sock")
    assert "haptic daemon run" in refused.value.hint


def test_a_file_of_ones_own_is_sent_by_its_whole_path(client, control, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text("")
    with pytest.raises(BadInputError):
        client.play("token", "mine.toml")
    assert control.calls == [("play", str(tmp_path / "mine.toml"))]
    client.record(Path("run.h5"))
    assert client.status().recording == str(tmp_path / "run.h5")
    assert client.record(None).recording is None


def test_another_model_is_used_by_its_name_or_whole_path(client, control, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "finger.toml").write_text("")
    assert client.use_model("other").model == "other"
    with pytest.raises(BadInputError, match=r"there is no model .*finger\.toml"):
        client.use_model("finger.toml")
    assert control.calls == [("use_model", "other"), ("use_model", str(tmp_path / "finger.toml"))]


def test_views(client, control):
    assert client.textures() == ["grating", "linen"]
    assert [event.message for event in client.events()] == ["idle"]
    samples = client.samples(most=3)
    assert samples["lateness_s"].tolist() == [15e-6, 3e-3, 1.0]
    assert np.isnan(samples["measured_cof"][-1])
    assert next(client.watch()).status.rig == "bench"
    assert next(client.watch_events()).message == "idle"
