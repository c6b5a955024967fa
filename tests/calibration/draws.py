"""A set drawn from the hypothesis space: what is true of it, and what would be observed.

The truth comes from the priors: nothing, one effect, two, or something unknown; each effect in its
exact form or bent as `form_terms` allows; something unknown as a discrepancy of any shape, or as a
term at any place of the chain. The finger, the gains, the noise and its scale come from theirs.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from haptic_driver.lab.measuring.plan import load_plan
from haptic_driver.lab.measuring.resolving import ways
from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import load_rig
from model.description import ModelDescription
from model.diagnosis.data import Measurements
from model.diagnosis.form import form_terms
from model.diagnosis.hidden import NO_TRACE
from model.diagnosis.hypotheses import testable_effects
from model.diagnosis.model_fit import Fit, Problem
from model.diagnosis.noise import noise_of
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
from model.diagnosis.witness import WITNESSES
from model.effects import Effect
from model.effects.learned import learned_kind
from model.support.arrays import Array
from model.touch_model import TouchModel
from tests.limits.draws import random_form

PLANS = ("full", "witnesses", "voltage_frequency", "speed_load_time")
COF_STD = (0.003, 0.01, 0.02)
FEWEST_LEFT = 0.9  # of a plan's rows that need an equilibrium: other draws are no finger
AGAINST = {witness.against for witness in WITNESSES if witness.against}
Rng = np.random.Generator


class Truth(NamedTuple):
    """What is true of a set: `names` of the effects that leave a trace, none, or unknown."""

    names: tuple[str, ...]
    about: str


def drawn(seed: int, number: int) -> tuple[Truth, Measurements] | None:
    """One set; None where the finger that was drawn could not be measured."""
    rng = np.random.default_rng([seed, number])
    description = load_model("reference")
    plan, cof_std = str(rng.choice(PLANS)), float(rng.choice(COF_STD))
    kinds_of_plan = _templates(plan, cof_std)
    way = str(rng.choice(list(kinds_of_plan)))
    template = kinds_of_plan[way]
    kinds, is_unknown = _truth(rng, testable_effects(template, ()))
    predictor = Predictor(description, template)
    acts = kinds if not is_unknown or rng.random() < 0.5 else (learned_kind(random_form(rng)),)
    vector = rng.normal(size=predictor.size(acts))
    exact = predictor.predicted(acts, vector[None])[0]
    usable = np.isfinite(exact)
    if usable.mean() < FEWEST_LEFT:
        return None
    exact = np.where(usable, exact, 0.0)
    noise = noise_of(_saying(template, exact))
    assert noise is not None
    seen = exact + noise.lower @ _off(
        rng, Problem(predictor, exact, noise), acts, vector, is_unknown
    )
    scale = np.sqrt(noise.degrees / rng.chisquare(noise.degrees))
    values = seen + scale * (noise.lower @ rng.normal(size=seen.size))
    data = _saying(template, values).subset(usable)
    names = _with_a_trace(description, data, seen[usable], kinds, is_unknown)
    return Truth(names, f"{plan}, {way}, {cof_std:g}"), data


@cache
def _templates(plan: str, cof_std: float) -> dict[str, Measurements]:
    """What the plan would observe on a simulated rig, without current and with spectra."""
    rig, touch = load_rig("simulated"), TouchModel(load_model("reference"))
    return ways(rig, touch, load_plan(plan), cof_std)[0]


def _saying(template: Measurements, values: Array) -> Measurements:
    """The template as a file would have it, with `values` [n] as the diagnosis compares them."""
    columns = dict(template.columns)
    row = np.arange(template.count) if template.row is None else template.row
    against = {name: np.zeros(row.max() + 1) for name in ("", *AGAINST)}
    for i in sorted(template.witnesses, key=lambda i: bool(WITNESSES[i].against)):
        witness, mine = WITNESSES[i], template.of(i)
        by_row = np.zeros(row.max() + 1)
        by_row[row[mine]] = values[mine]
        if witness.against in columns:
            by_row += against[witness.against]
        if witness.column in against:
            against[witness.column] = by_row
        size = 1.0 if witness.is_phase else np.exp(by_row)[row]
        known = np.isfinite(columns[witness.column])
        said = by_row[row] if witness.is_phase else size
        columns[witness.column] = np.where(known, said, np.nan)
        columns[witness.std] = columns[witness.std] * size
    return replace(template, columns=columns)


def _truth(rng: Rng, kinds: list[type[Effect]]) -> tuple[tuple[type[Effect], ...], bool]:
    """Effects by the priors, and whether something unknown is there."""
    count = len(kinds)
    each = PRIOR_EFFECTS / count
    pairs = each**2 * count * (count - 1) / 2.0
    weights = np.array([PRIOR_NONE, PRIOR_UNKNOWN, PRIOR_EFFECTS, pairs])
    what = int(rng.choice(4, p=weights / weights.sum()))
    chosen = rng.choice(count, max(what - 1, 0), replace=False)
    return tuple(kinds[i] for i in chosen), what == 1


def _off(
    rng: Rng, problem: Problem, kinds: tuple[type[Effect], ...], vector: Array, is_unknown: bool
) -> Array:
    """What the finger or the rig differs by from any exact form, whitened [n]."""
    nothing = np.zeros(problem.observed.size)
    if is_unknown and not kinds:
        *single, together = problem.discrepancy
        term = together if rng.random() < 0.5 else single[rng.integers(len(single))]
        return float(rng.choice(AMPLITUDES)) * term @ rng.normal(size=term.shape[1])
    if is_unknown or not kinds or rng.random() < EXACT:
        return nothing
    at = Fit(kinds, vector, nothing, nothing[:, None], np.eye(1), 0.0, 1.0, 0.0)
    forms = form_terms(problem, at)
    if not forms:
        return nothing
    way = int(rng.integers(len(forms)))
    bend = float(rng.choice(FORM_ERRORS[way]))
    return bend * forms[way] @ rng.normal(size=forms[way].shape[1])


def _with_a_trace(
    description: ModelDescription,
    data: Measurements,
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
