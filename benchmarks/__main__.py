"""Run every benchmark, print one table, and exit with 1 when a claim does not hold."""

from __future__ import annotations

import sys

from rich.console import Console
from rich.table import Table

from benchmarks import (
    arbitrary_upload,
    envelope,
    published_algorithm,
    start_up,
    surface_build,
    surface_lookup,
    surface_rebuild,
    tick_compute,
    tick_lateness,
    transport,
)
from benchmarks.claim import Claim


def main() -> int:
    table = Table("claim", "measured", "wanted", "holds")
    claims: list[Claim] = []
    for part in (
        surface_build, surface_rebuild, surface_lookup, published_algorithm, transport, arbitrary_upload, tick_compute,
        envelope, tick_lateness, start_up,
    ):  # fmt: skip
        for claim in part.run():
            claims.append(claim)
            table.add_row(claim.what, claim.measured, claim.wanted, "[green]yes" if claim.holds else "[red]NO")
    Console(soft_wrap=True).print(table)
    return 0 if all(claim.holds for claim in claims) else 1


if __name__ == "__main__":
    sys.exit(main())
