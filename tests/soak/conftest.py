"""The killable daemon of the daemon's own tests, and a load."""

import os
import subprocess
import sys

import pytest

from tests.haptic_driver.daemon import killing

BUSY = (
    "import os; os.setpriority(os.PRIO_PROCESS, 0, 0)\nwhile os.getppid() == {parent}:"
    " sum(range(100000))"
)
killable_daemon = killing.killable_daemon


@pytest.fixture
def busy():
    """Begins so many busy processes of normal niceness; they end with the test."""
    processes = []

    def begin(count):
        command = [sys.executable, "-c", BUSY.format(parent=os.getpid())]
        processes.extend(subprocess.Popen(command, start_new_session=True) for _ in range(count))

    yield begin
    for process in processes:
        process.kill()
        process.wait()
