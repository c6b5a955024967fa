"""The measure of fidelity, on strokes of which everything is known."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_driver.fidelity.measure import best_constant, fidelity_of
from haptic_driver.fidelity.perception import load_perception
from haptic_driver.fidelity.strokes import Stroke
from haptic_driver.textures.bands import CENTRES_HZ
from tests.haptic_driver.fidelity.strokes_of import TICK_S, rough, stroke_of

PERCEPTION = load_perception()
TIME_S = np.arange(4000) * TICK_S
WAVY = 0.65 + 0.05 * np.sin(math.tau * 20.0 * TIME_S) + 0.03 * np.sin(math.tau * 90.0 * TIME_S)


def measured(*strokes, **how):
    return fidelity_of(strokes, TICK_S, PERCEPTION, **how)


@pytest.mark.parametrize(("gain", "within", "above"), [(1.04, 1, 0), (1.06, 0, 0), (0.88, 0, 1)])
def test_a_gain_error_is_within_or_above_as_it_is_large(gain, within, above):
    found = measured(stroke_of(WAVY, gain * WAVY))
    assert (found.share_within_5_percent, found.share_above_jnd) == (within, above)
    assert found.relative_error_rms == pytest.approx(abs(gain - 1.0))


def test_forces_and_target_are_averaged_apart_over_eleven_ticks():
    random = np.random.default_rng(1)
    asked, lateral, normal = random.uniform(0.5, 0.7, (3, 40))
    found = measured(Stroke(asked, lateral, normal, np.ones(40, bool)))
    felt, wanted = np.zeros(40), np.zeros(40)
    for i in range(40):
        near = slice(max(i - 5, 0), i + 6)
        felt[i] = np.sum(lateral[near]) / np.sum(normal[near])
        wanted[i] = np.mean(asked[near])
    assert found.relative_error_rms == pytest.approx(np.sqrt(np.mean((felt / wanted - 1.0) ** 2)))
    assert found.cof_error_rms == pytest.approx(np.sqrt(np.mean((felt - wanted) ** 2)))


def test_averages_do_not_reach_from_one_stroke_into_the_next():
    low, high = np.full(30, 0.4), np.full(30, 0.8)
    found = measured(stroke_of(low, low), stroke_of(high, high))
    assert found.relative_error_rms == pytest.approx(0.0, abs=1e-12)


def test_only_reachable_targets_count_for_the_score_but_a_finger_feels_all():
    reachable = np.arange(1000) < 600
    felt = np.where(reachable, 0.6, 0.9)
    found = measured(stroke_of(np.full(1000, 0.6), felt, reachable=reachable))
    assert found.reachable_share == pytest.approx(0.6)
    # 5 of 600 are averaged with what is out of reach; one twelfth of the window is 4.5 %.
    assert found.share_within_5_percent == pytest.approx(1.0, abs=0.01)
    assert found.share_above_jnd == pytest.approx(0.4, abs=0.01)


@given(asked=st.lists(st.floats(0.3, 1.5), min_size=1, max_size=40), other=st.floats(0.3, 1.5))
def test_no_constant_lies_within_5_percent_for_longer_than_the_best(asked, other):
    def share(constant):
        return np.mean(np.abs(constant / np.array(asked) - 1.0) <= 0.05 + 1e-12)

    assert share(best_constant(np.array(asked))) >= share(other) - 1e-12


def test_of_constants_that_are_as_good_the_middle_one_is_taken():
    # 0.60 and 0.62 are both within 5 % of all from 0.589 (0.62 less 5 %) to 0.630 (0.60 and 5 %).
    assert best_constant(np.array([0.60, 0.62, 0.9])) == pytest.approx(0.5 * (0.589 + 0.630))


def test_what_a_constant_reaches_stands_beside():
    asked = np.concatenate([np.full(700, 0.60), np.full(300, 0.80)])
    found = measured(stroke_of(asked[:700], asked[:700]), stroke_of(asked[700:], asked[700:]))
    assert found.constant_cof == pytest.approx(0.60)
    assert found.constant_share_within_5_percent == pytest.approx(0.7)
    # 0.60 where 0.80 was asked is 25 % off, for three tenths of the time.
    assert found.constant_relative_error_rms == pytest.approx(0.25 * math.sqrt(0.3))


def test_bands_above_the_reach_of_a_rig_are_not_counted():
    asked = rough(10.0, 2)
    felt = 0.9 * asked
    everywhere = measured(stroke_of(asked, felt)).bands_within(0.8, 1.2)
    assert everywhere == [True] * 7 + [None] * 2
    slow = measured(stroke_of(asked, felt), reach_hz=50.0).bands_within(0.8, 1.2)
    assert slow == [True] * 3 + [None] * 6  # centres at 16, 25 and 40 Hz
    counted = measured(stroke_of(asked, felt), reach_hz=100.0).bands_within(0.8, 0.85)
    assert counted == [False] * 5 + [None] * 4  # the fifth lies around 100 Hz


@pytest.mark.parametrize(("amplitude_n", "felt"), [(20e-3, True), (0.1e-3, False)])
def test_a_ripple_is_felt_where_its_force_exceeds_the_threshold(amplitude_n, felt):
    ripple = amplitude_n / 0.8 * np.sin(math.tau * 100.0 * TIME_S)
    found = measured(stroke_of(np.full(4000, 0.6), 0.6 + ripple, load_n=0.8))
    band = int(np.argmin(np.abs(CENTRES_HZ - 100.0)))
    assert found.band_residual_n[band] == pytest.approx(amplitude_n / math.sqrt(2.0), rel=0.01)
    assert found.bands_felt[band] is felt
    assert found.bands_felt[band - 2] is False
    assert found.bands_felt[7:] == [None, None]


def test_the_noise_of_the_sensor_is_not_felt():
    noise_n = 3e-3
    felt = 0.6 + noise_n / 0.5 * np.random.default_rng(3).standard_normal(20_000)
    stroke = stroke_of(np.full(20_000, 0.6), felt, load_n=0.5)
    as_it_is = measured(stroke)
    # White noise of 3 mN has 3 mN sqrt(46 Hz/500 Hz) in the band around 100 Hz.
    assert as_it_is.band_residual_n[4] == pytest.approx(0.91e-3, rel=0.05)
    assert as_it_is.bands_felt[4] is True
    assert True not in measured(stroke, noise_n=noise_n).bands_felt


def test_strokes_do_not_meet_when_lags_are_tried():
    asked = rough(1.0, 7)
    parts = [slice(0, 300), slice(300, 600), slice(600, 1000)]
    apart = measured(*(stroke_of(asked[p], np.roll(asked[p], 5)) for p in parts))
    assert apart.best_lag_s == pytest.approx(0.005, abs=0.1e-3)
    # Only the five ticks that were rolled round the end of each stroke do not fit.
    assert apart.correlation_at_best_lag == pytest.approx(1.0)


def test_unknown_ticks_count_for_nothing():
    asked, felt = WAVY.copy(), WAVY.copy()
    asked[1000:1100] = np.nan
    felt[2500] = np.nan
    found = measured(stroke_of(asked, felt))
    assert found.sliding_time_s == pytest.approx(3.899)
    assert found.share_within_5_percent == 1.0
    assert found.correlation == pytest.approx(1.0)


def test_strokes_of_one_tick_are_measured_as_far_as_they_go():
    found = measured(*(stroke_of([asked], [0.6]) for asked in (0.6, 0.61, 0.7)))
    assert found.sliding_time_s == pytest.approx(0.003)
    assert found.share_within_5_percent == pytest.approx(2.0 / 3.0)
    assert found.band_gain == [None] * 9
    assert found.best_lag_s is None


@given(
    gain=st.floats(0.5, 1.5),
    load_n=st.floats(0.1, 3.0),
    cuts=st.lists(st.integers(1, 3999), max_size=4),
)
def test_where_strokes_are_cut_and_the_load_do_not_change_a_gain(gain, load_n, cuts):
    edges = [0, *sorted(set(cuts)), 4000]
    parts = [slice(a, b) for a, b in pairwise(edges)]
    found = measured(*(stroke_of(WAVY[p], gain * WAVY[p], load_n) for p in parts))
    assert found.sliding_time_s == pytest.approx(4.0)
    assert found.relative_error_rms == pytest.approx(abs(gain - 1.0), abs=1e-9)
    assert all(value is None or value == pytest.approx(gain) for value in found.band_gain)
