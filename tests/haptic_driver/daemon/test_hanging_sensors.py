"""A sensor's driver from outside that hangs does not keep the daemon from ending, with the output
off.
"""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from haptic_driver.recording.read import read_run
from tests.haptic_driver.config_texts import changed, served_rig_text
from tests.haptic_driver.daemon.waiting import until_ready
from tests.waiting import HANG_S, until

pytestmark = pytest.mark.process

PLUGIN = '''
"""A finger tracker that says where the finger is. Once a file is there it hangs, in closing too."""

import time
from pathlib import Path
from typing import Literal

from haptic_driver.rig import devices
from haptic_driver.rig.part import Part, PartSection
from hw.finger.tracker import FingerReading


devices.CLOSE_S = 1.0  # as long as a test has


class Section(PartSection):
    kind: Literal["lab_finger"]
    folder: str

    def make(self, wiring):
        finger = LabFinger(self.folder)
        return Part(finger, closing=[finger.hang])


class LabFinger:
    def __init__(self, folder):
        self.folder = Path(folder)

    def hang(self):
        while (self.folder / "hang").exists():
            (self.folder / "hangs").touch()
            time.sleep(0.01)

    def read(self):
        self.hang()
        return FingerReading(time.monotonic(), 0.03, 0.03, True)
'''
RIG = """
[finger_tracker]
kind = "lab_finger"
folder = "{folder}"
"""


@pytest.fixture
def start(simulated, tmp_path):
    """Starts the daemon on a rig whose tracker is the plug-in's."""
    (tmp_path / "lab_finger.py").write_text(PLUGIN)
    about = tmp_path / "lab_finger-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: lab-finger\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(
        "[haptic_driver.finger_trackers]\nlab_finger = lab_finger:Section\n"
    )
    rig = tmp_path / "lab.toml"
    text = changed(served_rig_text(simulated[1]), ("[watchdog]", "[watchdog]\ngive_up_s = 2.0"))
    rig.write_text(text + RIG.format(folder=tmp_path))
    command = [
        Path(sys.executable).with_name("haptic"),
        "daemon",
        "run",
        "--rig",
        rig,
        "--allow-no-rt",
    ]
    command += ["--socket", tmp_path / "daemon.sock"]
    started = []

    def begin():
        environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
        process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
        started.append(process)
        return process

    yield begin
    for process in started:
        process.kill()
        process.wait()
        process.stderr.close()


def ends(process):
    process.send_signal(signal.SIGTERM)
    _, said = process.communicate(timeout=HANG_S)
    assert process.returncode == 0, said
    assert "the output was off" in said
    assert "hangs and is left alone" in said


@pytest.mark.timeout(600)
def test_a_tracker_that_hangs_is_told_and_does_not_keep_the_daemon_from_ending(
    start, tmp_path, haptic
):
    """The status has a row for each instrument, and for a driver of one's own."""
    place = ["--socket", tmp_path / "daemon.sock"]
    process = start()
    until_ready(process)

    def rows():
        said = haptic("status", *place, "--json").said["instruments"]
        return {row["name"]: row for row in said}

    found = rows()
    assert {"waveform_generator", "interlock", "force_sensor", "finger_tracker"} <= set(found)
    for row in found.values():
        assert row["asked"] > 0, row
        assert row["age_s"] is not None, row
        assert row["read_s"] is not None, row
    assert found["force_sensor"]["zero_age_s"] is not None
    shown = haptic("status", *place).out.splitlines()
    head = next(number for number, line in enumerate(shown) if "instrument" in line)
    names = [line.strip().partition("  ")[0] for line in shown[head + 1 :][: len(found)]]
    assert names == [name.replace("_", " ") for name in found]
    recording = tmp_path / "run.h5"
    for what in (recording, "--stop"):
        assert haptic("record", what, *place).status == 0
    recorded = [event for event in read_run(recording).events if event.kind == "instruments"]
    assert [[row["name"] for row in event.data["instruments"]] for event in recorded] == [
        list(found)
    ] * 2
    (tmp_path / "hang").touch()
    until(lambda: rows()["finger_tracker"]["age_s"] > 1.0, rows)
    ends(process)
