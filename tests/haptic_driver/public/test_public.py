"""The names of `import haptic_driver as hd`, used as a script uses them."""

import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import haptic_driver as hd

COLUMNS = ("frequency_hz", "voltage_v", "normal_force_n")


@pytest.mark.process
def test_the_bare_import_loads_nothing_slow():
    code = "import sys, haptic_driver; print(*sorted(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert "haptic_driver" in loaded
    assert not loaded & {"numpy", "scipy", "numba", "pydantic", "matplotlib", "h5py"}


@pytest.mark.parametrize("name", hd.__all__)
def test_every_name_is_there_and_says_what_it_is(name):
    assert getattr(hd, name).__doc__
    assert name in dir(hd)


def test_the_version_is_that_of_the_project():
    project = Path(__file__).parents[3] / "pyproject.toml"
    assert hd.__version__ == tomllib.loads(project.read_text("utf-8"))["project"]["version"]


def test_numbers_give_numbers_and_arrays_arrays():
    one = hd.predict("reference", frequency_hz=250.0, voltage_v=75.0, normal_force_n=0.5)
    spread = {"frequency_hz": [[10.0], [250.0]], "voltage_v": [0.0, 40.0, 75.0]}
    grid = hd.predict("reference", **spread, normal_force_n=0.5)
    assert one.cof.shape == ()
    assert grid.cof.shape == (2, 3)
    assert grid.cof[1, 2] == pytest.approx(float(one.cof))
    assert np.all(np.diff(grid.cof, axis=1) > 0.0)


def test_a_table_goes_in_and_comes_out():
    asked = pd.DataFrame([[100.0, 50.0, 0.5], [100.0, 0.0, 0.5]], columns=COLUMNS)
    frame = hd.predict("reference", asked).to_frame()
    assert frame[list(COLUMNS)].equals(asked)
    assert frame["electrostatic_force_n"][1] == 0.0
    assert frame.attrs["units"]["current_rms_a"] == "A"
    assert hd.predict("reference", asked).to_xarray()["cof"].sizes == {"row": 2}


def test_an_unknown_condition_is_refused_with_the_nearest():
    with pytest.raises(hd.BadInputError) as told:
        hd.predict("reference", frequency_hz=1.0, voltage=1.0, normal_force_n=1.0)
    assert "Did you mean 'voltage_v'?" in told.value.hint
    with pytest.raises(hd.BadInputError, match="voltage_v is missing"):
        hd.predict("reference", frequency_hz=1.0, normal_force_n=1.0)


def test_a_model_with_other_numbers_answers_otherwise():
    thin = hd.load_model("reference").with_values(skin_thickness_m=160e-6)
    asked = {"frequency_hz": 250.0, "voltage_v": 75.0, "normal_force_n": 0.5}
    assert hd.predict(thin, **asked).cof > hd.predict("reference", **asked).cof


@pytest.fixture(scope="module")
def rig():
    return hd.simulated_rig("simulated")


def test_a_point_gives_its_friction_by_the_model(rig):
    point = rig.surface.solve(friction=0.60, normal_force_n=0.5)
    at = {"frequency_hz": point.frequency_hz, "voltage_v": point.voltage_v}
    answer = hd.predict("reference", **at, normal_force_n=0.5)
    assert float(answer.cof) == pytest.approx(0.60, rel=2e-3)  # between the surface's nodes
    low, high = rig.surface.reachable(0.5)
    with pytest.raises(hd.BadInputError, match="cannot be reached") as told:
        rig.surface.solve(friction=2.0 * high)
    assert f"{low:.4g} to {high:.4g}" in told.value.hint


def test_a_slide_is_scored_drawn_and_tabled(rig, tmp_path):
    slide = rig.slide(0.6, speed_m_s=0.02, normal_force_n=0.5, duration_s=0.6)
    assert slide.score.share_within_5_percent > 0.8
    frame = slide.to_frame()
    assert len(frame) == 600
    assert 0.0 < slide.max_voltage_v <= 150.0
    assert slide.plot().save(tmp_path / "slide.pdf").read_bytes()[:4] == b"%PDF"
    assert "within 5 %" in str(slide)


@pytest.mark.parametrize("wrong", [{"speed_m_s": -1.0}, {"normal_force_n": 1e3}])
def test_a_slide_that_no_finger_makes_is_refused(rig, wrong):
    with pytest.raises(hd.BadInputError, match="out of range"):
        rig.slide("grating", **wrong)


def test_pictures_show_in_notebooks(rig):
    assert rig.surface.plot()._repr_mimebundle_()["image/png"][:4] == b"\x89PNG"


def test_a_command_that_fails_is_an_error(capsys):
    hd.command("texture check linen")
    assert "linen" in capsys.readouterr().out
    with pytest.raises(hd.HapticError, match="status 2"):
        hd.command("haptic texture check nowhere")


def test_figures_of_a_real_rig_that_nobody_measured_are_not_rendered_by():
    with pytest.raises(hd.HapticError, match="measured_by"):
        hd.simulated_rig("paper").slide(0.65, duration_s=0.1)
