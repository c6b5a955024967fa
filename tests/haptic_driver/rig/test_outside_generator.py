"""A generator from a package outside the project: installed by pip, and everything follows from its
entry point.
"""

import json
import os
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from haptic_driver.client import HapticClient
from tests.haptic_driver.daemon.waiting import until_ready
from tests.waiting import HANG_S, until

ROOT = Path(__file__).resolve().parents[3]
PACKAGE = ROOT / "tests" / "outside_generator"
HAPTIC = Path(sys.executable).with_name("haptic")
pytestmark = pytest.mark.timeout(300)


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """The environment of a computer on which the package is installed."""
    folder = tmp_path_factory.mktemp("installed")
    source = tmp_path_factory.mktemp("source")  # building leaves files beside the source
    for name in ("pyproject.toml", "lab_generator.py"):
        (source / name).write_text((PACKAGE / name).read_text())
    pip = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "-q",
        "--no-index",
        "--no-deps",
        "--no-build-isolation",
    ]
    subprocess.run([*pip, "--target", str(folder), str(source)], check=True, timeout=HANG_S)
    return {**os.environ, "PYTHONPATH": str(folder)}


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    simulated = (ROOT / "configs" / "rigs" / "simulated.toml").read_text()
    path = tmp_path_factory.mktemp("rig") / "lab.toml"
    path.write_text(simulated.replace('model = "agilent_33220a"', 'model = "lab_generator"'))
    return path


@pytest.fixture
def haptic(environment):
    def run(*arguments, status=0):
        command = [str(HAPTIC), *map(str, arguments), "--json"]
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=HANG_S, check=False
        )
        assert done.returncode == status, done.stderr + done.stdout
        return json.loads(done.stdout)

    return run


@pytest.fixture
def served(environment, rig):
    """The resource at which the rig's simulated generator answers."""
    command = [str(HAPTIC), "simulate", "--rig", str(rig), "--json"]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield json.loads(process.stdout.readline())["endpoints"]["waveform_generator"]
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=HANG_S)


def asked(resource, question):
    host, port = resource.split("::")[1:3]
    with (
        socket.create_connection((host, int(port)), timeout=HANG_S) as connection,
        connection.makefile("rwb") as stream,
    ):
        stream.write(question)
        stream.flush()
        return stream.readline()


def test_the_page_about_hardware_shows_the_package_word_for_word():
    page = (
        (ROOT / "docs" / "hardware.md")
        .read_text(encoding="utf-8")
        .partition("\n## A driver of your own\n")[2]
    )
    shown = re.findall(r"^```(python|toml)\n(.*?)^```", page, flags=re.DOTALL | re.MULTILINE)
    files = {"toml": "pyproject.toml"}
    shown = [(mark, code) for mark, code in shown if "SdkOutput" not in code]
    assert [mark for mark, _ in shown] == ["toml"]
    for mark, code in shown:
        assert code in (PACKAGE / files[mark]).read_text(encoding="utf-8")


@pytest.mark.process
def test_without_the_package_its_name_is_refused_with_what_is_installed(rig):
    done = subprocess.run(
        [str(HAPTIC), "doctor", "--rig", str(rig), "--json"],
        capture_output=True,
        text=True,
        timeout=HANG_S,
        check=False,
    )
    assert done.returncode == 2
    assert "'lab_generator' is no waveform generator that is installed" in done.stderr
    assert "agilent_33220a, analog_carrier, keysight_33500, siglent_sdg" in done.stderr


@pytest.mark.soak
def test_a_surface_a_point_and_a_demo(haptic, rig, tmp_path):
    surface = tmp_path / "surface.h5"
    haptic("surface", "build", "--rig", rig, "--out", surface)
    assert haptic("solve", "--friction", 0.6, "--rig", rig, "--surface", surface)[
        "cof"
    ] == pytest.approx(0.6, rel=0.02)
    trace = tmp_path / "stroke.csv"
    rows = "".join(
        f"{t:.2f},{0.02 + 0.03 * t:.5f},{0.5 * (0.2 < t < 1.8)}\n"
        for t in np.arange(0.0, 2.0, 0.01)
    )
    trace.write_text("time_s,position_m,normal_force_n\n" + rows)
    said = haptic(
        "demo", "--rig", rig, "--surface", surface, "--trace", trace, "--out", tmp_path / "demo"
    )
    assert said["contact_time_s"] > 1.0
    assert said["share_within_5_percent"] > 0.5
    assert 0.0 < said["max_voltage_v"] <= 150.0
    assert said["output_on_without_contact_s"] < 0.1


@pytest.mark.process
def test_the_doctor_asks_the_packages_driver(haptic, rig):
    checks = {check["name"]: check for check in haptic("doctor", "--rig", rig)["checks"]}
    assert checks["waveform generator"]["status"] == "ok"
    said = checks["waveform generator"]["message"]
    assert said.startswith("Our lab LAB1, serial number ")
    assert checks["output"]["message"].startswith("off; programmed: ")


@pytest.mark.process
def test_the_watchdog_switches_it_off_when_its_driver_dies(served, environment):
    command = [
        sys.executable,
        "-m",
        "hw.safety.watchdog",
        "--generator",
        served,
        "--model",
        "lab_generator",
    ]
    with subprocess.Popen(
        command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as watchdog:
        assert watchdog.stdin is not None
        assert watchdog.stdout is not None
        assert watchdog.stdout.readline() == b"ready\n"
        assert asked(served, b"A2.4\nG1\n?\n").endswith(b"A2.4 O0.0 G1\n")
        watchdog.stdin.write(b"b")
        watchdog.stdin.close()  # as when whoever beats is killed
        assert watchdog.wait(HANG_S) == 0  # off, with evidence
    assert asked(served, b"?\n").endswith(b"G0\n")


@pytest.mark.process
def test_the_daemon_drives_it(haptic, environment, rig, tmp_path):
    address = tmp_path / "d.sock"
    command = [str(HAPTIC), "daemon", "run", "--rig", str(rig), "--socket", str(address)]
    arm = [str(HAPTIC), "arm", "--lease", "30", "--socket", str(address)]
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) as daemon:
        try:
            until_ready(daemon)
            with subprocess.Popen(arm, env=environment, stdout=subprocess.DEVNULL) as armed:
                client = HapticClient(str(address))
                until(lambda: client.status().state == "armed", lambda: client.status().fault)
                haptic("set", 0.6, "--socket", address)
                until(lambda: client.status().output_on and client.status().voltage_v > 1.0)
                assert haptic("off", "--socket", address)["output_on"] is False
                armed.send_signal(signal.SIGINT)
                armed.wait(HANG_S)
            said = haptic("disarm", "--socket", address)
            assert said["state"] == "idle", said["fault"]
        finally:
            daemon.send_signal(signal.SIGINT)
            daemon.wait(HANG_S)
