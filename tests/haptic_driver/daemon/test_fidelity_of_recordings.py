"""What status and experiments say of friction, against a recording that is judged by other code.

Nothing of `haptic_driver.fidelity` is used here but through what is tested.
"""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

import h5py
import numpy as np
import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.lab.psychophysics.delivery import felt
from haptic_driver.processes.samples import SAMPLE
from tests.haptic_driver.daemon.waiting import LEASE_S, keep_rendering
from tests.waiting import until

pytestmark = pytest.mark.realtime

ENOUGH_S = 2.5  # of sliding
AGREES = 0.01
TICKS = 11  # of an average over 10 ms, centred
DAEMON_RIG = "simulated"


class Recorded(NamedTuple):
    """Linen on a rig: what the status said, and the ticks of that, from the file."""

    said: object
    ticks: np.ndarray


@pytest.fixture(scope="module")
def recorded(running, tmp_path_factory):
    """Made once on the daemon's rig."""
    return _record(running, tmp_path_factory.mktemp("recorded") / "linen.h5")


def _record(daemon, path):
    until(lambda: not daemon.supervisor.missing and not daemon.supervisor.silent())
    daemon.record(str(path))
    lease = daemon.arm(LEASE_S)

    def plays():
        with suppress(BadInputError):  # a busy machine may be longer over it than is waited for
            daemon.targets.play(lease.token, "linen")
            return True
        return False

    def judged():
        found = daemon.status().fidelity
        return found and found.sliding_time_s > ENOUGH_S and found

    keep_rendering(daemon, lease.token, plays)
    said = keep_rendering(daemon, lease.token, judged)
    daemon.disarm()
    daemon.record(None)
    with h5py.File(path) as file:
        columns = file["run_0001/samples"]
        ticks = np.zeros(columns["tick"].size, SAMPLE)
        for name in SAMPLE.names:
            ticks[name] = columns[name][:]
    inside = (ticks["tick"] >= said.first_tick) & (ticks["tick"] <= said.last_tick)
    return Recorded(said, ticks[inside])


def _touching_for(ticks):
    """Seconds since the finger came at each tick, inf where it was there from the first on."""
    since_s, came_s, before = np.full(ticks.size, np.inf), -np.inf, True
    for i, (time_s, there) in enumerate(zip(ticks["time_s"], ticks["in_contact"], strict=True)):
        if there and not before:
            came_s = time_s
        since_s[i], before = time_s - came_s, bool(there)
    return since_s


def _share(ticks, asked, *, of_all=False):
    """How much of the sliding time friction was within 5 % of `asked`, both over 10 ms; of what was
    within reach.
    """
    judged = (ticks["in_contact"] == 1) & (ticks["speed_m_s"] >= 0.002)
    judged &= np.isfinite(ticks["measured_cof"]) & np.isfinite(asked)
    judged &= (_touching_for(ticks) >= 0.1) & (of_all | (ticks["reachable"] == 1))
    good = []
    cuts = (np.diff(judged.astype(int)) != 0) | (np.diff(ticks["tick"].astype(int)) > 1)
    for stroke in np.split(np.arange(ticks.size), np.flatnonzero(cuts) + 1):
        if not judged[stroke[0]]:
            continue
        for place in range(stroke[0], stroke[-1] + 1):
            low, high = max(place - TICKS // 2, stroke[0]), min(place + TICKS // 2, stroke[-1])
            window = slice(low, high + 1)
            lateral_n = np.abs(ticks["lateral_force_n"][window]).mean()
            cof = lateral_n / ticks["normal_force_n"][window].mean()
            good.append(abs(cof / asked[window].mean() - 1.0) <= 0.05)
    return np.mean(good)


def _asked(ticks, lag_s):
    """What was asked for a moment so long before forces were read, by the times in the file."""
    felt_s = ticks["felt_time_s"] - lag_s
    return np.interp(felt_s, ticks["asked_time_s"], ticks["asked_cof"], left=np.nan, right=np.nan)


def _beside_a_stall(ticks):
    """The share of sliding ticks up to 10 ms from where ticks or readings are missing.

    What was asked of a force there lies between two commands, and who judges may choose.
    """
    gap_s = np.diff(ticks["time_s"], prepend=ticks["time_s"][0])
    reading_gap_s = np.diff(ticks["felt_time_s"], prepend=ticks["felt_time_s"][0])
    stalled_s = ticks["time_s"][(gap_s > 0.0025) | (reading_gap_s > 0.005)]
    away_s = np.abs(ticks["time_s"][:, None] - np.concatenate([stalled_s, [np.inf]])).min(axis=1)
    return np.mean(away_s[ticks["speed_m_s"] >= 0.002] < 0.010)


def test_it_is_that_of_the_recording_by_the_times_that_stand_there(recorded):
    """However late the machine was: when what was asked acts, and when forces were read."""
    said, ticks = recorded
    share, agrees = _share(ticks, _asked(ticks, 0.0)), AGREES + _beside_a_stall(ticks)
    assert _share(ticks, ticks["asked_cof"]) < share - 3.0 * AGREES  # it is not aligned there
    assert said.share_within_5_percent == pytest.approx(share, abs=agrees)
    of_all = _share(ticks, _asked(ticks, 0.0), of_all=True)
    assert felt(ticks).within_5_percent == pytest.approx(of_all, abs=agrees)
    assert said.sliding_time_s > ENOUGH_S
