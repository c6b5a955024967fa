"""No function takes more than eight parameters: what belongs together comes as a record."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("haptic_driver/render", "model")
MOST = 8

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


def crowded(source: str) -> list[str]:
    """Functions of a module with more than `MOST` parameters, `self` and `cls` not counted: name, line and how many."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            a = node.args
            every = [*a.posonlyargs, *a.args, *filter(None, (a.vararg,)), *a.kwonlyargs, *filter(None, (a.kwarg,))]
            count = len(every) - (bool(every) and every[0].arg in ("self", "cls"))
            if count > MOST:
                found.append(f"{getattr(node, 'name', 'lambda')} in line {node.lineno} takes {count}")
    return found


@pytest.mark.parametrize("room", ROOMS)
def test_no_function_takes_more_than_eight_parameters(room: str) -> None:
    files = sorted((ROOT / room).rglob("*.py"))
    assert files
    assert {str(file): too_many for file in files if (too_many := crowded(file.read_text()))} == {}


@pytest.mark.parametrize("source", TOO_MANY)
def test_a_function_with_nine_breaks_the_rule(source: str) -> None:
    assert len(crowded(source)) == 1


@pytest.mark.parametrize("source", ENOUGH)
def test_eight_and_self_keep_it(source: str) -> None:
    assert crowded(source) == []
