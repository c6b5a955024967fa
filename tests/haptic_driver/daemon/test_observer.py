"""The observer's process: started again when it dies, and heard."""

import os
import signal
from itertools import count

import numpy as np
import pytest

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.judge import JudgeSettings
from haptic_driver.daemon.observer import Observer
from haptic_driver.fidelity.perception import load_perception
from haptic_driver.live.follow import FollowSettings
from haptic_driver.simulation.finger_model import surface_friction
from tests.haptic_driver.live.recorded_runs import HEADER, LIFT, Part, moved, ticks
from tests.waiting import exists, until

STROKES = [
    part for v in (0.0, 60.0, 110.0) for part in (Part(1.2, voltage_v=v, normal_force_n=0.4), LIFT)
]


def written(shared, samples):
    """Samples as render writes them."""
    for sample in samples:
        shared.ring.write(sample.item())


@pytest.mark.soak
def test_an_observer_that_dies_is_started_again_and_mends_where_it_is_asked(
    shared, surface_file, limits
):
    events, installed = EventLog(), []
    judge = JudgeSettings(load_perception(), 500.0, 0.003)
    budget_s = HEADER.latency_budget_s
    followed = FollowSettings("reference", surface_file, limits, budget_s, period_s=0.2)
    law = surface_friction(surface_file, limits)
    observer = Observer(
        (followed, judge),
        shared,
        events,
        lambda surface, too_late: installed.append(surface) or True,
    )
    observer.start()
    try:
        before = until(lambda: observer.pids.get("observer"))
        until(lambda: os.getpriority(os.PRIO_PROCESS, before) == 19)
        os.kill(before, signal.SIGKILL)
        until(lambda: observer.pids["observer"] != before)
        observer.swap.adapt(True)
        rng = np.random.default_rng(1)
        lighter = ticks(2 * STROKES, lambda *at: 0.9 * law(*at), rng, wobble=0.01)

        begins_s = count(0.0, 10.0)

        def mended():
            """As render would, some seconds at a time."""
            written(shared, moved(lighter, next(begins_s)))
            return installed

        until(mended)
        friction = law(200.0, 0.0, 0.5, 0.02, 0.0) / 0.5
        assert installed[0].cof[0, 0, 2] == pytest.approx(0.9 * friction, rel=0.02)
        assert observer.rows
        # of the new surface: what was known of the old one is forgotten
        until(lambda: mended() and observer.cells)
    finally:
        observer.close()
    told = [
        (event.kind, event.message.partition(":")[0])
        for event in events.since(0)
        if event.kind != "agreement"
    ]
    said = "the observer process was killed by SIGKILL; it is started again, rendering goes on"
    assert told[0] == ("observer", said)
    assert ("adapt", "refitted") in told
    until(lambda: not exists(observer.pids["observer"]))
