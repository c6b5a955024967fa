"""No function takes more than eight parameters."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("model", "hw", "haptic_driver")
# a command has as many parameters as it has options
COMMANDS = {ROOT / "haptic_driver" / room for room in ("cli", "lab/commands")}
MOST_PARAMETERS = 8
TOP = {"errors", "files", "signals", "limits", "config", "client"}

EIGHT = "a, b, c, d, e, f, g, h"
TOO_MANY = [
    f"def f({EIGHT}, i): ...",
    f"def f({EIGHT}, *, i): ...",
    f"def f({EIGHT}, /, *i): ...",
    f"def f({EIGHT}, **i): ...",
    f"async def f({EIGHT}, i): ...",
    f"f = lambda {EIGHT}, i: 0",
    f"class A:\n    def f(self, {EIGHT}, i): ...",
    f"class A:\n    @staticmethod\n    def f({EIGHT}, i): ...",
    f"def outer():\n    def f({EIGHT}, i): ...",
]
ENOUGH = [
    f"def f({EIGHT}): ...",
    f"class A:\n    def f(self, {EIGHT}): ...",
    f"class A:\n    @classmethod\n    def f(cls, {EIGHT}): ...",
]


def crowded(source: str) -> Iterator[str]:
    """Functions with too many parameters, `self` and `cls` not counted: name, line and how many."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            a = node.args
            every = [
                *a.posonlyargs,
                *a.args,
                *filter(None, (a.vararg,)),
                *a.kwonlyargs,
                *filter(None, (a.kwarg,)),
            ]
            count = len(every) - (bool(every) and every[0].arg in ("self", "cls"))
            if count > MOST_PARAMETERS:
                yield f"{getattr(node, 'name', 'lambda')} in line {node.lineno} takes {count}"


@pytest.mark.parametrize("package", PACKAGES)
def test_nothing_that_is_shipped_is_crowded(package):
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    found = {}
    for file in files:
        source = file.read_text()
        found[str(file)] = [] if file.parent in COMMANDS else list(crowded(source))
    assert {file: what for file, what in found.items() if what} == {}


@pytest.mark.parametrize("source", TOO_MANY)
def test_a_function_with_nine_parameters_breaks_the_rule(source):
    assert len(list(crowded(source))) == 1


@pytest.mark.parametrize("source", ENOUGH)
def test_as_much_as_is_allowed_keeps_it(source):
    assert list(crowded(source)) == []


def test_six_files_lie_at_the_top_of_the_driver():
    assert {file.stem for file in (ROOT / "haptic_driver").glob("*.py")} - {"__init__"} == TOP
