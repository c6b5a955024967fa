"""Nothing in the catalogue: at which place of the chain the discrepancy acts, and the smoothest term that closes it.

At each place a free-form term (`model.effects.learned`) of the same prior is pushed through the linearised model;
inputs are added as long as the evidence asks for them. The best of every quantity is then fitted to the full model,
and the places are weighed by what those fits explain. Sessions that no fit has seen decide how many inputs the term
has, whether a short formula does as well, and whether the gap shrinks at all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from scipy.special import logsumexp

from model.description import ModelDescription
from model.diagnosis.data import Measurements
from model.diagnosis.fit import Fit, Problem
from model.diagnosis.naming import Candidate, candidate
from model.diagnosis.proof import Proof, prove
from model.diagnosis.rival import evidence, log_marginal
from model.effects.learned import (
    LEARNED,
    LOG_INPUTS,
    QUANTITIES,
    SHAPES,
    LearnedForm,
    Shape,
    Term,
    learned_kind,
    scaled,
)
from model.support.arrays import Array, Mask
from model.touch import Drive

AMPLITUDES = (0.02, 0.06, 0.2, 0.6, 1.5)  # of log(quantity)
ANOTHER_INPUT_NATS = 3.0  # that one more term must be worth
MOST_TERMS = 3
NODES, NODES_OF_PAIR = {"frequency_hz": 12}, {"frequency_hz": 7}  # at most; of other inputs:
OTHER_NODES, OTHER_NODES_OF_PAIR = 6, 4
GRID = 50  # parts of an input's span within which settings count as the same
STEP = 1e-3
ALIKE = 0.95  # of the probability, held by the places that are not told apart
AS_GOOD = 0.02  # of the held-out error: a simpler term may leave that much more
OF_THE_SMOOTH = 0.9  # share of what the smooth term closes that a short formula must close
FORMULA_STARTS = (0.0, -1.0, 1.0)


@dataclass(frozen=True)
class LearnedTerm:
    """What was learned: its fit, the places of the chain with their probabilities, and the proof on held-out data.

    `alike`: the places, most probable first, that these data cannot tell apart; the term stands at one of them.
    `smooth_closed`: share of the gap that the smooth term closes, beside which a short formula is judged.
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


def learn(
    description: ModelDescription,
    data: Measurements,
    problem: Problem,
    discrepancy: list[Array],
    base: Candidate,
    seed: int,
    progress: Callable[[str], None],
) -> LearnedTerm | None:
    """The term that closes the gap which `base` leaves; None where the model has one already, or none is worth it."""
    if LEARNED in description.effect_parameters:
        return None
    scale = base.beside_discrepancy.scale

    def judged(fit: Fit, rivals: list[Fit]) -> Proof:
        each = [candidate(problem, discrepancy, f.kinds, f) for f in (fit, *rivals)]
        return prove(description, data, problem.noise, each[0], each[1:], scale, seed, lambda _: None)

    paths: dict[str, list[LearnedForm]] = {}
    fits: dict[str, Fit] = {}
    for name in QUANTITIES:
        progress(f"learned: {QUANTITIES[name].words}")
        if path := _Selection(problem, base.fit, name).path:
            paths[name], fits[name] = path, _fitted(problem, base.fit, path[-1])
    if not fits:
        return None
    logs = {name: evidence(fit, problem.noise).log_evidence for name, fit in fits.items()}
    places = _places(logs)
    alike = _alike(places)
    place = "friction" if "friction" in alike else alike[0]
    chosen = max((name for name in fits if QUANTITIES[name].place == place), key=lambda name: logs[name])
    progress("learned: held out")
    tried = [(form, fit, judged(fit, [])) for form in paths[chosen] for fit in [_fitted(problem, base.fit, form)]]
    least = min(_left(proof) for _, _, proof in tried)
    form, fit, proof = next(t for t in tried if _left(t[2]) <= (1.0 + AS_GOOD) * least)
    smooth = proof.gap_closed
    for shape in SHAPES[1:]:
        short = _formula(form, shape)
        trial = _fitted(problem, base.fit, short)
        its_proof = judged(trial, [])
        if its_proof.gap_closed >= OF_THE_SMOOTH * smooth:
            form, fit = short, trial
            break
    elsewhere = [fits[n] for n in fits if n != chosen and QUANTITIES[n].place in alike]
    found = candidate(problem, discrepancy, fit.kinds, fit)
    return LearnedTerm(form, found, places, alike, judged(fit, elsewhere), smooth)


