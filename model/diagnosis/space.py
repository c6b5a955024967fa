"""Where fits happen: nuisance and effect parameters as one vector in units of their priors' standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log

import numpy as np

from model import pressure
from model.chain import prepare, touch_friction
from model.description import ModelDescription
from model.diagnosis.data import Array, Measurements
from model.effects import Effect
from model.parameters import TouchParameters
from model.touch import Drive
from model.touch_model import TouchModel


@dataclass(frozen=True)
class Nuisance:
    """A parameter of the base model that differs between fingers: log-normal around the model's own value."""

    name: str
    log_std: float


NUISANCES = (
    Nuisance("cof_off", 0.6),  # decided by the rows without voltage
    Nuisance("roughness_rms_m", 0.10),
    Nuisance("skin_thickness_m", 0.20),
    Nuisance("leak_scale", log(1.5)),
)


class Predictor:
    """The model on one data set's conditions: parameter vectors in, log friction out.

    Rows with equal conditions are solved once. `effects` of the description are always on.
    """

    def __init__(self, description: ModelDescription, data: Measurements) -> None:
        self.description = description
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
        touch = prepare(parameters, self.description.dielectric, (*self.description.effects, *effects), self._drive)
        p_e = pressure.solve(self._table, touch.circuit)
        cof = touch_friction(self.description.friction_law, parameters, touch, p_e, self._drive.normal_force_n)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.log(np.broadcast_to(cof, (len(vectors), cof.shape[-1])))[:, self._row])

    def decode(self, kinds: Sequence[type[Effect]], vectors: Array) -> tuple[TouchParameters, list[Effect]]:
        """Parameters and effects as columns [m, 1]."""
        columns = np.asarray(vectors, dtype=np.float64).T[:, :, None]
        values = self.description.values
        changed = {
            n.name: getattr(values, n.name) * np.exp(n.log_std * np.clip(columns[i], -8.0, 8.0))
            for i, n in enumerate(NUISANCES)
        }
        position = len(NUISANCES)
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
