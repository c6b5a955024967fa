"""How much faster than real time an envelope is made, on one core, from targets along the finger's way."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.claim import Claim, seconds
from haptic_driver.config import load_model, load_rig
from haptic_driver.render import envelope
from haptic_driver.render.controller import INITIAL, Controller, ControllerSettings
from haptic_driver.signals import FingerState
from haptic_driver.surface_builder import build_surface
from haptic_driver.surface_file import ready_for_lookup

BLOCKS = 2_000


def run() -> Iterator[Claim]:
    limits = load_rig("simulated").operating_limits()
    surface = ready_for_lookup(build_surface(load_model("reference"), limits), limits)
    settings = envelope.EnvelopeSettings()
    controller = Controller(ControllerSettings(surface, limits, "fixed_frequency", 250.0))
    finger = FingerState(0.0, 0.0, 0.0, 0.1, 0.0, 0.5, in_contact=True)
    cof = 0.7 + 0.1 * np.sin(np.linspace(0.0, 5.0, settings.points))
    samples_v = np.empty(settings.samples)
    powers_v2 = np.empty(settings.points + 1)

    def block() -> None:
        voltage_v, _ = controller.along(INITIAL, cof, finger, 250.0)
        np.multiply(voltage_v, voltage_v, out=powers_v2[1:])
        envelope.synthesise(powers_v2, 1.0, 1.0, samples_v)

    each_s = seconds(lambda: [block() for _ in range(BLOCKS)]) / BLOCKS
    ratio = settings.tick_s / each_s
    yield Claim(
        f"envelope at {settings.sample_rate_hz:g} samples/s, friction to samples, a call per tick, one core",
        f"{ratio:.0f} x real time ({1e6 * each_s:.1f} us per ms)", "at least 100 x", ratio >= 100.0,
    )  # fmt: skip
    long = np.full(BLOCKS * settings.points + 1, 50.0)
    out = np.empty(BLOCKS * settings.samples)
    ratio = BLOCKS * settings.tick_s / seconds(lambda: envelope.synthesise(long, 1.0, 1.0, out))
    yield Claim("envelope, synthesis alone", f"{ratio:.0f} x real time", "at least 100 x", ratio >= 100.0)
