"""`haptic calibrate`: what it prints and writes, and how it refuses."""

import numpy as np
import pytest

from model.conditions import Conditions
from model.description import read_model

KNOWN = {"cof_off", "roughness_rms_m", "skin_thickness_m", "leak_scale"}


@pytest.fixture
def data(touch, rng, tmp_path):
    """The reference finger itself, with 2 % of noise."""
    f, v = (
        x.ravel()
        for x in np.meshgrid(
            [10.0, 100.0, 250.0, 1e3, 1e4], [0.0, 40.0, 80.0, 110.0], indexing="ij"
        )
    )
    f, v = np.tile(f, 2), np.tile(v, 2)
    clean = touch.predict(Conditions(f, v, np.full(f.size, 0.5))).cof
    cof = clean * np.exp(0.02 * rng.standard_normal(f.size))
    path = tmp_path / "finger.csv"
    rows = [f"{a},{b},0.5,{c},{0.02 * c}" for a, b, c in zip(f, v, cof, strict=True)]
    path.write_text("\n".join(["frequency_hz,voltage_v,normal_force_n,cof,cof_std", *rows]) + "\n")
    return path


def test_a_parameter_that_is_not_known_gives_the_nearest_that_is(haptic, data, tmp_path):
    done = haptic(
        "calibrate", data, "--also", "skin_thicknes_m", "--out", tmp_path / "finger.toml", "--json"
    )
    assert done.status == 2
    error = done.said["error"]
    assert "--also skin_thicknes_m" in error["message"]
    assert error["hint"].startswith("Did you mean 'skin_thickness_m'?")
    assert not (tmp_path / "finger.toml").exists()


@pytest.mark.parametrize("name", ["finger", "finger.png"])
def test_a_model_file_that_no_command_would_find_is_refused(haptic, data, tmp_path, name):
    done = haptic("calibrate", data, "--out", tmp_path / name, "--json")
    assert (done.status, done.said["error"]["code"]) == (2, "bad_ending")
    assert not (tmp_path / name).exists()


def test_a_finger_is_fitted_and_written(haptic, data, tmp_path):
    out = tmp_path / "out" / "finger.toml"
    done = haptic("calibrate", data, "--out", out, "--json")
    assert done.status == 0, done.err
    found = done.said
    assert set(found["parameters"]) == KNOWN
    for name, p in found["parameters"].items():
        assert p["value"] == pytest.approx(read_model(out).parameters[name].value)
        assert p["interval_95"][0] < p["value"] < p["interval_95"][1]
    assert found["rows"] == 40
    assert 0.4 < found["chi2_per_point"] < 1.8
    assert out.with_suffix(".png").read_bytes()[:4] == b"\x89PNG"
    shown = haptic("calibrate", data, "--out", out)
    assert "chi-square per point" in shown.out


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [(["--also", "skin_modulus"], "skin_modulus_pa"), (["--model", "refernce"], "reference")],
)
def test_wrong_arguments_of_calibrate(haptic, data, tmp_path, arguments, hint):
    done = haptic("calibrate", data, "--out", tmp_path / "f.toml", "--json", *arguments)
    assert done.status == 2
    assert hint in done.said["error"]["hint"]
    assert not (tmp_path / "f.toml").exists()


def test_a_table_of_other_names_and_units_gives_the_same_finger(haptic, data, tmp_path):
    """Loads in mN, friction under a name of the lab's."""
    ours = data.read_text().splitlines()[1:]
    theirs = tmp_path / "theirs.csv"
    rows = [line.replace(",0.5,", ",500,", 1) for line in ours]
    theirs.write_text("\n".join(["frequency_hz,voltage_v,Fz,COF_mean,cof_std", *rows]) + "\n")
    named = ["--column", "normal_force_n=Fz:mN", "--column", "cof=COF_mean:1"]
    first = haptic("calibrate", data, "--out", tmp_path / "a.toml", "--json").said
    second = haptic("calibrate", theirs, *named, "--out", tmp_path / "b.toml", "--json").said
    assert second["parameters"] == first["parameters"]
