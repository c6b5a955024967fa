"""`kind = "spectrum"`: what its waves come to, by the tile's own Fourier series."""

import math

import numpy as np
import pytest

from haptic_driver.signals import FingerState
from haptic_driver.textures.library import load_texture
from haptic_driver.textures.process import coefficients, reflections
from tests.haptic_driver.lab.refusal import refused

EDGES_HZ = [12.5 * 2.0 ** (2.0 * k / 3.0) for k in range(10)]
HEAD = 'kind = "spectrum"\nmean_cof = 0.7\n'
RMS = [0.03, 0.0, 0.02, 0.0, 0.01, 0.0, 0.01, 0.0, 0.02]
BANDS = f"band_cof_rms = {RMS}\n"


def load(folder, text):
    (folder / "s.toml").write_text(HEAD + text)
    return load_texture(str(folder / "s.toml"), [])


def series(texture, tile_m=0.064, speed_m_s=0.05):
    """Frequencies and mean squares of the waves that a finger at that speed crosses in one tile."""
    count = 1 << 16
    cof = texture.cof_at(tile_m * np.arange(count) / count, np.zeros(count))
    return (
        np.arange(1, count // 2) * speed_m_s / tile_m,
        2.0 * np.abs(np.fft.rfft(cof)[1:-1] / count) ** 2,
    )


def ringing(frequency_hz):
    """Coefficients of a process that rings at a frequency, at 2000 samples per second."""
    turn = math.tau * frequency_hz / 2000.0
    return [-2.0 * 0.98 * math.cos(turn), 0.98**2]


def process(speed_mm_s, normal_force_n, ar, more="", rate="rate_hz = 2000\n"):
    about = f"speed_mm_s = {speed_mm_s}\nnormal_force_n = {normal_force_n}\ncof_rms = 0.02\n"
    return f"{rate}[[process]]\n{about}ar = {ar}\n{more}"


def in_bands(texture, **crossed):
    frequency_hz, square = series(texture, **crossed)
    return np.sqrt(np.histogram(frequency_hz, EDGES_HZ, weights=square)[0])


def test_each_band_has_the_friction_that_was_asked_for(tmp_path):
    # Straight lines between 12 points a wave lose 2 % of the shortest, and less of the others.
    assert in_bands(load(tmp_path, BANDS)) == pytest.approx(RMS, rel=0.025, abs=1e-3)


def test_at_another_speed_the_bands_are_the_same(tmp_path):
    found = in_bands(load(tmp_path, BANDS + "speed_mm_s = 100\n"), speed_m_s=0.1)
    assert found == pytest.approx(RMS, rel=0.025, abs=1e-3)


def test_waves_that_no_finger_follows_are_left_out(tmp_path):
    slow = in_bands(
        load(tmp_path, BANDS + "speed_mm_s = 10\n"), speed_m_s=0.01
    )  # 0.05 mm are 200 Hz
    assert slow[:6] == pytest.approx(RMS[:6], rel=0.025, abs=1e-3)
    assert slow[7:] == pytest.approx(0.0, abs=1e-3)


def test_gain_and_inverse_of_the_finger(tmp_path):
    plain = in_bands(load(tmp_path, BANDS))
    assert in_bands(load(tmp_path, BANDS + "perceptual_gain = 3\n")) == pytest.approx(3.0 * plain)
    inverted = in_bands(load(tmp_path, BANDS + "invert_finger = true\n"))
    # A finger at 50 mm/s is cut off at 690 Hz: waves of 504 to 800 Hz need 1.24 to 1.53 times as
    # much.
    assert 1.24 < inverted[8] / plain[8] < 1.54
    assert inverted[0] == pytest.approx(plain[0], rel=1e-3)


def test_a_beta_form_has_its_energy_and_the_mean_and_spread_of_its_distribution(tmp_path):
    frequency_hz, square = series(load(tmp_path, "cof_rms = 0.05\nbeta = [4.0, 2.0]\n"))
    place = np.log(frequency_hz / 12.5) / math.log(64.0)
    square = square * (place >= 0.0) * (place <= 1.0)
    assert math.sqrt(square.sum()) == pytest.approx(0.05, rel=0.01)
    mean = np.sum(place * square) / square.sum()
    assert mean == pytest.approx(4.0 / 6.0, abs=0.01)
    assert np.sum((place - mean) ** 2 * square) / square.sum() == pytest.approx(
        8.0 / (36.0 * 7.0), rel=0.05
    )


def test_an_autoregressive_form_rings_where_its_poles_are(tmp_path):
    text = f"cof_rms = 0.05\nar = {ringing(150.0)}\nrate_hz = 2000\n"
    frequency_hz, square = series(load(tmp_path, text))
    assert math.sqrt(square.sum()) == pytest.approx(0.05, rel=0.01)
    assert frequency_hz[square.argmax()] == pytest.approx(150.0, abs=2.0)


def finger(speed_m_s, normal_force_n, x_m, y_m=0.0):
    return FingerState(0.0, x_m, y_m, speed_m_s, 0.0, normal_force_n, True)


def test_processes_change_with_speed_and_load_and_stay_where_they_are(tmp_path):
    given = ((20, 0.2, 100.0), (20, 1.0, 200.0), (160, 0.2, 300.0), (160, 1.0, 400.0))
    text = "".join(
        process(v, n, ringing(f), rate="" if i else "rate_hz = 2000\n")
        for i, (v, n, f) in enumerate(given)
    )
    texture = load(tmp_path, text)
    for speed_mm_s, load_n, ring_hz in (*given, (160, 3.0, 400.0), (300, 0.2, 300.0 * 300 / 160)):
        met = texture.under(1e-3 * speed_mm_s, load_n)
        frequency_hz, square = series(met, speed_m_s=1e-3 * speed_mm_s)
        assert math.sqrt(square.sum()) == pytest.approx(0.02, rel=0.02)
        assert frequency_hz[square.argmax()] == pytest.approx(ring_hz, rel=0.04)
    # Between them everything lies between, and neighbouring speeds have nearly the same waves: it
    # is one surface.
    met = [texture.under(speed_m_s, 0.2) for speed_m_s in (0.060, 0.062)]
    frequency_hz, square = series(met[0], speed_m_s=0.060)
    assert 100.0 < frequency_hz[square.argmax()] < 300.0
    first, second = (one.cof_at(np.linspace(0.0, 0.064, 5000), np.zeros(5000)) for one in met)
    assert np.corrcoef(first, second)[0, 1] > 0.97
    # The ticks ask the same as pictures do, by the finger's own speed and load; who rests is at the
    # slowest.
    ahead_s = np.arange(20) * 5e-5
    along = texture.cof_along(finger(0.08, 0.6, 0.01), ahead_s)
    assert along == pytest.approx(
        texture.under(0.08, 0.6).cof_at(0.01 + 0.08 * ahead_s, np.zeros(20))
    )
    assert texture.cof_under(finger(0.08, 0.6, 0.01)) == pytest.approx(along[0])
    assert texture.cof_under(finger(0.0, 0.2, 0.01)) == pytest.approx(
        texture.under(0.02, 0.2).cof_at(0.01, 0.0)
    )
    assert math.isnan(texture.cof_under(finger(0.0, 0.2, math.inf)))


def test_processes_on_one_line_of_speeds_are_enough(tmp_path):
    texture = load(
        tmp_path, process(20, 0.5, ringing(100.0)) + process(80, 0.5, ringing(200.0), rate="")
    )
    frequency_hz, square = series(texture.under(0.08, 0.7), speed_m_s=0.08)
    assert frequency_hz[square.argmax()] == pytest.approx(200.0, rel=0.04)


@pytest.mark.parametrize("order", [1, 2, 7, 30])
def test_any_mixture_of_two_processes_that_die_away_dies_away(order):
    rng = np.random.default_rng(order)
    for _ in range(20):
        radius, turn = rng.random((2, 2, order // 2))
        zeros = 0.99 * np.sqrt(radius) * np.exp(1j * math.pi * turn)
        pair = [np.poly([*z, *z.conj(), *([0.9] if order % 2 else [])]).real[1:] for z in zeros]
        one, other = (reflections(ar) for ar in pair)
        assert coefficients(one) == pytest.approx(pair[0], abs=1e-6)
        mixture = coefficients(0.3 * one + 0.7 * other)
        assert np.abs(np.roots([1.0, *mixture])).max() < 1.0


def test_it_repeats_without_a_seam_and_in_its_direction(tmp_path):
    texture = load(tmp_path, BANDS + "direction_deg = 90\n")
    places = np.array([0.0, 0.0123, 0.0639])
    assert texture.cof_at(0.0 * places, places) == pytest.approx(
        texture.cof_at(0.5 + 0.0 * places, places + 0.064)
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "one of band_cof_rms, beta, ar and process, not none"),
        ("beta = [1.0, 2.0]\n", "'cof_rms' goes together with beta or ar"),
        (BANDS + "tile_mm = 1000\n", "'tile_mm': 16 to 130.2 for a speed_mm_s of 50"),
        (BANDS + "perceptual_gain = 10\n", "friction goes from -"),
        (process(20, 0.5, [-1.1]), "key 'ar' has a zero on or outside the unit circle"),
        (
            process(20, 0.5, [0.1]) + process(40, 0.5, [0.1, 0.1], rate=""),
            "unequal numbers of coefficients",
        ),
    ],
)
def test_what_makes_no_sense_is_refused_with_the_file_and_the_key(tmp_path, text, words):
    with refused("bad_texture", words, str(tmp_path / "s.toml")):
        load(tmp_path, text)
