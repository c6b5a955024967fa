"""Investigations of fingers that the project does not know: which effects get a name, and what
choosing well saves.

`python -m tests.blind.investigations --seed N --counts W0=2,W1=10 --out DIR` investigates each
finger twice on the simulated rig, with the same first plan, the same number of blocks per round,
and rounds that end as soon as something shows: once with blocks as `haptic investigate` chooses
them, once at random among all that the rig may do. It writes
what came of each into DIR, goes on there, and prints tables. A stranger is right as `unexplained`,
a finger with nothing hidden as `nothing_missing`.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from haptic_driver.lab.measuring import investigate as product
from haptic_driver.lab.measuring.investigate import Budget, Subject, investigate
from haptic_driver.lab.measuring.plan import Plan, load_plan
from haptic_driver.lab.measuring.run import prepare
from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import load_rig
from haptic_driver.simulation.finger_function import FingerFunction
from model.diagnosis.witness import LEAST_STD
from model.planning.design import Design, design, design_for_unseen
from model.planning.discrimination import Choice
from model.touch_model import TouchModel
from tests.reports import without_pictures

from .generator.designs import NONE, RESTING, SLIDING
from .generator.designs import Design as Reading
from .generator.effects import STRANGERS
from .generator.electrode import Rig, alone
from .generator.families import specs
from .generator.touch import STEADY_SPEED, Finger, Rows
from .generator.witnesses import Noise, Truth, WitnessSight, truth_of
from .scores import wilson

ROUNDS = 4
CHOSEN, RANDOM = "chosen", "at random"
TIME_STEP_S = 0.05  # effects of time see it in steps this long
FEW = """
name = "few"
voltage_off_every = 4
[[points]]
frequency_hz = [20.0, 100.0, 250.0]
voltage_v = [75.0, 110.0]
normal_force_n = [0.25, 1.0]
speed_m_s = 0.02
[[sweep]]
frequency_hz = { low = 10.0, high = 1e5, per_decade = 1 }
normal_force_n = 0.5
finger = ["none", "resting", "sliding"]
"""


def finger_function(finger: Finger, rig: Rig, truth: Truth) -> Callable[..., Any]:
    """The generator's finger as design.md wants a function."""
    needs = set[str]().union(*(hidden.needs for hidden in truth))

    @lru_cache(maxsize=512)
    def answer(
        frequency_hz: float, voltage_v: float, load_n: float, speed_m_s: float, time_s: float
    ) -> Any:
        kind = NONE if load_n <= 0.0 else RESTING if speed_m_s == 0.0 else SLIDING
        speed = speed_m_s if "speed_m_s" in needs else STEADY_SPEED
        row = Rows(
            *(
                np.array([x])
                for x in (frequency_hz, voltage_v, load_n if kind != NONE else 0.5, speed, time_s)
            )
        )
        seen = alone(row, kind, finger, rig, truth)
        force_n = float(seen.cof[0]) * load_n if kind == SLIDING else 0.0
        silent = voltage_v <= 0.0
        return (
            force_n,
            0j if silent else complex(seen.current[0]),
            0j if silent else complex(seen.voltage[0]),
        )

    def of_arrays(
        frequency_hz: Any, voltage_v: Any, normal_force_n: Any, speed_m_s: Any, time_s: Any
    ) -> Any:
        steps = TIME_STEP_S * round(float(time_s[0]) / TIME_STEP_S) if "time_s" in needs else 0.0
        condition = (float(x[0]) for x in (frequency_hz, voltage_v, normal_force_n, speed_m_s))
        return tuple(np.array([part]) for part in answer(*condition, steps))

    return of_arrays


