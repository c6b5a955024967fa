"""`haptic simulate` in a process of its own, talked to by software that is not ours."""

import datetime
import json
import re
import signal
import socket
import subprocess
import sys

import pytest
import serial

from haptic_driver.rig.config import load_rig
from haptic_driver.rig.devices import connect_devices
from haptic_driver.rig.doctor import examine
from tests.haptic_driver.config_texts import CONFIGS
from tests.waiting import until

pytestmark = pytest.mark.process

TODAY = datetime.date(2026, 6, 1)
TIMEOUT_S = 120.0  # of a busy machine


def begun(*words):
    """`haptic simulate` in a process of its own."""
    command = [sys.executable, "-c", "from haptic_driver.cli.main import run; run()", "simulate"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen([*command, *map(str, words)], text=True, **pipes)


@pytest.fixture(scope="module")
def process():
    with begun("--json") as running:
        yield running
        running.kill()


@pytest.fixture(scope="module")
def endpoints(process):
    return json.loads(process.stdout.readline())["endpoints"]


def tcp(resource):
    _, host, port, kind = resource.split("::")
    assert kind == "SOCKET"
    connection = socket.create_connection((host, int(port)), timeout=TIMEOUT_S)
    return connection, connection.makefile("rwb", buffering=0)


def asked(stream, line):
    stream.write(line + b"\n")
    return stream.readline().strip()


def test_a_bare_socket_talks_to_the_generator(endpoints):
    connection, stream = tcp(endpoints["waveform_generator"])
    with connection, stream:
        assert asked(stream, b"*IDN?").split(b",")[1] == b"33220A"
        assert asked(stream, b"FREQ 1234;:FREQ?") == b"+1.2340000000000E+03"
        assert asked(stream, b"OUTP?") == b"0"


def test_the_same_instrument_is_on_the_pseudo_terminal(endpoints):
    connection, stream = tcp(endpoints["waveform_generator"])
    port = endpoints["waveform_generator_serial"].removeprefix("ASRL").removesuffix("::INSTR")
    with connection, stream, serial.Serial(port, 115200, timeout=TIMEOUT_S) as line:
        assert asked(stream, b"FREQ 321;:FREQ?") == b"+3.2100000000000E+02"
        line.write(b"FREQ?\n")
        assert line.readline().strip() == b"+3.2100000000000E+02"


def test_it_ends_cleanly_when_told(process, endpoints):
    """Last of all, as the others use the same process."""
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=TIMEOUT_S)
    assert (process.returncode, out, err) == (0, "", "")
    _, host, port, _ = endpoints["waveform_generator"].split("::")
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((host, int(port)), timeout=TIMEOUT_S)


def test_sigterm_ends_it_too_and_a_port_can_be_chosen():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with begun("--port", port) as running:
        assert running.stdout.readline().split() == [
            "waveform_generator",
            f"TCPIP::127.0.0.1::{port}::SOCKET",
        ]
        running.terminate()
        _, err = running.communicate(timeout=TIMEOUT_S)
    assert (running.returncode, err) == (0, "")


def test_ones_own_rig_has_twins_on_which_its_drivers_run(tmp_path):
    mine, copy = tmp_path / "mine.toml", tmp_path / "twin.toml"
    text = (CONFIGS / "rigs" / "template.toml").read_text(encoding="utf-8")
    signed = 'measured_by = "A. Smith"\nmeasured_at = 2026-01-31'
    mine.write_text(re.sub('measured_by = ""', signed, text), encoding="utf-8")
    with begun("--like", mine, "--out", copy, "--json") as running:
        try:
            said = json.loads(running.stdout.readline())
            rig = load_rig(said["rig"])
            checks = {check.name: check.status.value for check in examine(rig, TODAY)}
            with connect_devices(rig) as devices:
                assert devices.rig.state.value == "off"
                until(lambda: devices.force_sensor.read().normal_force_n > 0.4)  # it slides
                until(lambda: devices.tracker.read().touching)
        finally:
            running.terminate()
    assert said["rig"] == str(copy)
    assert "event_line: no simulator of kind trigger_box" in said["left_out"]
    assert "failed" not in checks.values()
    asked = ("waveform generator", "interlock", "stage", "force sensor", "touch screen")
    assert {checks[name] for name in asked} == {"ok"}


def test_a_copy_goes_over_no_file_of_a_person(refuses, tmp_path):
    mine, twin = tmp_path / "mine.toml", tmp_path / "twin.toml"
    mine.write_text((CONFIGS / "rigs" / "template.toml").read_text(encoding="utf-8"))
    refuses("file_exists", "simulate", "--like", mine, "--out", mine)
    refuses("simulated", "simulate", "--like", "simulated", "--out", twin)
    refuses("usage", "simulate", "--out", twin)


def test_what_cannot_be_served_is_said(refuses):
    refuses("not_simulated", "simulate", "--rig", "paper")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        refuses("port_taken", "simulate", "--port", port, status=1)
