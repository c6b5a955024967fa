"""One claim: what was measured against what was promised; and the tables that show them."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable
from typing import NamedTuple

from rich.console import Console
from rich.table import Table

COLUMNS = 100


class Claim(NamedTuple):
    """`wanted` None: nothing is promised, the line is information."""

    what: str
    measured: str
    wanted: str | None = None
    holds: bool = True


def show(claims: Iterable[Claim]) -> None:
    """What is promised first, in one table; then what is information only, in another."""
    promised = Table("claim", "measured", "wanted", "holds", width=COLUMNS)
    told = Table("information", "measured", width=COLUMNS)
    for what, measured, wanted, holds in claims:
        if wanted is None:
            told.add_row(what, measured)
        else:
            promised.add_row(what, measured, wanted, "[green]yes" if holds else "[red]NO")
    console = Console(width=COLUMNS)
    for table in (promised, told):
        if table.rows:
            console.print(table)


def seconds(function: Callable[[], object], repeats: int = 5) -> float:
    """Median time of one call, after one call that is not counted."""
    function()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return statistics.median(times)
