"""Where fits happen: nuisance and effect parameters as one vector in units of their priors'
standard deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cosh, log, sinh
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from model import solver
from model.description import ModelDescription
from model.diagnosis.data import Measurements
from model.diagnosis.witness import (
    CONTACT_AREA,
    CURRENT,
    CURRENT_PHASE,
    FRICTION,
    VOLTAGE,
    VOLTAGE_PHASE,
)
from model.effects import Effect
from model.effects.drive_gain_error import DriveGainError
from model.electric.current import sliding_admittance_per_m
from model.parameters import TouchParameters
from model.support.arrays import Array
from model.support.errors import ModelError
from model.touch import Drive
from model.touch_model import PreparedTouch, TouchModel, cof, electrode_current_a, prepare

FARTHEST = 6.0  # prior units
ONLY_OF_EFFECTS = ("speed_m_s", "time_s")  # conditions that only effects that need them see


@dataclass(frozen=True)
class Nuisance:
    """A parameter of the base model that differs between fingers, around the model's own value.

    Its logarithm is log_std sinh(tail x)/tail for x in prior units, standard normal. With a tail of
    0.45 a finger three log_std off is at x = 2.5, and one six off at x = 3.8. Fingers far from the
    reference are common, and a normal prior would rather name an effect than believe in one.
    """

    name: str
    log_std: float
    tail: float = 0.2
    farthest: float = 6.0  # prior units; seven and a half log_std with this tail
    # median of what is added to the model's own value, for what is zero there
    added: float | None = None

    def log_factor(self, x: Array) -> Array:
        """Log of the factor on the model's own value, at `x` in prior units."""
        return np.asarray(
            self.log_std
            / self.tail
            * np.sinh(self.tail * np.clip(x, -self.farthest, self.farthest))
        )

    def value(self, own: float, x: Array) -> Array:
        """The parameter at `x` in prior units, around the model's `own`."""
        factor = np.exp(self.log_factor(x))
        return np.asarray(own * factor if self.added is None else own + self.added * factor)

    def slope(self, own: float, x: float) -> float:
        """Derivative of `value`: turns a standard deviation in prior units into one of the
        parameter.
        """
        varies = own if self.added is None else self.added
        return (
            float(varies * np.exp(self.log_factor(np.asarray(x))))
            * self.log_std
            * cosh(self.tail * x)
        )

    def in_std(self, x: float) -> float:
        """`x` as a number of log_std."""
        return sinh(self.tail * x) / self.tail


FINGER = (
    Nuisance("cof_off", 0.6, tail=0.01),  # decided by the rows without voltage
    Nuisance("roughness_rms_m", 0.10),
    Nuisance("skin_thickness_m", 0.20),
    Nuisance("leak_scale", log(1.5)),
)
# Dust, sebum or a protective film of some 10 nm is no effect worth a name, and 0.3 um changes force
# as much as one.
GAP_OFFSET = Nuisance("gap_offset_m", 2.0, tail=0.01, added=3e-9)
NUISANCES = (*FINGER, GAP_OFFSET)
AREA = Nuisance("contact_area_m2", 0.22)  # between the medians of 10 people, CapContact's masks
# Leads and electrodes have 10 to 1000 pF.
STRAY = Nuisance("stray_capacitance_f", 1.5, tail=0.01, added=1e-10)
# A finger that comes changes the field that goes past it: an open circuit tells C_stray within 1 %
# (two of this).
OPEN = Nuisance("open_circuit", 0.005, tail=0.01)
REST = Nuisance("rest_softening", 0.8, tail=0.01)


def nuisances(description: ModelDescription, data: Measurements) -> tuple[Nuisance, ...]:
    """What differs between fingers and rigs, as far as these data can show it."""
    free = [*NUISANCES]
    if data.has_current or data.has_area:
        free.append(AREA)
    if data.has_current:
        free.append(_as_known(description, STRAY))
        if data.finger is not None and 0 < np.sum(data.finger == "none") < data.count:
            free.append(_as_known(description, OPEN))
    if data.finger is not None and np.any(data.finger == "resting"):
        free.append(REST)
    return tuple(free)


