"""What all tests share: how long something takes says what the machine had to do meanwhile, not
whether it is right.

Tests of the daemon and of rigs in real time have its precedence, where that is allowed: whatever
else runs on the machine, simulated instruments must answer within the time-outs of real ones.
"""

from __future__ import annotations

import os
import signal
import tomllib
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from haptic_driver.processes.real_time import take_precedence
from hw import plugins
from tests import kinds

pytest_runtest_setup = kinds.pytest_runtest_setup
pytest_runtest_call = kinds.pytest_runtest_call
pytest_collection_modifyitems = kinds.pytest_collection_modifyitems

settings.register_profile(
    "project",
    settings.default,  # with what hypothesis itself changes in continuous integration
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("project")


# Linux shares a busy processor among sessions before it looks at niceness.
AUTOGROUP = Path("/proc/self/autogroup")


def pytest_configure(config: pytest.Config) -> None:
    _kinds_are_installed()
    config.pluginmanager.register(kinds.Beside())
    # A shell without job control starts background jobs with SIGINT ignored, and tests interrupt
    # what they start.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if hasattr(config, "workerinput"):
        # precedence is for the tests, not for what else the shell that called them has started
        os.setsid()


def pytest_collection_finish(session: pytest.Session) -> None:
    """Take precedence where daemons are to be started."""
    if not _has_workers(session.config) and not all(map(kinds.is_pure, session.items)):
        with suppress(OSError):
            AUTOGROUP.write_text("-10" if take_precedence() else "0")


def pytest_unconfigure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput") and not _has_workers(config):
        with suppress(OSError):
            AUTOGROUP.write_text("0")


def _kinds_are_installed() -> None:
    """Kinds of devices are found by what is installed, which a change of pyproject.toml leaves as
    it was.
    """
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text("utf-8"))
    for group, points in project["project"]["entry-points"].items():
        found = {name: point.value for name, point in plugins.installed(group).items()}
        if not points.items() <= found.items():
            again = "touch pyproject.toml; make .venv/.test"
            pytest.exit(f"{group} is not installed as in pyproject.toml: {again}", 4)


def _has_workers(config: pytest.Config) -> bool:
    return bool(getattr(config.option, "numprocesses", None))
