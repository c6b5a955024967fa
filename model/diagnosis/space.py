"""Where fits happen: nuisance and effect parameters as one vector in units of their priors' standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cosh, log, sinh
from typing import Any

import numpy as np

from model import solver
from model.description import ModelDescription
from model.diagnosis.data import Measurements
from model.effects import Effect
from model.parameters import TouchParameters
from model.support.arrays import Array
from model.support.errors import ModelError
from model.touch import Drive
from model.touch_model import TouchModel, cof, prepare

FARTHEST = 6.0  # prior units


@dataclass(frozen=True)
class Nuisance:
    """A parameter of the base model that differs between fingers, around the model's own value.

    Its logarithm is log_std sinh(tail x)/tail for x in prior units, standard normal: with a tail of 0.45 a finger three
    log_std off is at x = 2.5 and one six off at x = 3.8. Fingers far from the reference are common, and a normal
    prior would rather name an effect than believe in one.
    """

    name: str
    log_std: float
    tail: float = 0.2
    farthest: float = 6.0  # prior units; seven and a half log_std with this tail
    added: float | None = None  # median of what is added to the model's own value, for what is zero there

    def log_factor(self, x: Array) -> Array:
        """Log of the factor on the model's own value, at `x` in prior units."""
        return np.asarray(self.log_std / self.tail * np.sinh(self.tail * np.clip(x, -self.farthest, self.farthest)))

    def value(self, own: float, x: Array) -> Array:
        """The parameter at `x` in prior units, around the model's `own`."""
        factor = np.exp(self.log_factor(x))
        return np.asarray(own * factor if self.added is None else own + self.added * factor)

    def slope(self, own: float, x: float) -> float:
        """Derivative of `value`: turns a standard deviation in prior units into one of the parameter."""
        varies = own if self.added is None else self.added
        return float(varies * np.exp(self.log_factor(np.asarray(x)))) * self.log_std * cosh(self.tail * x)

    def in_std(self, x: float) -> float:
        """`x` as a number of log_std."""
        return sinh(self.tail * x) / self.tail


FINGER = (
    Nuisance("cof_off", 0.6, tail=0.01),  # decided by the rows without voltage
    Nuisance("roughness_rms_m", 0.10),
    Nuisance("skin_thickness_m", 0.20),
    Nuisance("leak_scale", log(1.5)),
)
# Dust, sebum or a protective film of some 10 nm is no effect worth a name, and 0.3 um changes force as much as one.
GAP_OFFSET = Nuisance("gap_offset_m", 2.0, tail=0.01, added=3e-9)
NUISANCES = (*FINGER, GAP_OFFSET)


class Predictor:
    """The model on one data set's conditions: parameter vectors in, log friction out.

    Rows with equal conditions are solved once. `effects` of the description are always on; those asked for are on
    where the data set says so.
    """

    def __init__(self, description: ModelDescription, data: Measurements, free: Sequence[Nuisance] = NUISANCES) -> None:
        if description.is_published:
            raise ModelError("the equations as printed cannot be fitted to data", "Use a model of variant 'corrected'")
        self.description = description
        self.free = tuple(free)
        self._on = data.effects_on
        self._table = TouchModel(description).table
        drive = data.conditions().drive()
        fields = [np.broadcast_to(np.asarray(v, float), data.count) for v in vars(drive).values()]
        _, first, self._row = np.unique(np.stack(fields, axis=1), axis=0, return_index=True, return_inverse=True)
        self._row = self._row.ravel()
        pick = {
            name: value[first] if np.ndim(value) and np.size(value) > 1 else value
            for name, value in vars(drive).items()
        }
        self._drive = Drive(**pick)

    def log_cof(self, kinds: Sequence[type[Effect]], vectors: Array) -> Array:
        """Log friction [m, n] for parameter vectors [m, k]: nuisances first, then each effect's parameters in order."""
        parameters, effects = self.decode(kinds, vectors)
        with_effects = self._solve(parameters, effects, len(vectors))
        if self._on is None or not effects:
            return with_effects
        return np.where(self._on, with_effects, self._solve(parameters, [], len(vectors)))

    def _solve(self, parameters: TouchParameters, effects: list[Effect], count: int) -> Array:
        touch = prepare(parameters, self.description.dielectric, (*self.description.effects, *effects), self._drive)
        p_e, _ = solver.solve(self._table, touch.circuit)
        law, load_n = self.description.friction_law, self._drive.normal_force_n
        with np.errstate(invalid="ignore", divide="ignore"):
            log_cof = np.log(cof(law, parameters, touch, p_e, load_n))
        return np.broadcast_to(log_cof, (count, log_cof.shape[-1]))[:, self._row]

    def decode(self, kinds: Sequence[type[Effect]], vectors: Array) -> tuple[TouchParameters, list[Effect]]:
        """Parameters and effects as columns [m, 1]."""
        columns = np.asarray(vectors, dtype=np.float64).T[:, :, None]
        values = self.description.values
        changed: dict[str, Any] = {
            n.name: n.value(getattr(values, n.name), columns[i]) for i, n in enumerate(self.free)
        }
        position = len(self.free)
        effects = []
        for kind in kinds:
            known = kind.parameters()
            given = columns[position : position + len(known)]
            effects.append(kind(**{p.name: p.from_normal(x) for p, x in zip(known, given, strict=True)}))
            position += len(known)
        return replace(values, **changed), effects


def size(kinds: Sequence[type[Effect]]) -> int:
    """Length of a parameter vector."""
    return len(NUISANCES) + sum(len(kind.parameters()) for kind in kinds)
