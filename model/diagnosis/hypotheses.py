"""What may be true of a data set, and the evidence of each hypothesis.

The hypotheses are: nothing is missing; one effect of the catalogue, in its exact or a modified
form; two effects; something unknown. The last is something that is not of the touch. `Evidences`
holds the logarithms alone, so that a rule can be judged without fitting anything.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from model.diagnosis.data import Measurements
from model.diagnosis.evidence import Evidence, evidence, evidence_beside, explained, log_marginal
from model.diagnosis.form import form_terms
from model.diagnosis.hidden import Hidden
from model.diagnosis.model_fit import Fit, Problem
from model.diagnosis.priors import AMPLITUDES, LOG_PRIOR_EACH, NONE
from model.diagnosis.witness import FRICTION
from model.effects import CATALOGUE, Effect, SecondTouch
from model.support.arrays import Array
from model.touch import LOAD_REFERENCE_N

FORCE_SENSOR = "a force sensor that reads the load"
SECOND_TOUCH = "another touch on the screen"
OUTSIDE = {  # not of the touch, and its check
    FORCE_SENSOR: "tare it, and press without sliding",
    SECOND_TOUCH: SecondTouch.check,
}
Kinds = tuple[type[Effect], ...]

STARTS = (0.0, -2.0, 1.5, -3.0)  # of an effect's first parameter, prior standard deviations
STRENGTHS = (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)  # at which the score test looks at a signature
FITTED = 6  # single effects that may have a second beside them, and pairs fitted at a time
REFITS = 4  # at most, of a model whose form is off
WORTH_REFITTING = 0.3  # nats


@dataclass(frozen=True, eq=False)
class Candidate:
    """One model, fitted: its own evidence, and with a discrepancy of unknown shape beside it.

    `bent` [n, m]: the deviation of its form, whitened, as far as the data ask for it. `around`: the
    most probable parameters with that deviation; evidences are linear about them. `fit` is of the
    exact form.
    """

    kinds: Kinds
    fit: Fit
    alone: Evidence
    around: Fit
    bent: Array
    _beside: Callable[[], Evidence]

    @cached_property
    def beside_discrepancy(self) -> Evidence:
        """Evidence with a discrepancy of unknown shape beside the effects; worked out when asked
        for.
        """
        return self._beside()

    @property
    def names(self) -> tuple[str, ...]:
        """Of its effects; of none for the base model."""
        return tuple(kind.name for kind in self.kinds) or (NONE,)

    @property
    def name(self) -> str:
        return "+".join(self.names)


class Evidences(NamedTuple):
    """log evidence of every hypothesis about one data set.

    `alone`: of none, of each effect that can be tested, and of the pairs that were fitted, by
    names. `unseen`: of that part of an effect's prior that leaves no trace. `beside`: of none, of
    the best single effect and of the best pair with a discrepancy of unknown shape. `outside`: of
    what is not of the touch.
    """

    alone: dict[tuple[str, ...], float]
    untestable: tuple[str, ...]
    unseen: dict[str, float]
    beside: dict[tuple[str, ...], float]
    outside: dict[str, float]


@dataclass(frozen=True)
class Hypotheses:
    """Every model that was fitted to one data set. `outside` as in `Evidences`."""

    base: Candidate
    singles: list[Candidate]
    pairs: list[Candidate]
    untestable: tuple[str, ...]
    hidden: dict[str, Hidden]
    outside: dict[str, float]

    @property
    def _leading(self) -> list[Candidate]:
        """Of no effect, of one and of two that with the most evidence."""
        of_each = ([self.base], self.singles, self.pairs)
        return [max(models, key=_evidence) for models in of_each if models]

    def of(self, names: tuple[str, ...]) -> Candidate:
        """The model with just these effects, in any order."""
        fitted = (self.base, *self.singles, *self.pairs)
        return next(c for c in fitted if set(c.names) == set(names))

    @cached_property
    def evidences(self) -> Evidences:
        """The logarithms alone."""
        base = _evidence(self.base)
        return Evidences(
            {c.names: _evidence(c) for c in (self.base, *self.singles, *self.pairs)},
            self.untestable,
            {name: base + hidden.log_odds for name, hidden in self.hidden.items()},
            {c.names: c.beside_discrepancy.log_evidence for c in self._leading},
            self.outside,
        )


def testable_effects(data: Measurements, switched_on: Sequence[Effect]) -> list[type[Effect]]:
    """The effects that could leave a trace in these columns and are not in the model already."""
    on = {effect.name for effect in switched_on}
    others = (kind for kind in CATALOGUE if kind.name not in on)
    return [kind for kind in others if all(data.varies(column) for column in kind.needs)]


def candidate(problem: Problem, kinds: Kinds, fit: Fit, *others: Fit) -> Candidate:
    """Weigh one fitted model; `others`: where else its parameters may lie if its form is off.

    Where its form is modified, the finger and the gains make up for that in `fit`. A second fit
    lets the form do so, for as long as the evidence grows.
    """
    around, (alone, bent) = fit, _weigh(problem, fit)
    exact = alone.exact
    again = list(others)
    for _ in range(REFITS):
        again += [problem.refitted(around, bent)] if alone.bend else []
        before = alone.log_evidence
        for other in again:
            better, its_bent = _weigh(problem, other)
            if better.log_evidence > alone.log_evidence:
                around, alone, bent = other, replace(better, exact=exact), its_bent
        if alone.log_evidence - before < WORTH_REFITTING:
            break
        again = []

    def beside() -> Evidence:
        return evidence_beside(around, problem.noise, problem.discrepancy, bent, alone)

    return Candidate(kinds, fit, alone, around, bent, beside)


def _weigh(problem: Problem, fit: Fit) -> tuple[Evidence, Array]:
    """Evidence about one fit, and what the form may be off as far as the data ask for it [n, m]."""
    forms = form_terms(problem, fit)
    found = evidence(fit, problem.noise, forms)
    nothing = np.zeros((fit.residual.size, 0))
    return found, found.bend * forms[found.way] if found.bend else nothing


def fit_candidates(
    problem: Problem, base: Fit, kinds: Sequence[Kinds], progress: Callable[[str], None]
) -> list[Candidate]:
    """Fit each model warm from `base`, several starts for its last effect."""
    found = []
    for kind in kinds:
        progress("+".join(k.name for k in kind) or NONE)
        found.append(candidate(problem, kind, problem.best_fit(kind, base.vector, STARTS)))
    return found


class Promise(NamedTuple):
    """A pair, and the log evidence that the score test expects of it."""

    pair: frozenset[type[Effect]]
    log_evidence: float


def fit_pairs(
    problem: Problem, singles: list[Candidate], progress: Callable[[str], None]
) -> list[Candidate]:
    """The pairs that promise most beside the leading effects, and beside those of the best pair."""
    ranked = sorted(singles, key=_evidence, reverse=True)
    promised: list[Promise] = []
    fitted: dict[frozenset[type[Effect]], Candidate] = {}
    asked: list[Candidate] = []
    to_ask = ranked[:FITTED]
    while to_ask:
        asked += to_ask
        promised += [promise for one in to_ask for promise in _beside(problem, one, singles)]
        promised.sort(key=lambda promise: -promise.log_evidence)
        for pair in list(dict.fromkeys(promise.pair for promise in promised))[:FITTED]:
            if pair not in fitted:
                first, second = (c for c in ranked if c.kinds[0] in pair)
                progress(f"{first.name}+{second.name}")
                fitted[pair] = with_one_more(problem, first, second.kinds)
        best = max(fitted.values(), key=_evidence, default=None)
        members = () if best is None else best.kinds
        to_ask = [c for c in singles if c.kinds[0] in members and c not in asked]
    return list(fitted.values())


def with_one_more(problem: Problem, first: Candidate, more: Kinds) -> Candidate:
    """`first` with an effect beside it: fitted from there, with its form and as that is off."""
    kinds = (*first.kinds, *more)
    exact = problem.best_fit(kinds, first.fit.vector, STARTS)
    if not first.bent.shape[1]:
        return candidate(problem, kinds, exact)
    off = problem.loosened(first.bent).best_fit(kinds, first.around.vector, STARTS)
    return candidate(problem, kinds, exact, problem.whole(off))


def _beside(problem: Problem, first: Candidate, singles: list[Candidate]) -> list[Promise]:
    """What each other effect promises beside `first` by the score test, where it is worth its
    prior.

    The test asks how much of what `first` leaves a signature explains at its best strength.
    """
    fit, found = first.around, []
    for other in singles:
        if other is first:
            continue
        alone = other.fit.vector[-len(other.kinds[0].parameters()) :]
        vectors = np.zeros((len(STRENGTHS) + 1, fit.vector.size + alone.size))
        vectors[:, : fit.vector.size] = fit.vector
        vectors[:-1, fit.vector.size], vectors[-1, fit.vector.size :] = STRENGTHS, alone
        adds = fit.residual - problem.whitened((*fit.kinds, *other.kinds), vectors)
        gain = 0.5 * float(np.max(explained(fit, first.alone.scale, first.bent, adds)))
        if gain + LOG_PRIOR_EACH > 0.0:
            found.append(Promise(frozenset((*first.kinds, *other.kinds)), _evidence(first) + gain))
    return found


def force_sensor(problem: Problem, base: Candidate) -> float:
    """log evidence of a force sensor whose lateral reading has its zero off and a share of the
    load.

    Friction that it reads depends on load much as by a law of friction, and no other witness sees
    either. Linear about the base model; -inf where friction has but one load.
    """
    data, fit = problem.predictor.data, base.fit
    friction = data.of(FRICTION)
    if not data.subset(friction).varies("normal_force_n"):
        return -np.inf
    load_n = data.columns["normal_force_n"]
    # By predicted friction: that which is observed would bring its noise along.
    predicted = problem.predictor.predicted((), fit.vector[None])[0]
    lateral_n = np.exp(np.where(friction, predicted, 0.0)) * load_n
    shifts_n = np.stack([np.full(load_n.size, LOAD_REFERENCE_N), load_n], axis=1)
    shown = problem.noise.whiten(np.where(friction[:, None], shifts_n / lateral_n[:, None], 0.0))
    target = fit.residual + fit.jacobian @ fit.vector
    spreads = [np.hstack([fit.jacobian, share * shown]) for share in AMPLITUDES]
    logs = [log_marginal(target, spread, problem.noise) for spread in spreads]
    return float(logsumexp(logs) - np.log(len(AMPLITUDES)))


def second_touch(problem: Problem, base: Candidate) -> float:
    """log evidence of other touches, whose current is seen with the finger's; -inf where no current
    was.
    """
    if not problem.predictor.data.has_current:
        return -np.inf
    (found,) = fit_candidates(problem, base.fit, [(SecondTouch,)], lambda _: None)
    return _evidence(found)


def _evidence(candidate: Candidate) -> float:
    return candidate.alone.log_evidence