@contextmanager
def random_choice(seed: int) -> Iterator[None]:
    """As many blocks in every round as would have been chosen, but drawn from all."""
    chance = np.random.default_rng(seed)

    def drawn(choose: Callable[..., Design], diagnosis: Any, pool: Any, *given: Any) -> Design:
        chosen = choose(diagnosis, pool, *given)
        blocks = chance.permutation(pool.cost_s.size)[: len(chosen.choices)]
        pairs = [choice.separates for choice in chosen.choices]
        return Design(
            tuple(Choice(int(b), p, 0.0) for b, p in zip(blocks, pairs, strict=True)), chosen.reach
        )

    product.design, product.design_for_unseen = (
        partial(drawn, design),
        partial(drawn, design_for_unseen),
    )  # type: ignore[assignment]
    try:
        yield
    finally:
        product.design, product.design_for_unseen = design, design_for_unseen


def lambda_read(folder: Path, finger: Finger, rig: Rig, truth: Truth) -> float:
    """How visible what is hidden is over all that was read, a file being a session, in the noise
    that the files state.

    Monitors are believed to LEAST_STD.
    """
    files = sorted(folder.glob("round-*/data*.csv"))
    parts = [
        np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8")
        for path in files
    ]
    read = {name: np.concatenate([part[name] for part in parts]) for name in parts[0].dtype.names}
    touch = np.select(
        [read["finger"] == "none", read["finger"] == "resting"], [NONE, RESTING], SLIDING
    )
    load_n = np.where(touch == NONE, 0.5, read["normal_force_n"])
    rows = Rows(read["frequency_hz"], read["voltage_v"], load_n, read["speed_m_s"], read["time_s"])
    session = np.repeat(np.arange(len(parts)), [part.size for part in parts])

    def std(column: str, of: str = "") -> float:
        there = read[of] > 0.0 if of else np.isfinite(read[column])
        return max(
            float(np.median(read[column][there] / (read[of][there] if of else 1.0))), LEAST_STD
        )

    noise = Noise(
        std("cof_std", "cof"),
        std("current_std_a", "current_a"),
        std("current_phase_std_rad"),
        std("electrode_voltage_std_v", "electrode_voltage_v"),
        std("electrode_voltage_phase_std_rad"),
    )
    reading = Reading(
        "read", rows, session, session, (), finger=touch, slides=np.isfinite(read["cof"])
    )
    return WitnessSight(reading, finger, rig, noise).of(truth)


def asked(
    hidden: list[str],
    function: Callable[..., Any],
    plan: Plan,
    seed: int,
    visible: Callable[[Path], float] = lambda folder: 0.0,
) -> dict[str, Any]:
    """One investigation: its outcome, the names, and what it took; `beyond`: settings that the
    first plan has not.

    `visible`: lambda over what was read.
    """
    subject = Subject(
        load_rig("simulated"), load_model("reference"), plan, FingerFunction(function), seed
    )
    first = prepare(subject.config, TouchModel(subject.description), plan).rows
    with tempfile.TemporaryDirectory() as folder, without_pictures():
        found = investigate(subject, Path(folder), Budget(rounds=ROUNDS))
        seen = visible(Path(folder))
    names = [effect["name"] for effect in found.diagnosis["effects"]]
    alike = [
        other for effect in found.diagnosis["effects"] for other in effect["indistinguishable_from"]
    ]
    return {
        "hidden": hidden,
        "outcome": found.outcome,
        "named": names,
        "or": alike,
        "rounds": found.rounds,
        "settings": len(found.settings),
        "beyond": len(set(found.settings) - {row.setting for row in first}),
        "minutes": found.measured_s / 60.0,
        "lambda": seen,
    }


def _is_right(got: dict[str, Any]) -> bool:
    known = [name for name in got["hidden"] if name not in STRANGERS]
    if not known:
        return bool(got["outcome"] == ("unexplained" if got["hidden"] else "nothing_missing"))
    return bool(got["outcome"] == "named" and set(got["named"]) == set(known))


