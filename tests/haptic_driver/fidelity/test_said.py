"""What is said of a fidelity."""

import math

import numpy as np

from haptic_driver.fidelity.measure import fidelity_of
from haptic_driver.fidelity.perception import load_perception
from haptic_driver.fidelity.said import said
from tests.haptic_driver.fidelity.strokes_of import TICK_S, stroke_of

PERCEPTION = load_perception()


def told(*strokes, **how):
    return said(fidelity_of(strokes, TICK_S, PERCEPTION, **how))


def test_a_score_is_told_beside_that_of_a_constant():
    asked = np.concatenate([np.full(680, 0.61), np.full(320, 0.80)])
    felt = np.concatenate([np.full(710, 0.61), np.full(290, 0.70)])
    parts = (slice(0, 680), slice(680, 710), slice(710, 1000))
    asked[680:710] = 0.61 * 1.04 / 0.95 + 0.02  # felt as little as one constant could be right
    found = told(*(stroke_of(asked[p], felt[p]) for p in parts))
    assert found[0].startswith("within 5 % for 68 % of the time; a constant 0.61 reaches 68 %")
    assert "no better than a constant" in found[0]


def test_texture_correlation_and_feeling_are_told():
    time_s = np.arange(5000) * TICK_S
    wave = np.sin(math.tau * 40.0 * time_s)
    found = told(stroke_of(0.65 + 0.1 * wave, 0.65 + 0.07 * wave), reach_hz=50.0)
    assert "at 40 Hz the gain is 0.70, coherence 1.00; 0 of 1 bands within 0.8 to 1.2" in found[1]
    assert "up to 50 Hz" in found[1]
    assert found[2].startswith("correlation 1.00, 1.00 at a lag of 0.0 ms")
    assert "others report 0.35 to 0.71 and 0.69 to 0.79" in found[2]
    assert "above 11 % for 0 % of the time, and may feel what is wrong at 40 Hz (" in found[3]
    assert "factor of 10 either way" in found[3]
    assert found[4].startswith("unverified in 'published': detection thresholds")


def test_what_cannot_be_told_is_said():
    constant = np.full(3000, 0.6)
    found = told(stroke_of(constant, constant))
    assert found[0] == "within 5 % for 100 % of the time; error 0.0 % rms"
    assert found[1].startswith("no band can be judged")
    assert found[2].startswith("no correlation")
    assert "nothing of the rest" in found[3]
    short = told(stroke_of(constant[:50], constant[:50]))
    assert "is unknown" in short[3]
    assert told() == ["nothing was felt: no sliding with a target and known forces"]
    away = told(stroke_of(constant, constant, reachable=np.zeros(3000, bool)))
    assert away[0] == "no target was within reach"


def test_the_share_within_reach_is_told_where_it_is_not_all():
    reachable = np.arange(1000) < 920
    found = told(stroke_of(np.full(1000, 0.6), np.full(1000, 0.6), reachable=reachable))
    assert found[0].endswith("; 92 % of the time was within reach")
