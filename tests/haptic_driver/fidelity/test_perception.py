"""Thresholds from a file: what they compute, and what is wrong with a file that is wrong."""

import math
import re
from pathlib import Path

import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.fidelity.perception import load_perception
from haptic_driver.textures.reach import WEBER

ROOT = Path(__file__).resolve().parents[3]
PUBLISHED = ROOT / "configs" / "perception" / "published.toml"
OWN = """
name = "ours"
about = "measured here"

[friction_jnd]
relative = 0.15
relative_low = 0.10
relative_high = 0.20
source = "our lab"
read = "full"
conditions = "our rig"

[detection]
kind = "force"
spread_factor = 2.0
source = "our lab"
read = "full"
conditions = "our rig"
points = [
  { frequency_hz = 50.0, force_peak_n = 4e-3 },
  { frequency_hz = 200.0, force_peak_n = 1e-3 },
]
"""


def loaded(tmp_path, text):
    path = tmp_path / "own.toml"
    path.write_text(text)
    return load_perception(str(path))


def refused(tmp_path, text):
    with pytest.raises(BadInputError) as error:
        loaded(tmp_path, text)
    return error.value


def test_published_thresholds_say_what_is_unverified():
    found = load_perception()
    assert found.jnd_friction == WEBER  # what `texture check` counts steps with
    assert found.unverified == ["detection thresholds", "other labs' correlation"]


def test_a_threshold_of_displacement_becomes_a_force_by_the_finger_s_impedance():
    # At 250 Hz, w = 1571/s: |1000 - 1e-4 w^2 + i w| = |753 + 1571 i| = 1742 N/m, times 0.1 um.
    expected_n = 1742.0 * 0.1e-6 / math.sqrt(2.0)
    assert load_perception().force_threshold_n(250.0) == pytest.approx(expected_n, rel=1e-3)


def test_thresholds_are_lowest_for_the_pacinian_channel():
    thresholds_n = load_perception().band_thresholds_n()
    assert len(thresholds_n) == 9
    assert min(thresholds_n) == thresholds_n[6]  # 200 to 318 Hz


def test_a_lab_gives_forces_of_its_own(tmp_path):
    found = loaded(tmp_path, OWN)
    assert found.jnd_friction == 0.15
    assert found.unverified == []
    rms = math.sqrt(2.0)
    assert found.force_threshold_n(50.0) == pytest.approx(4e-3 / rms)
    # Half way in the logarithm of frequency is half way in that of force.
    assert found.force_threshold_n(100.0) == pytest.approx(2e-3 / rms)
    assert found.force_threshold_n(10.0) == pytest.approx(4e-3 / rms)
    assert found.force_threshold_n(900.0) == pytest.approx(1e-3 / rms)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("relative = 0.15", "relative = 0.25", "between relative_low and relative_high"),
        ('read = "full"', 'read = "memory"', "needs unverified = true"),
        ("frequency_hz = 200.0", "frequency_hz = 50.0", "must rise"),
        ('kind = "force"', 'kind = "displacement"', "finger is missing"),
        ('source = "our lab"\n', "", "source is missing"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, old, new, said):
    assert said in refused(tmp_path, OWN.replace(old, new)).message


def test_the_page_names_every_source_of_the_file():
    page = (ROOT / "docs" / "fidelity.md").read_text()
    sources = re.findall(r'^doi = "(.+)"$', PUBLISHED.read_text(), flags=re.MULTILINE)
    assert len(sources) >= 12
    assert [doi for doi in sources if doi not in page] == []


def test_an_unknown_name_is_answered_with_the_nearest():
    with pytest.raises(BadInputError) as error:
        load_perception("publishd")
    assert error.value.code == "unknown_perception"
    assert "Did you mean 'published'?" in error.value.hint
