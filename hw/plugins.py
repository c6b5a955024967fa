"""Kinds of devices that are installed, by entry point: a package outside this one adds a kind by
naming it.

A package may fail, exit or hang while it is imported: only names are listed, and one is loaded
where a file names it.
"""

from __future__ import annotations

from difflib import get_close_matches
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any


@cache
def installed(group: str) -> dict[str, EntryPoint]:
    """The entry points of a group by name; none of them is loaded."""
    found = tuple(entry_points(group=group))
    # as for imports, the first on the path wins
    return {point.name: point for point in reversed(found)}


def known(group: str, name: str, what: str) -> str:
    """Return `name` if something of that name is installed; ValueError lists what is, the nearest
    first.
    """
    names = sorted(installed(group))
    if name not in names:
        close = get_close_matches(name, names, n=1, cutoff=0.5)
        meant = f"did you mean {close[0]!r}? " if close else ""
        raise ValueError(
            f"{name!r} is no {what} that is installed; {meant}Installed:"
            f" {', '.join(names) or 'none'}"
        )
    return name


@cache
def load(group: str, name: str, what: str) -> Any:
    """What the entry point names; ValueError as `known`, or for one that cannot be loaded, even one
    that exits.
    """
    point = installed(group)[known(group, name, what)]
    try:
        return point.load()
    except (Exception, SystemExit) as error:
        said = f"{type(error).__name__}: {error}"
        raise ValueError(f"{what} {name!r} ({point.value}) cannot be loaded: {said}") from error
