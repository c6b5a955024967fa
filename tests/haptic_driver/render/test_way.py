"""Waves finer than places are known: met along the finger's reports at their own pace."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_driver.render.finger import INITIAL, FingerSettings, track
from haptic_driver.render.texture import Waves
from haptic_driver.render.way import follow
from haptic_driver.signals import FingerSample

TICK_S, INTERVAL_S, LONGEST_S = 1e-3, 0.02, 0.05
PIXEL_M = 0.17e-3


def placed(reports, ticks, settings=None):
    """Of each tick the place by the way, its velocity, and the place that the filter expects."""
    settings = settings or FingerSettings(longest_age_s=LONGEST_S)
    tracking, way, found = INITIAL, None, []
    due = iter([*reports, None])
    report, following = next(due), next(due)
    for k in range(ticks):
        now_s = k * TICK_S
        while following is not None and following[0] <= now_s:
            report, following = following, next(due)
        sample = FingerSample(*report, 0.0, 0.5, 0.0, now_s)
        tracking, felt = track(settings, tracking, sample)
        way, at = follow(way, sample, felt, LONGEST_S)
        found.append((at.position_x_m, at.velocity_x_m_s, felt.position_x_m))
    return np.array(found).T


def test_a_steady_finger_is_followed_one_report_late():
    speed_m_s = 0.137
    reports = [(k * INTERVAL_S, speed_m_s * k * INTERVAL_S) for k in range(20)]
    place_m, velocity_m_s, _ = placed(reports, 380)
    time_s = np.arange(380) * TICK_S
    late = time_s >= INTERVAL_S
    assert place_m[late] == pytest.approx(speed_m_s * (time_s[late] - INTERVAL_S), abs=1e-9)
    assert velocity_m_s[late] == pytest.approx(speed_m_s, rel=1e-9)


@given(
    steps=st.lists(
        st.tuples(st.floats(0.002, 0.2), st.floats(-0.01, 0.01)), min_size=2, max_size=12
    )
)
def test_whatever_is_reported_the_place_does_not_jump_and_stays_among_the_reports(steps):
    waits_s, moves_m = np.array(steps).T
    reports = list(zip(np.cumsum(waits_s) - waits_s[0], np.cumsum(moves_m), strict=True))
    ticks = math.ceil((reports[-1][0] + 0.06) / TICK_S)
    place_m, _, _ = placed(reports, ticks)
    x_m = [x_m for _, x_m in reports]
    assert min(x_m) - 1e-12 <= place_m.min() <= place_m.max() <= max(x_m) + 1e-12
    # no way is shorter than the shortest wait, and none longer than from end to end
    fastest_m = (max(x_m) - min(x_m)) * TICK_S / min(waits_s[1:].min(), LONGEST_S)
    assert np.abs(np.diff(place_m)).max() <= fastest_m + 1e-12
    assert place_m[-1] == pytest.approx(x_m[-1], abs=1e-12)


def test_where_a_report_is_late_the_finger_still_slides_for_waves_that_go_by_its_speed():
    """Its place waits; friction would jump to that of a finger at rest."""
    cof = np.array([[[0.5] * 8], [[0.7] * 8]])
    waves = Waves(cof, np.array([0.01, 0.2]), np.array([0.5]), 0.01, 0.0, (0.1, 0.5))
    way, tracking = None, INITIAL
    for k in range(4):
        sample = FingerSample(k * INTERVAL_S, 0.2 * k * INTERVAL_S, 0.0, 0.5)
        tracking, felt = track(FingerSettings(), tracking, sample)
        way, at = follow(way, sample, felt, LONGEST_S)
    late = sample._replace(now_s=sample.time_s + 2.0 * INTERVAL_S)
    tracking, felt = track(FingerSettings(), tracking, late)
    _, at = follow(way, late, felt, LONGEST_S)
    assert at.velocity_x_m_s == 0.0
    assert waves.cof_under(at) == pytest.approx(0.7, abs=1e-3)
    assert waves.cof_along(at, np.array([1e-3])) == pytest.approx(0.7, abs=1e-3)


def test_a_finger_that_lifts_begins_anew():
    settings = FingerSettings()
    way, tracking = None, INITIAL
    for time_s, x_m, load_n in ((0.0, 0.0, 0.5), (0.02, 0.002, 0.5), (0.04, 0.0, 0.0)):
        sample = FingerSample(time_s, x_m, 0.0, load_n)
        tracking, felt = track(settings, tracking, sample)
        way, at = follow(way, sample, felt, LONGEST_S)
    assert way is None
    assert at is felt
    sample = FingerSample(0.06, 0.05, 0.0, 0.5)
    _, felt = track(settings, tracking, sample)
    assert follow(way, sample, felt, LONGEST_S)[1].position_x_m == 0.05


def test_fine_waves_have_their_length_by_time_and_not_by_space():
    """Two millimetres at 50 reports a second, in pixels and at odd moments, 20 ms ahead.

    A wave of the right length is one that fits that of the finger at some delay.
    """
    random = np.random.default_rng(5)
    time_s = np.arange(1000) * TICK_S
    speed_m_s = 0.137 + 0.03 * np.sin(2.0 * math.pi * time_s)
    finger_m = np.cumsum(speed_m_s) * TICK_S
    reports = []
    for k in range(50):
        seen = max(20 * k - int(random.integers(0, 10)), 0)  # polled by the panel up to 10 ms ago
        reports.append((20 * k * TICK_S, round(finger_m[seen] / PIXEL_M) * PIXEL_M))
    settings = FingerSettings(
        output_latency_s=0.02,
        longest_age_s=LONGEST_S,
        position_noise_m=PIXEL_M / math.sqrt(12.0),
        report_jitter_s=0.01 / math.sqrt(12.0),
    )
    by_time_m, _, by_space_m = placed(reports, 1000, settings)

    def fit(place_m):
        felt, rendered = (np.exp(1j * math.pi * x_m / 1e-3) for x_m in (finger_m, place_m))
        at = range(200, 900, 50)
        return np.mean([_fit(felt[a : a + 100], rendered[a - 10 : a + 200]) for a in at])

    assert fit(by_time_m) > 0.8
    assert 1.0 - fit(by_time_m) < 0.5 * (1.0 - fit(by_space_m))


def _fit(wave, rendered):
    """How well a wave [n] is found in a longer one, at the best delay: 1 where it is there."""
    found = np.correlate(rendered, wave, "valid")
    return np.abs(found).max() / wave.size
