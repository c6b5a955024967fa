"""Record of one hidden effect: a strength, a shape drawn once per data set, and its functional
forms.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from .touch import State

CATALOGUE, ALTERNATIVE, SECOND, THIRD = "catalogue", "alternative", "second", "third"
FORMS = (CATALOGUE, ALTERNATIVE, SECOND, THIRD)
Strength = float | np.ndarray  # an array where it differs from row to row


@dataclass(frozen=True)
class Form:
    """A second or third alternative: `apply(state, strength, shape)` changes the state.

    Nothing applies it at strength 0. `reason` says whose law it is, or why a device or a finger
    would follow it. `needs` is a column without which it is the catalogue's form.
    """

    apply: Callable[[State, Strength, dict], None]
    knob: tuple[float, float]
    draw: Callable[[np.random.Generator], dict]
    reason: str
    needs: str = ""


@dataclass(frozen=True)
class Effect:
    """`apply(state, knob, shape, alternative)` changes the state; knob 0 is never applied.

    `knob` is the range searched for a wanted visibility (log spaced); `describe` gives the
    parameters in SI units. `needs` names the column without which the effect cannot be seen, if
    there is one. `own` are forms that stand by themselves, by name; strangers have none.
    """

    apply: Callable[[State, float, dict, bool], None]
    knob: tuple[float, float]
    draw: Callable[[np.random.Generator], dict]
    describe: Callable[[float, dict], dict]
    needs: str = ""
    own: dict[str, Form] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return self.apply.__name__


@dataclass(frozen=True)
class Hidden:
    """An effect at one strength; `sessions` limits it to some sessions (empty: all).

    `bend` (share, phase) is an error of shape: the strength swings by that share over the decades
    of frequency.
    """

    effect: Effect
    strength: float
    shape: dict
    form: str = CATALOGUE
    sessions: tuple[int, ...] = ()
    bend: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if self.form in (SECOND, THIRD) and self._own is None:
            raise ValueError(f"{self.effect.name} has no {self.form} form")

    @property
    def _own(self) -> Form | None:
        return self.effect.own.get(self.form)

    @property
    def knob(self) -> tuple[float, float]:
        """Weakest and strongest that is searched."""
        return self._own.knob if self._own else self.effect.knob

    @property
    def needs(self) -> set[str]:
        """Columns that it reads beside frequency, voltage and load."""
        own = self._own.needs if self._own else ""
        return {column for column in (self.effect.needs, own) if column}

    def act(self, state: State) -> None:
        if self.strength > 0:
            share, phase = self.bend
            swing = 1 + share * np.sin(np.log10(state.rows.f) + phase) if share else 1.0
            if self._own:
                self._own.apply(state, self.strength * swing, self.shape)
            else:
                self.effect.apply(
                    state, self.strength * swing, self.shape, self.form == ALTERNATIVE
                )

    def at(self, strength: float) -> Hidden:
        return replace(self, strength=strength)

    def label(self) -> dict:
        plain = {"strength": self.strength, **self.shape}
        described = plain if self._own else self.effect.describe(self.strength, self.shape)
        parameters = {k: float(v) for k, v in described.items()}
        said = {
            "name": self.effect.name,
            "form": self.form,
            "parameters": parameters,
            "sessions": list(self.sessions),
        }
        return said | ({"bend": list(self.bend)} if self.bend[0] else {})


def drawn(effect: Effect, rng: np.random.Generator, form: str = CATALOGUE) -> Hidden:
    """The effect at strength 1 with a shape of the form's own."""
    own = effect.own.get(form)
    return Hidden(effect, 1.0, own.draw(rng) if own else effect.draw(rng), form)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def nothing(_rng: np.random.Generator) -> dict:
    return {}
