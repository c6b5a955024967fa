"""A room's modules are closed to others, but for those that its `__init__` names in `__all__`."""

from __future__ import annotations

import ast
from importlib import import_module
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("haptic_driver", "model", "hw")
CONTAINERS = (*PACKAGES, "haptic_driver.lab")  # their children are rooms, or single modules


@pytest.fixture(scope="module")
def graph():
    return grimp.build_graph(*PACKAGES, cache_dir=None)


def rooms(graph: grimp.ImportGraph) -> set[str]:
    children = set().union(*map(graph.find_children, CONTAINERS)) - set(CONTAINERS)
    return {child for child in children if graph.find_children(child)}


def named(room: str) -> list[str]:
    """What its `__init__` names; a test fails here for a room that names nothing."""
    tree = ast.parse((ROOT / room.replace(".", "/") / "__init__.py").read_text())
    (said,) = (
        node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    )
    return list(ast.literal_eval(said))


def through_walls(graph: grimp.ImportGraph) -> list[str]:
    """Imports of what a room does not name, from outside of it."""
    return [
        f"{importer} -> {module}"
        for room in rooms(graph)
        for module in graph.find_descendants(room)
        if module.removeprefix(f"{room}.").split(".")[0] not in named(room)
        for importer in graph.find_modules_that_directly_import(module)
        if importer != room and not importer.startswith(f"{room}.")
    ]


def test_nothing_is_imported_that_its_room_does_not_name(graph):
    assert through_walls(graph) == []


def test_what_a_room_names_is_there(graph):
    for room in rooms(graph):
        inner = {child.removeprefix(f"{room}.") for child in graph.find_children(room)}
        own = {name for name in named(room) if hasattr(import_module(room), name)}
        assert set(named(room)) <= inner | own, room


@pytest.mark.parametrize(
    ("importer", "imported"),
    [
        ("haptic_driver.client", "haptic_driver.daemon.supervision"),
        ("haptic_driver.lab.papers.pdf", "haptic_driver.lab.measuring.bench"),
        ("hw.force.net_ft", "hw.transport.visa"),
        ("model.reporting.report", "model.diagnosis.decide"),
    ],
)
def test_an_import_through_a_wall_is_found(graph, importer, imported):
    graph.add_import(importer=importer, imported=imported)
    found = through_walls(graph)
    graph.remove_import(importer=importer, imported=imported)
    assert found == [f"{importer} -> {imported}"]
