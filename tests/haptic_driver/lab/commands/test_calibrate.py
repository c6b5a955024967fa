"""`haptic calibrate`: what it prints and writes, and how it refuses."""

import numpy as np
import pytest

from model.conditions import Conditions
from model.description import read_model
from tests.haptic_driver.commands import said_by

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


def test_a_model_file_that_no_command_would_find_is_refused(refuses, data, tmp_path):
    refuses("bad_ending", "calibrate", data, "--out", tmp_path / "finger.png")
    assert not (tmp_path / "finger.png").exists()


def test_a_finger_is_fitted_and_written(haptic, data, tmp_path):
    out = tmp_path / "out" / "finger.toml"
    found = said_by("calibrate", data, "--out", out)
    assert set(found["parameters"]) == KNOWN
    for name, p in found["parameters"].items():
        assert p["value"] == pytest.approx(read_model(out).parameters[name].value)
        assert p["interval_95"][0] < p["value"] < p["interval_95"][1]
    assert found["rows"] == 40
    assert 0.4 < found["chi2_per_point"] < 1.8
    assert out.with_suffix(".png").read_bytes()[:4] == b"\x89PNG"
    shown = haptic("calibrate", data, "--out", out)
    assert "chi-square per point" in shown.out


def test_a_parameter_that_is_not_known_gives_the_nearest_that_is(refuses, data, tmp_path):
    words = ("calibrate", data, "--also", "skin_thicknes_m", "--out", tmp_path / "f.toml")
    error = refuses("bad_parameter", *words)
    assert "--also skin_thicknes_m" in error["message"]
    assert error["hint"].startswith("Did you mean 'skin_thickness_m'?")
    assert not (tmp_path / "f.toml").exists()
