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
    for number in range(4, 9):
        assert matplotlib.image.imread(out / f"figure-{number}.png")[..., :3].std() > 0.05


def test_figure_4_leaves_a_field_empty_where_the_print_has_no_answer(everything):
    out, _ = everything
    rows = rows_of(out / "figure-4.csv")
    lost = [r for r in rows if r["electrostatic_pressure_published_pa"] == ""]
    assert 0 < len(lost) < len(rows)
    assert all(float(r["electrostatic_pressure_corrected_pa"]) >= 0.0 for r in rows)


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
    names = {f.name for f in (tmp_path / "six").iterdir()}
    assert names == {"figure-6.png", "figure-6.csv", "facts.csv"}


def test_a_published_model_has_nothing_to_stand_beside(haptic, tmp_path):
    done = haptic("reproduce", "--model", "published", "--out", tmp_path / "no")
    assert done.status == 2
    assert "variant 'corrected'" in done.err
    assert not (tmp_path / "no").exists()
