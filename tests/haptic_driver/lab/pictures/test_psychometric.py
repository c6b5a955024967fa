"""Psychometric functions as they are drawn: what the axis says, and where an interval goes on."""

import numpy as np
import pytest

from haptic_driver.lab.pictures.psychometric import (
    Answers,
    Threshold,
    _draw,
    draw_functions,
    draw_levels,
    draw_thresholds,
)
from haptic_driver.lab.psychophysics.functions import Psychometric
from haptic_driver.pictures.saving import pyplot
from tests.haptic_driver.pictures.test_friction_pictures import assert_picture

FUNCTION = Psychometric("weibull", 0.2, 3.0, 0.5)
LEVELS = np.array([0.05, 0.1, 0.2, 0.3])


def panel(interval, axis="level"):
    answered = np.full(4, 10.0)
    positive = FUNCTION.at(LEVELS) * answered
    return Answers("a", LEVELS, positive, answered, FUNCTION.at, 0.2, interval, axis=axis)


@pytest.mark.parametrize(
    ("interval", "arrows"),
    [
        ((0.15, 0.25), []),
        ((0.0, 0.25), ["<"]),
        ((0.15, 0.64), [">"]),
        ((-np.inf, np.inf), ["<", ">"]),
    ],
)
def test_an_interval_that_leaves_the_axis_has_an_arrow_there(interval, arrows):
    figure, axes = pyplot().subplots()
    _draw(axes, panel(interval))
    assert [line.get_marker() for line in axes.lines if line.get_marker() in "<>"] == arrows
    pyplot().close(figure)


def test_trials_and_thresholds_are_drawn(tmp_path):
    course = ([0.3, 0.2, 0.2], [True, False, True])
    levels = panel((0.1, 0.2))._replace(courses=[course, course])
    nothing = Answers("b", *3 * [np.empty(0)], said="too few", courses=[course])
    draw_levels([levels, nothing], "P01", tmp_path / "levels.png")
    rows = [Threshold("P01", 0.2, (-np.inf, 0.3)), Threshold("mean of 2", 0.25, (0.1, 0.4))]
    draw_thresholds(rows, "task", "level", tmp_path / "thresholds.png")
    for name in ("levels", "thresholds"):
        assert_picture(tmp_path / f"{name}.png")


def test_a_picture_of_two_conditions(tmp_path):
    draw_functions([panel((0.1, 0.9)), panel((0.1, 0.2))], "P01", tmp_path / "picture.png")
    assert_picture(tmp_path / "picture.png")