def _rates(part: Sequence[dict[str, Any]]) -> list[str]:
    """Right, wrongly named, right or in the group; and the median of what it took."""
    wrong = sum(got["outcome"] == "named" and not _is_right(got) for got in part)
    listed = sum(
        _is_right(got) or set(got["hidden"]) <= {*got["named"], *got["or"]} for got in part
    )
    counts = [sum(map(_is_right, part)), wrong, listed]
    took = [
        f"{statistics.median(got[what] for got in part):.3g}"
        for what in ("rounds", "settings", "minutes")
    ]
    return [*(wilson(count, len(part)) for count in counts), *took]


def settings_to_a_name(pairs: Sequence[dict[str, Any]]) -> str:
    """Settings beyond the first plan to the right name, as chosen and at random, where the first
    plan gave none.

    No name counts as more than any.
    """
    later = [pair for pair in pairs if max(got["rounds"] for got in pair.values()) > 1]
    if not later:
        return ""
    took = {
        how: [pair[how]["beyond"] if _is_right(pair[how]) else math.inf for pair in later]
        for how in (CHOSEN, RANDOM)
    }
    medians = (f"{statistics.median(counts):.3g} {how}" for how, counts in took.items())
    return (
        f"settings beyond the first plan to the name, median of {len(later)}: {', '.join(medians)};"
        f" {took}\n"
    )


def table(found: dict[str, list[dict[str, Any]]]) -> str:
    """Markdown; `found`: a family's name to what came of each finger, as chosen and at
    random.
    """
    lines = [
        "| family | blocks | right | named wrongly | right or in the group | rounds | settings |"
        " minutes |"
    ]
    lines.append("|---" * 8 + "|")
    for family, pairs in found.items():
        for how in (CHOSEN, RANDOM):
            rates = _rates([pair[how] for pair in pairs])
            lines.append(f"| {family} | {how} | {' | '.join(rates)} |")
    lines += ["", "| hidden | blocks | outcome | names | or | rounds | settings | lambda |"]
    lines.append("|---" * 8 + "|")
    for how, got in (item for pairs in found.values() for pair in pairs for item in pair.items()):
        names, others = " ".join(got["named"]), " ".join(got["or"])
        took = f"{got['rounds']} | {got['settings']} | {got['lambda']:.0f}"
        lines.append(
            f"| {' '.join(got['hidden']) or 'nothing'} | {how} | {got['outcome']} | {names} |"
            f" {others} | {took} |"
        )
    known = [
        pair
        for pairs in found.values()
        for pair in pairs
        if set(pair[CHOSEN]["hidden"]) - set(STRANGERS)
    ]
    return "\n".join(lines) + "\n\n" + settings_to_a_name(known)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--counts", default="W1=10")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    few = given.out / "few.toml"
    few.write_text(FEW)
    plan = load_plan(str(few))
    counts = {
        name: int(count)
        for name, _, count in (item.partition("=") for item in given.counts.split(","))
    }
    found: dict[str, list[dict[str, Any]]] = {}
    for spec in specs(given.seed, 1.0, counts=counts):
        kept = given.out / f"{spec.family}-{spec.index}.json"
        if not kept.exists():
            finger, rig, truth = truth_of(spec, given.seed)
            names, function = (
                [name for name, _ in spec.effects],
                finger_function(finger, rig, truth),
            )
            visible = partial(lambda_read, finger=finger, rig=rig, truth=truth)
            asks = partial(asked, names, function, plan, visible=visible)
            pair = {CHOSEN: asks(spec.index)}
            with random_choice(spec.index):
                pair[RANDOM] = asks(spec.index)
            kept.write_text(json.dumps(pair, indent=1))
        found.setdefault(spec.family, []).append(json.loads(kept.read_text()))
        said = (
            f"{how}: {got['outcome']} {got['named']} {got['settings']}"
            for how, got in found[spec.family][-1].items()
        )
        print(spec.family, spec.index, *(name for name, _ in spec.effects), *said, flush=True)
    print(table(found))


if __name__ == "__main__":
    main()
