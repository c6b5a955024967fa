"""Sets of a challenge, which strangers answer: `haptic challenge`.

No form is the catalogue's. Set i of a seed is the same however many are made.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from string import Template

import numpy as np

from .__main__ import csv_text
from .build import ALTERNATIVE, CATALOGUE, BlindSet, Spec, build, suitable
from .designs import between
from .effects import CATALOGUE_EFFECTS, FIRST_STRANGERS, SECOND, SECOND_STRANGERS, UNFELT
from .families import CLEAR_LEVELS, INCOMPATIBLE, WITNESSES
from .measured import SMALL
from .witnesses import build_pair

MIX = {"nothing": 0.15, "one": 0.5, "outside": 0.2, "two": 0.15}
OUTSIDE = (*FIRST_STRANGERS, *SECOND_STRANGERS)
FAMILY = "challenge"
UNSEEN = 24  # settings that are asked for and were not measured
# what answers call the numbers of a finger, and what a label does
FINGER = {
    "cof_off": "mu_off",
    "roughness_rms_m": "h_rms",
    "skin_thickness_m": "skin",
    "leak_scale": "leak",
    "contact_area_m2": "area",
}


def challenge_set(i: int, seed: int, friction_alone: bool) -> BlindSet:
    """Set i: every other one with the electrode's witnesses, or none."""
    spec = _spec(i, np.random.default_rng([seed, 78, i]), friction_alone or i % 2 == 1)
    return build_pair(spec, seed)[0] if spec.design == WITNESSES else build(spec, seed)


def unseen(
    made: BlindSet, i: int, seed: int
) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """Settings of set i that nobody measured: their columns, and friction without noise, with the
    hidden effects and without.
    """
    design = between(np.random.default_rng([seed, 79, i]), made.design, UNSEEN)
    rows = design.rows
    every = {
        "frequency_hz": rows.f,
        "voltage_v": rows.v,
        "normal_force_n": rows.n,
        "speed_m_s": rows.speed,
        "time_s": rows.time,
        "session": design.session,
    }
    columns = {name: values for name, values in every.items() if name in made.columns}
    return columns, *made.friction_of(design)


def data_sheet(count: int, effects: Mapping[str, str]) -> str:
    """Columns, names of effects with their physics, form of an answer and rules, as Markdown."""
    text = Path(__file__).with_suffix(".md").read_text(encoding="utf-8")
    lines = [f"- `{name}`: {physics}" for name, physics in effects.items()]
    return Template(text).substitute(count=count, effects="\n".join(lines))


def _spec(i: int, rng: np.random.Generator, friction: bool) -> Spec:
    kind = str(rng.choice(list(MIX), p=list(MIX.values())))
    names = _names(kind, rng, friction)
    effects = tuple((name, float(rng.choice(CLEAR_LEVELS))) for name in names)
    form = CATALOGUE if kind == "outside" else str(rng.choice([ALTERNATIVE, SECOND]))
    design = _design(names, rng) if friction else WITNESSES
    return Spec(FAMILY, i, effects, form, design)


def _names(kind: str, rng: np.random.Generator, friction: bool) -> list[str]:
    if kind == "nothing":
        return []
    if kind == "outside":
        return [str(rng.choice([n for n in OUTSIDE if not (friction and n in UNFELT)]))]
    count = 2 if kind == "two" else 1
    while True:
        names = [str(n) for n in rng.choice(list(CATALOGUE_EFFECTS), count, replace=False)]
        if frozenset(names) not in INCOMPATIBLE:
            return names


def _design(names: list[str], rng: np.random.Generator) -> str:
    """One of few rows in which all of the effects can show; six sessions show every one."""
    return str(rng.choice(sorted(set(SMALL).intersection(*map(suitable, names)))))


__all__ = ["FINGER", "challenge_set", "csv_text", "data_sheet", "unseen"]
