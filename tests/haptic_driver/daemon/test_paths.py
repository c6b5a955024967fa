"""Ten strokes on a panel of 50 reports a second, through the daemon's own parts by a stepped clock:
where friction is rendered, against where the finger was.
"""

import datetime
import math

import numpy as np
import pytest

from haptic_driver.daemon.set_up import placement_of, render_settings
from haptic_driver.daemon.stepped import render_slide
from haptic_driver.processes.samples import Flag
from haptic_driver.render.texture import Grating
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.parts.finger_trackers import EvdevFingerConfig
from haptic_driver.rig.slide import Slide
from haptic_driver.signals import TICK_S
from haptic_driver.simulation.rig import SimulatedRig
from hw.finger.simulated_touch_screen import SCREEN

SPEED_M_S, PATHS = 0.137, 10
TICKS, SETTLED = 300, 60  # of a stroke, and those by which its velocity is known
SPEEDS_M_S = np.linspace(0.002, 0.5, 30)
FINE = Grating(0.65, 0.05, 0.002).of_waves(0.0)
PANEL = EvdevFingerConfig(
    kind="evdev",
    device="/dev/null",
    report_rate_hz=50.0,
    report_jitter_s=0.0,  # the simulated panel stamps each report as it makes it
    matrix_m=[list(row) for row in SCREEN.matrix_m],
    measured_at=datetime.date(2024, 1, 1),
    placeholder=False,
)


@pytest.fixture(scope="module", params=["simulated-envelope", "simulated"])
def config(request):
    return load_rig(request.param).model_copy(update={"finger_tracker": PANEL})


def strokes():
    """Fingers whose velocity changes as those on a panel do: by white noise, in proportion to their
    speed (`finger.py` has the numbers); none leaves the screen.
    """
    random = np.random.default_rng(3)
    while True:
        place_m, velocity_m_s, way_m = 0.025, SPEED_M_S, []
        for _ in range(TICKS):
            density = 0.01 + 5.0 * 0.5 * velocity_m_s**2
            velocity_m_s += math.sqrt(density * TICK_S) * random.standard_normal()
            place_m += velocity_m_s * TICK_S
            way_m.append(place_m)
        if min(way_m) > 0.002 and max(way_m) < 0.098:
            yield np.array(way_m)


@pytest.fixture(scope="module")
def replayed(config, surface_file, touch):
    """(where the finger was, samples of the recording) of each stroke."""
    settings, found = render_settings(config, surface_file), []
    for _, way_m in zip(range(PATHS), strokes(), strict=False):
        time_s = TICK_S * np.arange(TICKS)
        slide = Slide("a stroke", time_s, way_m, np.full(TICKS, 0.5))
        with SimulatedRig(config, touch, envelope=settings.envelope) as bench:
            found.append((way_m, render_slide(slide, FINE, settings, bench).samples))
    return found


def test_the_error_of_places_that_is_printed_is_that_of_ten_recordings(config, replayed):
    """Half of the errors along the stroke are less than what is printed for the finger's speed at
    that moment; the latency is the recording's own.
    """
    medians_m = [placement_of(config, speed_m_s).median_m for speed_m_s in SPEEDS_M_S]
    errors_m, printed_m = [], []
    for way_m, samples in replayed:
        began_s = samples["time_s"][0]
        acts = (samples["asked_time_s"] - began_s) / TICK_S
        known = np.arange(TICKS) >= SETTLED
        known &= acts < TICKS - 1
        there_m = np.interp(acts[known], np.arange(TICKS), way_m)
        errors_m.extend(np.abs(samples["output_x_m"][known] - there_m))
        speed_m_s = np.abs(np.gradient(way_m, TICK_S))[known]
        printed_m.extend(np.interp(speed_m_s, SPEEDS_M_S, medians_m))
    assert np.mean(np.array(errors_m) < printed_m) == pytest.approx(0.5, abs=0.1)
    assert np.median(errors_m) == pytest.approx(np.median(printed_m), abs=1e-4)


def test_a_fine_grating_is_rendered_by_time_and_follows_each_finger_one_report_late(replayed):
    """Friction asked for, against that of the place where the finger was a report before."""
    for way_m, samples in replayed:
        assert np.all(samples["flags"][SETTLED:] & Flag.BY_TIME)
        before_m = np.interp(np.arange(TICKS) - 20.0, np.arange(TICKS), way_m)
        fit = max(
            np.corrcoef(samples["asked_cof"][SETTLED:-5], cof[SETTLED:-5])[0, 1]
            for late in range(6)  # of a report: when it was read
            for cof in [FINE.cof_at(np.roll(before_m, late), np.zeros(TICKS))]
        )
        assert fit > 0.9  # a turn between two reports is lost


@pytest.mark.soak
@pytest.mark.parametrize(
    ("report_rate_hz", "period_m", "least"),
    [(50.0, 0.004, 0.7), (50.0, 0.01, 0.85), (1000.0, 0.004, 0.9), (1000.0, 0.01, 0.9)],
)
def test_friction_by_an_envelope_is_that_under_the_finger(
    surface_file, touch, report_rate_hz, period_m, least
):
    """Measured friction against the grating's where the finger is; docs/textures.md has these."""
    panel = PANEL.model_copy(update={"report_rate_hz": report_rate_hz})
    config = load_rig("simulated-envelope").model_copy(update={"finger_tracker": panel})
    settings, grating, fits = (
        render_settings(config, surface_file),
        Grating(0.65, 0.05, period_m),
        [],
    )
    for _, way_m in zip(range(6), strokes(), strict=False):
        slide = Slide("a stroke", TICK_S * np.arange(TICKS), way_m, np.full(TICKS, 0.5))
        with SimulatedRig(config, touch, envelope=settings.envelope) as bench:
            measured = render_slide(slide, grating, settings, bench).samples["measured_cof"]
        wanted = grating.cof_at(way_m, np.zeros(TICKS))[: measured.size]
        known = np.isfinite(measured) & (np.arange(measured.size) >= SETTLED)
        fits.append(np.corrcoef(wanted[known], measured[known])[0, 1])
    print(f"{report_rate_hz:g} Hz, {1e3 * period_m:g} mm: r {np.median(fits):.2f}")
    assert np.median(fits) > least
