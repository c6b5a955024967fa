"""What an envelope costs on one core, from a texture along the finger's way to samples, against the
same in numpy.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.claim import Claim, seconds
from haptic_driver.lookup.build import build_surface
from haptic_driver.lookup.file import ready_for_lookup
from haptic_driver.lookup.models import load_model
from haptic_driver.render import envelope
from haptic_driver.render.controller import Controller, ControllerSettings
from haptic_driver.render.drive import DriveSettings
from haptic_driver.render.finger import FingerSettings
from haptic_driver.render.safety import table_of
from haptic_driver.render.surface import place_of
from haptic_driver.render.texture import Grating
from haptic_driver.render.tick import TickSettings, TickState, tick
from haptic_driver.rig.config import load_rig
from haptic_driver.signals import COURSE_POINTS, FingerSample

TICKS = 2_000
TICK_S, RATE_HZ = 1e-3, 50e3
# Times the same in numpy: that goes over all nodes of voltage where bisection looks at a few, and
# begins a loop in C some ten times per tick, each for as long as the compiled call takes to begin.
WITH_CALLS = 1.0
# Of long arrays: one pass of the same arithmetic where numpy makes two, but a root at a time, where
# numpy takes them by vectors.
IN_BULK = 2.0


def run() -> Iterator[Claim]:
    limits = load_rig("simulated").operating_limits()
    file = build_surface(load_model("reference"), limits)
    surface, worst_case = ready_for_lookup(file, limits), table_of(file.worst_case(limits))
    controller = Controller(ControllerSettings(surface, limits, "fixed_frequency", 250.0))
    stages = TickSettings(
        FingerSettings(), Grating(0.7, 0.1, 1e-4), controller, limits, DriveSettings(), worst_case
    )
    state = TickState()
    for k in range(100):
        state, done = tick(
            stages, state, FingerSample(1.0 + TICK_S * k, 0.1 * TICK_S * k, 0.0, 0.5)
        )
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

    surface = stages.controller.settings.surface
    gains = known.gains
    place = place_of(surface, 250.0, done.finger.normal_force_n)
    moments, samples_at = (
        np.arange(COURSE_POINTS + 1.0),
        np.linspace(0.0, COURSE_POINTS, samples_v.size),
    )

    def in_numpy() -> None:
        i, a, j, b = place
        corners = surface.cof[i : i + 2, j : j + 2]
        column = (1.0 - a) * ((1.0 - b) * corners[0, 0] + b * corners[0, 1])
        column = column + a * ((1.0 - b) * corners[1, 0] + b * corners[1, 1])
        wanted = column[0] + (cof - gains.off * column[0]) / gains.rise
        powers_v2[1:] = np.interp(wanted, column, surface.voltage_v) ** 2
        np.sqrt(np.interp(samples_at, moments, powers_v2), out=samples_v)

    ours_s, numpy_s = (
        seconds(lambda work=work: [work() for _ in range(TICKS)]) / TICKS
        for work in (from_friction, in_numpy)
    )
    yield _against(
        f"envelope at {RATE_HZ:g} samples/s, friction to samples, a call per tick",
        ours_s,
        numpy_s,
        WITH_CALLS,
    )
    yield Claim("envelope, friction to samples", f"{TICK_S / ours_s:.0f} x real time")
    each_s = seconds(lambda: [from_texture() for _ in range(TICKS)]) / TICKS
    assert samples_v.max() > 0.0
    yield Claim(
        "the same envelope with texture and last gate",
        f"{TICK_S / each_s:.0f} x real time ({1e6 * each_s:.1f} us per ms)",
    )
    long = np.full(TICKS * COURSE_POINTS + 1, 50.0)
    out = np.empty(TICKS * samples_v.size)
    points = np.arange(float(long.size))
    places = np.linspace(0.0, long.size - 1.0, out.size)
    ours_s = seconds(lambda: envelope.synthesise(long, out))
    numpy_s = seconds(lambda: np.sqrt(np.interp(places, points, long), out=out))
    yield _against("envelope, synthesis alone, two seconds at once", ours_s, numpy_s, IN_BULK)


def _against(what: str, ours_s: float, numpy_s: float, most: float) -> Claim:
    ratio = ours_s / numpy_s
    return Claim(
        f"{what}, against numpy",
        f"{ratio:.2f} x ({1e6 * ours_s:.3g} us against {1e6 * numpy_s:.3g} us)",
        f"at most {most:g} x",
        ratio <= most,
    )
