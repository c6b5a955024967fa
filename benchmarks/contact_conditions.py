"""Attraction on a finger that nothing measures the force of, under four conditions of its touch: by
the model alone, by the electrode's current, and with the contact area that a panel tells.

The simulated finger is the model's own under another load, moisture or area. The rig believes in
the usual one. The voltage changes as under a texture, at 200 Hz; the current has noise of 1 %, the
stray capacitance is known to 1 %, the area to 19 % (`haptic calibrate-panel`, people left out).
Judged are the last five of ten seconds.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from typing import NamedTuple

import numpy as np

from benchmarks.claim import Claim
from benchmarks.live import CARRIER_HZ, CURRENT_NOISE, STRAY_F, STRAY_OFF, USUAL_N, WORKERS, rms
from haptic_driver.live.touch_by_current import TouchByCurrent
from haptic_driver.lookup.models import load_model
from haptic_driver.simulation.finger_model import with_hidden
from hw.monitor.contract import ElectrodeReading
from model.conditions import Conditions
from model.touch_model import TouchModel

USUAL_M2, AREA_OFF = 100e-6, 0.19
READ_S, READINGS, JUDGED = 0.02, 500, 250
WAVE_V, SWING_V, WAVE_HZ = 60.0, 40.0, 1.6
SEEDS = range(4)
ALONE, CURRENT, WITH_AREA = "by the model alone", "by the current", "by current and area"


class Touch(NamedTuple):
    """What differs from the usual touch."""

    load_n: float = USUAL_N
    area_m2: float = USUAL_M2
    wetness: float = 0.0


TOUCHES = {
    "pressed lightly, 0.25 N": Touch(0.25),
    "pressed hard, 1 N": Touch(1.0),
    "moist": Touch(wetness=1.5),
    "on its edge, half of the area, 0.25 N": Touch(0.25, 0.5 * USUAL_M2),
}


def off(case: tuple[str, str, int]) -> float:
    """How far attraction is off, relative, root mean square."""
    name, way, seed = case
    touch, rng, usual = TOUCHES[name], np.random.default_rng(seed), load_model("reference")
    when_s = READ_S * np.arange(READINGS)
    voltage_v = WAVE_V + SWING_V * np.sin(2.0 * np.pi * WAVE_HZ * when_s)
    stray_f = STRAY_F * (1.0 + STRAY_OFF * rng.standard_normal())
    finger = with_hidden(
        TouchModel(usual.with_values(stray_capacitance_f=stray_f, contact_area_m2=touch.area_m2)),
        {"skin_hydration": {"wetness": touch.wetness}} if touch.wetness else {},
    )
    there = finger.predict(_driven(voltage_v, touch.load_n))
    if way == ALONE:
        alone = TouchModel(usual).predict(_driven(voltage_v, USUAL_N))
        believed_n = alone.electrostatic_force_n
    else:
        noise = 1.0 + CURRENT_NOISE * (rng.standard_normal((READINGS, 2)) @ np.array([1.0, 1.0j]))
        area_m2 = touch.area_m2 * np.exp(AREA_OFF * rng.standard_normal())
        estimate = TouchByCurrent(usual, USUAL_N, STRAY_F)
        believed_n = np.empty(READINGS)
        currents_a = there.electrode_current_a * noise
        for k, current_a in enumerate(currents_a):
            reading = ElectrodeReading(
                complex(there.electrode_voltage_v[k]),
                0.0,
                current_a,
                CURRENT_NOISE * abs(current_a),
            )
            told_m2 = area_m2 if way == WITH_AREA else np.nan
            felt = estimate.felt(CARRIER_HZ, reading, READ_S, told_m2)
            believed_n[k] = felt.load_n * (felt.cof / usual.values.cof_off - 1.0)
    return rms((believed_n / there.electrostatic_force_n - 1.0)[JUDGED:])


def _driven(voltage_v: np.ndarray, load_n: float) -> Conditions:
    frequency_hz, loads_n = (np.full(voltage_v.size, x) for x in (CARRIER_HZ, load_n))
    return Conditions(frequency_hz, voltage_v, loads_n)


def run() -> Iterator[Claim]:
    ways = (ALONE, CURRENT, WITH_AREA)
    cases = list(product(TOUCHES, ways, SEEDS))
    with ProcessPoolExecutor(WORKERS) as pool:
        found = dict(zip(cases, pool.map(off, cases), strict=True))
    for name in TOUCHES:
        alone, current, area = (
            float(np.mean([found[name, way, s] for s in SEEDS])) for way in ways
        )
        yield Claim(
            f"error of attraction, finger {name}",
            f"{alone:.0%} {ALONE}, {current:.0%} {CURRENT}, {area:.0%} {WITH_AREA}",
        )
