"""Families F0 to F10 of diagnosis.md section 7, W0 to W5 with the electrode's witnesses, and the
fixed list for CI.

Every family draws the first two forms of its effects and the first ten strangers; `anew` turns what
it drew into the second or third alternatives and the same ten.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from . import noise
from .build import ALTERNATIVE, CATALOGUE, Spec
from .designs import BAD, GOOD
from .effects import (
    CATALOGUE_EFFECTS,
    FIRST_STRANGERS,
    SECOND,
    SECOND_STRANGERS,
    THIRD_STRANGERS,
    UNFELT,
)
from .measured import SMALL

COUNTS = {
    "F0": 300,
    "F1": 960,
    "F2": 100,
    "F3": 1000,
    "F4": 300,
    "F5": 200,
    "F6": 150,
    "F7": 300,
    "F8": 100,
    "F9": 100,
    "F10": 200,
    "W0": 150,
    "W1": 400,
    "W4": 100,
    "W5": 150,
}
NAMES = tuple(CATALOGUE_EFFECTS)
OUTSIDE = tuple(FIRST_STRANGERS)
WITNESSES = "witnesses"  # the design of the families W
SECOND_COUNTS = {
    "W0": 18,
    "W1": 66,
    "W4": 22,
    "W5": 20,
}  # each effect three times, each stranger at least twice
CLEAR_LEVELS = (100.0, 300.0, 1000.0)
LEVELS = (9.0, 16.0, 25.0, 50.0, 100.0, 400.0)
# truth, and a design on which physics.md or a first look says it hides behind another effect
ALIASED = (
    ("series_resistance", "paper"),
    ("amplifier_bandwidth", "paper"),
    ("amplifier_slew_limit", "paper"),
    ("electrode_polarization", "voltage_frequency"),
    ("humid_gap_conduction", "voltage_frequency"),
    ("floating_body", "voltage_frequency"),
    ("speed_dependent_gap", "speed_sweep"),
    ("viscoelastic_skin", "speed_sweep"),
    ("air_breakdown", "paper"),
    ("trapped_charge", "paper"),
    ("load_dependent_friction", "factorial"),
    ("capillary_adhesion", "factorial"),
    ("drive_gain_error", "paper"),
    ("skin_hydration", "paper"),
    ("skin_nonlinearity", "paper"),
    ("contact_area_law", "factorial"),
    ("charge_build_up", "timed"),
)
INCOMPATIBLE = {
    frozenset(p)
    for p in (("skin_hydration", "skin_nonlinearity"), ("air_breakdown", "trapped_charge"))
}


def _cycle(options: tuple, i: int):
    return options[i % len(options)]


def _form(i: int) -> str:
    return ALTERNATIVE if i % 2 else CATALOGUE


def f0(i: int, _rng: np.random.Generator) -> Spec:
    return Spec("F0", i, design=_cycle(tuple(GOOD), i))


def f1(i: int, rng: np.random.Generator) -> Spec:
    level = LEVELS[(i + i // len(NAMES)) % len(LEVELS)]
    return Spec(
        "F1", i, ((_cycle(NAMES, i * 7), level),), str(rng.choice([CATALOGUE, ALTERNATIVE]))
    )


def f2(i: int, rng: np.random.Generator) -> Spec:
    name, design = _cycle(ALIASED, i)
    return Spec("F2", i, ((name, float(rng.choice([50.0, 100.0, 200.0]))),), design=design)


def f3(i: int, rng: np.random.Generator) -> Spec:
    """Strengths spread evenly in log lambda: the generator knows no priors of the catalogue under
    test.
    """
    if rng.random() < 0.2:
        return Spec("F3", i)
    return Spec(
        "F3", i, ((str(rng.choice(NAMES)), float(np.exp(rng.uniform(0.0, np.log(2000.0))))),)
    )


def f4(i: int, rng: np.random.Generator) -> Spec:
    return Spec(
        "F4", i, ((_cycle(OUTSIDE, i), float(rng.choice([50.0, 100.0, 200.0, 400.0, 800.0]))),)
    )


def f5(i: int, rng: np.random.Generator) -> Spec:
    while True:
        chosen = [str(n) for n in rng.choice(NAMES, 3 if i % 10 == 9 else 2, replace=False)]
        if not any(frozenset((a, b)) in INCOMPATIBLE for a in chosen for b in chosen if a != b):
            break
    weak = float(rng.choice([12.0, 35.0, 100.0, 250.0]))
    levels = [weak, weak * float(rng.uniform(1.0, 3.0)), weak * 1.5]
    return Spec("F5", i, tuple(zip(chosen, levels[: len(chosen)], strict=True)), _form(i // 2))


def f6(i: int, rng: np.random.Generator) -> Spec:
    effects = () if i % 2 else ((str(rng.choice(NAMES)), 100.0),)
    if i % 6 == 5:  # a drive ten per cent off that nobody calls an effect
        effects = (("drive_gain_error", 12.0),)
    return Spec("F6", i, effects, far=True)


def f7(i: int, rng: np.random.Generator) -> Spec:
    effects = () if i % 2 == 0 else ((str(rng.choice(NAMES)), 100.0),)
    return Spec("F7", i, effects, _form(i // 2), noise=_cycle(noise.WRONG, i // 2))


def f8(i: int, rng: np.random.Generator) -> Spec:
    kind = i % 3
    effect = ((str(rng.choice(NAMES)), 400.0),)
    if kind == 0:
        return Spec("F8", i, gain_sd=0.08, design="six_sessions")
    if kind == 1:
        return Spec("F8", i, effect, gain_sd=0.08, partial_sessions=2)
    return Spec("F8", i, effect if i % 2 else (), gain_sd=0.08, contaminated=True)


def f9(i: int, rng: np.random.Generator) -> Spec:
    effects = (
        ()
        if i % 3 == 2
        else (
            (
                str(rng.choice([n for n in NAMES if CATALOGUE_EFFECTS[n].needs != "speed_m_s"])),
                100.0,
            ),
        )
    )
    return Spec("F9", i, effects, _form(i), design=_cycle(tuple(BAD), i))


def f10(i: int, rng: np.random.Generator) -> Spec:
    level = float(rng.choice([50.0, 100.0, 200.0, 400.0]))
    return Spec("F10", i, ((_cycle(NAMES, i * 7), level),), ALTERNATIVE)


def w0(i: int, _rng: np.random.Generator) -> Spec:
    return Spec("W0", i, design=WITNESSES)


def w1(i: int, rng: np.random.Generator) -> Spec:
    level = float(rng.choice(CLEAR_LEVELS))
    return Spec(
        "W1", i, ((_cycle(NAMES, i * 7), level),), _form(i // len(NAMES) + i), design=WITNESSES
    )


def w4(i: int, rng: np.random.Generator) -> Spec:
    return Spec(
        "W4", i, ((_cycle(OUTSIDE, i * 3), float(rng.choice(CLEAR_LEVELS))),), design=WITNESSES
    )


def w5(i: int, rng: np.random.Generator) -> Spec:
    drawn = f5(0, rng).effects[:2]
    return Spec(
        "W5",
        i,
        tuple((n, float(rng.choice(CLEAR_LEVELS))) for n, _ in drawn),
        _form(i),
        design=WITNESSES,
    )


FAMILIES: dict[str, Callable[[int, np.random.Generator], Spec]] = {
    family.__name__.upper(): family
    for family in (f0, f1, f2, f3, f4, f5, f6, f7, f8, f9, f10, w0, w1, w4, w5)
}


def specs(seed: int, scale: float, counts: dict[str, int] | None = None) -> list[Spec]:
    """Specifications; set i of a family does not depend on `scale`. `counts` overrides it."""
    wanted = counts or {name: max(1, round(count * scale)) for name, count in COUNTS.items()}
    return [
        FAMILIES[name](i, np.random.default_rng([seed, 77, int(name[1:]), i]))
        for name, count in wanted.items()
        for i in range(count)
    ]


def anew(spec: Spec, form: str = SECOND) -> Spec:
    """The same set with the second (or third) alternative of every effect, a stranger of that ten.

    Where friction is all there is, a stranger leaves its trace there.
    """
    ten = SECOND_STRANGERS if form == SECOND else THIRD_STRANGERS
    strange = tuple(n for n in ten if spec.design == WITNESSES or n not in UNFELT)
    effects = tuple(
        (_cycle(strange, OUTSIDE.index(name)) if name in OUTSIDE else name, level)
        for name, level in spec.effects
    )
    is_strange = any(name in ten for name, _ in effects)
    return replace(spec, effects=effects, form=CATALOGUE if is_strange else form)


def as_measured(spec: Spec) -> Spec:
    """The same set as a lab's sensors would give it, of a plan that is small enough for that."""
    design = spec.design if spec.design in (*SMALL, *BAD) else ""
    return replace(spec, measured=True, design=design)


def ci_specs() -> list[Spec]:
    """Five fixed sets: 1 null, 2 single, 1 stranger, 1 with wrong noise."""
    null = Spec("F0", 0, design="paper")
    singles = (
        ("amplifier_bandwidth", 200.0, "voltage_frequency"),
        ("contact_ageing", 300.0, "timed"),
    )
    single = [Spec("F1", i, ((n, level),), _form(i), d) for i, (n, level, d) in enumerate(singles)]
    strange = Spec("F4", 0, (("sensor_resonance_frequency", 800.0),), design="voltage_frequency")
    return [null, *single, strange, Spec("F7", 0, noise="scale_1.5", design="six_sessions")]
