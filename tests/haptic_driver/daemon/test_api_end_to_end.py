"""`haptic daemon run` on the simulated rig, used through its socket as a user would."""

import io
import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from haptic_driver.cli.main import main
from haptic_driver.client import HapticClient
from haptic_driver.daemon.messages import DaemonState
from haptic_driver.lab.psychophysics.data import sessions
from haptic_driver.recording.read import read_run
from tests.haptic_driver.commands import one_object
from tests.waiting import HANG_S, until

pytestmark = pytest.mark.process

SCRIPT = Path(sys.executable).with_name("haptic")
LONG_S = 60.0  # a lease that a busy machine does not lose


@pytest.fixture(scope="module")
def announced(tmp_path_factory):
    """What the daemon says when it is ready."""
    folder = tmp_path_factory.mktemp("daemon")
    command = [
        SCRIPT,
        "daemon",
        "run",
        "--rig",
        "simulated",
        "--port",
        "0",
        "--json",
        "--socket",
        folder / "d.sock",
    ]
    with (
        open(folder / "log.txt", "w+") as log,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True) as process,
    ):
        try:
            said = json.loads(process.stdout.readline())
            assert set(said) == {"socket", "page"}, said
            yield said
            process.send_signal(signal.SIGTERM)
            assert process.wait(HANG_S) == 0, (
                log.seek(0) or log.read()
            )  # the output is known to be off
        finally:
            process.kill()
    assert [path.name for path in folder.glob("d.sock*")] == ["d.sock.lock"]


@pytest.fixture
def client(announced):
    with HapticClient(Path(announced["socket"])) as client:
        if (
            client.status().state is DaemonState.FAULT
        ):  # what a busy machine did to one test is not the next one's
            client.reset()
        yield client
        client.disarm()


def test_a_touch_is_timed_to_the_edge_that_the_monitor_shows(client, announced, haptic):
    """The simulated generator takes 30 ms to set an amplitude; nothing is armed or asked for."""

    def timed(touches):
        said = ("--touches", touches, "--socket", announced["socket"], "--json")
        return haptic("doctor", "--latency", *said).said

    assert timed(1)["error"]["code"] == "not_rendering"
    with client.armed(LONG_S) as session:
        session.set(client.status().reachable_cof[0], nearest=True)
        refused = timed(1)["error"]
        assert refused["code"] == "no_touch_timed"
        session.set(0.8)
        until(lambda: client.status().output_on)
        found = timed(3)
    stages = {stage["name"]: stage for stage in found["stages"]}
    assert list(stages) == ["panel", "read", "tick", "wait", "output", "total", "lead"]
    parts = [stages[name]["median_s"] for name in ("output", "total", "lead")]
    assert 0.030 < parts[0] < parts[1]
    assert parts[2] == pytest.approx(0.035)
    assert found["touches"] + sum(found["left_out"].values()) >= 3
    assert found["dialogues_s"]["waveform_generator"] > 0.0
    assert [what.partition(":")[0] for what in found["unknown"]] == ["panel", "electrode"]


def test_a_friction_is_rendered_and_switched_off(client):
    before = max((event.number for event in client.events()), default=0)
    with client.armed(LONG_S) as session:
        assert client.status().output_on is False
        session.set(0.65)
        until(lambda: client.status().output_on)
        assert client.off().state is DaemonState.ARMED
    status = client.status()
    assert (status.state, status.output_on, status.simulated) == (DaemonState.IDLE, False, True)
    told = [event.kind for event in client.events(before)]
    assert told.count("target") == 1
    ticks = client.samples(most=500)
    assert ticks.size
    assert (ticks["tick"][1:] > ticks["tick"][:-1]).all()
    assert client.textures()
    assert next(client.watch()).ticks.count > 0


EXPERIMENT = """
name = "short"
[trial]
intervals = 1
duration_s = 0.5
[delivery]
settle_s = 0.15
least_sliding_s = 0.1
least_share = 0.5
retries = 100
[method]
kind = "constant"
levels = [0.1]
repeats = 3
[[condition]]
name = "a"
cof = 0.55
"""


def test_an_experiment_runs_stops_goes_on_and_says_what_was_felt(
    announced, client, tmp_path, monkeypatch, capsys
):
    """Once in a pipe that ends after an answer; then by the simulated participant, recorded."""
    monkeypatch.setenv("HAPTIC_SOCKET", announced["socket"])
    monkeypatch.setattr("haptic_driver.client.LEASE_S", LONG_S)
    (tmp_path / "short.toml").write_text(EXPERIMENT)
    run = [
        "experiment",
        "run",
        str(tmp_path / "short.toml"),
        "--participant",
        "P1",
        "--out",
        str(tmp_path / "out"),
    ]
    monkeypatch.setattr(sys, "stdin", io.StringIO("go\nx\n2\n"))
    assert main([*run, "--json"]) == 2
    assert one_object(capsys.readouterr().out)["error"]["code"] == "no_answers"
    assert client.status().output_on is False
    (files,) = sessions(tmp_path / "out")
    assert [row.response for row in files.rows()] == ["no"]

    assert main([*run, "--simulated", "--record", "--json"]) == 0
    assert one_object(capsys.readouterr().out)["done"] is True
    rows = files.rows()
    delivered = [row for row in rows if row.delivered]
    assert [row.level for row in delivered] == 3 * [0.1]
    for row in delivered:
        felt = row.comparison
        assert felt.asked_cof == pytest.approx(0.605)
        assert felt.felt_cof == pytest.approx(0.605, rel=0.1)
        assert felt.sliding_s >= 0.1
        assert 0.2 < felt.normal_force_n < 0.8
    (recording,) = files.beh.glob("*.h5")
    markers = [event for event in read_run(recording).events if event.kind == "marker"]
    begun = [
        (event.data["trial"], event.time_s) for event in markers if event.message == "trial begins"
    ]
    assert begun == [(row.trial, pytest.approx(row.time_s, abs=1e-5)) for row in rows[1:]]
    assert files.described()["Rig"]["simulated"] is True
