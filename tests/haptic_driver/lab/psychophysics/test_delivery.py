"""What was felt, by samples that are made for it, and what counts as delivered."""

import numpy as np
import pytest

from haptic_driver.lab.psychophysics.apparatus import _halves
from haptic_driver.lab.psychophysics.delivery import (
    NO_ONSET,
    Delivered,
    felt,
    onsets,
    strokes,
    why_not_delivered,
)
from haptic_driver.lab.psychophysics.description import Delivery
from haptic_driver.processes.samples import SAMPLE
from haptic_driver.textures.library import load_texture

GOOD = Delivered(0.5, 0.5, 0.51, 0.02, 0.95, 1.0, 1.0, 2, 0.05, 0.5)


def made(count=1000, cof=0.6, noise=0.0, asked=0.6):
    """A finger that goes to and fro at 50 mm/s, 0.5 s each way, under half a newton."""
    samples = np.zeros(count, SAMPLE)
    t = np.arange(count) * 1e-3
    rng = np.random.default_rng(4)
    samples["tick"], samples["time_s"] = np.arange(count), 100.0 + t
    samples["position_x_m"] = 0.02 + 0.05 * np.abs((t + 0.5) % 1.0 - 0.5)
    samples["speed_m_s"], samples["in_contact"] = 0.05, 1
    samples["normal_force_n"] = 0.5 + noise * rng.normal(size=count)
    samples["lateral_force_n"] = -cof * 0.5 + noise * rng.normal(size=count)
    samples["measured_cof"] = np.abs(samples["lateral_force_n"]) / samples["normal_force_n"]
    samples["target_cof"], samples["expected_cof"], samples["reachable"] = asked, asked, 1
    return samples


def test_noise_averages_out_and_an_offset_stays():
    found = felt(made(cof=0.618, noise=0.02))
    assert (found.asked_cof, found.reachable_cof) == (pytest.approx(0.6), pytest.approx(0.6))
    assert found.felt_cof == pytest.approx(0.618, rel=0.01)
    assert found.error == pytest.approx(0.03, abs=0.01)
    assert found.within_5_percent > 0.8
    assert found.sliding_s == pytest.approx(1.0)
    assert (found.strokes, found.speed_m_s) == (2, pytest.approx(0.05))
    assert felt(made(cof=0.66)).within_5_percent == 0.0


def test_a_fine_texture_is_judged_as_it_is_felt_over_a_window():
    samples = made(asked=np.tile([0.5, 0.7], 500), cof=0.6)
    found = felt(samples)
    assert (found.asked_cof, found.felt_cof) == (pytest.approx(0.6, rel=1e-3), pytest.approx(0.6))
    assert found.within_5_percent == 1.0
    samples["lateral_force_n"] *= 1.1
    assert felt(samples).error == pytest.approx(0.1, abs=2e-3)


def test_asked_friction_is_that_of_the_moment_that_was_felt():
    """Friction that follows a wave 40 ms late, beside what is asked for 40 ms from now."""
    wave = 0.6 + 0.06 * np.sin(2.0 * np.pi * np.arange(1040) / 80.0)
    samples = made(cof=wave[:1000], asked=wave[:1000])
    samples["asked_cof"] = wave[40:]
    assert felt(samples).within_5_percent == 1.0


def test_what_is_out_of_reach_counts_and_is_told():
    samples = made(cof=0.6, asked=0.9)
    samples["expected_cof"], samples["reachable"] = 0.6, 0
    samples["target_cof"][:400] = 0.6
    samples["reachable"][:400] = 1
    found = felt(samples)
    assert found.reachable_share == pytest.approx(0.4)
    assert found.within_5_percent == pytest.approx(0.4, abs=0.01)
    assert found.reachable_cof == pytest.approx(0.6)


