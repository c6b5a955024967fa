"""What an experiment's file may say, and what is said of one that is wrong."""

import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.lab.psychophysics.description import Stimulus, load_experiment
from tests.haptic_driver.lab.psychophysics.files import CONDITION, CONSTANT, made


def test_the_experiment_that_comes_with_the_program_loads():
    experiment = load_experiment("friction_difference")
    assert [c.name for c in experiment.file.condition] == ["at 0.55", "at 0.65"]
    assert (experiment.answers, experiment.keys) == (("first", "second"), ("1", "2"))
    assert experiment.guess == 0.5


def test_levels_become_stimuli(tmp_path):
    conditions = """
[[condition]]
name = "ratio"
cof = 0.5
[[condition]]
name = "difference"
cof = 0.5
compare = "difference"
[[condition]]
name = "texture"
texture = "linen"
comparisons = [{ level = 0.1, texture = "grating" }, { level = 0.3, texture = "ramp" }]
"""
    ratio, difference, texture = made(tmp_path, conditions=conditions).file.condition
    assert (ratio.standard, ratio.comparison(0.2)) == (Stimulus(0.5), Stimulus(0.6))
    assert difference.comparison(0.2) == Stimulus(0.7)
    assert ratio.level_between(0.5, 0.6) == pytest.approx(0.2)
    assert difference.level_between(0.5, 0.6) == pytest.approx(0.1)
    assert (texture.available(0.19), texture.available(0.21)) == (0.1, 0.3)
    pair = (texture.standard.texture, texture.comparison(0.3).texture)
    assert pair == ("linen", "ramp")
    assert ratio.available(0.19) == 0.19
    assert [one.axis for one in (ratio, difference, texture)] == [
        "friction above 0.5, as a share of it",
        "friction above 0.5",
        "level of the texture, as the file numbers it",
    ]


@pytest.mark.parametrize(
    ("head", "form", "guess"),
    [
        ("[trial]\nintervals = 3", "weibull", 1 / 3),
        ("[trial]\nintervals = 1", "weibull", None),
        ("", "normal", 0.0),
        ("[trial]\nintervals = 1", "normal", None),
    ],
)
def test_guessing_follows_from_the_task(tmp_path, head, form, guess):
    experiment = made(tmp_path, tables=f'{head}\n[analysis]\nform = "{form}"\n{CONSTANT}')
    assert experiment.guess == (None if guess is None else pytest.approx(guess))
    assert len(experiment.answers) == max(experiment.file.trial.intervals, 2)


@pytest.mark.parametrize(
    ("head", "tables", "conditions", "words"),
    [
        ("", '[method]\nkind = "stair"\n', CONDITION, "method.kind is 'stair'"),
        ("", CONSTANT, CONDITION.replace('"a"', '" a"'), "neither begins nor ends with a space"),
        ("", CONSTANT, CONDITION.replace('"a"', r'"a\nb"'), "one line"),
        ("", CONSTANT, CONDITION + '[[block]]\nconditions = ["b"]', "no condition 'b'"),
        ("", CONSTANT, '[[condition]]\nname = "a"\ntexture = "linen"', "comparisons"),
        ("", '[trial]\nintervals = 3\nplace = "regions"\n' + CONSTANT, CONDITION, "2 intervals"),
        ("", '[response]\nanswers = ["yes"]\n' + CONSTANT, CONDITION, "give 2 different ones"),
        ("", CONSTANT.replace("0.05", "-0.05"), CONDITION, "below 0"),
        (
            "",
            CONSTANT.replace("0.05", "-1.0") + '[analysis]\nform = "normal"',
            CONDITION,
            "makes friction 0",
        ),
        ("", '[method]\nkind = "outside"', CONDITION, "either python or url"),
        (
            "",
            '[method]\nkind = "staircase"\nstart = 2.0\nsteps = [0.1]\nlow = 0.1\nhigh = 1.0',
            CONDITION,
            "start",
        ),
    ],
)
def test_what_is_wrong_is_said(tmp_path, head, tables, conditions, words):
    with pytest.raises(BadInputError, match=words):
        made(tmp_path, head, tables, conditions)
