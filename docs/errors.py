"""The codes that errors have, read from the source: for the table of `errors.md`."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("haptic_driver", "model", "hw")
KINDS = {"HapticError", "BadInputError", "RefusedError"}  # whose code comes first


class Raised(NamedTuple):
    """A code at one place of the source; `said` is the message there, empty where it is made up."""

    code: str
    said: str
    place: str


@cache
def raised() -> list[Raised]:
    """Every code at every place, in order of the codes."""
    nodes = {
        file.relative_to(ROOT).as_posix(): [*ast.walk(ast.parse(file.read_text("utf-8")))]
        for name in FOLDERS
        for file in (ROOT / name).rglob("*.py")
    }
    takes = dict(one for all_of in nodes.values() for one in _that_take_codes(all_of))
    found = (
        Raised(code, said, f"{file}:{line}")
        for file, all_of in nodes.items()
        for code, said, line in _in_file(all_of, takes)
    )
    return sorted(found)


def table() -> str:
    """A row for each code, with the first message that there is for it."""
    messages: dict[str, str] = {}
    for one in raised():
        messages[one.code] = messages.get(one.code) or one.said
    rows = [f"| `{code}` | {said or '…'} |" for code, said in messages.items()]
    return "\n".join(["| code | such as |", "|---|---|", *rows])


def _that_take_codes(nodes: list[ast.AST]) -> Iterator[tuple[str, int]]:
    """Functions and classes with a parameter `code`, and its place; methods come without `self`."""
    for node in nodes:
        if isinstance(node, ast.ClassDef):
            own = [one for one in node.body if getattr(one, "name", "") == "__init__"]
            for inner in own:
                assert isinstance(inner, ast.FunctionDef)
                yield from ((node.name, place - 1) for place in _place_of_code(inner))
            if not own and {getattr(base, "id", "") for base in node.bases} & KINDS:
                yield node.name, 0
        elif isinstance(node, ast.FunctionDef) and node.name != "__init__":
            yield from ((node.name, place) for place in _place_of_code(node))


def _place_of_code(function: ast.FunctionDef) -> list[int]:
    names = [each.arg for each in (*function.args.posonlyargs, *function.args.args)]
    return [names.index("code")] if "code" in names else []


def _in_file(nodes: list[ast.AST], takes: dict[str, int]) -> Iterator[tuple[str, str, int]]:
    names = {
        target.id: node.value
        for node in nodes
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name)
    }
    for node in nodes:
        if isinstance(node, ast.ClassDef):
            for inner in node.body:
                if isinstance(inner, ast.Assign) and ast.unparse(inner.targets[0]) == "code":
                    yield _text(inner.value, names), ast.get_docstring(node) or "", inner.lineno
        called = getattr(node.func, "id", "") if isinstance(node, ast.Call) else ""
        if called not in takes:
            continue
        assert isinstance(node, ast.Call)
        given = [each.value for each in node.keywords if each.arg == "code"]
        given += node.args[takes[called] : takes[called] + 1]
        for one in given:
            if code := _text(one, names):
                place = 1 - (takes[called] > 0)
                messages = node.args[place : place + 1] if called.endswith("Error") else []
                before = _before(nodes, node, messages)
                yield code, "".join(_text(said, before) for said in messages), node.lineno


def _before(nodes: list[ast.AST], call: ast.Call, messages: list[ast.expr]) -> dict[str, ast.expr]:
    """What the names in `messages` last stood for above a call."""
    wanted = {said.id for said in messages if isinstance(said, ast.Name)}
    found = [
        (node.lineno, node.targets[0].id, node.value)
        for node in (nodes if wanted else ())
        if isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Name)
        and node.targets[0].id in wanted
        and node.lineno < call.lineno
    ]
    return {name: value for _, name, value in sorted(found, key=lambda one: one[0])}


def _text(node: ast.expr, names: dict[str, ast.expr]) -> str:
    """A text of the source with an ellipsis for each value; empty for anything else."""
    if isinstance(node, ast.Constant):
        return " ".join(str(node.value).split()) if isinstance(node.value, str) else ""
    if isinstance(node, ast.JoinedStr):
        parts = (str(p.value) if isinstance(p, ast.Constant) else "…" for p in node.values)
        return " ".join("".join(parts).split()).replace("|", "\\|")
    if isinstance(node, ast.Name) and node.id in names:
        return _text(names[node.id], {})
    return ""
