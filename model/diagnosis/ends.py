"""Fitted numbers that stand at an end of their range: bounds, not measurements."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from model.description import ModelDescription
from model.diagnosis.model_fit import Fit
from model.diagnosis.space import FARTHEST, Nuisance
from model.parameters import SPECIFICATION

NEAR = 1e-6  # relative, or of a prior standard deviation


def at_an_end(description: ModelDescription, free: Sequence[Nuisance], fit: Fit) -> dict[str, str]:
    """The numbers of a fit that stand at an end of their range, each with a sentence that says so.

    `free`: those with which the fit's vector begins; effects' parameters follow as `effect.name`.
    """
    said = {}
    for nuisance, x in zip(free, fit.vector.tolist(), strict=False):
        known, own = SPECIFICATION[nuisance.name], description.parameters[nuisance.name]
        value = float(nuisance.value(own.value, np.asarray(x)))
        inside = _inside(value, known["low"], known["high"])
        if not inside or abs(x) >= nuisance.farthest - NEAR:
            value = float(np.clip(value, known["low"], known["high"]))
            said[nuisance.name] = _sentence(nuisance.name, value, own.unit)
    position = len(free)
    for kind in fit.kinds:
        for p in kind.parameters():
            x = float(fit.vector[position])
            value = float(p.from_normal(x))
            if not _inside(value, p.low, p.high) or abs(x) >= FARTHEST - NEAR:
                name = f"{kind.name}.{p.name}"
                said[name] = _sentence(name, value, p.unit)
            position += 1
    return said


def _inside(value: float, low: float, high: float) -> bool:
    """Whether a value is off both ends; an end of zero is where there is nothing, and no bound."""
    return (low == 0.0 or value > low + NEAR * abs(low)) and value < high - NEAR * abs(high)


def _sentence(name: str, value: float, unit: str) -> str:
    of_unit = "" if unit in ("", "1") else f" {unit}"
    return (
        f"{name} stands at {value:.3g}{of_unit}, the end of its range: that is a bound, and no"
        " measurement"
    )
