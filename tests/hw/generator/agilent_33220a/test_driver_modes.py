"""The 33220A driver on the simulated generator: its range, changes by others, two threads."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import pytest

from hw.errors import BadReply
from hw.generator.settings import RangePolicy
from tests.hw.generator.asking import read_output
from tests.hw.generator.kinds import SETTINGS, Bench


def connected(**settings: Any) -> Bench:
    bench = Bench("agilent_33220a", replace(SETTINGS, **settings))
    bench.connect()
    return bench


@pytest.mark.parametrize("policy", list(RangePolicy))
def test_only_autoranging_switches_relays_while_amplitudes_change(policy):
    bench = connected(range_policy=policy)
    bench.driver.set_point(250.0, 2.0)
    bench.driver.set_output(True)
    before = bench.generator.range_switches
    for voltage_v in (300.0, 50.0, 150.0, 2.0, 300.0):
        bench.driver.set_point(250.0, voltage_v)
        assert bench.voltage_v == pytest.approx(voltage_v)
    assert (bench.generator.range_switches == before) is (policy is RangePolicy.FIXED)


def test_a_range_is_never_visited_with_the_output_on():
    """Somebody connects to a generator that puts out something; the highest amplitude is tried with
    it off.
    """
    bench = connected()
    bench.driver.set_point(250.0, 20.0)
    bench.driver.set_output(True)
    bench.peak_v = 0.0
    bench.say("VOLT:RANG:AUTO ON;:VOLT:UNIT VRMS")
    with pytest.raises(BadReply):
        bench.driver.set_point(250.0, 30.0)
    bench.say("OUTP 1")
    with pytest.raises(BadReply, match="changes its range"):
        bench.driver.set_point(250.0, 30.0)
    bench.driver.set_point(250.0, 30.0)
    bench.driver.set_output(True)
    assert bench.peak_v <= 30.0 * 2.0 * math.sqrt(2.0)


def test_a_load_changed_behind_the_driver_is_noticed_before_switching_on():
    bench = connected()
    bench.driver.set_point(250.0, 120.0)
    bench.say(bench.words.higher)
    with pytest.raises(BadReply):
        bench.driver.set_output(True)
    assert bench.peak_v == 0.0


@pytest.mark.timeout(60)
def test_two_threads_on_one_driver_never_cross_replies():
    """Every set point is read back: a crossed reply, or a belief about what another thread changed,
    is a BadReply.

    One thread changes voltages at one frequency, the other frequencies at one of these voltages.
    """
    driver = connected().driver

    def hammer(points: list[tuple[float, float]]) -> list[bool | None]:
        states = []
        for _ in range(100):
            for point in points:
                driver.set_point(*point)
                states.append(read_output(driver))
        return states

    with ThreadPoolExecutor(2) as pool:
        states = list(
            pool.map(hammer, ([(100.0, 20.0), (100.0, 30.0)], [(200.0, 20.0), (300.0, 20.0)]))
        )
    assert states == [[False] * 200] * 2
    assert driver.close() is True
