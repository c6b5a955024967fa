"""MPEG .hjif friction: own fixtures with values worked out by hand, and a refusal for everything
else.
"""

import copy
import json
import math

import numpy as np
import pytest

from haptic_driver.textures.library import load_texture
from tests.haptic_driver.lab.refusal import refused

EFFECT = {
    "id": 0,
    "effect_type": "Basis",
    "position": 10,
    "keyframes": [
        {"relative_position": 0, "amplitude_modulation": 0.0},
        {"relative_position": 20, "amplitude_modulation": 0.8},
        {"relative_position": 30, "frequency_modulation": 5},
        {"relative_position": 40, "amplitude_modulation": 0.4},
    ],
}
BAND = {"band_type": "Curve", "curve_type": "Linear", "effects": [EFFECT]}
CHANNEL = {"id": 0, "gain": 1.0, "body_part_mask": 0, "bands": [BAND], "vertices": []}
FRICTION = {"id": 3, "perception_modality": "Friction", "channels": [CHANNEL]}
CONTENT = {"version": "2023", "profile": "Main", "perceptions": [FRICTION], "avatars": []}
TOML = 'kind = "hjif"\nfile = "effect.hjif"\ncof_low = 0.5\ncof_high = 0.7\n'


def changed(path, value):
    """The fixture with the entry at `path` replaced, or removed where the value is `...`."""
    content = copy.deepcopy(CONTENT)
    place = content
    for key in path[:-1]:
        place = place[key]
    if value is ...:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return content


P = ("perceptions", 0)
C = (*P, "channels", 0)
B = (*C, "bands", 0)
E = (*B, "effects", 0)


def load(folder, content, toml=TOML):
    (folder / "effect.hjif").write_text(
        content if isinstance(content, str) else json.dumps(content)
    )
    (folder / "effect.toml").write_text(toml)
    return load_texture(str(folder / "effect.toml"), [])


def along_x(texture, *x_mm):
    return [texture.cof_at(x * 1e-3, 0.0) for x in x_mm]


def test_curve_of_lines(tmp_path):
    curve = load(tmp_path, CONTENT)
    # amplitudes 0, 0.8 and 0.4 at 10, 30 and 50 mm; 0 is 0.5 and 1 is 0.7
    assert along_x(curve, 10, 20, 30, 40, 50) == pytest.approx([0.5, 0.58, 0.66, 0.62, 0.58])
    assert all(math.isnan(c) for c in along_x(curve, 9.9, 50.1))
    assert curve.bounds() == pytest.approx((0.5, 0.66))


def test_gain_unit_direction_and_ends(tmp_path):
    assert along_x(load(tmp_path, changed((*C, "gain"), 0.5)), 30) == pytest.approx([0.58])
    assert along_x(load(tmp_path, changed((*P, "unit_exponent"), -2)), 300) == pytest.approx([0.66])
    turned = load(tmp_path, CONTENT, TOML + 'direction_deg = 90\noutside = "clamp"\n')
    assert turned.cof_at(0.2, 0.030) == pytest.approx(0.66)
    assert turned.cof_at(0.2, 0.090) == pytest.approx(0.58)


def test_older_files_say_tracks(tmp_path):
    content = copy.deepcopy(CONTENT)
    content["perceptions"][0]["tracks"] = content["perceptions"][0].pop("channels")
    assert along_x(load(tmp_path, content), 30) == pytest.approx([0.66])


@pytest.mark.parametrize("kind", ["Cubic", "Akima"])
def test_curved_through_its_keyframes(tmp_path, kind):
    curve = load(tmp_path, changed((*B, "curve_type"), kind))
    assert along_x(curve, 10, 30, 50) == pytest.approx([0.5, 0.66, 0.58])
    x_mm = np.linspace(10, 50, 4001)
    slopes = np.diff(along_x(curve, *x_mm.tolist())) / np.diff(x_mm)
    assert np.abs(np.diff(slopes)).max() < 1e-3  # lines would turn by 0.012 per mm at 30 mm


def test_natural_cubic_against_its_formula(tmp_path):
    # One inner knot: second derivative m there, 4 m h/6 = (difference of the slopes); see any text
    # on splines.
    curve = load(tmp_path, changed((*B, "curve_type"), ...))
    h, (a, b, c) = 20.0, (0.5, 0.66, 0.58)
    m = 1.5 * ((c - b) / h - (b - a) / h) / h
    middle = (a + b) / 2 - m * h**2 / 16
    assert along_x(curve, 20) == pytest.approx([middle])


def test_overshoot_of_a_curve_is_cut(tmp_path):
    frames = [
        {"relative_position": 10 * i, "amplitude_modulation": a}
        for i, a in enumerate([0.0, 0.0, 1.0, 1.0, 1.0])
    ]
    content = changed((*E, "keyframes"), frames)
    content["perceptions"][0]["channels"][0]["bands"][0]["curve_type"] = "Cubic"
    curve = load(tmp_path, content)
    assert curve.bounds() == pytest.approx((0.5, 0.7))
    assert along_x(curve, 10, 20, 30, 40) == pytest.approx([0.5, 0.5, 0.7, 0.7])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("MIHS\0\0", "is not JSON"),
        (changed(("perceptions",), [FRICTION, FRICTION]), "has the perceptions Friction, Friction"),
        (changed((*P, "channels"), [CHANNEL, CHANNEL]), "has 2 channels"),
        (changed((*C, "direction"), {"X": 0, "Y": 1, "Z": 0}), "has a direction"),
        (changed((*C, "gain"), 1.5), "amplitudes 0 to 1.2"),
        (changed((*B, "band_type"), "WaveletWave"), "band of type WaveletWave"),
        (changed((*E, "keyframes"), ...), "without keyframes"),
        (changed((*E, "keyframes"), EFFECT["keyframes"][::-1]), "do not increase"),
        (changed((*P, "unit_exponent"), 3), "is 40000 m long"),
    ],
)
def test_what_is_not_supported_is_refused_by_name(tmp_path, content, words):
    if words.startswith("is 40000"):
        content["perceptions"][0]["channels"][0]["bands"][0]["curve_type"] = "Cubic"
    with refused("bad_hjif", words, str(tmp_path / "effect.hjif")):
        load(tmp_path, content)


@pytest.mark.parametrize("through", ["effect.hmpg", "effect.toml"])
def test_binary_files_are_refused(tmp_path, through):
    (tmp_path / "effect.hmpg").write_bytes(b"\0\1\2")
    (tmp_path / "effect.toml").write_text(TOML.replace(".hjif", ".hmpg"))
    with refused("bad_hjif", "binary .hmpg", hint="export the effect as .hjif"):
        load_texture(str(tmp_path / through), [])