def _left(proof: Proof) -> float:
    return float(np.mean(proof.after)) if proof.after.size else np.inf


def _fitted(problem: Problem, base: Fit, form: LearnedForm) -> Fit:
    kind = learned_kind(form)
    if form.shape == "spline":
        return problem.fit((kind,), np.concatenate([base.vector, np.zeros(len(kind.parameters()))]))
    return problem.best_fit((kind,), base.vector, FORMULA_STARTS)


def _formula(form: LearnedForm, shape: Shape) -> LearnedForm:
    """The same inputs, each by a formula of its own; only the ends of their nodes matter to those."""
    nodes = {n: x for term in form.terms for n, x in zip(term.inputs, term.nodes, strict=True)}
    terms = tuple(Term((name,), ((x[0], x[-1]),)) for name, x in nodes.items())
    return replace(form, shape=shape, terms=terms, with_phase=False, amplitude=max(form.amplitude, AMPLITUDES[2]))


def _places(logs: Mapping[str, float]) -> dict[str, float]:
    """Probability of every place, the largest first: the places are alike before the data, and so what is there."""
    per_place: dict[str, list[float]] = {}
    for name, log in logs.items():
        per_place.setdefault(QUANTITIES[name].place, []).append(log)
    counts = {place: sum(q.place == place for q in QUANTITIES.values()) for place in per_place}
    each = {place: float(logsumexp(found)) - np.log(counts[place]) for place, found in per_place.items()}
    total = logsumexp(list(each.values()))
    return {place: float(np.exp(log - total)) for place, log in sorted(each.items(), key=lambda item: -item[1])}


def _alike(places: Mapping[str, float]) -> tuple[str, ...]:
    """The fewest places that hold `ALIKE` of the probability."""
    enough = int(np.searchsorted(np.cumsum(list(places.values())), ALIKE))
    return tuple(places)[: enough + 1]


