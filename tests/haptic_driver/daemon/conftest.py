"""One daemon for the tests of a module, on the simulated rig that it names as `RIG`."""

import json
import subprocess
import sys
from functools import partial

import pytest

from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.messages import DaemonState
from haptic_driver.daemon.set_up import DaemonSettings, render_settings
from haptic_driver.rig.config import load_rig
from tests.haptic_driver.daemon import electrode, killing
from tests.haptic_driver.daemon.waiting import reset
from tests.waiting import until

killable_daemon = killing.killable_daemon


@pytest.fixture(scope="module")
def settings(request, surface_file, tmp_path_factory):
    name = request.module.RIG
    config = load_rig(name)
    record = tmp_path_factory.mktemp("amplifier") / "record.txt"
    render = render_settings(config, surface_file)
    return DaemonSettings(name, "reference", config, surface_file, render, amplifier_record=record)


@pytest.fixture(scope="module")
def running(settings):
    with Daemon(settings) as daemon:
        yield daemon


@pytest.fixture
def daemon(running):
    """It, once all of it is there: a busy machine may keep it waiting; and without what another
    test has left.
    """
    until(lambda: not running.supervisor.missing and not running.supervisor.silent())
    if running.status().state is DaemonState.FAULT:
        reset(running)
    yield running
    running.disarm()


@pytest.fixture
def history(settings):
    """(time_s, voltage_v) of every change at the electrode after a time."""
    return partial(electrode.history, settings.amplifier_record)


@pytest.fixture
def simulated():
    """`haptic simulate`, and where its instruments are."""
    command = [
        sys.executable,
        "-c",
        "from haptic_driver.cli.main import run; run()",
        "simulate",
        "--json",
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        yield process, json.loads(process.stdout.readline())["endpoints"]
        process.kill()
