"""Gratings against their formulas, noise against a sum of cosines and spectrum, averaging against
hand-made maps.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_driver.textures import formulas
from haptic_driver.textures.description import GratingDescription, NoiseDescription


def grating(**keys):
    plain = {"mean_cof": 0.6, "amplitude_cof": 0.1, "period_mm": 4.0}
    return formulas.grating(GratingDescription(kind="grating", **(plain | keys)))


def noise(**keys):
    plain = {
        "mean_cof": 0.6,
        "amplitude_cof": 0.1,
        "shortest_mm": 1.0,
        "longest_mm": 3.0,
        "tile_mm": 12.0,
    }
    return NoiseDescription(kind="noise", **(plain | keys))


def along_x(texture, x_mm):
    return [texture.cof_at(x * 1e-3, 0.123) for x in x_mm]


def test_sine():
    assert along_x(grating(), [0, 1, 2, 3, 5]) == pytest.approx([0.6, 0.7, 0.6, 0.5, 0.7])


def test_square_is_high_for_its_duty_and_turns_within_a_tenth_of_a_millimetre():
    ridges = grating(wave="square", duty=0.25)
    assert along_x(ridges, [0.051, 0.5, 0.949]) == pytest.approx([0.7] * 3)
    assert along_x(ridges, [1.051, 2.0, 3.949, -0.051]) == pytest.approx([0.5] * 4)
    assert along_x(ridges, [0.0, 1.0, 4.0, 40.0]) == pytest.approx([0.6] * 4)
    assert along_x(ridges, [0.025, 400.025]) == pytest.approx([0.65] * 2)
    assert ridges.bounds() == pytest.approx((0.5, 0.7))


def test_sawtooth_rises_over_its_duty():
    triangle = grating(wave="sawtooth", duty=0.5)
    assert along_x(triangle, [0, 0.5, 1, 1.5, 2, 3, 3.5]) == pytest.approx(
        [0.6, 0.65, 0.7, 0.65, 0.6, 0.5, 0.55]
    )
    steep = grating(wave="sawtooth")  # rises for 3.9 mm, falls within 0.1 mm
    assert along_x(steep, [0, 1.95, 2.0, 2.05]) == pytest.approx([0.6, 0.7, 0.6, 0.5])
    falling = grating(wave="sawtooth", duty=0.0)
    assert along_x(falling, [-0.05, 0.0, 0.05, 2.0]) == pytest.approx([0.5, 0.6, 0.7, 0.6])


@pytest.mark.parametrize("wave", ["sine", "square", "sawtooth"])
def test_phase_and_direction_move_and_turn_every_wave(wave):
    plain = grating(wave=wave)
    moved = grating(wave=wave, phase_deg=90)
    turned = grating(wave=wave, direction_deg=60)
    for along_mm in (0.3, 1.2, 2.6, 3.3):
        x_m, y_m = along_mm * 1e-3 * 0.5, along_mm * 1e-3 * math.sqrt(0.75)
        assert turned.cof_at(x_m, y_m) == pytest.approx(plain.cof_at(along_mm * 1e-3, 0.0))
        assert moved.cof_at(along_mm * 1e-3, 0.0) == pytest.approx(
            plain.cof_at((along_mm + 1.0) * 1e-3, 0.0)
        )


def test_noise_is_the_sum_of_cosines_it_says():
    described = noise(shortest_mm=3.0, longest_mm=6.0)
    tile = formulas.noise(described)
    phases = np.random.PCG64(1).random_raw(81)
    y, x = np.mgrid[0:48, 0:48] / 48.0
    expected = np.zeros((48, 48))
    for number, (ky, kx) in enumerate((ky, kx) for ky in range(-4, 5) for kx in range(-4, 5)):
        if 2.0 <= math.hypot(ky, kx) <= 4.0:
            share = (int(phases[number]) >> 11) / 2**53
            expected += np.cos(math.tau * (kx * x + ky * y + share))
    np.testing.assert_allclose(tile, 0.6 + 0.1 * expected / np.abs(expected).max(), atol=1e-12)


def test_noise_holds_nothing_outside_its_band():
    tile = formulas.noise(noise()) - 0.6
    power = np.abs(np.fft.fft2(tile)) ** 2
    per_mm = np.hypot(*np.meshgrid(*[np.fft.fftfreq(tile.shape[0], 1.0 / 12.0)] * 2))
    inside = (per_mm >= 1.0 / 3.0 - 1e-9) & (per_mm <= 1.0 + 1e-9)
    assert power[~inside].sum() < 1e-20 * power.sum()


@given(seed=st.integers(0, 2**63 - 1), shortest=st.floats(0.5, 2.0), ratio=st.floats(1.6, 3.0))
def test_noise_reaches_its_amplitude_and_never_more(seed, shortest, ratio):
    tile = formulas.noise(noise(seed=seed, shortest_mm=shortest, longest_mm=shortest * ratio))
    assert np.abs(tile - 0.6).max() == pytest.approx(0.1)


def test_averaging_by_hand():
    # Five pixels of 0.04 mm make two of 0.1 mm: 1, 1, half of 4 | half of 4, 2, 3.
    values, pitch_x_m, pitch_y_m = formulas.averaged(
        np.array([[1.0, 1.0, 4.0, 2.0, 3.0]]), 4e-5, 1e-3
    )
    np.testing.assert_allclose(values, [[4.0 / 2.5, 7.0 / 2.5]])
    assert (pitch_x_m, pitch_y_m) == (pytest.approx(1e-4), 1e-3)


@given(
    rows=st.integers(1, 40),
    columns=st.integers(1, 40),
    pitch_um=st.tuples(st.floats(1.0, 300.0), st.floats(1.0, 300.0)),
    seed=st.integers(0, 1000),
)
def test_averaging_keeps_size_mean_and_bounds(rows, columns, pitch_um, seed):
    values = np.random.default_rng(seed).uniform(0.5, 0.7, (rows, columns))
    pitch_x_m, pitch_y_m = (p * 1e-6 for p in pitch_um)
    coarse, coarse_x_m, coarse_y_m = formulas.averaged(values, pitch_x_m, pitch_y_m)
    assert coarse.shape[1] * coarse_x_m == pytest.approx(columns * pitch_x_m)
    assert coarse.shape[0] * coarse_y_m == pytest.approx(rows * pitch_y_m)
    assert coarse.mean() == pytest.approx(values.mean(), abs=1e-10)
    assert values.min() <= coarse.min()
    assert coarse.max() <= values.max()
    assert (
        coarse_x_m >= 1e-4 * (1 - 1e-6) or coarse.shape[1] == 1 or coarse_x_m == pitch_x_m >= 1e-4
    )
