"""How well a load of 0.5 N is held at 20 mm/s while 80 V are switched in mid-stroke: by the loop
with the settings' gains, by the loop with tuned gains, and without a loop.

The fingers are a third to three times as stiff as the settings say, with exponents of 1.5, 1.75 and
2, pulse, tremor and relaxation; the plate rises by 5 mm/m. The stage answers within 4 ms and has an
LTS150's limits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from benchmarks.claim import Claim
from haptic_driver.lab.load_tuning import tune
from haptic_driver.rig.load_controller import LoadSettings
from hw.finger.body import FingerBody, PowerLaw
from tests.haptic_driver.rig.load_rig import DT_S, Finger, Score, score, slow_part

TARGET_N = 0.5
FACTORS = (1.0 / 3.0, 1.0, 3.0)
EXPONENTS = (1.5, 1.75, 2.0)
SECONDS = 12.0
FIXED = LoadSettings(TARGET_N, depth_m=5e-3, softest_n_per_m=200.0)
MASS_KG = TARGET_N / 9.81  # of the weights
DAMPING = 0.2  # of their guide and the hand: assumed, as a share of the critical one


class Case(NamedTuple):
    factor: float
    exponent: float

    def elastic(self) -> Callable[[float], float]:
        law = PowerLaw(exponent=self.exponent)
        return lambda depth_m: self.factor * law(depth_m)

    def finger(self) -> Finger:
        return Finger(self.elastic(), voltage_on=switched)


def switched(time_s: float) -> bool:
    return time_s % 1.0 < 0.5


def tuned(case: Case) -> LoadSettings:
    """By the steps of `haptic load tune` on the same finger."""
    with case.finger().loop(FIXED) as loop:
        loop.settle(10.0)
        found = tune(loop)
    return replace(FIXED, stiffness_n_per_m=found.stiffness_n_per_m)


def by_weights(case: Case) -> tuple[float, float]:
    """Shares of the load below and above 5 Hz under a mass on a guide without friction: it follows
    the plate by itself, and swings on the fingertip.
    """
    body, friction_n, rise_m = FingerBody(case.elastic()), 0.0, 0.0
    depth_m, speed_m_s, loads = 1.2e-3, 0.0, []
    stiffness = case.factor * 700.0
    damping = 2.0 * DAMPING * math.sqrt(stiffness * MASS_KG)
    for i in range(round((4.0 + SECONDS) / DT_S)):
        slides = i * DT_S >= 4.0
        on = switched(i * DT_S)
        rise_m += 0.1e-3 * DT_S if slides else 0.0
        cof = (0.7 if on else 0.4) if slides else 0.0
        friction_n += (cof * body.load_n - friction_n) * 0.8
        load_n = body.step(
            DT_S, depth_m + rise_m, attraction_n=0.25 if on else 0.0, friction_n=friction_n
        )
        speed_m_s += (TARGET_N - load_n - damping * speed_m_s) / MASS_KG * DT_S
        depth_m += speed_m_s * DT_S
        if slides:
            loads.append(load_n / TARGET_N)
    held = np.array(loads)
    slow = slow_part(held)
    return float(np.sqrt(np.mean((slow - 1.0) ** 2))), float(np.std(held - slow))


def locked(case: Case) -> tuple[float, float]:
    """The same with the stage locked where the load was there."""
    finger = case.finger()
    loop = finger.loop(FIXED)
    loop.settle(10.0)
    since_s, finger.slides = finger.now_s, True
    finger.sleep(SECONDS)
    held = finger.load(since_s, since_s + SECONDS - DT_S) / TARGET_N
    slow = slow_part(held)
    return float(np.sqrt(np.mean((slow - 1.0) ** 2))), float(np.std(held - slow))


def run() -> Iterator[Claim]:
    cases = [Case(factor, exponent) for factor in FACTORS for exponent in EXPONENTS]
    by_loop = {
        "fixed gains": [score(case.finger(), FIXED, SECONDS) for case in cases],
        "tuned gains": [score(case.finger(), tuned(case), SECONDS) for case in cases],
    }
    for gains, found in by_loop.items():
        yield from _held(gains, found)
    for what, way in (("by weights, a free guide", by_weights), ("with the stage locked", locked)):
        slow, fast = np.array([way(case) for case in cases]).T
        said = f"{slow.max():.1%} rms below 5 Hz at worst, {np.median(slow):.1%} at the median"
        yield Claim(f"0.5 N {what}", f"{said}; above 5 Hz {fast.min():.1%} to {fast.max():.1%}")


def _held(gains: str, found: list[Score]) -> Iterator[Claim]:
    what = f"0.5 N by the loop, {gains}"
    settled, over, slow, fast = (np.array(column) for column in zip(*map(_row, found), strict=True))
    said = f"{slow.max():.1%} at worst, {np.median(slow):.1%} at the median"
    yield Claim(f"{what}: rms below 5 Hz", said, "at most 5 %", bool(slow.max() <= 0.05))
    said = f"within {settled.max():.2f} s, overshoot {over.max():.0%} at most"
    holds = bool(settled.max() <= 1.0 and over.max() <= 0.2)
    yield Claim(f"{what}: settled within 10 %", said, "within 1 s, at most 20 %", holds)
    said = f"{fast.min():.1%} to {fast.max():.1%} of the load: beyond the stage"
    yield Claim(f"{what}: tremor above 5 Hz", said)


def _row(one: Score) -> tuple[float, float, float, float]:
    return one.settled_s, one.overshoot, one.slow, one.fast
