"""Whether a texture keeps its places or the length of its waves on a panel that reports seldom."""

import math

import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.render.texture import Uniform
from haptic_driver.textures.library import load

SAID = {
    "grating": 'kind = "grating"\nmean_cof = 0.6\namplitude_cof = 0.1\nperiod_mm = 2.0\n',
    "noise": (
        'kind = "noise"\nmean_cof = 0.6\namplitude_cof = 0.1\nshortest_mm = 2.0\nlongest_mm = 4.0\n'
    ),
    "profile": 'kind = "profile"\nfile = "points.csv"\n',
}
POINTS = "position_mm,cof\n0,0.6\n1,0.7\n"


def loaded(folder, text):
    (folder / "points.csv").write_text(POINTS)
    (folder / "texture.toml").write_text(text)
    return load(str(folder / "texture.toml"), []).target


@pytest.mark.parametrize(
    ("kind", "finest_m"), [("grating", 0.002), ("noise", 0.002), ("profile", math.inf)]
)
def test_waves_give_way_where_places_are_less_well_known_than_half_of_one(tmp_path, kind, finest_m):
    texture = loaded(tmp_path, SAID[kind])
    assert texture.wave_m == pytest.approx(finest_m)
    assert texture.is_finer_than(0.0011) is (kind != "profile")
    assert not texture.is_finer_than(0.0009)


@pytest.mark.parametrize("kind", SAID)
def test_an_author_may_choose(tmp_path, kind):
    assert loaded(tmp_path, SAID[kind] + 'placement = "time"\n').is_finer_than(1e-6)
    assert not loaded(tmp_path, SAID[kind] + 'placement = "space"\n').is_finer_than(1.0)
    with pytest.raises(BadInputError, match="placement"):
        loaded(tmp_path, SAID[kind] + 'placement = "both"\n')


def test_what_has_no_waves_keeps_its_places():
    assert not Uniform(0.6).is_finer_than(1.0)


def test_check_says_how_waves_are_rendered(haptic, tmp_path):
    """A panel that is off by 1.7 mm half of the time cannot place waves of 1 mm."""
    (tmp_path / "fine.toml").write_text(SAID["grating"])
    fine = "texture", "check", tmp_path / "fine.toml", "--speed", "0.137"
    assert haptic(*fine, "--rig", "paper", "--json").said["placement"]["by"] == "time"
    said = " ".join(haptic(*fine, "--rig", "paper").out.split())
    assert "rendered by time" in said
    assert "mm behind at 137 mm/s" in said
    near = haptic(*fine, "--rig", "simulated-envelope", "--json").said["placement"]
    assert near["by"] == "space"
