"""A set drawn from the hypothesis space: what is true of it, and what would be observed.

The truth comes from the priors: nothing, one effect, two, or something unknown; each effect in its
exact form or bent as `form_terms` allows; something unknown as a discrepancy of any shape, or as a
term at any place of the chain. The finger, the gains, the noise and its scale come from theirs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from haptic_driver.experiments.plan import load_plan
from haptic_driver.experiments.resolving import ways
from haptic_driver.rig.config import load_rig
from haptic_driver.surface.models import load_model
from model.description import ModelDescription
from model.diagnosis.data import Measurements
from model.diagnosis.fit import Fit, Problem
from model.diagnosis.form import form_terms
from model.diagnosis.hypotheses import NO_TRACE, testable_effects
from model.diagnosis.noise import Noise, noise_of
from model.diagnosis.priors import (
    AMPLITUDES,
    EXACT,
    FORM_ERRORS,
    NONE,
    PRIOR_EFFECTS,
    PRIOR_NONE,
    PRIOR_UNKNOWN,
    UNKNOWN,
)
from model.diagnosis.space import Predictor
from model.effects import Effect
from model.effects.learned import learned_kind
from model.support.arrays import Array
from model.touch_model import TouchModel
from tests.limits.draws import random_form

PLANS = ("full", "witnesses", "voltage_frequency", "speed_load_time")
COF_STD = (0.003, 0.01, 0.02)
FEWEST_LEFT = 0.9  # of a plan's rows that need an equilibrium: other draws are no finger
Rng = np.random.Generator


@dataclass(frozen=True)
class Drawn(Measurements):
    """Measurements of which every witness says `values` [n], as the diagnosis compares them."""

    values: Array | None = None

    @property
    def observed(self) -> Array:
        """The values."""
        assert self.values is not None
        return self.values

    def subset(self, rows: Any) -> Measurements:
        """Some of the rows."""
        assert self.values is not None
        return replace(super().subset(rows), values=self.values[rows])  # type: ignore[call-arg]


class Truth(NamedTuple):
    """What is true of a set: `names` of the effects that leave a trace, none, or unknown."""

    names: tuple[str, ...]
    about: str


def drawn(seed: int, number: int) -> tuple[Truth, Drawn] | None:
    """One set; None where the finger that was drawn could not be measured."""
    rng = np.random.default_rng([seed, number])
    description = load_model("reference")
    plan, cof_std = str(rng.choice(PLANS)), float(rng.choice(COF_STD))
    kinds_of_plan = _templates(plan, cof_std)
    way = str(rng.choice(list(kinds_of_plan)))
    template = kinds_of_plan[way]
    kinds, is_unknown = _truth(rng, testable_effects(template, ()))
    noise = noise_of(template)
    assert noise is not None
    predictor = Predictor(description, template)
    vector = rng.normal(size=predictor.size(kinds))
    seen, usable = _seen(rng, description, predictor, kinds, vector, noise, is_unknown)
    if usable.mean() < FEWEST_LEFT:
        return None
    scale = np.sqrt(noise.degrees / rng.chisquare(noise.degrees))
    values = seen + scale * (noise.lower @ rng.normal(size=seen.size))
    data = Drawn(**vars(template), values=np.where(usable, values, 0.0)).subset(usable)
    assert isinstance(data, Drawn)
    names = _with_a_trace(description, data, seen[usable], kinds, is_unknown)
    return Truth(names, f"{plan}, {way}, {cof_std:g}"), data


@cache
def _templates(plan: str, cof_std: float) -> dict[str, Measurements]:
    """What the plan would observe on a simulated rig, without current and with spectra."""
    rig, touch = load_rig("simulated"), TouchModel(load_model("reference"))
    return ways(rig, touch, load_plan(plan), cof_std)[0]


def _truth(rng: Rng, kinds: list[type[Effect]]) -> tuple[tuple[type[Effect], ...], bool]:
    """Effects by the priors, and whether something unknown is there."""
    count = len(kinds)
    each = PRIOR_EFFECTS / count
    pairs = each**2 * count * (count - 1) / 2.0
    weights = np.array([PRIOR_NONE, PRIOR_UNKNOWN, PRIOR_EFFECTS, pairs])
    what = int(rng.choice(4, p=weights / weights.sum()))
    chosen = rng.choice(count, max(what - 1, 0), replace=False)
    return tuple(kinds[i] for i in chosen), what == 1


def _seen(
    rng: Rng,
    description: ModelDescription,
    predictor: Predictor,
    kinds: tuple[type[Effect], ...],
    vector: Array,
    noise: Noise,
    is_unknown: bool,
) -> tuple[Array, Array]:
    """What every witness says without noise [n], and where the finger has an equilibrium [n]."""
    if is_unknown and rng.random() < 0.5:
        term = (learned_kind(random_form(rng)),)
        weights = rng.normal(size=predictor.size(term) - len(predictor.free))
        seen = predictor.predicted(term, np.append(vector, weights)[None])[0]
        return seen, np.isfinite(seen)
    seen = predictor.predicted(kinds, vector[None])[0]
    problem = Problem(predictor, np.nan_to_num(seen), noise)
    if is_unknown:
        *single, together = problem.discrepancy
        term_of = together if rng.random() < 0.5 else single[rng.integers(len(single))]
        off = float(rng.choice(AMPLITUDES)) * term_of @ rng.normal(size=term_of.shape[1])
    elif kinds and rng.random() > EXACT:
        nothing = np.zeros(seen.size)
        at = Fit(kinds, vector, nothing, nothing[:, None], np.eye(1), 0.0, 1.0, 0.0)
        forms = form_terms(problem, at)
        way = int(rng.integers(len(forms))) if forms else -1
        bend = float(rng.choice(FORM_ERRORS[way])) if forms else 0.0
        off = bend * forms[way] @ rng.normal(size=forms[way].shape[1]) if forms else nothing
    else:
        return seen, np.isfinite(seen)
    return seen + noise.lower @ off, np.isfinite(seen)


def _with_a_trace(
    description: ModelDescription,
    data: Drawn,
    seen: Array,
    kinds: tuple[type[Effect], ...],
    is_unknown: bool,
) -> tuple[str, ...]:
    """The names of what the base model cannot take up; none where that is nothing."""
    if not kinds and not is_unknown:
        return (NONE,)
    noise = noise_of(data)
    assert noise is not None
    problem = Problem(Predictor(description, data), seen, noise)
    if problem.fit((), np.zeros(len(problem.predictor.free))).chi2 < NO_TRACE:
        return (NONE,)
    return (UNKNOWN,) if is_unknown else tuple(kind.name for kind in kinds)
