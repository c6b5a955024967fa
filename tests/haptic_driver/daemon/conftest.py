"""One daemon for the tests of all modules that name the same simulated rig as `DAEMON_RIG`.

`tests/kinds.py` lets them run one after the other; a daemon ends when another is asked for.
"""

import json
import subprocess
import sys
from functools import cache, partial

import pytest

from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.messages import DaemonState
from haptic_driver.daemon.set_up import DaemonSettings, render_settings
from haptic_driver.rig.config import load_rig
from tests.haptic_driver.daemon import electrode, killing
from tests.haptic_driver.daemon.lines import with_lines
from tests.haptic_driver.daemon.waiting import reset
from tests.waiting import until

killable_daemon = killing.killable_daemon


class Kept:
    """The daemon that runs: that of the settings last asked for."""

    def __init__(self):
        self._settings = self._daemon = None

    def of(self, settings):
        if settings is not self._settings or self._daemon is None:
            self.close()
            self._settings = settings
            self._daemon = Daemon(settings)
            self._daemon.start()
        return self._daemon

    def close(self):
        ended, self._daemon = self._daemon, None
        if ended is not None:
            assert ended.close().on is False


@pytest.fixture(scope="session")
def kept():
    """Asked for a daemon by its settings; nobody else's runs beside it."""
    daemon = Kept()
    yield daemon
    daemon.close()


@pytest.fixture(scope="session")
def settings_of(surface_file, tmp_path_factory):
    """The settings of a rig, once for all; " with lines": with those of `lines.py`."""

    @cache
    def of(asked):
        name = asked.removesuffix(" with lines")
        config = load_rig(name)
        if name != asked:
            config = with_lines(config, tmp_path_factory.mktemp("recordings"))
        record = tmp_path_factory.mktemp("amplifier") / "record.txt"
        render = render_settings(config, surface_file)
        return DaemonSettings(
            name, "reference", config, surface_file, render, amplifier_record=record
        )

    return of


@pytest.fixture(scope="module")
def settings(request, settings_of):
    return settings_of(request.module.DAEMON_RIG)


@pytest.fixture(scope="module")
def running(settings, kept):
    return kept.of(settings)


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
