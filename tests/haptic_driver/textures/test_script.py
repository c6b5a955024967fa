"""Timed target scripts: CSV and TOML alike, textures by name, and what is refused with which
words.
"""

from pathlib import Path

import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.render.texture import Marker, Profile, Script, Uniform
from haptic_driver.signals import FingerState
from haptic_driver.textures.library import load

SHIPPED = [Path(__file__).parents[3] / "configs" / "textures"]
TABLE = (
    "time_s,cof,texture,interpolation,label\n"
    "0,0.6,,,start\n1,0.7,,linear,\n2,,uniform,cosine,fade\n3,,mine,,end\n"
)
TOML = """
kind = "script"
interpolation = "{}"
step = [
  {{ time_s = 0, cof = 0.6, label = "start" }},
  {{ time_s = 1, cof = 0.7, interpolation = "linear" }},
  {{ time_s = 2, texture = "uniform", interpolation = "cosine", label = "fade" }},
  {{ time_s = 3, texture = "mine", label = "end" }},
]
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "mine.csv").write_text("position_mm,cof\n0,0.5\n100,0.7\n")
    (tmp_path / "mine.toml").write_text('kind = "profile"\nfile = "mine.csv"\n')
    return tmp_path


def read(folder, text, name="script.csv"):
    (folder / name).write_text(text)
    loaded = load(str(folder / name), SHIPPED)
    assert loaded.kind == "script"
    assert isinstance(loaded.target, Script)
    return loaded.target


def at(script, time_s, x_m=0.05):
    return script.cof_under(FingerState(time_s, x_m, 0.0, 0.0, 0.0, 0.5, True))


def refused(folder, text, name="script.csv"):
    with pytest.raises(BadInputError) as caught:
        read(folder, text, name)
    assert caught.value.hint
    return caught.value


@pytest.mark.parametrize(
    ("text", "name"), [(TABLE, "script.csv"), (TOML.format("hold"), "script.toml")]
)
def test_csv_and_toml_say_the_same(folder, text, name):
    script = read(folder, text, name)
    assert [s.time_s for s in script.steps] == [0.0, 1.0, 2.0, 3.0]
    assert [s.interpolation for s in script.steps] == ["hold", "linear", "cosine", "hold"]
    assert script.steps[2].texture == Uniform(0.60)
    assert isinstance(script.steps[3].texture, Profile)  # found beside the script
    assert [at(script, t) for t in (0.5, 1.5, 2.5)] == pytest.approx([0.6, 0.65, 0.6])
    assert at(script, 2.5, x_m=0.1) == pytest.approx(0.65)  # halfway from 0.6 to the profile's 0.7
    assert script.markers(-1.0, 9.0) == tuple(
        Marker(*one) for one in ((0.0, "start"), (2.0, "fade"), (3.0, "end"))
    )


def test_interpolation_for_steps_that_do_not_say(folder):
    script = read(folder, TOML.format("linear"), "script.toml")
    assert at(script, 0.5) == pytest.approx(0.65)
    (folder / "s.csv").write_text("time_s,cof\n0,0.6\n1,0.7\n")
    text = 'kind = "script"\nfile = "s.csv"\ninterpolation = "linear"'
    assert at(read(folder, text, "t.toml"), 0.5) == pytest.approx(0.65)


def test_shipped_script():
    loaded = load("steps", SHIPPED)
    labels = [m.label for m in loaded.target.markers(-1.0, 9.0)]
    assert labels == ["low", "high", "ramp", "fade", "linen", "end"]
    assert [at(loaded.target, t) for t in (0.5, 1.5, 2.5)] == pytest.approx([0.60, 0.75, 0.675])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time_s,cof\n0,0.6\n", "fewer than two steps"),
        ("time_s,cof\n1,0.6\n1,0.7\n", "line 3: time_s 1 comes after 1"),
        (
            "time_s,cof,texture\n0,0.6,uniform\n1,0.7,\n",
            "line 2: a step has either a cof or a texture",
        ),
        ("time_s,texture\n0,linnen\n1,linen\n", "line 2: there is no texture 'linnen'"),
        ("time_s,texture\n0,script.csv\n1,linen\n", "script.csv is a script itself"),
        ("time_s,mu\n0,0.6\n1,0.7\n", "unknown column 'mu'"),
    ],
)
def test_fault_is_named_with_its_line(folder, text, words):
    error = refused(folder, text)
    assert words in error.message
    assert str(folder / "script.csv") in error.message


def test_scripts_in_a_circle_are_refused(folder):
    for own, other in (("a", "b"), ("b", "a")):
        steps = f'{{ time_s = 0, texture = "{other}" }}, {{ time_s = 1, cof = 0.6 }}'
        (folder / f"{own}.toml").write_text(f'kind = "script"\nstep = [{steps}]\n')
    with pytest.raises(BadInputError, match="is a script itself"):
        load("a", [folder])


def test_unknown_texture_and_column_get_the_nearest(folder):
    assert "Did you mean 'linen'?" in refused(folder, "time_s,texture\n0,linnen\n1,linen\n").hint
    assert "Did you mean 'label'?" in refused(folder, "time_s,cof,labl\n0,0.6,a\n1,0.7,b\n").hint


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            'file = "a.csv"\nstep = [{ time_s = 0, cof = 0.6 }, { time_s = 1, cof = 0.6 }]',
            "either the key 'file'",
        ),
        ("step = [{ time_s = 0, cof = 0.6 }, { time_s = 1, cof = 99.0 }]", "step.1.cof: "),
        ('file = "gone.csv"', "gone.csv does not exist"),
    ],
)
def test_fault_in_toml_is_named(folder, text, words):
    assert words in refused(folder, f'kind = "script"\n{text}\n', "script.toml").message
