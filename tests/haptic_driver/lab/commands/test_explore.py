"""`haptic explore`: the files it writes, and that they say what the model says."""

import math
from pathlib import Path

import matplotlib.image
import pytest

from tests.haptic_driver.commands import rows_of, said_by

PICTURES = ["force-spectra", "impedance", "steepness", "friction-load", "friction-speed"]


@pytest.fixture(scope="module")
def explored(tmp_path_factory):
    """The folder and what `--json` said."""
    out = tmp_path_factory.mktemp("explored") / "folder"
    return out, said_by("explore", "--out", out)


def test_it_lists_what_it_wrote(explored):
    out, said = explored
    assert said["model"] == "reference"
    names = {f"{name}.{ending}" for name in PICTURES for ending in ("png", "csv")}
    assert {Path(f).name for f in said["files"]} == {f.name for f in out.iterdir()} == names
    for name in PICTURES:
        assert matplotlib.image.imread(out / f"{name}.png")[..., :3].std() > 0.02


def test_the_mean_force_of_the_sine_is_the_reference(explored):
    rows = rows_of(explored[0] / "force-spectra.csv")
    mean, ripple = (row for row in rows if row["drive"].startswith("sine"))
    assert (float(mean["frequency_hz"]), float(ripple["frequency_hz"])) == (0.0, 500.0)
    # the key result, section 1 of physics.md
    assert float(mean["force_n"]) == pytest.approx(0.1008, rel=2e-3)


def test_the_stuck_finger_is_insulator_and_skin_in_series(explored):
    """Table I, and dry skin at 1 MHz by the check values of physics.md: eps' 990.8, 1.32e-2 S/m."""
    rows = rows_of(explored[0] / "impedance.csv")
    stuck = [row for row in rows if row["touch"] == "stuck or wet"][-1]
    assert float(stuck["frequency_hz"]) == pytest.approx(1e6)
    jw_eps0 = 2j * math.pi * 1e6 * 8.854e-12
    length_m = 1e-6 / 3.9 + 200e-6 / (990.8 + 1.32e-2 / jw_eps0)
    found = complex(float(stuck["resistance_ohm"]), float(stuck["reactance_ohm"]))
    assert (
        abs(found / (length_m / (jw_eps0 * 1e-4)) - 1.0) < 2e-3
    )  # three digits are known of the skin


def test_equations_that_know_only_the_sine_are_refused(haptic, tmp_path):
    done = haptic("explore", "--model", "published", "--out", tmp_path / "new", "--json")
    assert done.status == 2
    assert "no drive but the sine" in done.said["error"]["message"]
    assert not (tmp_path / "new").exists()
