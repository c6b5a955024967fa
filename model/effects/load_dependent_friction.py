"""Friction does not grow in proportion to load."""

from __future__ import annotations

from dataclasses import dataclass, replace

from model.effects.base import Effect, linear_parameter
from model.touch import Drive, Friction


@dataclass(frozen=True)
class LoadDependentFriction(Effect):
    """F_t = mu_off F_ref ((F_n + F_e)/F_ref)^m, F_ref = 0.5 N."""

    name = "load_dependent_friction"
    stage = "friction"
    physics = "the real contact area does not grow in proportion to load"
    source = "Hertz-like contacts have m = 2/3; range unverified"
    signature = "friction without voltage depends on load; no trace in the current"
    check = "measure friction without voltage at 0.25, 0.5 and 1 N"

    exponent: float = linear_parameter("1", 1.0, 0.12, (0.2, 2.0), off=1.0)

    def friction(self, friction: Friction, drive: Drive) -> Friction:
        return replace(friction, load_exponent=friction.load_exponent * self.exponent)
