"""What an effect is: one file, one small frozen record, entering the chain at one place.

An effect overrides the method of the stage where it enters; every other stage passes through
unchanged. Its fields are its parameters: floats, or arrays that broadcast against the conditions.
Each carries its unit, bounds, prior, and the value at which the effect is off and the base model
comes back.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import MISSING, dataclass, field, fields
from functools import cache
from typing import Any, ClassVar, Literal, Self

import numpy as np

from model.parameters import TouchParameters
from model.support.arrays import Values
from model.touch import Branch, Contact, Drive, Friction

Stage = Literal["drive", "stack", "air gap", "pressure", "load", "friction", "contact"]
Scale = Literal["log", "linear"]
MECHANICAL: tuple[Stage, ...] = ("friction", "contact")  # what the drive does not reach


@dataclass(frozen=True)
class EffectParameter:
    """Unit, prior, bounds and off value of one parameter.

    The prior is normal: on a linear scale around `median`, on a log scale of the logarithm, with
    standard deviation `std` (natural log units). Unless a file says otherwise its numbers are
    judged, not measured.
    """

    name: str
    unit: str
    scale: Scale
    median: float
    std: float
    low: float
    high: float
    off: float

    def from_normal(self, x: Values) -> Values:
        """The value that lies `x` prior standard deviations from the median, kept within the
        bounds.
        """
        away = self.std * x
        value = (
            self.median * np.exp(np.clip(away, -80.0, 80.0))
            if self.scale == "log"
            else self.median + away
        )
        return np.clip(value, self.low, self.high)


def log_parameter(
    unit: str,
    median: float,
    factor: float,
    bounds: tuple[float, float],
    off: float,
    usual: Any = MISSING,
) -> Any:
    """A positive parameter known to a `factor` (one standard deviation); `usual` where a file does
    not say it.
    """
    return _parameter("log", unit, median, float(np.log(factor)), bounds, off, usual)


def linear_parameter(
    unit: str, median: float, std: float, bounds: tuple[float, float], off: float
) -> Any:
    """A parameter of either sign."""
    return _parameter("linear", unit, median, std, bounds, off)


def _parameter(
    scale: Scale,
    unit: str,
    median: float,
    std: float,
    bounds: tuple[float, float],
    off: float,
    usual: Any = MISSING,
) -> Any:
    known = {"scale": scale, "unit": unit, "median": median, "std": std, "off": off}
    return field(default=usual, metadata=known | dict(zip(("low", "high"), bounds, strict=True)))


@dataclass(frozen=True)
class Effect:
    """The null effect: every stage unchanged. Candidates derive from it.

    `signature` says what it looks like in friction and in the electrode's voltage and current.
    `check` says what a person can do at the rig to see whether it is there. `needs` names the
    optional data columns without which the effect leaves no trace; `removed_by` the interventions
    under which it is gone, see `interventions`. `order_counts_with` names effects that answer
    otherwise before it than after it: the order of the catalogue decides. `knows_one_tone_only`
    where its formula has no meaning for a drive of several tones.
    """

    name: ClassVar[str] = "none"
    stage: ClassVar[Stage] = "drive"
    physics: ClassVar[str] = "nothing is missing"
    source: ClassVar[str] = "starting point of the catalogue; ranges unverified"
    signature: ClassVar[str] = "residuals without structure"
    check: ClassVar[str] = "repeat the measurement"
    needs: ClassVar[tuple[str, ...]] = ()
    removed_by: ClassVar[tuple[str, ...]] = ()
    order_counts_with: ClassVar[tuple[str, ...]] = ()
    knows_one_tone_only: ClassVar[bool] = False

    @classmethod
    @cache
    def parameters(cls) -> tuple[EffectParameter, ...]:
        """The parameters in the order of the fields."""
        return tuple(EffectParameter(f.name, **f.metadata) for f in fields(cls))

    @classmethod
    def usual(cls) -> dict[str, float]:
        """The parameters that a file need not say."""
        return {f.name: f.default for f in fields(cls) if f.default is not MISSING}

    @classmethod
    def asked(cls, given: Collection[str]) -> list[EffectParameter]:
        """The parameters that a file which gives these has to say."""
        return [p for p in cls.parameters() if p.name in given or p.name not in cls.usual()]

    @classmethod
    def parameters_in(cls, said: Collection[str]) -> list[EffectParameter]:
        """Those of the parameters that a file says; the others are as usual, and certain."""
        return [p for p in cls.parameters() if p.name in said]

    @classmethod
    def bends_with(cls) -> tuple[str, ...]:
        """On what of the drive its strength may depend where the catalogue's does not, without
        being another effect.
        """
        return () if cls.stage in MECHANICAL else ("frequency_hz",)

    @classmethod
    def off(cls) -> Self:
        """The effect with every parameter at its off value."""
        return cls(**{p.name: p.off for p in cls.parameters()})

    def drive(self, drive: Drive) -> Drive:
        """What the amplifier makes of the set amplitude, and how far it lags."""
        return drive

    def stack(self, branch: Branch, parameters: TouchParameters, drive: Drive) -> Branch:
        """What the layers and the air gap are at one frequency."""
        return branch

    def contact(self, contact: Contact, parameters: TouchParameters, drive: Drive) -> Contact:
        """How the skin lies on the screen, and what else pulls it there."""
        return contact

    def friction(self, friction: Friction, drive: Drive) -> Friction:
        """How friction follows from load."""
        return friction
