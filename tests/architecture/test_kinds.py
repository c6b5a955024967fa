"""What each kind of test may do, and what becomes of one of real time on a late machine."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests import machine
from tests.waiting import until

pytestmark = pytest.mark.process
ROOT = Path(__file__).parents[2]
CONFTEST = """
from types import SimpleNamespace
from tests import kinds

pytest_runtest_setup = kinds.pytest_runtest_setup
pytest_runtest_call = kinds.pytest_runtest_call
pytest_collection_modifyitems = kinds.pytest_collection_modifyitems


def pytest_configure(config):
    for name in kinds.MARKED:
        config.addinivalue_line("markers", name)
    beside = kinds.Beside()
    loop = SimpleNamespace(longest_wait_s=lambda since_s: {late_s}, close=lambda: None)
    beside.loop = lambda: loop
    config.pluginmanager.register(beside)
"""
REAL_TIME = """
import pytest
tries = []

@pytest.mark.realtime
def test_it():
    tries.append(1)
    assert len(tries) > {failures}, "it was late"
"""
STARTS = """
import subprocess, sys

def test_it():
    subprocess.run([sys.executable, "-c", ""], check=True)
"""


UNNAMED = """
import pytest
pytestmark = getattr(pytest.mark, "process")

def test_it():
    pass
"""


def said(folder, late_s, **tests):
    """The last lines of a run of tests beside a loop that was so late."""
    (folder / "conftest.py").write_text(CONFTEST.replace("{late_s}", str(late_s)))
    for name, text in tests.items():
        (folder / f"test_{name}.py").write_text(text)
    command = [sys.executable, "-m", "pytest", "-q", "-rA", "-p", "no:cacheprovider", str(folder)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    return done.stdout + done.stderr


def test_beside_a_late_loop_what_fails_once_passes_and_twice_is_skipped(tmp_path):
    twice, once = (REAL_TIME.format(failures=failures) for failures in (9, 1))
    out = said(tmp_path, 0.31, twice=twice, once=once, starts=STARTS)
    assert "PASSED test_once.py" in out
    assert "SKIPPED [1] test_twice.py" in out
    assert "waiting for 0.31 s; it failed with" in out
    # A pure one that starts a process fails.
    assert "FAILED test_starts.py" in out
    assert "mark it process or realtime" in out


def test_what_fails_on_a_machine_that_was_in_time_is_a_failure(tmp_path):
    assert "1 failed" in said(tmp_path, 0.0, once=REAL_TIME.format(failures=1))


def stopped(loop):
    """Stop it for a moment, which it may have been too young to notice."""
    loop.signal(signal.SIGSTOP)
    time.sleep(0.3)
    loop.signal(signal.SIGCONT)
    time.sleep(0.1)


def test_the_loop_notices_that_it_was_kept_waiting():
    """A stopped process stands for a machine that lets nobody run."""
    loop = machine.EmptyLoop()
    try:
        began_s = time.monotonic()
        until(lambda: stopped(loop) or loop.longest_wait_s(began_s) > 0.2)
    finally:
        loop.close()


def test_a_kind_stands_in_its_files_text(tmp_path):
    """A run of one kind imports the files that name it alone."""
    assert "its text has to name pytest.mark.process" in said(tmp_path, 0.0, unnamed=UNNAMED)
