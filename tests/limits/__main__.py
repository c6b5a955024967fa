"""`make limits`: the largest share of each limit that anything takes, and what keeping them costs.

python -m tests.limits [--draws N] [--seed N]
"""

from __future__ import annotations

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import cpu_count
from typing import NamedTuple

import numpy as np

from haptic_driver.lookup.models import load_model
from tests.limits.draws import authority_left, drawn, shares


class Found(NamedTuple):
    """Of one draw: the largest shares by limit, points out and refused, and what is left of
    authority.
    """

    number: int
    largest: dict[str, float]
    out: int
    refused: list[str]
    left: float
    has_effects: bool
    about: str


def found(seed: int, number: int) -> Found | None:
    """One draw, if there is one."""
    draw = drawn(load_model("reference"), np.random.default_rng([seed, number]))
    if draw is None:
        return None
    largest: dict[str, float] = {}
    for kind, voltages_v in (
        ("set point", [p.voltage_v for p in draw.points]),
        ("carrier at full scale", draw.full_scale_v),
    ):
        for limit, taken in shares(draw, voltages_v)._asdict().items():
            largest[f"{limit.replace('_', ' ')}, {kind}"] = float(np.max(taken, initial=0.0))
    has_effects = bool(draw.description.effect_parameters)
    return Found(
        number,
        largest,
        len(draw.points),
        draw.refused,
        authority_left(draw),
        has_effects,
        draw.about,
    )


def main() -> int:
    """Draw, and say what came of it; 1 where a limit is exceeded or a point was refused."""
    parser = argparse.ArgumentParser(
        description="Random models on random rigs against every limit."
    )
    parser.add_argument("--draws", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=2)
    asked = parser.parse_args()
    began_s = time.monotonic()
    results: list[Found] = []
    done = 0
    with ProcessPoolExecutor(cpu_count()) as pool:
        for result in pool.map(partial(found, asked.seed), range(asked.draws), chunksize=4):
            done += 1
            results += [] if result is None else [result]
            if done % 100 == 0:
                print(
                    f"{done} of {asked.draws} draws, {time.monotonic() - began_s:.0f} s", flush=True
                )
    worst = {name: max(results, key=lambda r: r.largest[name]) for name in results[0].largest}
    print("\nlargest share of each limit, by the full model at that very point:")
    for name, result in worst.items():
        print(f"  {name:45} {result.largest[name]:.6f}  (draw {result.number})")
    refused = [result for result in results if result.refused]
    out, at_the_gate = sum(r.out for r in results), sum(len(r.refused) for r in results)
    print(f"{out} points went out, {at_the_gate} were refused at the gate")
    for has_effects, whose in ((False, "without effects"), (True, "with effects")):
        left = np.array(
            [r.left for r in results if r.has_effects is has_effects and np.isfinite(r.left)]
        )
        print(
            f"authority that is left of what the limits allow, models {whose} ({left.size}): mean"
            f" {left.mean():.3f}, 5th percentile {np.quantile(left, 0.05):.3f}, least"
            f" {left.min():.3f}"
        )
    for result in refused[:3]:
        print(f"refused in draw {result.number}: {result.refused[0]}; {result.about}")
    exceeded = [r for r in worst.values() if max(r.largest.values()) > 1.0 + 1e-9]
    for result in exceeded[:3]:
        print(f"exceeded in draw {result.number}: {result.about}")
    return int(bool(exceeded or refused))


if __name__ == "__main__":
    sys.exit(main())
