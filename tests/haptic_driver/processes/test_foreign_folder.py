"""Processes of the program that are started in a folder of somebody else's.

A `queue.py` in a folder that anybody may write to once ran in the watchdog, as root.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from haptic_driver.base.interpreter import PYTHON, module_command
from tests.traps import set_traps, sprung
from tests.waiting import HANG_S

pytestmark = pytest.mark.process

MODULES = (
    *("haptic_driver.daemon.render_process", "haptic_driver.daemon.envelope_process"),
    *("haptic_driver.daemon.observer", "haptic_driver.daemon.loader", "haptic_driver.live.why"),
    *("haptic_driver.recording.process", "haptic_driver.simulation.process"),
    "hw.safety.watchdog",
)
POOL = """
import os
from haptic_driver.processes.started import start_workers
with start_workers("study", 1) as pool:
    print(pool.submit(os.getppid).result() == os.getpid())
"""


@pytest.fixture
def foreign(tmp_path):
    set_traps(tmp_path)
    return tmp_path


def run(command: list[str], folder: Path) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(
        command,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        check=False,
        timeout=HANG_S,
    )


def test_a_module_that_is_started_carelessly_springs_the_traps(foreign):
    run([sys.executable, "-m", "hw.safety.watchdog"], foreign)
    assert sprung(foreign)


@pytest.mark.parametrize("module", MODULES)
def test_no_process_imports_from_there(foreign, module):
    """Without its arguments each ends at once, when it has imported all that it needs."""
    said = run(module_command(module), foreign).stderr.decode()
    assert sprung(foreign) == []
    assert "ModuleNotFoundError" not in said


def test_nor_do_the_workers_of_a_pool(foreign):
    done = run([*PYTHON, "-c", POOL], foreign)
    assert done.stdout.strip() == b"True", done.stderr.decode()
    assert sprung(foreign) == []