def _as_known(description: ModelDescription, usual: Nuisance) -> Nuisance:
    """A parameter as well known as the model file says; as usual where it does not."""
    own = description.parameters[usual.name]
    return (
        Nuisance(usual.name, own.std / own.value, tail=0.01)
        if own.value > 0.0 and own.std
        else usual
    )


class _Settings(NamedTuple):
    """Distinct settings, and the number of each observation's [n]."""

    drive: Drive
    row: NDArray[np.intp]


class Predictor:
    """The model on one data set's conditions: parameter vectors in, what every witness should say
    out.

    Observations with equal conditions, as far as effects can see them, are solved once. `effects`
    of the description are always on; those asked for are on where the data set says so. `free`:
    what a vector begins with, by default what the data can show.
    """

    def __init__(
        self,
        description: ModelDescription,
        data: Measurements,
        free: Sequence[Nuisance] | None = None,
    ) -> None:
        if description.is_published:
            raise ModelError(
                "the equations as printed cannot be fitted to data",
                "Use a model of variant 'corrected'",
            )
        self.description = description
        self.free = nuisances(description, data) if free is None else tuple(free)
        self.data = data
        self._is_phase = data.is_phase
        self._witnesses = [(witness, data.of(witness)) for witness in data.witnesses]
        self._against = [data.against(witness) for witness in data.witnesses]
        self._table = TouchModel(description).table
        self._drive = data.conditions().drive()
        self._settings: dict[tuple[str, ...], _Settings] = {}

    def _distinct(self, effects: Sequence[Effect]) -> _Settings:
        """Settings that differ in what these effects and the description's can see."""
        seen = {name for e in (*self.description.effects, *effects) for name in e.needs}
        unseen = tuple(name for name in ONLY_OF_EFFECTS if name not in seen)
        if unseen not in self._settings:
            drive, count = self._drive, self.data.count
            names = [name for name in vars(drive) if name not in unseen]
            fields = [np.broadcast_to(np.asarray(getattr(drive, n), float), count) for n in names]
            _, first, row = np.unique(
                np.stack(fields, axis=1), axis=0, return_index=True, return_inverse=True
            )
            pick = {
                name: value[first] if np.ndim(value) and np.size(value) > 1 else value
                for name, value in vars(drive).items()
            }
            self._settings[unseen] = _Settings(Drive(**pick), row.ravel())
        return self._settings[unseen]

    def size(self, kinds: Sequence[type[Effect]]) -> int:
        """Length of a parameter vector."""
        return len(self.free) + sum(len(kind.parameters()) for kind in kinds)

    def force_share(self) -> Array:
        """How far each row's friction is the electrostatic force's [n]: what it lacks without it,
        the most being 1.
        """
        parameters, _ = self.decode((), np.zeros((1, len(self.free))))
        drive, row = self._distinct(())
        gains = [DriveGainError(1.0)], [DriveGainError(0.0)]
        log_cof, without = (
            self._friction(parameters, *self._pressed(parameters, gain, drive), drive)[FRICTION][0]
            for gain in gains
        )
        share = np.nan_to_num(-np.expm1(without - log_cof))[row]  # 0 where the model says nothing
        share = np.where(self.data.of(FRICTION) & self.data.driven, share, 0.0)
        return np.asarray(share / max(np.abs(share).max(initial=0.0), 1e-300))

    def less(self, values: Array, predicted: Array) -> Array:
        """What observed `values` [n] have over `predicted` ones [..., n]; angles within half a
        turn.
        """
        difference = values - predicted
        if not self._is_phase.any():
            return difference
        return np.where(
            self._is_phase, np.remainder(difference + np.pi, 2.0 * np.pi) - np.pi, difference
        )

    def predicted(self, kinds: Sequence[type[Effect]], vectors: Array, group: int = 1) -> Array:
        """As observed [m, n], for parameter vectors [m, k]: nuisances first, then each effect's
        parameters in order.

        Of every `group` vectors all are all but the same.
        """
        parameters, effects = self.decode(kinds, vectors)
        if not (kinds and self.data.has_effects_off):
            return self._solve(parameters, effects, len(vectors), group)
        on = np.array([self.data.with_effect(kind.name) for kind in kinds])
        # a number for which effects are on together, per observation
        together = 2 ** np.arange(len(kinds)) @ on
        predicted = np.empty((len(vectors), self.data.count))
        for number in np.unique(together):
            here = together == number
            left = [effect for i, effect in enumerate(effects) if number >> i & 1]
            predicted[:, here] = self._solve(parameters, left, len(vectors), group)[:, here]
        return predicted

    def _solve(
        self, parameters: TouchParameters, effects: list[Effect], count: int, group: int
    ) -> Array:
        drive, row = self._distinct(effects)
        touch, p_e = self._pressed(parameters, effects, drive, group)
        seen = {witness for witness, _ in self._witnesses}
        answers = self._friction(parameters, touch, p_e, drive)
        answers[CONTACT_AREA] = np.log(touch.area_m2.reshape(touch.shape))
        if seen - {FRICTION, CONTACT_AREA}:
            answers |= self._electrode(touch, p_e)
        predicted = np.empty((count, row.size))
        for (witness, mine), against in zip(self._witnesses, self._against, strict=True):
            here = np.broadcast_to(answers[witness], (count, answers[witness].shape[-1]))[
                :, row[mine]
            ]
            if against.any():
                other = VOLTAGE if witness == CURRENT else VOLTAGE_PHASE
                there = np.broadcast_to(answers[other], (count, answers[other].shape[-1]))[
                    :, row[mine]
                ]
                here = here - np.where(against, there, 0.0)
            predicted[:, mine] = here
        return predicted

    def _pressed(
        self, parameters: TouchParameters, effects: Sequence[Effect], drive: Drive, group: int = 1
    ) -> tuple[PreparedTouch, Array]:
        """The touch, and the electrostatic pressure on it in Pa."""
        effects = (*self.description.effects, *effects)
        touch = prepare(parameters, self.description.dielectric, effects, drive)
        if group == 1:
            return touch, solver.solve(self._table, touch.circuit)[0]
        settings = touch.shape[-1]
        which = np.arange(touch.circuit.load_pa.size).reshape(-1, group, settings)
        p_e_pa = np.empty(which.shape)
        first, others = (touch.circuit.rows(part.ravel()) for part in (which[:, 0], which[:, 1:]))
        p_e_pa[:, 0] = solver.solve(self._table, first)[0].reshape(-1, settings)
        near_pa = np.repeat(p_e_pa[:, 0], group - 1, axis=0).ravel()
        p_e_pa[:, 1:] = solver.solve_near(self._table, others, near_pa).reshape(
            -1, group - 1, settings
        )
        return touch, p_e_pa.ravel()

    def _friction(
        self, parameters: TouchParameters, touch: PreparedTouch, p_e_pa: Array, drive: Drive
    ) -> dict[int, Array]:
        law, load_n = self.description.friction_law, drive.normal_force_n
        with np.errstate(invalid="ignore", divide="ignore"):
            return {FRICTION: np.log(cof(law, parameters, touch, p_e_pa, load_n))}

    def _electrode(self, touch: PreparedTouch, p_e_pa: Array) -> dict[int, Array]:
        total_pa = touch.circuit.load_pa + p_e_pa + touch.circuit.added_pa
        gaps_per_m = sliding_admittance_per_m(self._table, touch.circuit, total_pa)
        current_a = electrode_current_a(self._table, touch, gaps_per_m, total_pa)
        voltage_v = touch.electrode_v.reshape(touch.shape)
        with np.errstate(invalid="ignore", divide="ignore"):
            return {
                CURRENT: np.log(np.abs(current_a)),
                CURRENT_PHASE: np.angle(current_a),
                VOLTAGE: np.log(np.abs(voltage_v)),
                VOLTAGE_PHASE: np.angle(voltage_v),
            }

    def decode(
        self, kinds: Sequence[type[Effect]], vectors: Array
    ) -> tuple[TouchParameters, list[Effect]]:
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
            effects.append(
                kind(**{p.name: p.from_normal(x) for p, x in zip(known, given, strict=True)})
            )
            position += len(known)
        return replace(values, **changed), effects
