"""Finger stage: contact with hysteresis, velocity, position at output time, and what bad samples
do.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import linalg

from haptic_driver.errors import BadInputError
from haptic_driver.render.finger import (
    CHANGE_PER_S,
    INITIAL,
    LEAST_CHANGE_M2_S3,
    FingerSettings,
    track,
)
from haptic_driver.signals import FingerSample

PRESSED_N = 0.5
SETTINGS = FingerSettings()
anything = st.floats(allow_nan=True, allow_infinity=True)


def follow(samples, settings=SETTINGS):
    state, fingers = INITIAL, []
    for sample in samples:
        state, finger = track(settings, state, FingerSample(*sample))
        fingers.append(finger)
    return fingers


def slide(times_s, speed_x_m_s, speed_y_m_s=0.0, start_m=0.02):
    return [(t, start_m + speed_x_m_s * t, start_m + speed_y_m_s * t, PRESSED_N) for t in times_s]


@given(
    speed_x=st.floats(-0.5, 0.5),
    speed_y=st.floats(-0.5, 0.5),
    intervals=st.lists(st.floats(0.5e-3, 20e-3), min_size=1, max_size=60),
    latency=st.floats(0.0, 0.05),
)
def test_steady_slide_has_no_bias_in_velocity_or_position(speed_x, speed_y, intervals, latency):
    times = [0.0]
    for interval in intervals:
        times.append(times[-1] + interval)
    finger = follow(slide(times, speed_x, speed_y), FingerSettings(output_latency_s=latency))[-1]
    # rounding of positions near 1 m (2e-16) over 0.5 ms stays below 1e-12 m/s; the margin is for
    # accumulation
    assert finger.velocity_x_m_s == pytest.approx(speed_x, abs=1e-10)
    assert finger.velocity_y_m_s == pytest.approx(speed_y, abs=1e-10)
    assert finger.position_x_m == pytest.approx(0.02 + speed_x * (times[-1] + latency), abs=1e-11)
    assert finger.position_y_m == pytest.approx(0.02 + speed_y * (times[-1] + latency), abs=1e-11)


def test_samples_of_a_slow_panel_read_by_a_fast_tick_give_the_same_velocity():
    repeated = [sample for sample in slide([0.0, 0.010, 0.020, 0.030], 0.1) for _ in range(10)]
    fingers = follow(repeated)
    assert fingers[-1].velocity_x_m_s == pytest.approx(0.1, abs=1e-12)
    assert fingers[15].velocity_x_m_s == fingers[10].velocity_x_m_s


def turning(report_s=0.01, change_m2_s3=0.02, seed=1):
    """A finger whose acceleration is white noise, at 1 kHz, and what a panel of 0.2 mm reports."""
    rng = np.random.default_rng(seed)
    dt_s, count = 1e-3, 4000
    speeds = np.cumsum(rng.normal(0.0, math.sqrt(change_m2_s3 * dt_s), (count, 2)), axis=0)
    places = 0.05 + np.cumsum(speeds * dt_s, axis=0)
    step = round(report_s / dt_s)
    reports = np.arange(0, count, step)
    told = 2e-4 * np.round(places[reports] / 2e-4)
    samples = [(dt_s * k, *told[i], PRESSED_N) for i, k in enumerate(reports.tolist())]
    return places, reports, samples


@pytest.mark.parametrize("interval_s", [0.001, 0.01, 0.02])
def test_the_filter_settles_at_the_solution_of_the_riccati_equation(interval_s):
    """By scipy's solver, which knows nothing of how reports come one after the other."""
    noise_m, jitter_s, speed_m_s = 6e-5, 0.003, 0.2
    settings = FingerSettings(position_noise_m=noise_m, report_jitter_s=jitter_s)
    state = INITIAL
    for sample in slide([k * interval_s for k in range(2000)], speed_m_s):
        state, _ = track(settings, state, FingerSample(*sample))
    dt, square = interval_s, 0.5 * speed_m_s**2
    move = np.array([[1.0, dt], [0.0, 1.0]])
    change = np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    change *= LEAST_CHANGE_M2_S3 + CHANGE_PER_S * square
    noise = np.array([[noise_m**2 + jitter_s**2 * square]])
    before = linalg.solve_discrete_are(move.T, np.eye(2)[:, :1], change, noise)
    after = before - np.outer(before[:, 0], before[0]) / (before[0, 0] + noise[0, 0])
    found = state.variance_m2, state.covariance_m2_s, state.variance_m2_s2
    # the filter reckons the doubt of the speed to its square: some 10 % of it here
    assert found == pytest.approx((after[0, 0], after[0, 1], after[1, 1]), rel=0.2)


@pytest.mark.parametrize("report_s", [0.004, 0.01, 0.02])
def test_the_standard_deviation_is_that_of_the_error(report_s):
    latency_s, off, std = 0.02, [], []
    settings = FingerSettings(output_latency_s=latency_s, position_noise_m=2e-4 / math.sqrt(12.0))
    for seed in range(3):
        # as much as the filter takes for granted of a finger that is slow
        places, reports, samples = turning(report_s, LEAST_CHANGE_M2_S3, seed)
        state = INITIAL
        for k, sample in zip(reports.tolist(), samples, strict=True):
            state, finger = track(settings, state, FingerSample(*sample))
            if k > 100 and k + 20 < len(places):
                std += [state.std_m(latency_s)] * 2
                off += [*(places[k + 20] - (finger.position_x_m, finger.position_y_m))]
    share = np.sqrt(np.mean(np.square(off) / np.square(std)))
    # faster than the floor the filter reckons with more change than there is, so it is cautious
    assert 0.5 < share < 1.15


