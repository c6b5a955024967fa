"""How far off a rig renders a place, against strokes whose velocity changes as the filter says."""

import datetime
import math

import numpy as np
import pytest

from haptic_driver.render.finger import FingerSettings
from haptic_driver.rig.parts.finger_trackers import EvdevFingerConfig, Reports
from haptic_driver.rig.placement import at_turns, placement

PANEL = Reports(0.02, 2e-4, 0.02 / math.sqrt(12.0))


def settings_of(latency_s, reports):
    return FingerSettings(
        output_latency_s=latency_s,
        position_noise_m=reports.noise_m,
        report_jitter_s=reports.jitter_s,
    )


def of(latency_s, speed_m_s, reports=PANEL):
    return placement(settings_of(latency_s, reports), reports, speed_m_s)


def test_half_and_all_but_a_twentieth_of_the_errors_are_within_what_is_said():
    found = of(0.02, 0.137)
    assert found.share_beyond(found.median_m) == pytest.approx(0.5, abs=1e-3)
    assert found.share_beyond(found.most_m) == pytest.approx(0.05, abs=1e-3)
    assert found.share_beyond(math.inf) == 0.0


def test_what_is_not_known_of_a_stroke_is_no_less_than_what_its_velocity_may_change():
    """By the integral of white noise over the time ahead, twice: a bound no filter goes below."""
    ahead_s, speed_m_s = 0.05, 0.2
    least_m = math.sqrt((0.01 + 5.0 * 0.5 * speed_m_s**2) * ahead_s**3 / 3.0)
    assert all(least_m < std_m < 4.0 * least_m for std_m in of(ahead_s, speed_m_s).stds_m)


@pytest.mark.parametrize("speed_m_s", [0.05, 0.137, 0.5])
def test_beside_a_turn_a_place_is_off_by_what_the_finger_turns_back_meanwhile(speed_m_s):
    """A tracker that knows place and velocity without doubt, 40 ms ahead, errs by half of the
    deceleration times the square of that time, in the middle of a turn of a 2 Hz sine. It is a
    little less beside the middle, and less than 40 ms off where reports come each millisecond.
    """
    exact = Reports(0.001, 1e-9)
    ahead_s = 0.04
    bound_m = 0.5 * math.tau * 2.0 * speed_m_s * ahead_s**2
    median_m, most_m = at_turns(settings_of(ahead_s, exact), exact, speed_m_s)
    assert 0.85 * bound_m < median_m < most_m < 1.1 * bound_m


def test_a_slower_panel_and_a_later_output_are_further_off_beside_a_turn():
    fast = Reports(0.005, 2e-4)
    medians_m = [
        at_turns(settings_of(latency_s, reports), reports, 0.137)[0]
        for latency_s, reports in ((0.0, fast), (0.02, fast), (0.02, PANEL), (0.04, PANEL))
    ]
    assert medians_m == sorted(medians_m)
    assert medians_m[-1] > 5.0 * medians_m[0]


def test_a_panel_is_told_by_its_rate_and_its_counts():
    """10 counts per mm along x, 5 along y: the coarser one."""
    matrix = [[1e-4, 0.0, 0.0], [0.0, 2e-4, 0.0]]
    said = {"kind": "evdev", "device": "/dev/null", "measured_at": datetime.date(2024, 1, 1)}
    panel = EvdevFingerConfig(**said, placeholder=False, report_rate_hz=50.0, matrix_m=matrix)
    found = panel.reports()
    assert found[:2] == (0.02, 2e-4)
    # a time that is anywhere within 20 ms, by a histogram of it
    assert found.jitter_s == pytest.approx(np.std(np.linspace(0.0, 0.02, 100_001)), rel=1e-3)
    known = panel.model_copy(update={"report_jitter_s": 0.001})
    assert known.reports().jitter_s == 0.001
