"""What is held against the model while something renders, whatever pieces the samples come in."""

from itertools import count

import numpy as np
import pytest

from haptic_driver.live.follow import ATTEMPT_S, Following, FollowSettings
from haptic_driver.live.proof import LEAST_UNSEEN
from haptic_driver.live.swap import Word
from haptic_driver.live.window import windows
from haptic_driver.simulation.finger_model import surface_friction
from tests.haptic_driver.live.recorded_runs import HEADER, LIFT, Part, moved, ticks

BATCH = 2000
STROKES = [
    part for v in (0.0, 60.0, 110.0) for part in (Part(1.2, voltage_v=v, normal_force_n=0.4), LIFT)
]


@pytest.fixture
def following(surface_file, limits, model_description):
    settings = FollowSettings("reference", surface_file, limits, HEADER.latency_budget_s)
    return Following(settings, model_description)


@pytest.fixture(scope="module")
def law(surface_file, limits):
    return surface_friction(surface_file, limits)


def observed(following, samples):
    """Samples as the ring gives them, some at a time."""
    return [following.add(samples[i : i + BATCH]) for i in range(0, samples.size, BATCH)]


def test_a_finger_as_the_model_has_it_is_told_of_as_one_that_agrees(following, law, rng):
    samples = ticks(6 * STROKES, lambda *at: 1.1 * law(*at), rng, wobble=0.01)
    seen = observed(following, samples)
    assert not [found for each in seen for found in each.found]
    assert {cell.axis for cell in seen[-1].cells} >= {"voltage_v", "normal_force_n", "speed_m_s"}
    assert max(abs(cell.share) for cell in seen[-1].cells) < 0.02


def test_friction_that_the_voltage_no_longer_gives_is_told_with_its_place(following, law, rng):
    def changed(f, v, n, s, t):
        return law(f, v, n, s, t) * (0.9 if v > 100.0 else 1.0)

    observed(following, ticks(6 * STROKES, law, rng, wobble=0.01))
    later = moved(ticks(6 * STROKES, changed, rng, wobble=0.01), 60.0)
    every = [found for each in observed(following, later) for found in each.found]
    told = [found for found in every if found.axis == "voltage_v"]
    assert told
    for found in told:
        assert found.low == 100.0
        assert found.share < -0.05
        assert found.since_s > 100.0
    following.begin()
    assert not following.add(later[:0]).cells


def test_pieces_give_the_windows_of_the_whole(following, law, rng):
    """But for the ends of pieces: a window there is two."""
    samples = ticks(2 * STROKES, law, rng)
    pieces = [window for each in observed(following, samples) for window in each.windows]
    whole, _ = windows(samples, HEADER.latency_budget_s)
    assert {each.voltage_v for each in pieces} == {each.voltage_v for each in whole}
    assert len(whole) <= len(pieces) <= len(whole) + samples.size // BATCH
    trials = [each.trial for each in pieces]
    assert trials == sorted(trials)
    assert {each.session for each in pieces} == {1}
    times_s = np.array([each.time_s for each in pieces])
    assert np.all(np.diff(times_s) > 0.0)
    assert times_s[0] > samples["time_s"][0]


def test_a_pause_between_pieces_begins_a_session(following, law, rng):
    samples, seen = ticks(STROKES, law, rng), []
    for begin_s in (0.0, 5.0, 30.0):
        seen += following.add(moved(samples, begin_s)).windows
    assert sorted({(each.session, each.trial) for each in seen}) == [
        *((1, trial) for trial in range(1, 7)),
        *((2, trial) for trial in range(1, 4)),
    ]


def test_a_model_is_proposed_until_render_goes_by_it_and_again_when_it_does_no_more(
    following, law, rng, model_description
):
    lighter = ticks(6 * STROKES, lambda *at: 0.9 * law(*at), rng, wobble=0.01)
    begins_s = count(0.0, 30.0)

    def later():
        return following.add(moved(lighter, next(begins_s)))

    assert later().proposal is None
    following.hear(Word.ADAPT)
    for _ in range(2):  # render does not take up the first
        found = later()
        assert found.proposal.surface is not None
        assert found.cells  # what is expected has not changed
    own = model_description.parameters["cof_off"].value
    assert found.proposal.numbers["cof_off"] == pytest.approx(0.9 * own, rel=0.01)
    assert found.proposal.rows[-1][2:4] == pytest.approx([0.4, 0.02], rel=0.01)
    following.hear(Word.TAKEN)
    assert not following.add(lighter[:0]).cells  # it has
    found = later()
    assert found.proposal.surface is None
    assert "not better" in found.proposal.said
    soon = moved(lighter[-1400:], next(begins_s) - 30.0 + 0.9 * ATTEMPT_S)
    found = following.add(soon)
    assert found.windows
    assert found.proposal is None
    following.hear(Word.BASE)
    assert later().proposal.surface is not None
    following.hear(Word.REST)
    assert later().proposal is None


def test_too_few_windows_to_judge_by_lead_to_nothing(following, law, rng):
    following.hear(Word.ADAPT)
    found = following.add(ticks(STROKES, law, rng))
    assert 0 < len(found.windows) <= LEAST_UNSEEN + 1
    assert found.proposal is None
