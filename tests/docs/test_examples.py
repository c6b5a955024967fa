"""Every numbered script of `examples/` runs as it stands, from a folder of the reader's."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"

# What each must say at the end, as far as it does not depend on chance or machine.
SAID = {
    "1_predict_a_table": r"\n +10000 +0\.0\d+ +0\.5\d+ ",
    "2_find_an_operating_point": r"friction 0\.600 at \d+ Hz and \d+\.\d V peak",
    "3_render_a_slide": (
        r"within 5 % for (9\d|100) % of the time; a constant(.|\n)*generator says off"
    ),
    "4_calibrate_a_finger": r"skin_thickness_m +0\.00016\d* m, .*\n",
}


@pytest.mark.parametrize("name", SAID)
def test_it_runs_and_says_what_it_should(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(EXAMPLES / f"{name}.py"))
    assert re.search(SAID[name], capsys.readouterr().out)
    assert list(tmp_path.iterdir()) == []


def test_none_is_left_out():
    assert {path.stem for path in EXAMPLES.glob("[0-9]*.py")} == set(SAID)
