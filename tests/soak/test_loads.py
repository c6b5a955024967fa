"""200 random moments of `haptic measure` on a rig that presses a finger: a pulled or deaf stage, a
silent, frozen or saturated sensor, a finger that thrusts, Ctrl-C, and a process that is killed.

`HAPTIC_SOAK_LOADS`: how many (200), a quarter of them kills. `HAPTIC_SOAK_SEED`: of the moments
(1). Each is printed, and at the end the highest load of each kind.
"""

from __future__ import annotations

import os
import random
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import load_rig
from model.touch_model import TouchModel
from tests.haptic_driver.lab.measuring.load_moments import Moment, failed, moments, serving

LOADS = int(os.environ.get("HAPTIC_SOAK_LOADS", "200"))
SEED = int(os.environ.get("HAPTIC_SOAK_SEED", "1"))
KILLS = LOADS // 4
LONGEST_S = 8.0  # after the load stage begins to approach: over the first rows


@pytest.mark.soak
@pytest.mark.timeout(LOADS * 60 + 600)
def test_at_every_moment_the_finger_feels_less_than_the_limit_and_the_output_is_off(tmp_path):
    model = TouchModel(load_model("reference"))
    highest, unsafe = defaultdict[str, list[float]](list), list[str]()
    for number, moment in enumerate(_all(model, tmp_path)):
        print(f"{number}: {moment}", flush=True)
        highest[moment.what].append(moment.highest_n)
        unsafe += [] if moment.safe else [str(moment)]
    for what, loads in highest.items():
        print(f"{what}: {len(loads)} moments, at most {max(loads):.2f} N", flush=True)
    assert not unsafe, unsafe


def _all(model: TouchModel, folder: Path) -> Iterable[Moment]:
    for what, moment_s in moments(LOADS - KILLS, SEED):
        yield failed(model, folder / "data.csv", what, moment_s)
    yield from _killed(model, folder)


def _killed(model: TouchModel, folder: Path) -> Iterator[Moment]:
    chance = random.Random(SEED)
    with serving(load_rig("simulated"), model, folder) as served:
        for _ in range(KILLS):
            yield served.killed(chance.uniform(0.0, LONGEST_S))
