"""OFF at random moments after a machine has refused threads, processes, memory, disk or the log.

`HAPTIC_SOAK_DENIALS`: how often in all (200). How long each took from OFF to zero at the electrode
is printed.
"""

from __future__ import annotations

import os
import random
import time
from itertools import cycle, islice

import numpy as np
import pytest

from tests.haptic_driver.daemon import denying
from tests.haptic_driver.daemon.denying import DENIALS, EVERYTHING
from tests.haptic_driver.daemon.electrode import history
from tests.waiting import until

TIMES = int(os.environ.get("HAPTIC_SOAK_DENIALS", "200"))
LIMIT_S = 0.1
LONGEST_WAIT_S = 0.5


def off_took_s(daemon):
    """From OFF to zero at the electrode."""
    sent_s = time.monotonic()
    daemon.off()
    until(lambda: history(daemon.record)[-1][1] == 0.0)
    return max(history(daemon.record)[-1][0] - sent_s, 0.0)


@pytest.mark.soak
@pytest.mark.timeout(TIMES * 20 + 60)
def test_off_is_zero_within_a_tenth_of_a_second_whatever_is_denied(tmp_path):
    chance = random.Random(1)
    took_s: dict[str, list[float]] = {}
    for number, what in enumerate(islice(cycle([*DENIALS, EVERYTHING]), TIMES)):
        folder = tmp_path / str(number)
        folder.mkdir()
        daemon = denying.DeniedDaemon(folder, what)
        try:
            daemon.render()
            time.sleep(chance.uniform(0.0, LONGEST_WAIT_S))
            daemon.deny()
            time.sleep(chance.uniform(0.0, LONGEST_WAIT_S))
            took_s.setdefault(what, []).append(off_took_s(daemon))
        finally:
            daemon.close()
    for what, times_s in took_s.items():
        print(
            f"{what}: {len(times_s)} times, median {np.median(times_s):.3f} s, longest"
            f" {max(times_s):.3f} s"
        )
    assert max(map(max, took_s.values())) <= LIMIT_S
