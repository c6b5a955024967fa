"""Look-up and inversion against scipy's RegularGridInterpolator and the direct model, in one
run.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from benchmarks.claim import Claim, seconds
from haptic_driver.lookup.build import build_surface
from haptic_driver.lookup.file import ready_for_lookup
from haptic_driver.lookup.models import load_model
from haptic_driver.render.controller import INITIAL, Controller, ControllerSettings
from haptic_driver.render.policies import POLICIES
from haptic_driver.render.surface import NO_CAPS, Surface, cof_at, invert
from haptic_driver.rig.config import load_rig
from haptic_driver.signals import NO_COMMAND, FingerState, TargetFriction
from model.conditions import Conditions
from model.touch_model import TouchModel

CALLS = 3_000
POINTS = 200_000
INVERSIONS = 20_000


def looked_up(surface: Surface, *points: np.ndarray) -> np.ndarray:
    """Friction at n points, one by one."""
    return np.array(
        [cof_at(surface, *point) for point in zip(*(x.tolist() for x in points), strict=True)]
    )


def run() -> Iterator[Claim]:
    description, limits = load_model("reference"), load_rig("simulated").operating_limits()
    file = build_surface(description, limits)
    surface = ready_for_lookup(file, limits)
    touch = TouchModel(description)
    rng = np.random.default_rng(20)

    def random_points(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        f = np.exp(rng.uniform(*np.log(file.frequency_hz[[0, -1]]), count))
        n = np.exp(rng.uniform(*np.log(file.normal_force_n[[0, -1]]), count))
        return f, rng.uniform(0.0, file.voltage_v[-1], count), n

    scipy_lookup = RegularGridInterpolator(
        (np.log(file.frequency_hz), file.voltage_v, np.log(file.normal_force_n)), file.cof
    )
    one = np.array([[np.log(250.0), 75.0, np.log(0.5)]])
    scalar = seconds(lambda: [cof_at(surface, 250.0, 75.0, 0.5) for _ in range(CALLS)]) / CALLS
    scipy_scalar = seconds(lambda: [scipy_lookup(one) for _ in range(CALLS // 10)]) / (CALLS // 10)
    yield Claim(
        "look-up of one point against RegularGridInterpolator",
        f"{scipy_scalar / scalar:.0f} x ({1e6 * scalar:.2f} us against"
        f" {1e6 * scipy_scalar:.0f} us)",
        "at least 20 x",
        scipy_scalar >= 20 * scalar,
    )

    f, v, n = random_points(POINTS)
    direct = touch.predict(Conditions(f, v, n)).cof
    error = np.abs(looked_up(surface, f, v, n) / direct - 1.0)
    yield Claim(
        f"surface against the direct model, {POINTS} random points",
        f"{100 * error.max():.3f} % at most, {100 * np.sqrt(np.mean(error**2)):.4f} % rms",
        "at most 0.2 %",
        bool(error.max() <= 2e-3),
    )

    f, _, n = random_points(INVERSIONS)
    share = rng.uniform(0.0, 1.0, INVERSIONS)
    target, voltage = np.empty(INVERSIONS), np.empty(INVERSIONS)
    for i in range(INVERSIONS):
        most = invert(surface, np.inf, f[i], n[i], NO_CAPS)
        target[i] = most.cof_low + share[i] * (most.cof_high - most.cof_low)
        voltage[i] = invert(surface, target[i], f[i], n[i], NO_CAPS).voltage_v
    back = np.abs(looked_up(surface, f, voltage, n) / target - 1.0).max()
    yield Claim(
        f"inversion, back through the surface, {INVERSIONS} random targets",
        f"{100 * back:.1e} % at most",
        "at most 0.1 %",
        bool(back <= 1e-3),
    )
    direct = np.abs(touch.predict(Conditions(f, voltage, n)).cof / target - 1.0).max()
    yield Claim(
        "inversion, back through the direct model",
        f"{100 * direct:.3f} % at most",
        "at most 0.1 %",
        bool(direct <= 1e-3),
    )

    finger = FingerState(0.0, 0.0, 0.0, 0.0, 0.0, 0.5, True)
    for policy in POLICIES:
        settings = ControllerSettings(
            surface, limits, policy, 250.0 if policy == "fixed_frequency" else None
        )
        controller = Controller(settings)
        state, _ = controller.step(INITIAL, TargetFriction(0.6, True), finger, NO_COMMAND)
        start = time.perf_counter()
        for i in range(CALLS):
            state, _ = controller.step(
                state, TargetFriction(0.55 + 1e-4 * (i % 900), True), finger, NO_COMMAND
            )
        each = (time.perf_counter() - start) / CALLS
        yield Claim(f"controller step, {policy}", f"{1e6 * each:.1f} us")
