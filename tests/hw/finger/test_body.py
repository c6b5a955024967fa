"""The load that a simulated finger's body gives: what is known of fingers, by limits."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from hw.finger.body import BodySettings, FingerBody, PowerLaw

STILL = BodySettings(relaxation=(), pulse_share=0.0, tremor_m=0.0)
DT_S = 1e-3


def loads(body: FingerBody, indentation_m: float, seconds: float, **touch: float) -> np.ndarray:
    return np.array([body.step(DT_S, indentation_m, **touch) for _ in range(round(seconds / DT_S))])


def test_it_stiffens_to_a_newton_within_two_millimetres():
    half, whole = (
        FingerBody(PowerLaw(), STILL).step(DT_S, depth_m) for depth_m in (0.875e-3, 1.75e-3)
    )
    assert whole == pytest.approx(1.0)
    assert half == pytest.approx(0.2973, rel=1e-3)  # 0.5 ** 1.75
    assert FingerBody(PowerLaw(), STILL).step(DT_S, -1e-4) == 0.0


def test_the_load_relaxes_by_its_shares_over_seconds():
    body = FingerBody(PowerLaw(), replace(STILL, relaxation=((0.1, 0.4), (0.15, 4.0))))
    force_n = loads(body, 1.75e-3, 30.0)
    assert force_n[0] == pytest.approx(1.0, abs=1e-3)
    assert force_n[3999] == pytest.approx(1.0 - 0.1 - 0.15 * (1.0 - math.exp(-1.0)), abs=1e-3)
    assert force_n[-1] == pytest.approx(0.75, abs=1e-3)


def test_relaxation_does_not_depend_on_the_step():
    settings = replace(STILL, relaxation=((0.3, 0.5),))
    fine, coarse = FingerBody(PowerLaw(), settings), FingerBody(PowerLaw(), settings)
    for _ in range(100):
        fine_n = fine.step(0.01, 1e-3)
    assert fine_n == pytest.approx(coarse.step(1.0, 1e-3), rel=1e-12)


def test_the_pulse_is_a_share_of_the_load_at_its_frequency():
    force_n = loads(FingerBody(PowerLaw(), replace(STILL, pulse_share=0.02)), 1.75e-3, 10.0)
    spectrum = np.abs(np.fft.rfft(force_n - force_n.mean())) * 2.0 / len(force_n)
    hz = np.fft.rfftfreq(len(force_n), DT_S)
    assert hz[np.argmax(spectrum)] == pytest.approx(1.0)
    assert spectrum.max() == pytest.approx(0.02, rel=0.01)


def test_the_tremor_has_its_size_and_lies_in_its_band():
    """On tissue that is a spring of 1 N/m the load is the movement."""
    body = FingerBody(lambda depth_m: depth_m, replace(STILL, tremor_m=15e-6))
    moved_m = loads(body, 1e-3, 60.0) - 1e-3
    power = np.abs(np.fft.rfft(moved_m - moved_m.mean())) ** 2
    hz = np.fft.rfftfreq(len(moved_m), DT_S)
    assert power[(hz > 7.9) & (hz < 12.1)].sum() > 0.99 * power.sum()
    assert moved_m.std() == pytest.approx(15e-6, rel=0.05)


def test_attraction_adds_no_load_and_lets_the_tissue_go_a_little():
    free, drawn = (
        FingerBody(PowerLaw(), STILL).step(DT_S, 1.2e-3, attraction_n=n) for n in (0.0, 0.4)
    )
    assert drawn == pytest.approx(PowerLaw()(1.2e-3 - 0.4 * 10e-6))
    assert 0.0 < free - drawn < 0.01 * free


def test_a_share_of_friction_shows_along_the_normal_while_it_touches():
    body = FingerBody(PowerLaw(), STILL)
    assert body.step(DT_S, 1.75e-3, friction_n=0.5) == pytest.approx(1.0 + 0.03 * 0.5)
    assert body.step(DT_S, -1e-3, friction_n=0.5) == 0.0