class _Selection:
    """Forward selection of the inputs of one quantity's term, on the linearised model."""

    def __init__(self, problem: Problem, base: Fit, acts_on: str) -> None:
        self.data, self.noise, self.acts_on = problem.predictor.data, problem.noise, acts_on
        self.base, self.target = base, base.residual + base.jacobian @ base.vector
        drive = self.data.conditions().drive()
        for effect in problem.predictor.description.effects:
            drive = effect.drive(drive)
        self.drive = drive
        self.with_phase = QUANTITIES[acts_on].has_phase and bool(self.data.is_phase.any())
        self.slopes = _slopes(problem, base, acts_on, self.with_phase)

    @cached_property
    def path(self) -> list[LearnedForm]:
        """Forms of one term, two, ... as far as the evidence asks for another; empty where it asks for none."""
        terms = self._possible()
        features = {term: self._features(term) for term in terms}
        chosen: tuple[Term, ...] = ()
        found: list[LearnedForm] = []
        best = log_marginal(self.target, self.base.jacobian, self.noise)
        while len(found) < MOST_TERMS:
            tried = []
            for term in terms:
                kept = tuple(t for t in chosen if not set(t.inputs) <= set(term.inputs))
                if term not in chosen:
                    together = np.concatenate([features[t] for t in (*kept, term)], axis=1)
                    tried += [(self._weighed(a * together), a, (*kept, term)) for a in AMPLITUDES]
            if not tried:
                break
            log, amplitude, wanted = max(tried, key=lambda t: t[0])
            if log - best < ANOTHER_INPUT_NATS:
                break
            best, chosen = log, wanted
            found.append(self._form(chosen, amplitude))
        return found

    def _form(self, terms: tuple[Term, ...], amplitude: float = 1.0) -> LearnedForm:
        volts = np.broadcast_to(self.drive.voltage_v, self.data.count)
        lowest = float(volts[volts > 0.0].min())
        return LearnedForm(self.acts_on, "spline", terms, amplitude, lowest, self.with_phase)

    def _weighed(self, features: Array) -> float:
        return log_marginal(self.target, np.concatenate([self.base.jacobian, features], axis=1), self.noise)

    def _features(self, term: Term) -> Array:
        """What every observation does per unit of every parameter of a term [n, m], whitened."""
        weights = self._form((term,)).weights(self.drive)
        each = np.stack([np.broadcast_to(w, self.data.count) for w in weights], axis=1)
        return self.noise.whiten(np.concatenate([slope[:, None] * each for slope in self.slopes], axis=1))

    def _possible(self) -> list[Term]:
        """A term of every input that varies where the quantity shows, and of every pair of them."""
        shows = np.any(np.abs(self.slopes) > 1e-6, axis=0)
        names = QUANTITIES[self.acts_on].inputs
        alone = {n: _nodes(n, self.drive, shows, NODES.get(n, OTHER_NODES)) for n in names}
        paired = {n: _nodes(n, self.drive, shows, NODES_OF_PAIR.get(n, OTHER_NODES_OF_PAIR)) for n in names}
        vary = [n for n in names if len(alone[n]) > 1]
        return [Term((n,), (alone[n],)) for n in vary] + [
            Term((a, b), (paired[a], paired[b])) for a, b in combinations(vary, 2)
        ]


def _slopes(problem: Problem, base: Fit, acts_on: str, with_phase: bool) -> Array:
    """Derivative of every observation with respect to the quantity's logarithm, and to its phase: [1 or 2, n]."""
    everywhere = (Term(("voltage_v",), ((0.0, 1.0),)),)  # equal values at both nodes shift all rows alike
    kind = learned_kind(LearnedForm(acts_on, "spline", everywhere, 1.0, 1.0, with_phase))
    vectors = np.zeros((3 if with_phase else 2, base.vector.size + len(kind.parameters())))
    vectors[:, : base.vector.size] = base.vector
    vectors[1, base.vector.size : base.vector.size + 2] = STEP
    if with_phase:
        vectors[2, base.vector.size + 2 :] = STEP
    predicted = problem.predictor.predicted((kind,), vectors)
    return np.nan_to_num(problem.predictor.less(predicted[1:], predicted[0]) / STEP)


def _nodes(name: str, drive: Drive, shows: Mask, most: int) -> tuple[float, ...]:
    """Values at which an input was set where it matters, thinned out to at most so many; its ends are among them."""
    volts = np.broadcast_to(drive.voltage_v, shows.size)
    x = np.broadcast_to(np.asarray(getattr(drive, name), float), shows.size)
    x = x[
        shows
        & ((volts > 0.0) if name in ("frequency_hz", "voltage_v") else True)
        & ((x > 0.0) | (name not in LOG_INPUTS))
    ]
    if not x.size or np.ptp(x) == 0.0:
        return ()
    level = scaled(name, replace(drive, **{name: x}), (float(x.min()), float(x.max())))
    level = np.round(GRID * (level - level.min()) / np.ptp(level))
    values = [float(np.median(x[level == at])) for at in np.unique(level)]
    values[0], values[-1] = float(x.min()), float(x.max())
    kept = np.unique(np.round(np.linspace(0, len(values) - 1, min(most, len(values)))).astype(int))
    return tuple(values[i] for i in kept)
