"""Run every benchmark, print what was promised and what else was found, and exit with 1 when a
claim does not hold.

python -m benchmarks [NAME ...] runs those of these names alone, e.g. `tick_lateness`; `live` and
`why` run only when named.
"""

from __future__ import annotations

import sys

from benchmarks import (
    contact_area,
    contact_conditions,
    daemon_fidelity,
    envelope,
    event_line,
    live,
    load,
    placement,
    published_algorithm,
    scene,
    sensing,
    shares,
    start_up,
    surface_build,
    surface_lookup,
    tick_compute,
    tick_lateness,
    transport,
    why,
)
from benchmarks.claim import Claim, show

PARTS = (
    start_up,
    surface_build,
    surface_lookup,
    published_algorithm,
    transport,
    load,
    contact_area,
    tick_compute,
    envelope,
    sensing,
    contact_conditions,
    placement,
    tick_lateness,
    scene,
    shares,
    daemon_fidelity,
    event_line,
)


def main(names: list[str]) -> int:
    parts = {part.__name__.removeprefix("benchmarks."): part for part in (*PARTS, live, why)}
    if unknown := [name for name in names if name not in parts]:
        print(f"there is no benchmark '{unknown[0]}'; known: {', '.join(parts)}", file=sys.stderr)
        return 2
    claims: list[Claim] = []
    try:
        for name in names or [*parts][: len(PARTS)]:
            for claim in parts[name].run():
                print(f"{claim.what}: {claim.measured}", file=sys.stderr, flush=True)
                claims.append(claim)
    finally:
        show(claims)
    return 0 if all(claim.holds for claim in claims) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