def test_what_is_no_sliding_contact_or_comes_too_early_is_not_judged():
    samples = made()
    samples["lateral_force_n"][:200] = -0.4  # the one before still acts
    samples["speed_m_s"][400:600] = 0.0
    samples["measured_cof"][400:600] = np.nan
    samples["lateral_force_n"][400:600] = 9.0
    samples["in_contact"][700:750] = 0
    samples["lateral_force_n"][700:850] = 9.0  # and for 0.1 s after a touch
    samples["in_contact"][900:] = 0
    found = felt(samples, settle_s=0.2)
    assert found.felt_cof == pytest.approx(0.6)
    assert found.sliding_s == pytest.approx(0.35, abs=0.002)
    only = felt(samples, samples["position_x_m"] > 0.03, 0.2)
    assert 0.0 < only.sliding_s < found.sliding_s
    assert felt(samples[:0]) == Delivered()
    assert np.isnan(felt(samples[400:600]).felt_cof)


def test_strokes_are_counted_from_turn_to_turn_and_lift_to_lift():
    assert [strokes(made(n)) for n in (40, 400, 560, 1000, 2600)] == [0, 1, 1, 2, 6]
    lifted = made(1000)
    lifted["in_contact"][200:300] = 0
    assert strokes(lifted) == 3
    resting = made(1000)
    resting["position_x_m"] = 0.02 + 1e-4 * np.sin(np.arange(1000))
    assert strokes(resting) == 0
    across = made(1000)
    across["position_y_m"], across["position_x_m"] = across["position_x_m"], 0.0
    assert strokes(across) == 2


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({}, ""),
        ({"sliding_s": 0.1}, "interval 2: the finger slid for 0.1 s"),
        (
            {"within_5_percent": 0.4, "felt_cof": 0.54},
            "interval 2: within 5 % for 40% of the time; speed or finger: 0.5 was expected, 0.54"
            " was felt at 50 mm/s",
        ),
        (
            {"within_5_percent": 0.4, "reachable_share": 0.0, "reachable_cof": 0.46},
            "load: under 0.5 N friction 0.5 is out of this finger's reach for 100% of it, at most"
            " 0.46 was expected",
        ),
        (
            {"within_5_percent": 0.0, "reachable_share": 0.2, "reachable_cof": 0.56},
            "at least 0.56 was expected",
        ),
        (
            {"within_5_percent": 0.1, "reachable_share": 0.9, "reachable_cof": 0.46},
            "feedback's caution: of a finger that it knows little of it asked 0.46, for 0.5",
        ),
        ({"reachable_share": 0.0, "reachable_cof": 0.49}, ""),  # as near as one feels
    ],
)
def test_why_a_trial_counts_as_not_delivered(changed, words):
    said = why_not_delivered([GOOD, GOOD._replace(**changed)], Delivery())
    assert words in said
    assert bool(words) == bool(said)


def test_an_interval_can_be_felt_once_the_finger_slides_and_the_output_is_on():
    samples = made(1000)  # from 100 s on
    samples["in_contact"][:100] = 0
    samples["speed_m_s"][:150] = 0.0
    samples["output_on"][120:] = 1
    samples["monitor_voltage_v"] = np.nan
    times_s = (100.1, 100.15, 100.12, 100.15)
    assert onsets(samples)[:4] == pytest.approx(times_s)
    assert onsets(samples).onset_error_s is None
    samples["monitor_voltage_v"] = np.where(np.arange(1000) < 173, 0.2, 80.0)
    assert onsets(samples).onset_error_s == pytest.approx(0.023)
    samples["output_on"][:300] = 0
    assert onsets(samples).onset_s == pytest.approx(100.3)
    samples["output_on"] = 0
    assert onsets(samples)[2:] == (None, None, None)
    assert onsets(samples[:50]) == NO_ONSET


def test_two_regions_are_a_profile_that_changes_in_the_middle(tmp_path):
    (tmp_path / "regions.csv").write_text(_halves(0.5, 0.625, 50.0))
    texture = load_texture(str(tmp_path / "regions.csv"), [])
    x_m = np.array([0.0, 0.049, 0.051, 0.3])
    np.testing.assert_allclose(texture.cof_at(x_m, np.zeros(4)), [0.5, 0.5, 0.625, 0.625])
