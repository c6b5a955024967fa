"""Nothing in the catalogue: at which place of the chain the discrepancy acts, and the smoothest
term that closes it.

Free-form terms of the same prior are tried for each quantity that a term may multiply
(`model.effects.learned`). They are pushed through the linearised model, and the best is fitted.
Inputs are added as long as the evidence asks for them. The places are weighed by what these fits
explain. Place, inputs and values are chosen anew without each session, which no fit has seen. These
sessions decide whether a short formula does as well, and whether the gap shrinks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from model.description import ModelDescription
from model.diagnosis.data import Measurements
from model.diagnosis.evidence import evidence, log_marginal
from model.diagnosis.hypotheses import Candidate, candidate
from model.diagnosis.model_fit import Fit, Problem
from model.diagnosis.priors import LOG_ODDS, SURE
from model.diagnosis.proof import Proof, Selected, held_out
from model.effects.learned import (
    LEARNED,
    LOG_INPUTS,
    QUANTITIES,
    SHAPES,
    LearnedForm,
    Term,
    learned_kind,
    scaled,
)
from model.support.arrays import Array, Mask
from model.touch import Drive

AMPLITUDES = (0.02, 0.06, 0.2, 0.6, 1.5)  # of log(quantity)
MOST_TERMS = 3
MOST_NODES = {"frequency_hz": (12, 7)}  # alone, and in a pair; of every other input:
OTHERS = (6, 4)
GRID = 50  # parts of an input's span within which settings count as the same
STEP = 1e-3
# The finger's own form is not quite the model's, and a term at a wrong place may take to that as
# well: a fiftieth of what is explained says nothing about the place.
FORM_ERROR = 0.02
PREFERRED = "friction"  # of those: what reads friction has the most ways to be wrong
OF_THE_SMOOTH = 0.9  # share of what the smooth term closes that a short formula must close
FORMULA_STARTS = (0.0, -1.0, 1.0)
# of a smooth term, whose valleys are long; more gain less than another term must be worth
ENOUGH_ITERATIONS = 12


@dataclass(frozen=True)
class LearnedTerm:
    """What was learned: its fit, the places of the chain with their probabilities, and the proof on
    held-out data.

    `alike`: the places, most probable first, that these data cannot tell apart; the term stands at
    one of them. In each fold of `proof` place, inputs and values are chosen anew; its `inclusion`
    is the share of folds with the same place. `smooth_closed`: share of the gap that the smooth
    term closes, by which a short formula was judged.
    """

    form: LearnedForm
    candidate: Candidate
    places: dict[str, float]
    alike: tuple[str, ...]
    proof: Proof
    smooth_closed: float

    @property
    def is_proved(self) -> bool:
        """Whether the gap shrinks on data left out of the fit, by its interval as well."""
        return bool(self.proof.gap_closed > 0.0 and self.proof.interval[0] > 0.0)


class _Tried(NamedTuple):
    form: LearnedForm
    fit: Fit
    log_evidence: float


class _Choice(NamedTuple):
    tried: _Tried
    places: dict[str, float]
    alike: tuple[str, ...]


def learn(
    description: ModelDescription,
    data: Measurements,
    problem: Problem,
    base: Candidate,
    seed: int,
    progress: Callable[[str], None],
) -> LearnedTerm | None:
    """The term that closes the gap which `base` leaves; None where the model has one already, or
    none is worth it.
    """
    if LEARNED in description.effect_parameters:
        return None
    progress("learned term")
    choice = _choose(problem, base.fit)
    if choice is None:
        return None
    (form, fit, _), places, alike = choice

    def select(inner: Problem, without: Fit) -> list[Selected]:
        anew = _choose(inner, without)
        if anew is None:
            return [Selected(without, False)] * len(SHAPES)
        smooth = anew.tried
        fits = [
            smooth.fit,
            *(_fitted(inner, without, short).fit for short in _formulas(smooth.form)),
        ]
        return [
            Selected(f, smooth.form.place == form.place)
            for f in fits + fits[:1] * (len(SHAPES) - len(fits))
        ]

    scale = evidence(fit, problem.noise).scale  # of the noise as the smooth term leaves it
    proofs = held_out(
        description, data, problem.noise, select, base.fit.vector, scale, seed, progress
    )
    proof = proofs[0]
    for short, its_proof in zip(_formulas(form), proofs[1:], strict=False):
        if its_proof.gap_closed >= OF_THE_SMOOTH * proofs[0].gap_closed:
            (form, fit, _), proof = _fitted(problem, base.fit, short), its_proof
            break
    found = candidate(problem, fit.kinds, fit)
    return LearnedTerm(form, found, places, alike, proof, proofs[0].gap_closed)


def _choose(problem: Problem, base: Fit) -> _Choice | None:
    """The smooth term at its place, and the places by their probability; None where the evidence
    asks for no term.
    """
    paths = {name: path for name in QUANTITIES if (path := _path(problem, base, name))}
    if not paths:
        return None
    logs = {name: path[-1].log_evidence for name, path in paths.items()}
    gain = max(logs.values()) - evidence(base, problem.noise).log_evidence
    places = _places({name: log / (1.0 + FORM_ERROR * gain) for name, log in logs.items()})
    alike = _alike(places)
    place = PREFERRED if PREFERRED in alike else alike[0]
    name = max((n for n in paths if QUANTITIES[n].place == place), key=lambda n: logs[n])
    return _Choice(paths[name][-1], places, alike)


def _fitted(problem: Problem, base: Fit, form: LearnedForm) -> _Tried:
    kind = learned_kind(form)
    if form.shape == "spline":  # all but linear: one valley
        start = np.concatenate([base.vector, np.zeros(len(kind.parameters()))])
        fit = problem.fit((kind,), start, ENOUGH_ITERATIONS)
    else:
        fit = problem.best_fit((kind,), base.vector, FORMULA_STARTS)
    return _Tried(form, fit, evidence(fit, problem.noise).log_evidence)


def _formulas(form: LearnedForm) -> list[LearnedForm]:
    """The same inputs, each by a short formula of its own; only the ends of their nodes matter to
    those.
    """
    ends = {
        n: (x[0], x[-1])
        for term in form.terms
        for n, x in zip(term.inputs, term.nodes, strict=True)
    }
    amplitude = max(AMPLITUDES[2], *(term.amplitude for term in form.terms))
    terms = tuple(Term((name,), (x,), amplitude) for name, x in ends.items())
    return (
        [] if form.with_phase else [replace(form, shape=shape, terms=terms) for shape in SHAPES[1:]]
    )


def _places(logs: Mapping[str, float]) -> dict[str, float]:
    """Probability of every place, the largest first: before the data all are alike, and so are a
    place's quantities.
    """
    per_place: dict[str, list[float]] = {}
    for name, log in logs.items():
        per_place.setdefault(QUANTITIES[name].place, []).append(log)
    counts = {place: sum(q.place == place for q in QUANTITIES.values()) for place in per_place}
    each = {
        place: float(logsumexp(found)) - np.log(counts[place]) for place, found in per_place.items()
    }
    total = logsumexp(list(each.values()))
    return {
        place: float(np.exp(log - total))
        for place, log in sorted(each.items(), key=lambda item: -item[1])
    }


def _alike(places: Mapping[str, float]) -> tuple[str, ...]:
    """The fewest places that hold SURE of the probability."""
    enough = int(np.searchsorted(np.cumsum(list(places.values())), SURE))
    return tuple(places)[: enough + 1]


def _path(problem: Problem, base: Fit, acts_on: str) -> list[_Tried]:
    """Fits of one term of a quantity, of two, ... as far as the evidence asks for another."""
    noise, drive = problem.noise, problem.predictor.data.conditions().drive()
    for effect in problem.predictor.description.effects:
        drive = effect.drive(drive)
    with_phase = QUANTITIES[acts_on].has_phase and bool(problem.predictor.data.is_phase.any())
    volts = np.broadcast_to(drive.voltage_v, problem.observed.size)
    empty = LearnedForm(acts_on, "spline", (), float(volts[volts > 0.0].min()), with_phase)
    slopes = _slopes(problem, base, empty)
    possible = _possible(acts_on, drive, np.any(np.abs(slopes) > 1e-6, axis=0))
    path: list[_Tried] = []
    at, least = base, evidence(base, noise).log_evidence
    while possible and len(path) < MOST_TERMS:
        before = path[-1].form.terms if path else ()
        target, slopes = at.residual + at.jacobian @ at.vector, _slopes(problem, at, empty)
        scores: dict[Term, float] = {}
        for term in possible:
            features = noise.whiten(_features(replace(empty, terms=(term,)), drive, slopes))
            spreads = {a: np.concatenate([at.jacobian, a * features], axis=1) for a in AMPLITUDES}
            scores |= {
                replace(term, amplitude=a): log_marginal(target, s, noise)
                for a, s in spreads.items()
            }
        wanted = max(scores, key=lambda term: scores[term])
        kept = tuple(term for term in before if not set(term.inputs) <= set(wanted.inputs))
        tried = _fitted(problem, base, replace(empty, terms=(*kept, wanted)))
        if tried.log_evidence - least < LOG_ODDS:
            break
        path.append(tried)
        at, least = tried.fit, tried.log_evidence
    return path


def _features(form: LearnedForm, drive: Drive, slopes: Array) -> Array:
    """What every observation does per unit of every value of a form [n, m]; `slopes` [1 or 2,
    n].
    """
    each = np.stack([np.broadcast_to(w, slopes.shape[1]) for w in form.weights(drive)], axis=1)
    return np.concatenate([slope[:, None] * each for slope in slopes], axis=1)


def _slopes(problem: Problem, at: Fit, form: LearnedForm) -> Array:
    """Derivative of every observation with respect to the quantity's logarithm, and to its phase:
    [1 or 2, n].
    """
    # equal values at both nodes shift all rows alike
    everywhere = (Term(("voltage_v",), ((0.0, 1.0),)),)
    probe = learned_kind(replace(form, terms=everywhere))
    steps = STEP * np.repeat(np.eye(2 if form.with_phase else 1), 2, axis=1)
    vectors = np.hstack(
        [np.tile(at.vector, (len(steps) + 1, 1)), np.vstack([0.0 * steps[:1], steps])]
    )
    predicted = problem.predictor.predicted((*at.kinds, probe), vectors)
    return np.nan_to_num(problem.predictor.less(predicted[1:], predicted[0]) / STEP)


def _possible(acts_on: str, drive: Drive, shows: Mask) -> list[Term]:
    """A term of every input that varies where the quantity shows, and of every pair of them."""
    names = QUANTITIES[acts_on].inputs
    nodes = {
        n: [_nodes(n, drive, shows, most) for most in MOST_NODES.get(n, OTHERS)] for n in names
    }
    vary = [n for n in names if nodes[n][0]]
    alone = [Term((n,), (nodes[n][0],)) for n in vary]
    return alone + [Term((a, b), (nodes[a][1], nodes[b][1])) for a, b in combinations(vary, 2)]


def _nodes(name: str, drive: Drive, shows: Mask, most: int) -> tuple[float, ...]:
    """Values at which an input was set where it matters, thinned out to `most`; its ends are among
    them.
    """
    x = np.broadcast_to(np.asarray(getattr(drive, name), float), shows.size)
    matters = shows & ((x > 0.0) | (name not in LOG_INPUTS))
    if name in ("frequency_hz", "voltage_v"):
        matters = matters & (np.broadcast_to(drive.voltage_v, shows.size) > 0.0)
    x = x[matters]
    if not x.size or np.ptp(x) == 0.0:
        return ()
    level = scaled(name, replace(drive, **{name: x}), (float(x.min()), float(x.max())))
    level = np.round(GRID * (level - level.min()) / np.ptp(level))
    values = [float(np.median(x[level == at])) for at in np.unique(level)]
    values[0], values[-1] = float(x.min()), float(x.max())
    kept = np.unique(np.round(np.linspace(0, len(values) - 1, min(most, len(values)))).astype(int))
    return tuple(values[i] for i in kept)
