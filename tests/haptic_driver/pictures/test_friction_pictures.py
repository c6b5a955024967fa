"""Pictures are written, show the right section, and fail with a message."""

import matplotlib.image
import numpy as np
import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.pictures.friction_pictures import draw_surface
from model.conditions import Conditions


def assert_picture(path):
    pixels = matplotlib.image.imread(path)
    assert min(pixels.shape[:2]) > 300
    assert pixels[..., :3].std() > 0.01  # not one flat colour


@pytest.mark.parametrize("asked_n", [0.1, 2.0])
def test_a_surface_under_the_load_asked_for(small_file, tmp_path, asked_n):
    """Levels of the small surface: 0.1, 0.271, 0.737 and 2 N."""
    draw_surface(small_file, asked_n, tmp_path / "surface.png")
    assert_picture(tmp_path / "surface.png")


def test_a_section_is_what_the_model_says_between_levels_too(surface_file, touch):
    cof, allowed = surface_file.section(0.5)
    f, v = np.meshgrid(
        surface_file.frequency_hz[::40], surface_file.voltage_v[1::40], indexing="ij"
    )
    said = touch.predict(Conditions(f.ravel(), v.ravel(), np.full(f.size, 0.5))).cof
    assert cof[::40, 1::40].ravel() == pytest.approx(said, rel=2e-3)
    level = surface_file.normal_force_n.searchsorted(0.5)
    assert not (allowed & ~surface_file.within_limits[:, :, level]).any()


def test_a_surface_of_which_nothing_is_allowed(make_file, tmp_path):
    shape = (5, 6, 4)
    file = make_file(
        np.geomspace(1, 1e4, 5),
        np.geomspace(0.1, 2, 4),
        np.linspace(0, 90, 6),
        within_limits=np.zeros(shape, bool),
    )
    draw_surface(file, 0.5, tmp_path / "surface.png")
    assert_picture(tmp_path / "surface.png")


@pytest.mark.parametrize("force_n", [0.05, 3.0, float("nan")])
def test_a_force_off_the_surface(small_file, tmp_path, force_n):
    with pytest.raises(BadInputError) as refused:
        draw_surface(small_file, force_n, tmp_path / "surface.png")
    assert refused.value.code == "out_of_range"
    assert "0.1 to 2 N" in refused.value.hint
