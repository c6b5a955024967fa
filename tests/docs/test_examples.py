"""Every numbered script of `examples/` runs as it stands, from a folder of the reader's."""

from __future__ import annotations

import ast
import json
import re
import runpy
from pathlib import Path

import pytest

import haptic_driver

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"

# What each must say at the end, as far as it does not depend on chance or machine.
SAID = {
    "1_predict_a_table": r"\n +1e\+04 +75 +0\.5 +0\.0\d+ +0\.5\d+ ",
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
    """The first and the last need a daemon: `test_docs.py` and `test_scene.py` run them."""
    named = {path.stem for path in EXAMPLES.glob("[1-9]*.py")}
    assert named == {*SAID, "5_drag_an_object"}


NUMBERED = sorted(EXAMPLES.glob("[0-9]*.py"))
DOCS = EXAMPLES.parent / "docs"
OURS = ("haptic_driver", "model", "hw")
FOR_DEVELOPERS = {"hardware.md", "house.md", "decisions.md"}  # they show the inside


def sources() -> dict[str, str]:
    """Every example, notebook and Python block of the pages for users, by name."""
    found = {path.name: path.read_text(encoding="utf-8") for path in NUMBERED}
    for path in EXAMPLES.glob("*.ipynb"):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
        found[path.name] = "\n".join(code)
    for path in DOCS.glob("*.md"):
        if path.name not in FOR_DEVELOPERS:
            blocks = re.findall(r"```python\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL)
            found[path.name] = "\n".join(blocks)
    return found


@pytest.mark.parametrize(("name", "source"), sources().items())
def test_it_uses_public_names_only(name, source):
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom):
            assert (node.module or "").split(".")[0] not in OURS, name
        if isinstance(node, ast.Import):
            ours = [
                a for a in node.names if a.name.split(".")[0] in {"haptic_driver", "model", "hw"}
            ]
            assert all((a.name, a.asname) == ("haptic_driver", "hd") for a in ours), name
        if isinstance(node, ast.Attribute) and getattr(node.value, "id", "") == "hd":
            assert node.attr in haptic_driver.__all__, name


def test_the_readme_shows_the_first_example_as_it_runs():
    readme = (EXAMPLES.parent / "README.md").read_text(encoding="utf-8")
    shown = re.findall(r"^```python\n(.*?)^```", readme, re.DOTALL | re.MULTILINE)
    file = (EXAMPLES / "0_first_touch.py").read_text(encoding="utf-8")
    assert shown == [file.split('"""', 2)[2].lstrip()]
