"""How much faster than real time an envelope is made, on one core: from a texture along the finger's way to samples."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.claim import Claim, seconds
from haptic_driver.render import envelope
from haptic_driver.render.controller import Controller, ControllerSettings
from haptic_driver.render.drive import DriveSettings
from haptic_driver.render.finger import FingerSettings
from haptic_driver.render.safety import table_of
from haptic_driver.render.texture import Grating
from haptic_driver.render.tick import TickSettings, TickState, tick
from haptic_driver.rig.config import load_rig
from haptic_driver.signals import COURSE_POINTS, FingerSample
from haptic_driver.surface.build import build_surface
from haptic_driver.surface.file import ready_for_lookup
from haptic_driver.surface.models import load_model

TICKS = 2_000
TICK_S, RATE_HZ = 1e-3, 50e3
WANTED = 20.0  # times real time: a twentieth of a tick, of which the whole may take a tenth


def run() -> Iterator[Claim]:
    limits = load_rig("simulated").operating_limits()
    file = build_surface(load_model("reference"), limits)
    surface, worst_case = ready_for_lookup(file, limits), table_of(file.worst_case)
    controller = Controller(ControllerSettings(surface, limits, "fixed_frequency", 250.0))
    stages = TickSettings(FingerSettings(), Grating(0.7, 0.1, 1e-4), controller, limits, DriveSettings(), worst_case)
    state = TickState()
    for k in range(100):
        state, done = tick(stages, state, FingerSample(1.0 + TICK_S * k, 0.1 * TICK_S * k, 0.0, 0.5))
    known = state.controller.estimate
    samples_v = np.empty(round(TICK_S * RATE_HZ))
    powers_v2 = np.zeros(COURSE_POINTS + 1)

    cof = 0.7 + 0.1 * np.sin(np.linspace(0.0, 5.0, COURSE_POINTS))

    def from_friction() -> None:
        voltage_v, _ = controller.along(known, cof, done.finger, 250.0)
        np.multiply(voltage_v, voltage_v, out=powers_v2[1:])
        envelope.synthesise(powers_v2, samples_v)

    def from_texture() -> None:
        _, powers_v2[1:] = envelope.ahead(stages, state, done, TICK_S)
        envelope.synthesise(powers_v2, samples_v)

    each_s = seconds(lambda: [from_friction() for _ in range(TICKS)]) / TICKS
    ratio = TICK_S / each_s
    yield Claim(
        f"envelope at {RATE_HZ:g} samples/s, friction to samples, a call per tick, one core",
        f"{ratio:.0f} x real time ({1e6 * each_s:.1f} us per ms)", f"at least {WANTED:g} x", ratio >= WANTED,
    )  # fmt: skip
    each_s = seconds(lambda: [from_texture() for _ in range(TICKS)]) / TICKS
    assert samples_v.max() > 0.0
    yield Claim(
        "the same envelope with texture and last gate",
        f"{TICK_S / each_s:.0f} x real time ({1e6 * each_s:.1f} us per ms)",
    )
    long = np.full(TICKS * COURSE_POINTS + 1, 50.0)
    out = np.empty(TICKS * samples_v.size)
    ratio = TICKS * TICK_S / seconds(lambda: envelope.synthesise(long, out))
    yield Claim("envelope, synthesis alone", f"{ratio:.0f} x real time", "at least 100 x", ratio >= 100.0)
