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


def said(folder, test, late_s=0.0):
    """The last lines of a run of one test beside a loop that was so late."""
    (folder / "conftest.py").write_text(CONFTEST.replace("{late_s}", str(late_s)))
    (folder / "test_it.py").write_text(test)
    command = [sys.executable, "-m", "pytest", "-q", "-rs", "-p", "no:cacheprovider", str(folder)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    return done.stdout + done.stderr


def test_what_fails_twice_beside_a_late_loop_is_skipped_with_the_figure(tmp_path):
    out = said(tmp_path, REAL_TIME.format(failures=9), late_s=0.31)
    assert "1 skipped" in out
    assert "waiting for 0.31 s; it failed with" in out


def test_what_fails_once_beside_a_late_loop_passes(tmp_path):
    assert "1 passed" in said(tmp_path, REAL_TIME.format(failures=1), late_s=0.31)


def test_what_fails_on_a_machine_that_was_in_time_is_a_failure(tmp_path):
    assert "1 failed" in said(tmp_path, REAL_TIME.format(failures=1))


def test_a_pure_test_that_starts_a_process_fails(tmp_path):
    assert "mark it process or realtime" in said(tmp_path, STARTS)


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
    assert "its text has to name pytest.mark.process" in said(tmp_path, UNNAMED)
