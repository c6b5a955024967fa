"""How well the daemon renders now, told of samples that are made for it."""

import numpy as np
import pytest

from haptic_driver.daemon.judge import (
    MOST_TICKS,
    Judge,
    JudgeSettings,
    MeasuredLatency,
    latency_in,
    measured_latency,
)
from haptic_driver.fidelity.lag import Latency
from haptic_driver.fidelity.perception import load_perception
from haptic_driver.processes.samples import SAMPLE
from haptic_driver.processes.shared_memory import NO_ORDER

LOAD_N = 0.5


def ticks(count, first=0, asked=0.6, felt=0.6):
    """A finger that slides all the time, one tick per millisecond."""
    made = np.zeros(count, SAMPLE)
    made["tick"] = first + np.arange(count)
    made["time_s"] = 1e-3 * made["tick"]
    made["in_contact"], made["reachable"], made["speed_m_s"] = 1, 1, 0.05
    made["target_cof"], made["expected_cof"], made["measured_cof"] = asked, asked, felt
    made["normal_force_n"], made["lateral_force_n"] = LOAD_N, -LOAD_N * np.asarray(felt)
    return made


@pytest.fixture
def judge(shared):
    return Judge(JudgeSettings(load_perception(), 100.0, 0.0), shared)


@pytest.fixture
def rendered(shared):
    """Write ticks as render does, for a target of an arming."""

    def write(samples, target=1, arming=1, rendering=True):
        order = NO_ORDER._replace(arming=arming, target=target, rendering=rendering)
        shared.order.write(order)
        for sample in samples:
            shared.ring.write(sample.item())

    return write


def test_errors_of_a_quarter_are_told_beside_what_a_constant_reaches(judge, rendered):
    asked = np.tile(np.repeat([0.5, 0.7], 500), 4)
    high = np.repeat([False, True, False, False], 1000)
    rendered(ticks(0))
    judge.look()
    rendered(ticks(4000, asked=asked, felt=asked * np.where(high, 1.06, 1.0)))
    said = judge.look().fidelity
    assert (said.first_tick, said.last_tick, said.reach_hz) == (0, 3999, 100.0)
    assert said.sliding_time_s == pytest.approx(4.0)
    assert said.share_within_5_percent == pytest.approx(0.75, abs=0.01)
    assert said.constant_share_within_5_percent == pytest.approx(0.5, abs=0.01)
    assert said.relative_error_rms == pytest.approx(0.03, abs=0.001)  # 6 % of a quarter
    assert "a constant" in said.said[0]


def test_a_new_target_is_judged_by_its_own_ticks(judge, rendered):
    rendered(ticks(0))
    judge.look()
    rendered(ticks(1000, felt=0.9))
    assert judge.look().fidelity.share_within_5_percent == 0.0
    rendered(ticks(0), target=2)
    assert judge.look().fidelity is None
    rendered(ticks(1000, first=1000, felt=0.6), target=2)
    assert judge.look().fidelity.share_within_5_percent == 1.0


def test_what_is_older_than_10_seconds_counts_no_more(judge, rendered):
    rendered(ticks(0))
    judge.look()
    rendered(ticks(1000, felt=0.9))
    rendered(ticks(MOST_TICKS, first=1000, felt=0.6))
    found = judge.look().fidelity
    assert (found.first_tick, found.share_within_5_percent) == (1000, 1.0)


def test_what_was_found_stands_once_the_output_is_off(judge, rendered):
    rendered(ticks(0))
    judge.look()
    rendered(ticks(4000, felt=np.repeat([0.9, 0.6], 2000)))
    found = judge.look()
    assert found.fidelity.share_within_5_percent == pytest.approx(0.5, abs=0.01)
    rendered(ticks(MOST_TICKS - 2000, first=4000, asked=np.nan), rendering=False)
    assert judge.look() == found
    rendered(ticks(1000, first=4000 + MOST_TICKS), arming=2)
    assert judge.look() != found


def test_without_a_target_or_sliding_nothing_is_told(judge, rendered):
    rendered(ticks(0))
    judge.look()
    rendered(ticks(1000, asked=np.nan))
    found = judge.look()
    assert (found.arming, found.fidelity, found.latency.lag_s) == (1, None, None)
    resting = ticks(1000, first=1000)
    resting["speed_m_s"] = 0.0
    rendered(resting)
    assert judge.look().fidelity is None


@pytest.mark.parametrize("late", [0, 17])
def test_the_lag_behind_what_is_expected_is_what_the_budget_misses(rng, late):
    texture = np.convolve(rng.normal(size=5100), np.hanning(40), "valid")
    texture = 0.6 + 0.05 * texture / np.std(texture)
    felt = np.roll(texture, late)
    found = latency_in(ticks(texture.size, asked=texture, felt=felt))
    assert found.lag_s == pytest.approx(1e-3 * late, abs=2e-4)
    said = measured_latency(found, 0.030)
    assert said.measured_s == pytest.approx(0.030 + 1e-3 * late, abs=2e-4)
    assert said.is_far_off is bool(late)


def test_half_a_second_tells_no_latency(rng):
    """Linen, at one speed for so long, fitted best at the next thread."""
    asked = 0.6 + 0.05 * np.sin(np.arange(500) * 2.0 * np.pi / 41.0) + rng.normal(size=500) * 0.01
    found = latency_in(ticks(500, asked=asked, felt=np.roll(asked, 41)))
    assert (found.lag_s, found.why) == (None, "less than 2 s of sliding")


def test_a_lag_that_is_unknown_small_or_unsure_is_not_far_off():
    assert not measured_latency(Latency(None, None, None, [], "the target"), 0.03).is_far_off
    assert not MeasuredLatency(0.0399, 0.0001, 0.03, "").is_far_off
    assert not MeasuredLatency(0.05, 0.0031, 0.03, "").is_far_off
    assert MeasuredLatency(0.0199, 0.0001, 0.03, "").is_far_off
