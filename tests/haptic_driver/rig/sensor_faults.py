"""Force sensors that say what is not so, and what a finger gets of a stage that believes them."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from haptic_driver.rig.load_controller import LoadSettings, Phase
from hw.finger.body import PowerLaw
from hw.force.sensor import ForceReading
from tests.haptic_driver.rig.load_rig import SENSOR_NOISE_N, Finger

Says = Callable[[float, float], float]
"""Seconds since the fault began and the load that is felt, N -> what the sensor says, N."""

MOMENTS = {"in the air": -1.0, "at the touch": 0.1, "while it rises": 0.6, "held": 0.0}
HELD_S = 6.0  # from the beginning on


def dead(noise_n: float = SENSOR_NOISE_N) -> Says:
    draw = random.Random(1)
    return lambda since_s, load_n: draw.gauss(0.0, noise_n)


def last_bit(step_n: float = 0.5e-3) -> Says:
    bits = itertools.cycle((0.0, step_n))
    return lambda since_s, load_n: next(bits)


def stays(noise_n: float) -> Says:
    """At the load of that moment."""
    draw, first = random.Random(2), list[float]()

    def says(since_s: float, load_n: float) -> float:
        first.append(load_n)
        return first[0] + draw.gauss(0.0, noise_n)

    return says


def scaled(gain: float) -> Says:
    return lambda since_s, load_n: gain * load_n


def shifted(by_n: float, rate_n_s: float = 0.0) -> Says:
    return lambda since_s, load_n: load_n + by_n + rate_n_s * since_s


@dataclass
class Sensor:
    """It says the truth until `since_s`."""

    says: Says
    since_s: float = math.inf

    def __call__(self, time_s: float, load_n: float) -> ForceReading:
        said = self.says(time_s - self.since_s, load_n) if time_s >= self.since_s else load_n
        return ForceReading(time_s, said, 0.0, False)


class Outcome(NamedTuple):
    """The highest load of the finger in N, until it was let go; why; and when after the fault."""

    highest_n: float
    reason: str
    after_s: float


@dataclass(frozen=True)
class Trial:
    """A finger so many times as stiff as usual, and a fault that begins at one of `MOMENTS`."""

    says: Callable[[], Says]
    moment: str
    factor: float
    seconds: float = 20.0
    settings: LoadSettings = field(default_factory=lambda: LoadSettings(0.5))

    def run(self) -> Outcome:
        sensor, law = Sensor(self.says()), PowerLaw()
        finger = Finger(lambda depth_m: self.factor * law(depth_m), sensor=sensor, tilt_m_s=0.0)
        began_s, share = finger.now_s, MOMENTS[self.moment]
        loop = finger.loop(self.settings)
        while finger.now_s < began_s + self.seconds and loop.look().phase is not Phase.ENDED:
            is_there = finger.body.load_n >= share * self.settings.target_n
            if sensor.since_s == math.inf and (
                is_there if share else finger.now_s >= began_s + HELD_S
            ):
                sensor.since_s = finger.now_s
        after_s = finger.now_s - sensor.since_s
        loop.let_go()
        finger.sleep(0.5)
        return Outcome(max(load_n for _, load_n in finger.told), loop.reason, after_s)


def drawn(draw: random.Random) -> tuple[str, Trial]:
    """Any fault of these kinds, of any size, at any moment, under any of the known fingers."""
    kinds: dict[str, Callable[[], Says]] = {
        "dead": lambda: dead(noise_n),
        "last bit": lambda: last_bit(noise_n),
        "frozen": lambda: stays(0.0),
        "stays": lambda: stays(noise_n),
        "sign": lambda: scaled(-gain),
        "gain": lambda: scaled(gain),
        "offset": lambda: shifted(offset_n),
        "drift": lambda: shifted(0.0, drift_n_s),
    }
    noise_n = 10.0 ** draw.uniform(-4.0, -2.0)
    gain = 10.0 ** draw.uniform(-2.0, 0.0)
    offset_n = draw.uniform(-1.0, 1.0)
    drift_n_s = draw.choice((-1.0, 1.0)) * 10.0 ** draw.uniform(-3.0, -1.0)
    kind, moment = draw.choice(list(kinds)), draw.choice(list(MOMENTS))
    factor = 3.0 ** draw.uniform(0.0, 1.0)
    return kind, Trial(kinds[kind], moment, factor, 60.0 if kind == "drift" else 20.0)
