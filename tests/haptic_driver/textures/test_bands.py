"""Bands of frequency, worked out by hand: waves of known height, an output's and a finger's gain at
known places.
"""

import math

import numpy as np
import pytest

from haptic_driver.render.texture import Grating, Placed, Profile, Uniform
from haptic_driver.textures.bands import (
    EDGES_HZ,
    Output,
    asked,
    finger_gain,
    predicted,
    rms_in_bands,
)

SCREEN_M = (0.1, 0.06)


def test_nine_bands_of_two_thirds_of_an_octave():
    assert EDGES_HZ[[0, 3, 6, 9]] == pytest.approx([12.5, 50.0, 200.0, 800.0])


@pytest.mark.parametrize(("speed_m_s", "band"), [(0.02, 0), (0.1, 3), (0.4, 6)])
def test_a_wave_is_in_the_band_that_the_speed_puts_it_in(speed_m_s, band):
    x_m = np.arange(0.0, 0.1, 1e-5)
    rms = rms_in_bands(
        0.6 + 0.1 * np.sin(math.tau * x_m / 1.3e-3), 1e-5, speed_m_s
    )  # 15, 77 and 308 Hz
    assert rms[band] == pytest.approx(0.1 / math.sqrt(2.0), rel=0.01)
    assert np.delete(rms, band) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("direction_rad", [0.0, math.pi / 2.0])
def test_strokes_go_across_the_texture_whatever_its_direction(direction_rad):
    rms, mean = asked(Placed(Grating(0.6, 0.1, 1e-3), rotation_rad=direction_rad), 0.1, SCREEN_M)
    assert rms.max() == pytest.approx(0.1 / math.sqrt(2.0), rel=0.02)
    assert mean == pytest.approx(0.6, abs=1e-3)


def test_beside_the_texture_nothing_is_asked():
    rms, mean = asked(Profile([1.0, 2.0], [0.5, 0.7]), 0.1, SCREEN_M)
    assert math.isnan(mean)
    bands = predicted(rms, mean, (0.5, 1.0), Output(1e-2, False), 0.1)
    assert {band.verdict for band in bands} == {"nothing_asked"}
    assert asked(Uniform(0.6), 0.1, SCREEN_M)[0] == pytest.approx(0.0, abs=1e-9)


def test_a_finger_follows_to_its_cut_off():
    assert finger_gain(np.array([0.0, 276.0]), 0.020) == pytest.approx(
        [1.0, math.sqrt(0.5)]
    )  # 13.8 Hz per mm/s


def test_an_output_holds_or_joins_and_ends_at_half_its_rate():
    held, joined = Output(0.01, False), Output(0.01, True)
    # The mean of a wave over a quarter of its period, around its crest: sin(pi/4)/(pi/4); for
    # straight lines squared.
    mean = math.sin(math.pi / 4.0) / (math.pi / 4.0)
    assert held.gain(np.array([25.0])) == pytest.approx([mean])
    assert joined.gain(np.array([25.0])) == pytest.approx([mean**2])
    assert list(held.gain(np.array([50.0, 75.0]))) == [0.0, 0.0]


@pytest.mark.parametrize(
    ("rms", "mean_cof", "speed_m_s", "verdict"),
    [
        (0.05, 0.9, 0.1, "reached"),
        (0.0, 0.9, 0.1, "nothing_asked"),
        (
            0.05,
            0.9,
            0.01,
            "with_boost",
        ),  # a finger at 10 mm/s follows to 138 Hz, at 635 Hz with 0.21
        (0.05, 0.55, 0.1, "out_of_reach"),  # an amplitude of 0.07 where 0.05 are left
        (0.08, 0.9, 0.01, "out_of_reach"),  # 0.11 are there, but not 0.11/0.21
    ],
)
def test_verdicts_of_the_highest_band(rms, mean_cof, speed_m_s, verdict):
    bands = predicted(np.full(9, rms), mean_cof, (0.5, 1.3), Output(5e-5, True), speed_m_s)
    assert bands[-1].verdict == verdict
