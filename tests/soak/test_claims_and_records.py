"""One program has a rig, and recordings lose nothing, over many rounds at random moments.

`HAPTIC_SOAK_ROUNDS`: rounds of each (40).
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import time
from collections.abc import Callable
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_driver.client import HapticClient
from haptic_driver.errors import HapticError
from haptic_driver.lookup.models import load_model
from haptic_driver.recording.read import read_run
from haptic_driver.recording.records import records_of
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.devices import connect_devices
from haptic_driver.simulation.served import ServedRig
from haptic_driver.simulation.twin import as_real
from model.touch_model import TouchModel
from tests.soak.test_attack import served
from tests.waiting import until

__all__ = ["served"]  # a fixture

ROUNDS = int(os.environ.get("HAPTIC_SOAK_ROUNDS", "40"))
ENDS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)


def having(rig: RigConfig, has: Any) -> None:
    """Open a rig and keep it until killed."""
    with connect_devices(rig):
        has.set()
        signal.pause()


@pytest.mark.soak
@pytest.mark.timeout(1200)
def test_a_rig_is_of_one_program_however_that_ends():
    """Two daemons on one rig: one said "idle, 0 V" while the other held 95 V."""
    chance, spawning = random.Random(7), get_context("spawn")
    config, touch = load_rig("simulated"), TouchModel(load_model("reference"))
    with ServedRig(as_real(config), touch) as instruments:
        rig = instruments.config
        for _ in range(ROUNDS):
            has = spawning.Event()
            first = spawning.Process(target=having, args=(rig, has), daemon=True)
            first.start()
            assert has.wait(60.0)
            with pytest.raises(HapticError) as refused:
                connect_devices(rig).open()
            assert refused.value.code == "in_use"
            assert f"process {first.pid}" in refused.value.message
            time.sleep(0.2 * chance.random())
            assert first.pid is not None
            os.kill(first.pid, chance.choice(ENDS))
            first.join(60.0)
            assert not first.is_alive()
            with connect_devices(rig) as mine:
                assert mine.rig.state.value == "off"


MEDDLING: tuple[Callable[[Path], object], ...] = (
    lambda left: left.unlink(),
    # A file that is being put back goes under another name first: one that is listed may be gone.
    lambda left: [each.unlink(missing_ok=True) for each in left.parent.iterdir()],
    lambda left: shutil.rmtree(left.parent, ignore_errors=True),
)


@pytest.mark.soak
@pytest.mark.timeout(1200)
def test_who_deletes_a_running_recording_loses_nothing(served, tmp_path):
    """A clean-up script deleted the hidden copy as well: 8 s were lost."""
    chance = random.Random(8)
    with HapticClient(served.socket) as client:
        for number in range(ROUNDS):
            path = tmp_path / f"folder {number}" / "run.h5"
            path.parent.mkdir()
            before = client.status().overruns
            client.record(path)
            left = records_of(path)
            for _ in range(chance.randint(1, 3)):
                until(left.exists)
                time.sleep(chance.uniform(0.0, 1.5))
                until(left.exists)
                chance.choice(MEDDLING)(left)
            time.sleep(chance.uniform(0.0, 1.0))
            missed = client.record(None).overruns - before
            run = read_run(path)
            assert run.attributes["complete"] is True
            gaps = np.diff(run.samples["tick"].astype(np.int64)) - 1
            assert gaps.sum() <= missed  # instants that render missed are no samples
