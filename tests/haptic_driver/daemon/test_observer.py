"""What is held against the model while something renders: rows and agreement, whatever pieces the
samples come in.
"""

from __future__ import annotations

import os
import signal
from dataclasses import replace

import numpy as np
import pytest

from haptic_driver.daemon.adaptation import Adaptation
from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.judge import JudgeSettings
from haptic_driver.daemon.observation import Observation, ObserverSettings, Word
from haptic_driver.daemon.observer import Following, Observer
from haptic_driver.experiments.mending import Mended
from haptic_driver.experiments.recorded import cut
from haptic_driver.fidelity.perception import load_perception
from haptic_driver.recording.read import Run
from haptic_driver.simulation.finger_model import surface_friction
from tests.haptic_driver.experiments.recorded_runs import HEADER, LIFT, Part, ticks
from tests.waiting import exists, until

BATCH = 2000
STROKES = [
    part for v in (0.0, 60.0, 110.0) for part in (Part(1.2, voltage_v=v, normal_force_n=0.4), LIFT)
]


@pytest.fixture(scope="module")
def expected(surface_file, limits):
    judge = JudgeSettings(load_perception(), 500.0, 0.003)
    return ObserverSettings("reference", surface_file, limits, HEADER.latency_budget_s, judge)


@pytest.fixture(scope="module")
def law(surface_file, limits):
    return surface_friction(surface_file, limits)


def observed(observation, samples):
    """Samples as the ring gives them, some at a time."""
    return [observation.add(samples[i : i + BATCH]) for i in range(0, samples.size, BATCH)]


def test_a_finger_as_the_model_has_it_is_told_of_as_one_that_agrees(expected, law, rng):
    samples = ticks(6 * STROKES, lambda *at: 1.1 * law(*at), rng, wobble=0.01)
    seen = observed(Observation(expected), samples)
    assert not [found for each in seen for found in each.found]
    assert {cell["axis"] for cell in seen[-1].cells} >= {"voltage_v", "normal_force_n", "speed_m_s"}
    assert max(abs(cell["share"]) for cell in seen[-1].cells) < 0.02


def test_friction_that_the_voltage_no_longer_gives_is_told_with_its_place(expected, law, rng):
    def changed(f, v, n, s, t):
        return law(f, v, n, s, t) * (0.9 if v > 100.0 else 1.0)

    observation = Observation(expected)
    observed(observation, ticks(6 * STROKES, law, rng, wobble=0.01))
    later = ticks(6 * STROKES, changed, rng, wobble=0.01)
    later["time_s"] += 60.0
    told = [
        found
        for each in observed(observation, later)
        for found in each.found
        if found.axis == "voltage_v"
    ]
    assert told
    assert all(
        found.low == 100.0 and found.share < -0.05 and found.since_s > 100.0 for found in told
    )
    observation.begin()
    assert not observation.add(later[:0]).cells


def test_pieces_give_the_rows_of_the_whole(expected, law, rng):
    """But for the ends of pieces: a row there is two."""
    samples = ticks(2 * STROKES, law, rng)
    pieces = [row for each in observed(Observation(expected), samples) for row in each.rows]
    whole = cut(Run("all", {"latency_budget_s": HEADER.latency_budget_s}, {}, samples, []))
    assert {each.row.setting.voltage_v for each in pieces} == {
        each.row.setting.voltage_v for each in whole
    }
    assert len(whole) <= len(pieces) <= len(whole) + samples.size // BATCH
    trials = [each.row.trial for each in pieces]
    assert trials == sorted(trials)
    assert {each.row.session for each in pieces} == {1}
    times_s = np.array([each.measured.time_s for each in pieces])
    assert np.all(np.diff(times_s) > 0.0)
    assert times_s[0] > samples["time_s"][0]


def test_after_a_swap_that_render_refused_the_observer_goes_by_the_surface_that_renders(
    expected, law, rng, model_description, limits
):
    light, presents = replace(model_description, parameters=dict(model_description.parameters)), []
    light.parameters["cof_off"] = replace(
        light.parameters["cof_off"], value=0.9 * light.parameters["cof_off"].value
    )

    def mend(known, description, held_out, present):
        presents.append(present)
        return Mended(light, "better")

    following = Following(expected, Adaptation(model_description, limits, mend))
    samples = ticks(6 * STROKES, law, rng)

    def proposed():
        samples["time_s"] += 30.0
        return following.add(samples)

    following.hear(Word.ADAPT)
    assert proposed().proposal.surface is not None
    assert proposed().cells  # what is expected has not changed
    following.hear(Word.TAKEN)
    assert not following.add(samples[:0]).cells  # it has
    proposed()
    following.hear(Word.BASE)
    proposed()
    assert [each is light for each in presents] == [False, False, True, False]


def written(shared, samples):
    """Samples as render writes them."""
    for sample in samples:
        shared.ring.write(sample.item())


@pytest.mark.soak
def test_an_observer_that_dies_is_started_again_and_mends_where_it_is_asked(
    shared, expected, law, rng
):
    events, installed = EventLog(), []
    observer = Observer(shared, events, lambda surface, too_late: installed.append(surface) or True)
    observer.start(replace(expected, period_s=0.2))
    try:
        before = until(lambda: observer.pids.get("observer"))
        until(lambda: os.getpriority(os.PRIO_PROCESS, before) == 19)
        os.kill(before, signal.SIGKILL)
        until(lambda: observer.pids["observer"] != before)
        observer.adapt(True)
        lighter = ticks(2 * STROKES, lambda *at: 0.9 * law(*at), rng, wobble=0.01)
        samples = lighter.copy()

        def mended():
            """As render would, some seconds at a time."""
            written(shared, samples)
            samples["time_s"] += 10.0
            return installed

        until(mended)
        friction = law(200.0, 0.0, 0.5, 0.02, 0.0) / 0.5
        assert installed[0].cof[0, 0, 2] == pytest.approx(0.9 * friction, rel=0.02)
        assert observer.rows
    finally:
        observer.close()
    told = [
        (event.kind, event.message.partition(":")[0])
        for event in events.since(0)
        if event.kind != "agreement"
    ]
    said = "the observer process was killed by SIGKILL; it is started again, rendering goes on"
    assert told[0] == ("observer", said)
    assert ("adapt", "mended") in told
    until(lambda: not exists(observer.pids["observer"]))
