"""Friction on the same fingers by the model alone, by the electrode's current, and by a force
sensor.

The fingers, their moisture and film, the drive and the noise are those of `live`: an envelope at
200 Hz, linen, loads from 0.3 to 0.8 N. Each finger is visited dry and moist. Friction without
voltage begins as the model's, and stays or rises.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import product

import numpy as np

from benchmarks.claim import Claim
from benchmarks.live import (
    CURRENT,
    FINGERS,
    FIXED,
    GAINS,
    RISES,
    WORKERS,
    Bench,
    WithoutSensor,
    rms,
    spread,
)
from haptic_driver.lookup.models import load_model
from haptic_driver.signals import WITHIN

WAYS = {"open loop": FIXED, "by the current": CURRENT, "by force": GAINS}
VISITS_S = (0.0, 300.0)  # dry, moist
CHANGES = {"stays": 0.0, f"rises by {RISES:.0%}": RISES}  # friction without voltage


def off(case: tuple[str, int, float, float]) -> list[float]:
    """How far friction is off, relative, at each tick that slides over a target in reach."""
    kind, seed, *finger = case
    bench = (Bench if kind == GAINS else WithoutSensor)(kind, "linen", seed, *finger)
    for begin_s in VISITS_S:
        bench.visit(begin_s)
    return bench.off


def run() -> Iterator[Claim]:
    dry = load_model("reference").values.cof_off
    cases = list(product(WAYS.values(), FINGERS, (dry,), CHANGES.values()))
    with ProcessPoolExecutor(WORKERS) as pool:
        found = dict(zip(cases, pool.map(off, cases), strict=True))
    for (change, rises), (way, kind) in product(CHANGES.items(), WAYS.items()):
        each = [np.array(found[kind, finger, dry, rises]) for finger in FINGERS]
        within = spread([float(np.mean(np.abs(values) <= WITHIN)) for values in each])
        yield Claim(
            f"friction without voltage {change}, {way}: error (rms), and within 5 %",
            f"{spread([rms(values) for values in each])}, {within}",
        )
