"""From a file that names real resources: the daemon's command on what `haptic simulate` serves, in
processes apart.
"""

import os
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from haptic_driver.client import HapticClient
from haptic_driver.daemon.messages import DaemonState, RefusedError
from hw.stage.lts150 import Lts150, StageSettings
from hw.transport.resource import make_transport
from tests.haptic_driver.config_texts import changed, served_rig_text
from tests.haptic_driver.daemon.waiting import until_ready
from tests.waiting import HANG_S, until

pytestmark = pytest.mark.process

RESTING = 1.0  # well above what a finger that has not slid yet is trusted to feel
TRACKER = """
[finger_tracker]
kind = "recorded"
file = "slide.csv"
"""


@pytest.fixture
def rig_file(simulated, tmp_path):
    _, endpoints = simulated
    text = (
        changed(served_rig_text(endpoints), ("[watchdog]", "[watchdog]\ngive_up_s = 2.0")) + TRACKER
    )
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    rows = "".join(f"{0.1 * i:.1f},{1e-6 * i:.6f},0.5\n" for i in range(6000))
    (tmp_path / "slide.csv").write_text(
        "time_s,position_m,normal_force_n\n" + rows, encoding="utf-8"
    )
    return path


@pytest.fixture
def daemon(rig_file, tmp_path):
    place = tmp_path / "daemon.sock"
    command = [
        Path(sys.executable).with_name("haptic"),
        "daemon",
        "run",
        "--rig",
        rig_file,
        "--socket",
        place,
    ]
    with subprocess.Popen(
        [*command, "--allow-no-rt"], stderr=subprocess.PIPE, text=True
    ) as process:
        until_ready(process)
        yield process, place
        process.kill()


def asked(endpoint, *lines):
    """What the generator says to somebody else."""
    _, host, port, _ = endpoint.split("::")
    with (
        socket.create_connection((host, int(port)), HANG_S) as connection,
        connection.makefile("rwb") as stream,
    ):
        answers = []
        for line in lines:
            stream.write(line + b"\n")
            stream.flush()
            answers.append(float(stream.readline()))
        return answers


def comes_on(client):
    """Whether the output is on by now: a busy machine lets the interlock box open, or the watchdog
    bite.
    """
    with suppress(RefusedError):
        if client.status().state is DaemonState.FAULT:
            client.reset()
        if client.status().state is DaemonState.IDLE:
            client.set(client.arm(60.0).token, RESTING)
    return client.status().output_on


@pytest.mark.timeout(600)
def test_a_file_is_all_that_a_real_rig_needs(simulated, daemon):
    instruments, endpoints = simulated
    process, place = daemon
    settings = StageSettings(
        0.0, 0.15, 0.02, 0.02, 0.05, 0.05, reply_timeout_s=HANG_S
    )  # simulated beside a daemon
    stage = Lts150(make_transport(endpoints["stage"]), settings)
    stage.connect()
    # the finger presses once it moves; closing would stop it before anybody has seen that
    stage.home()
    stage.wait(HANG_S)
    stage.close()
    with HapticClient(place) as client:
        assert client.status().simulated is False
        until(
            lambda: (
                comes_on(client) and asked(endpoints["waveform_generator"], b"VOLT?")[0] > 0.4
            ),  # 20 V
            lambda: (client.status(), client.events()[-10:]),
        )
        assert asked(endpoints["waveform_generator"], b"OUTP?") == [1.0]
        client.disarm()
        assert client.status().output_on is False
        assert asked(endpoints["waveform_generator"], b"OUTP?") == [0.0]
        until(lambda: comes_on(client), client.status)
        os.kill(instruments.pid, signal.SIGKILL)
        until(lambda: client.status().state is DaemonState.FAULT)
        assert client.status().output_on is None
    process.send_signal(signal.SIGTERM)
    said = process.stderr.read()
    assert process.wait(HANG_S) == 1
    assert "the output was UNKNOWN" in said
