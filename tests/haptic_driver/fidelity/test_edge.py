"""Stages of a touch, from ticks in which every time is known."""

import numpy as np
import pytest

from haptic_driver.fidelity.edge import Touch, stages, touches
from haptic_driver.processes.samples import SAMPLE

BEGINS, RISE_V, IDLE_V = (
    100,
    10.0,
    1.0,
)  # the tick of the touch; per tick; what the monitor rests at


def ticks(*, edge=140, came_out_v=60.0, look=10, lift=500):
    """A touch at tick 100 by a force read 1.2 ms before, used after 0.1 ms, in 0.2 ms. The command
    rises by 10 V a tick up to 100 V. The monitor shows `came_out_v` at a tick, 100 V with later
    looks.
    """
    made = np.zeros(700, SAMPLE)
    tick = np.arange(made.size)
    made["tick"], made["time_s"] = tick, 1e-3 * tick
    made["lateness_s"], made["compute_s"] = 1e-4, 2e-4
    made["felt_time_s"] = made["time_s"] - 1.1e-3
    made["finger_time_s"] = 0.05
    made["asked_time_s"] = made["time_s"] + 0.035
    made["in_contact"] = (tick >= BEGINS) & (tick < lift)
    made["voltage_v"] = made["in_contact"] * np.clip((tick - BEGINS + 1) * RISE_V, 0.0, 100.0)
    made["output_on"] = 1
    wobble = 0.01 * (tick // look % 2)
    made["monitor_voltage_v"] = np.where(tick < edge, IDLE_V, came_out_v) + wobble
    made["monitor_voltage_v"][edge + look :] = 100.0 + wobble[edge + look :]
    return made


def test_each_stage_of_a_touch_has_its_time():
    (touch,), left_out = touches(ticks())
    # 60 V is commanded in the sixth tick, 5 ms after the first; a monitor reads it at 140.1 ms.
    wanted = Touch(1.2e-3, 0.2e-3, 5e-3, 140.1e-3 - 105.3e-3, 35e-3, 10e-3)
    assert touch == pytest.approx(wanted, abs=1e-9)
    assert touch.total_s == pytest.approx(140.1e-3 - 98.9e-3)  # from the reading to the edge
    assert left_out == {}


def test_a_touch_by_a_new_place_counts_from_its_report():
    made = ticks()
    made["finger_time_s"][BEGINS:] = made["time_s"][BEGINS] - 3e-3
    assert touches(made)[0][0].read_s == pytest.approx(3.1e-3)
    made["felt_time_s"] = np.nan  # nor is there a force sensor
    assert touches(made)[0][0].read_s == pytest.approx(3.1e-3)


@pytest.mark.parametrize(
    ("changes", "off_before", "why"),
    [
        ({"lift": 130}, False, "lifted"),
        ({"came_out_v": IDLE_V + 4.0, "edge": 690}, False, "no edge"),
        ({"came_out_v": 200.0}, False, "more than was commanded"),
        ({}, True, "switched on first"),
    ],
)
def test_a_touch_that_tells_nothing_is_left_out_with_its_reason(changes, off_before, why):
    made = ticks(**changes)
    made["output_on"][:BEGINS] = not off_before
    found, left_out = touches(made)
    assert found == []
    ((said, count),) = left_out.items()
    assert (why in said, count) == (True, 1)


def test_without_a_monitor_the_stages_up_to_the_tick_are_known_and_no_others():
    made = ticks()
    made["monitor_voltage_v"] = np.nan
    told = stages(touches(made)[0], report_s=0.004, dialogue_s=0.001)
    assert [one.name for one in told] == ["panel", "read", "tick", "lead"]
    assert (told[0].median_s, told[0].most_s) == (0.002, pytest.approx(0.0038))


def test_median_and_95_percent_of_several_touches():
    found = [touches(ticks(edge=140 + 2 * n))[0][0] for n in range(5)]
    told = {one.name: one for one in stages(found, float("nan"), 0.001)}
    assert list(told) == ["read", "tick", "wait", "output", "total", "lead"]
    assert told["output"].median_s == pytest.approx(38.8e-3)
    assert told["output"].most_s == pytest.approx(
        42.4e-3
    )  # four fifths from the fourth to the last
    assert "generator 1 ms" in told["output"].said
