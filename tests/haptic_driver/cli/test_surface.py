"""`haptic surface build`, `info` and `plot`."""

import matplotlib.image
import numpy as np
import pytest

from haptic_driver.lookup.file import read_surface

SMALL = ["--frequency-count", "6", "--voltage-count", "8", "--force-count", "4"]


def test_build_writes_the_surface_it_describes(haptic, tmp_path, small_file):
    out = tmp_path / "folder" / "s.h5"
    done = haptic("surface", "build", "--out", out, *SMALL, "--json")
    assert (done.status, done.err) == (0, "")
    said = done.said
    assert said["out"] == str(out)
    assert said["axes"] == {
        "frequency_hz": {"low": 1.0, "high": 1e6, "count": 6},
        "voltage_v": {"low": 0.0, "high": 150.0, "count": 8},
        "normal_force_n": {"low": 0.1, "high": 2.0, "count": 4},
    }
    found = read_surface(out)
    assert said["content_hash"] == found.content_hash
    np.testing.assert_array_equal(found.cof, small_file.cof)
    assert found.cof_interval is not None
    plain = haptic("surface", "build", "--out", out, *SMALL, "--no-interval", "--json")
    assert plain.said["content_hash"] == small_file.content_hash
    other = ("--model", "table1", "--voltage-high-v", 80, "--no-interval", "--json")
    assert haptic("surface", "build", "--out", out, *SMALL, *other).said["model"] == "table1"
    assert read_surface(out).voltage_v[-1] == 80.0


def test_info_says_what_is_in_the_file(haptic, surface_path, surface_file):
    said = haptic("surface", "info", surface_path, "--json").said
    assert said["cof"]["low"] == pytest.approx(0.512, abs=1e-12)
    assert said["cof"]["high"] == pytest.approx(np.max(surface_file.cof))
    assert said["share_outside_limits"] == pytest.approx(1.0 - np.mean(surface_file.within_limits))
    assert said["share_pulled_in"] == said["share_outside_theory"] == 0.0
    assert (said["friction_law"], said["dielectric"]) == ("applied_load", "gabriel_dry")
    assert (said["model"], said["content_hash"]) == ("reference", surface_file.content_hash)


def test_plot_writes_a_picture(haptic, surface_path, tmp_path):
    out = tmp_path / "s.png"
    done = haptic("surface", "plot", surface_path, "--out", out, "--normal-force", 0.5, "--json")
    assert done.said == {"picture": str(out), "normal_force_n": 0.5}
    assert matplotlib.image.imread(out)[..., :3].std() > 0.05
