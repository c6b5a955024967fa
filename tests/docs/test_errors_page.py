"""Codes of errors: one table, and it holds every code at every place of the source."""

import importlib
import re
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"
sys.path.insert(0, str(DOCS))
errors = importlib.import_module("errors")
PAGE = (DOCS / "errors.md").read_text("utf-8")
WORD = r"[a-z0-9]+(_[a-z0-9]+)*(_…)?"


def test_the_table_has_each_code_that_is_raised_and_no_other():
    listed = re.findall(r"^\| `(.+?)` \|", PAGE, re.MULTILINE)
    assert listed == sorted({one.code for one in errors.raised()})


def test_each_code_is_named_by_a_test():
    """A code that is made up of a word and more, `unknown_…`, by one that begins so."""
    tests = Path(__file__).resolve().parents[1].rglob("*.py")
    named = set(re.findall(r"""["']([a-z0-9_]+)["']""", "".join(map(Path.read_text, tests))))
    codes = {one.code for one in errors.raised()}
    made_up = {code for code in codes if code.endswith("_…")}
    assert sorted(codes - made_up - named) == []
    assert all(any(name.startswith(code[:-1]) for name in named) for code in made_up)


def test_a_code_is_a_word_that_a_program_can_compare():
    odd = [one for one in errors.raised() if not re.fullmatch(WORD, one.code)]
    assert odd == []


def test_codes_are_found_however_they_are_given():
    """As an argument, a name, by keyword, to a helper, and as that of a class."""
    found = {one.code for one in errors.raised()}
    ways = {"out_of_range", "scene_too_large", "bad_toml", "bad_strokes", "device_timeout"}
    assert ways | {"unknown_…"} <= found
