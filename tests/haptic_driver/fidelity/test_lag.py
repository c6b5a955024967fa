"""The lag of felt behind asked friction: found, with its error, or said to be unknown."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_driver.config import texture_dirs
from haptic_driver.fidelity.lag import correlation_by_lag, latency_of
from haptic_driver.textures.library import load_texture
from tests.haptic_driver.fidelity.strokes_of import TICK_S, rough

NOISE_N = 3e-3  # of a reading, on a load of 0.5 N
LOAD_N = 0.5


def cloth(place_m):
    """Threads of 2 mm, no two alike, as a formula, so that it can be shifted by any time."""
    thread = np.sin(math.tau * place_m / 2.0e-3)
    slow = np.sin(math.tau * place_m / 5.3e-3) + np.sin(math.tau * place_m / 8.9e-3 + 1.0)
    return 0.62 + 0.04 * thread * (1.0 + 0.3 * slow)


def record(texture, speed_m_s, seconds, lag_s, seed, lifts=True, noise_n=NOISE_N):
    """Asked and felt friction of strokes of 80 mm there and back, a lift every 2 s, a bad gain."""
    time_s = np.arange(round(seconds / TICK_S)) * TICK_S

    def asked_at(when_s):
        way_m = np.mod(speed_m_s * when_s, 0.160)
        return texture(0.010 + np.where(way_m < 0.080, way_m, 0.160 - way_m))

    random = np.random.default_rng(seed)
    load_n = LOAD_N + 0.06 * np.sin(math.tau * 0.9 * time_s)
    lateral_n = (0.9 * asked_at(time_s - lag_s) + 0.03) * load_n
    lateral_n += noise_n * random.standard_normal(time_s.size)
    normal_n = load_n + noise_n * random.standard_normal(time_s.size)
    asked, felt = asked_at(time_s), lateral_n / normal_n
    if lifts:
        up = np.mod(time_s, 2.0) > 1.75
        asked[up] = np.nan
        felt[up] = np.nan
    return asked, felt


def linen(place_m):
    return load_texture("linen", texture_dirs()).cof_at(place_m, np.full(place_m.shape, 0.0303))


@settings(max_examples=20)
@given(seed=st.integers(0, 1000), gaps=st.floats(0.0, 0.3))
def test_every_lag_has_the_correlation_of_the_pairs_that_are_known(seed, gaps):
    random = np.random.default_rng(seed)
    asked, felt = random.standard_normal((2, 300))
    asked[random.random(300) < gaps] = np.nan
    felt[random.random(300) < gaps] = np.nan
    found = correlation_by_lag(asked, felt, 20)
    for lag in range(-20, 21):
        pairs = [(asked[t], felt[t + lag]) for t in range(300) if 0 <= t + lag < 300]
        x, y = np.array([pair for pair in pairs if np.isfinite(pair).all()]).T
        assert found[20 + lag] == pytest.approx(np.corrcoef(x, y)[0, 1], abs=1e-9)


def test_lags_with_less_than_half_of_the_pairs_are_unknown():
    asked = rough(0.1, 1)
    found = correlation_by_lag(asked, asked, 80)
    assert np.isfinite(found).tolist() == [abs(lag) <= 50 for lag in range(-80, 81)]


@pytest.mark.parametrize("speed_m_s", [0.020, 0.080])
@pytest.mark.parametrize("seconds", [2.0, 10.0])
@pytest.mark.parametrize("texture", [cloth, linen])
def test_the_lag_of_cloth_is_found_to_a_third_of_a_millisecond(texture, seconds, speed_m_s):
    for seed, lag_s in enumerate((0.0124, 0.0378, 0.0601)):
        found = latency_of(*record(texture, speed_m_s, seconds, lag_s, seed), TICK_S, lag_s)
        assert found.lag_s == pytest.approx(lag_s, abs=0.3e-3)
        assert abs(found.lag_s - lag_s) < 5.0 * found.error_s
        assert found.error_s < 0.5e-3


def missing(asked, felt):
    felt[np.random.default_rng(9).random(felt.size) < 0.1] = np.nan


def drifting(asked, felt):
    felt *= np.linspace(0.8, 1.1, felt.size)
    felt += 0.1 * np.mod(np.arange(felt.size), 2000) / 2000


def offset(asked, felt):
    felt += 0.2 * (np.arange(felt.size) // 2000 % 2)


def bare(asked, felt):
    """A ramp at 80 mm/s over a screen that it does not fill was told to lag by -44 ms."""
    beyond = np.mod(np.arange(asked.size), 500) < 150
    asked[beyond], felt[np.roll(beyond, 40)] = np.nan, 0.2


@pytest.mark.parametrize("change", [missing, drifting, offset, bare])
def test_readings_that_miss_drift_or_jump_do_not_move_it(change):
    asked, felt = record(cloth, 0.080 if change is bare else 0.040, 10.0, 0.030, 4)
    change(asked, felt)
    found = latency_of(asked, felt, TICK_S, 0.030)
    assert found.lag_s == pytest.approx(0.030, abs=0.5e-3 if change is drifting else 0.3e-3)
    assert found.others_s == [] or change is bare
    assert change is not offset or found.correlation > 0.9


def test_a_tenth_of_the_readings_is_too_little():
    asked, felt = record(cloth, 0.040, 10.0, 0.030, 10)
    felt[np.arange(felt.size) % 10 != 0] = np.nan
    assert "too rarely" in unknown(asked, felt)


def test_the_error_told_is_as_large_as_the_scatter_is():
    noisy = [record(cloth, 0.040, 5.0, 0.030, seed, noise_n=0.02) for seed in range(60)]
    found = [latency_of(*pair, TICK_S, 0.030) for pair in noisy]
    scatter_s = np.std([one.lag_s for one in found])
    # 60 records tell a scatter to 9 %, ten blocks each an error to 24 %.
    assert np.mean([one.error_s for one in found]) == pytest.approx(scatter_s, rel=0.3)


def test_edges_leave_a_cusp_on_which_a_parabola_is_off_and_the_error_says_so():
    def ridges(place_m):
        return 0.55 + 0.22 * (np.mod(place_m, 4.1e-3) < 1.0e-3)

    for seed, lag_s in enumerate((0.0203, 0.0306, 0.0408)):
        found = latency_of(*record(ridges, 0.080, 5.0, lag_s, seed, noise_n=1e-5), TICK_S, lag_s)
        assert 0.04e-3 < found.error_s < 0.1e-3
        assert abs(found.lag_s - lag_s) < 4.0 * found.error_s


def test_of_a_grating_the_lag_next_to_the_expected_is_told_with_the_others():
    def grating(place_m):
        return 0.65 + 0.1 * np.sin(math.tau * place_m / 1.0e-3)  # 80 mm are whole periods

    asked, felt = record(grating, 0.050, 6.0, 0.030, 3, lifts=False)  # 20 ms a period
    near = latency_of(asked, felt, TICK_S, expected_s=0.034)
    assert near.lag_s == pytest.approx(0.030, abs=0.2e-3)
    assert min(abs(lag_s - 0.050) for lag_s in near.others_s) < 0.2e-3
    assert "periodic" in near.why
    assert "periodic" in str(near)
    far = latency_of(asked, felt, TICK_S, expected_s=0.054)
    assert far.lag_s == pytest.approx(0.050, abs=0.2e-3)


def unknown(asked, felt):
    found = latency_of(asked, felt, TICK_S)
    assert (found.lag_s, found.error_s, found.correlation, found.others_s) == (None,) * 3 + ([],)
    assert found.why in str(found)
    return found.why


def test_a_constant_target_tells_nothing():
    assert "hardly changes" in unknown(np.full(5000, 0.6), rough(5.0, 5))


def test_a_slow_target_tells_nothing():
    time_s = np.arange(5000) * TICK_S
    asked = 0.6 + 0.1 * np.sin(math.tau * 0.5 * time_s)
    assert "too slowly" in unknown(asked, asked + 0.01 * rough(5.0, 6, rms=1.0, mean=0.0))
    assert "too slowly" in unknown(asked, 0.9 * asked)


@pytest.mark.parametrize("seed", range(3))
def test_a_lag_that_is_off_by_more_than_5_ms_is_not_told(seed):
    time_s = np.arange(2000) * TICK_S
    asked = 0.6 + 0.1 * np.sin(math.tau * 3.0 * time_s)  # keeps nothing of its peak 83 ms away
    # Friction wanders by as much, and about as fast.
    wander = np.convolve(rough(2.1, seed, rms=1.0, mean=0.0), np.hanning(101), mode="valid")
    assert "too slowly" in unknown(asked, asked + 0.07 * wander[:2000] / np.std(wander))


@pytest.mark.parametrize("seed", range(3))
def test_friction_that_does_not_follow_tells_nothing(seed):
    asked, _ = record(cloth, 0.040, 5.0, 0.030, seed)
    assert "does not follow" in unknown(asked, rough(5.0, seed))


def test_too_short_a_record_tells_nothing():
    asked, felt = record(cloth, 0.040, 0.15, 0.030, 7, lifts=False)
    assert "sliding" in unknown(asked, felt)
    assert "sliding" in unknown(np.full(3000, np.nan), rough(3.0, 8))