def test_nobody_knows_where_a_finger_of_one_report_goes():
    state, _ = track(SETTINGS, INITIAL, FingerSample(0.0, 0.02, 0.02, PRESSED_N))
    assert state.std_m(0.0) == pytest.approx(SETTINGS.position_noise_m)
    assert state.std_m(0.01) == math.inf


def test_doubtful_times_make_a_filter_slower_to_believe():
    """A panel that scans on its own tells places up to an interval old: steps of 1 and 2 scans."""
    ages_s = [0.0, 0.005, 0.0, 0.005, 0.002, 0.007] * 20
    samples = [
        (0.01 * k, 0.02 + 0.2 * (0.01 * k - age), 0.02, PRESSED_N) for k, age in enumerate(ages_s)
    ]
    errors = [
        np.std([f.velocity_x_m_s for f in follow(samples, FingerSettings(report_jitter_s=j))[20:]])
        for j in (0.0, 0.01 / math.sqrt(12.0))
    ]
    assert errors[1] < errors[0] / 2


def test_two_samples_at_almost_the_same_time_make_no_speed():
    fingers = follow([(0.0, 0.02, 0.02, PRESSED_N), (1e-9, 0.021, 0.02, PRESSED_N)])
    assert fingers[-1].velocity_x_m_s == 0.0
    assert fingers[-1].position_x_m == 0.021


def test_contact_has_hysteresis():
    forces = [0.0, 0.07, 0.08, 0.06, 0.05, 0.049, 0.06, 0.079, 0.081]
    fingers = follow([(k * 1e-3, 0.02, 0.02, force) for k, force in enumerate(forces)])
    assert [finger.in_contact for finger in fingers] == [
        False,
        False,
        True,
        True,
        True,
        False,
        False,
        False,
        True,
    ]


def test_a_new_touch_elsewhere_starts_without_the_old_velocity():
    first = slide([k * 1e-3 for k in range(50)], 0.2)
    lifted = (0.050, 0.03, 0.02, 0.0)
    second = [(0.051 + k * 1e-3, 0.09, 0.07, PRESSED_N) for k in range(3)]
    fingers = follow([*first, lifted, *second], FingerSettings(output_latency_s=0.02))
    assert fingers[50].in_contact is False
    assert fingers[50].velocity_x_m_s == 0.0
    assert [(f.position_x_m, f.velocity_x_m_s, f.in_contact) for f in fingers[51:]] == [
        (0.09, 0.0, True)
    ] * 3


@pytest.mark.parametrize("field", range(4))
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_sample_that_is_not_finite_is_no_contact_and_the_next_recovers(field, bad):
    samples = slide([k * 1e-3 for k in range(10)], 0.1)
    broken = list(samples[5])
    broken[field] = bad
    samples[5] = tuple(broken)
    fingers = follow(samples)
    assert [finger.in_contact for finger in fingers] == [True] * 5 + [False] + [True] * 4
    assert fingers[5].normal_force_n == 0.0
    assert fingers[-1].velocity_x_m_s == pytest.approx(0.1, abs=1e-10)


def test_time_that_goes_back_is_no_contact_and_the_next_recovers():
    fingers = follow(slide([1.0, 1.001, 0.5, 0.501, 0.502], 0.1))
    assert [finger.in_contact for finger in fingers] == [True, True, False, True, True]
    assert fingers[-1].velocity_x_m_s == pytest.approx(0.1, abs=1e-10)


@given(st.lists(st.tuples(anything, anything, anything, anything), max_size=30))
def test_contact_always_comes_with_finite_position_velocity_and_force(samples):
    for finger in follow(samples, FingerSettings(output_latency_s=0.01)):
        if finger.in_contact:
            assert all(map(math.isfinite, finger[:6]))
            assert finger.normal_force_n >= SETTINGS.contact_off_n


@pytest.mark.parametrize(
    "wrong", [{"contact_on_n": 0.04}, {"contact_off_n": 0.0}, {"longest_age_s": math.inf}]
)
def test_settings_without_meaning_are_refused_by_name(wrong):
    with pytest.raises(BadInputError, match=next(iter(wrong))) as caught:
        FingerSettings(**wrong)
    assert caught.value.code == "bad_finger_settings"


def test_a_touch_counts_from_its_own_beginning_whatever_the_clock_says():
    """Friction that ages with contact once aged with the machine: 93.9 V at its start, 0 V a day
    later.
    """
    day_s = 86_400.0
    pressed = [(day_s + 0.1 * k, 0.02, 0.02, PRESSED_N) for k in range(4)]
    lifted = [(day_s + 0.4, 0.02, 0.02, 0.0)]
    again = [(day_s + 0.5 + 0.1 * k, 0.02, 0.02, PRESSED_N) for k in range(3)]
    seen = [finger.contact_s for finger in follow(pressed + lifted + again)]
    assert seen == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.0, 0.0, 0.1, 0.2])
