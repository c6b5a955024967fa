"""Record of one hidden effect: a strength knob, a shape drawn once per data set, and two functional forms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

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
    """An effect at one strength; `sessions` limits it to some sessions (empty: all)."""

    effect: Effect
    strength: float
    shape: dict
    form: str = CATALOGUE
    sessions: tuple[int, ...] = ()

    def act(self, state: State) -> None:
        if self.strength > 0:
            self.effect.apply(state, self.strength, self.shape, self.form == ALTERNATIVE)

    def at(self, strength: float) -> Hidden:
        return Hidden(self.effect, strength, self.shape, self.form, self.sessions)

    def label(self) -> dict:
        parameters = {k: float(v) for k, v in self.effect.describe(self.strength, self.shape).items()}
        return {"name": self.effect.name, "form": self.form, "parameters": parameters, "sessions": list(self.sessions)}


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def nothing(_rng: np.random.Generator) -> dict:
    return {}
