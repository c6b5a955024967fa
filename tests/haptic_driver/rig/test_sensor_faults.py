"""What a finger gets at most of a stage whose force sensor lies; `pytest -s` prints the loads."""

from __future__ import annotations

import random

import pytest

from haptic_driver.rig.load_controller import LoadSettings, Phase
from hw.finger.body import PowerLaw
from tests.haptic_driver.rig.load_rig import Finger
from tests.haptic_driver.rig.sensor_faults import (
    MOMENTS,
    Sensor,
    Trial,
    dead,
    drawn,
    last_bit,
    scaled,
    shifted,
    stays,
)

LIMIT_N = LoadSettings(0.5).load_limit_n
DRAWS = 500
KINDS = {
    "dead, 3 mN of noise": dead,
    "dead, its last bit toggles": last_bit,
    "repeats one number": lambda: stays(0.0),
    "repeats the load, 3 mN of noise": lambda: stays(3e-3),
    "sign turned": lambda: scaled(-1.0),
    "gain 0.1": lambda: scaled(0.1),
    "gain 0.2": lambda: scaled(0.2),
    "gain 0.5": lambda: scaled(0.5),
    "offset -0.6 N": lambda: shifted(-0.6),
    "offset -0.3 N": lambda: shifted(-0.3),
    "offset 0.3 N": lambda: shifted(0.3),
    "zero falls by 5 mN/s": lambda: shifted(0.0, -5e-3),
    "zero rises by 5 mN/s": lambda: shifted(0.0, 5e-3),
}
SAYS_NOTHING = {"dead, 3 mN of noise", "sign turned", "gain 0.1"}


# A usual finger gets less: its loads are printed for docs/load.md.
@pytest.mark.parametrize("factor", [pytest.param(1.0, marks=pytest.mark.soak), 3.0])
@pytest.mark.parametrize("name", KINDS)
def test_no_fault_of_the_sensor_presses_beyond_the_signed_limit(name, factor):
    drifts = "mN/s" in name
    moments, seconds = (["held"], 120.0) if drifts else (list(MOMENTS), 20.0)
    found = {moment: Trial(KINDS[name], moment, factor, seconds).run() for moment in moments}
    for moment, outcome in found.items():
        said = outcome.reason or "goes on"
        print(f"\n{name}, {moment}, {factor:g} x: {outcome.highest_n:.2f} N; {said}", end="")
    assert max(outcome.highest_n for outcome in found.values()) < LIMIT_N
    if name in SAYS_NOTHING and factor == 3.0:
        assert all(outcome.reason for outcome in found.values())


@pytest.mark.parametrize(("factor", "target_n"), [(0.8, 1.0), (3.0, 0.25)])
def test_a_finger_under_a_sensor_without_fault_is_held(target_n, factor):
    """For ten times as long as the slowest tissue takes to relax."""
    outcome = Trial(lambda: scaled(1.0), "held", factor, 40.0, LoadSettings(target_n)).run()
    assert outcome.reason == ""
    assert outcome.highest_n < 1.5 * target_n


def test_a_bit_that_says_moving_for_ever_ends_the_loop():
    """The stage said it moved, at 0.12 N of 0.5, and the loop said that it held."""
    finger = Finger()
    loop = finger.loop(LoadSettings(0.5))
    while finger.body.load_n < 0.12:
        loop.look()
    finger.instrument.faults.says_moving = True
    finger.held(loop, finger.now_s + 2.0)
    assert loop.state.phase is Phase.ENDED
    assert "says that it moves" in loop.state.reason


@pytest.mark.soak
def test_drawn_faults_of_the_sensor_never_press_beyond_the_signed_limit():
    draw = random.Random(58)
    highest: dict[str, list[float]] = {}
    for _ in range(DRAWS):
        kind, trial = drawn(draw)
        highest.setdefault(kind, []).append(trial.run().highest_n)
    everyone = sorted(load_n for loads in highest.values() for load_n in loads)
    for kind, loads in highest.items():
        print(f"\n{kind}: {len(loads)} draws, at most {max(loads):.2f} N", end="")
    shares = [(share, everyone[round(share * (DRAWS - 1))]) for share in (0.5, 0.9, 0.99, 1.0)]
    print("\n" + ", ".join(f"{share:.0%} at most {load_n:.2f} N" for share, load_n in shares))
    assert everyone[-1] < LIMIT_N


@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_the_way_to_a_finger_is_bounded_by_what_the_last_touch_needed(factor):
    """The sensor dies in the air after a first touch, and the reach alone would give 34 N."""
    law, sensor, settings = PowerLaw(), Sensor(dead()), LoadSettings(0.5, reach_m=10e-3)
    finger = Finger(lambda depth_m: factor * law(depth_m), sensor=sensor, tilt_m_s=0.0)
    with finger.loop(settings) as first:
        first.settle(10.0)
    sensor.since_s = finger.now_s
    again = finger.loop(settings, first.touch_m)
    with again:
        finger.held(again, finger.now_s + 20.0)
    assert "no finger is felt" in again.reason
    highest_n = max(load_n for time_s, load_n in finger.told if time_s > sensor.since_s)
    print(f"\nthe sensor dies before the second touch, {factor:g} x: {highest_n:.2f} N")
    assert highest_n < LIMIT_N
