"""`haptic reproduce`: the files it writes and what it says."""

from pathlib import Path

import matplotlib.image
import pytest

from tests.haptic_driver.commands import rows_of, said_by


@pytest.fixture(scope="module")
def everything(tmp_path_factory):
    """All figures once: the folder and what `--json` said."""
    out = tmp_path_factory.mktemp("reproduction") / "folder"
    return out, said_by("reproduce", "--out", out)


def test_it_lists_what_it_wrote(everything):
    out, said = everything
    assert said["model"] == "reference"
    assert {Path(f).name for f in said["files"]} == {f.name for f in out.iterdir()}
    assert {f"figure-{n}.png" for n in range(4, 9)} <= {f.name for f in out.iterdir()}


def test_every_picture_opens_and_shows_something(everything):
    out, _ = everything
    for number in range(4, 9):
        picture = matplotlib.image.imread(out / f"figure-{number}.png")[..., :3]
        assert min(picture.shape[:2]) > 600
        assert picture.std() > 0.05


def test_figure_4_leaves_a_field_empty_where_the_print_has_no_answer(everything):
    out, _ = everything
    rows = rows_of(out / "figure-4.csv")
    lost = [r for r in rows if r["electrostatic_pressure_published_pa"] == ""]
    assert 0 < len(lost) < len(rows)
    assert all(float(r["electrostatic_pressure_corrected_pa"]) >= 0.0 for r in rows)


def test_elasticities_are_a_table_of_four_parameters_by_ten_frequencies(everything):
    out, _ = everything
    rows = rows_of(out / "figure-8-elasticities.csv")
    assert len(rows) == 10
    parameters = (
        "insulator_thickness_m",
        "skin_thickness_m",
        "insulator_permittivity",
        "skin_modulus_pa",
    )
    assert set(rows[0]) == {"frequency_hz"} | {
        f"{p}_{v}" for p in parameters for v in ("corrected", "published")
    }


def test_facts_are_in_the_table_and_in_the_answer(everything):
    out, said = everything
    rows = rows_of(out / "facts.csv")
    assert [r["statement"] for r in rows] == [f["statement"] for f in said["facts"]]
    no_answer = [f for f in said["facts"] if f["published"] is None]
    assert len(no_answer) == 1


def test_one_figure_for_a_person(haptic, tmp_path):
    done = haptic("reproduce", "--figure", 6, "--out", tmp_path / "six")
    assert done.status == 0
    assert "the text states" in done.out
    assert "figure-6.png" in done.out
    assert {f.name for f in (tmp_path / "six").iterdir()} == {
        "figure-6.png",
        "figure-6.csv",
        "facts.csv",
    }


@pytest.mark.parametrize("number", ["3", "x"])
def test_a_figure_that_the_model_does_not_compute(haptic, tmp_path, number):
    done = haptic("reproduce", "--figure", number, "--out", tmp_path / "no", "--json")
    assert done.status == 2
    assert done.said["error"]["code"] == "usage"
    assert not (tmp_path / "no").exists()


def test_a_published_model_has_nothing_to_stand_beside(haptic, tmp_path):
    done = haptic("reproduce", "--model", "published", "--out", tmp_path / "no", "--json")
    assert done.status == 2
    assert "variant 'corrected'" in done.said["error"]["hint"]
