"""The generated pages are those that the program would write today, and the site's menu shows every
page.
"""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path

import pytest
from pydantic import Field

from haptic_driver.config import Section
from haptic_driver.processes.started import MEMORY, PROCESSES, THREADS
from haptic_driver.rig.config import RigConfig

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
sys.path.insert(0, str(DOCS))
reference = importlib.import_module("reference")


def test_what_is_generated_is_up_to_date():
    stale = [p.name for p, text in reference.texts().items() if text != p.read_text("utf-8")]
    assert stale == [], "run: python docs/reference.py"


def test_the_page_of_processes_lists_those_that_there_are():
    page = (DOCS / "processes.md").read_text(encoding="utf-8")
    for title, parts in (("Processes", PROCESSES), ("Threads", THREADS), ("Memory", MEMORY)):
        section = page.split(f"## {title}\n")[1].split("\n## ")[0]
        listed = re.findall(r"^\| `(\w+)` \|", section, flags=re.MULTILINE)
        assert listed == [part.name for part in parts]


def test_every_key_that_a_rig_may_have_is_on_the_page():
    page = (DOCS / "configuration.md").read_text(encoding="utf-8")
    for key in RigConfig.model_fields:
        assert f"`{key}`" in page or re.search(rf"### `\[+{key}\]+`", page), key


class Sledge(Section):
    """What is pushed."""

    speed_m_s: float = Field(ge=0.0, description="how fast")
    mass_kg: float = Field(default=0.5, description="without the finger")


class SledgeFile(Section):
    """A file with a section."""

    sledge: Sledge


def test_one_field_is_a_row_of_the_reference():
    *_, table = reference.sections(SledgeFile.model_json_schema())
    assert table.splitlines()[2:] == [
        "| `speed_m_s` | number, ≥ 0 | m/s | required | how fast |",
        "| `mass_kg` | number |  | 0.5 | without the finger |",
    ]


@pytest.mark.parametrize("said", ["", "  # how slow, and\n      # much more"])
def test_one_field_is_a_line_of_the_template(said):
    template = f"# By hand.\n\n[sledge]  # by hand\nspeed_m_s = 0.1{said}\n"
    assert reference.commented(template, SledgeFile.model_json_schema()).splitlines() == [
        "# By hand.",
        "",
        "[sledge]  # by hand",
        "speed_m_s = 0.1                       # how fast",
        "# mass_kg = 0.5                       # without the finger",
    ]


def test_a_key_without_a_meaning_is_refused():
    class Made(Section):
        speed_m_s: float = Field(ge=0.0)

    with pytest.raises(KeyError, match="speed_m_s"):
        list(reference.sections(Made.model_json_schema()))


def test_a_page_without_a_place_for_a_part_is_refused():
    with pytest.raises(ValueError, match="no place for rows"):
        reference.filled("<!-- rows: by `python docs/reference.py` -->", {"rows": "a"})


def test_every_example_stands_word_for_word_on_the_page_about_python():
    page = (DOCS / "python.md").read_text(encoding="utf-8")
    shown = re.findall(r"```python\n(.*?)\n```", page, flags=re.DOTALL)
    for code, path in zip(shown, sorted((ROOT / "examples").glob("[0-9]*.py")), strict=True):
        assert path.read_text(encoding="utf-8").endswith(code + "\n")


def test_the_menu_of_the_site_shows_every_page_once():
    listed = re.findall(
        r": ([\w-]+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), flags=re.MULTILINE
    )
    assert sorted(listed) == sorted(path.name for path in DOCS.glob("*.md"))


def test_the_site_loads_nothing_from_elsewhere():
    menu = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert re.search(r"^  font: false", menu, flags=re.MULTILINE)
    assert "http" not in menu
