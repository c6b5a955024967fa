"""Record of one hidden effect: a strength knob, a shape drawn once per data set, and two functional forms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .touch import State

CATALOGUE, ALTERNATIVE = "catalogue", "alternative"
FORMS = (CATALOGUE, ALTERNATIVE)


@dataclass(frozen=True)
class Effect:
    """`apply(state, knob, shape, alternative)` changes the state; knob 0 is never applied.

    `knob` is the range searched for a wanted visibility (log spaced); `describe` gives the parameters in SI units.
    `needs` names the column without which the effect cannot be seen, if there is one.
    """

    name: str
    apply: Callable[[State, float, dict, bool], None]
    knob: tuple[float, float]
    draw: Callable[[np.random.Generator], dict]
    describe: Callable[[float, dict], dict]
    needs: str = ""
    about_alternative: str = ""


@dataclass(frozen=True)
class Hidden:
    """An effect at one strength; `sessions` limits it to some sessions (empty: all).

    `bend` (share, phase) is an error of shape: the strength swings by that share over the decades of frequency.
    """

    effect: Effect
    strength: float
    shape: dict
    form: str = CATALOGUE
    sessions: tuple[int, ...] = ()
    bend: tuple[float, float] = (0.0, 0.0)

    def act(self, state: State) -> None:
        if self.strength > 0:
            share, phase = self.bend
            swing = 1 + share * np.sin(np.log10(state.rows.f) + phase) if share else 1.0
            self.effect.apply(state, self.strength * swing, self.shape, self.form == ALTERNATIVE)

    def at(self, strength: float) -> Hidden:
        return replace(self, strength=strength)

    def label(self) -> dict:
        parameters = {k: float(v) for k, v in self.effect.describe(self.strength, self.shape).items()}
        said = {"name": self.effect.name, "form": self.form, "parameters": parameters, "sessions": list(self.sessions)}
        return said | ({"bend": list(self.bend)} if self.bend[0] else {})


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def nothing(_rng: np.random.Generator) -> dict:
    return {}
