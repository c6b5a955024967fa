"""Pictures of textures: what is drawn where."""

import matplotlib.image
import numpy as np
import pytest

from haptic_driver.pictures.textures import preview, preview_figure
from haptic_driver.render.texture import Grating, Profile, Script, Step, Uniform

HALVES = Profile([0.0, 0.040, 0.041, 0.080], [0.5, 0.5, 0.8, 0.8])
SCRIPT = Script(
    (
        Step(0.0, Uniform(0.6), "linear", "up"),
        Step(1.0, Uniform(0.8)),
        Step(2.0, Uniform(0.6), label="end"),
    )
)


def test_low_friction_is_dark_and_high_is_bright(tmp_path):
    preview(HALVES, tmp_path / "a.png", "halves")
    picture = matplotlib.image.imread(tmp_path / "a.png")[..., :3]
    dark, bright = (
        np.all(np.abs(picture - colour) < 0.02, axis=2)
        for colour in ((0.267, 0.005, 0.329), (0.993, 0.906, 0.144))
    )
    assert dark.sum() > 20_000
    assert bright.sum() > 20_000
    assert np.argwhere(dark)[:, 1].mean() < np.argwhere(bright)[:, 1].mean()  # rising to the right


@pytest.mark.parametrize("target", [SCRIPT])
def test_every_kind_can_be_drawn(tmp_path, target):
    preview(target, tmp_path / "new" / "a.svg", "title")
    assert (tmp_path / "new" / "a.svg").stat().st_size > 5000


def test_map_and_line_of_the_whole_screen_have_one_x_axis():
    """A place of the screen is at the same pixel in both, and the map says where the line runs."""
    figure = preview_figure(Grating(0.6, 0.1, 0.010), screen_m=(0.100, 0.060))
    line, plane = figure.axes[:2]
    assert plane.get_xlim() == line.get_xlim() == (0.0, 100.0)
    assert plane.get_ylim() == (60.0, 0.0)
    figure.canvas.draw()
    for x_mm in (0.0, 37.0, 100.0):
        on_line, on_plane = (
            axes.transData.transform((x_mm, axes.get_ylim()[0]))[0] for axes in (line, plane)
        )
        assert on_line == pytest.approx(on_plane, abs=0.01)
    assert {tuple(each.get_ydata()) for each in plane.lines} == {(30.0, 30.0)}
    wave = line.lines[0]
    x_mm, friction = wave.get_xdata(), wave.get_ydata()
    np.testing.assert_allclose(friction, 0.6 + 0.1 * np.sin(2 * np.pi * x_mm / 10.0), atol=1e-9)
    pixels = plane.get_window_extent()
    assert pixels.width / 100.0 == pytest.approx(pixels.height / 60.0, rel=1e-3)  # true to scale
