"""Several effects at once: forward steps, then swaps, by the evidence that single effects are judged by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from model.diagnosis.fit import Fit, Problem
from model.diagnosis.naming import (
    KIN_NATS,
    NEAR_NATS,
    PRIOR_EFFECTS,
    PRIOR_UNKNOWN,
    SURE,
    Candidate,
    could_stand_for,
    with_one_more,
)
from model.diagnosis.rival import explained, remaining
from model.diagnosis.weighing import MIMICS, Weighed, adequate, of_another_form, of_exact_form, of_its_form
from model.diagnosis.where import Disagreement
from model.effects import CATALOGUE, Effect
from model.support.arrays import Array

Kinds = tuple[type[Effect], ...]
MOST = 3  # effects at once
FITTED = 6  # of those beside others: the most promising
STRENGTHS = (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)  # prior standard deviations, at which its signature is looked at
ANOTHER = float(np.log(PRIOR_EFFECTS / len(CATALOGUE)))  # log prior of one more: as of the first
ANOTHER_NATS = 3.0  # that one more effect must be worth, its prior counted; SURE has as many,
NAMED_NATS = 5.0  # and more than what else it may be, to be named; pilot sets: none of 154 says 4, pairs 5 up
MOST_NAMED = 2  # effects at once: of sets of three there are a thousand
ANYTHING = "does hardly more than something unknown would in its place"  # what may be wrong with one of several,
A_FORM = "is not needed in the catalogue's form: it may mend that of another"
A_SETTING = "shows at a single setting"
OFF_BY = 0.2  # of what the first explains: what adds less may be what its form is off; pilot sets: up to 0.17 was
SAID_BY_FORM = 4.0  # nats; pilot sets: beside one effect of another form 4 to 33, of eleven true seconds one says more
OFF = "adds no more than what the form of the other may be off"
NO_CURRENT = "has another form than the catalogue's, and no current that was measured speaks for it"


@dataclass
class Search:
    """Looks for the set of effects with the most evidence; every set is fitted once."""

    problem: Problem
    base: Candidate
    singles: list[Candidate]
    progress: Callable[[str], None]
    _fitted: dict[frozenset[type[Effect]], Candidate] = field(default_factory=dict)
    _promising: dict[frozenset[type[Effect]], dict[type[Effect], float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Single effects are fitted already."""
        self._fitted |= {frozenset(c.kinds): c for c in self.singles}

    def best_with_one_more(self, chosen: Candidate) -> Candidate | None:
        """`chosen` with the effect beside it that the data like best; then each effect swapped while that helps."""
        if len(chosen.kinds) >= MOST or len(self.singles) <= len(chosen.kinds):
            return None
        more = self._beside(chosen.kinds)
        if len(chosen.kinds) == 1:  # two may hide behind a third that looks like both
            more += [self._fit(pair) for pair in self._pairs]
        best = max(more, key=_evidence, default=chosen)
        while best is not chosen:
            rivals = [c for i in range(len(best.kinds)) for c in self._beside(_without(best.kinds, i))]
            better = max(rivals, key=_evidence)
            if _evidence(better) <= _evidence(best):
                return best
            best = better
        return None

    def gain(self, chosen: Candidate) -> float:
        """What the least needed effect of `chosen` adds, in nats, its prior counted."""
        if len(chosen.kinds) < 2:
            return np.inf
        return min(_evidence(chosen) - _evidence(rest) for rest in self._rests(chosen)) + ANOTHER

    def mends_a_form(self, chosen: Candidate) -> bool:
        """Whether some effect of `chosen` is not needed in the catalogue's own forms: it mends another's by its own."""
        return self._gain_in_own_forms(chosen) <= ANOTHER_NATS

    def stands_for_a_form(self, chosen: Candidate) -> bool:
        """Whether forms that are off take the place of an effect of `chosen` for most of what it adds to exact ones."""
        return self.adds_little(chosen) and self._gain_in_own_forms(chosen) > self.gain(chosen) + SAID_BY_FORM

    def adds_little(self, chosen: Candidate) -> bool:
        """Whether some effect of `chosen` adds no more than what the form of the leading one may be off."""
        return self.gain(chosen) <= OFF_BY * (max(map(_evidence, self.singles)) - _evidence(self.base))

    def _gain_in_own_forms(self, chosen: Candidate) -> float:
        return min(chosen.alone.exact - rest.alone.exact for rest in self._rests(chosen)) + ANOTHER

    def places(self, chosen: Candidate, i: int) -> dict[str, float]:
        """Shares of the fewest effects that hold SURE of what may stand in the i-th place, the most probable first.

        And of what another form of the first of them could be.
        """
        rest = _without(chosen.kinds, i)
        rivals = sorted(self._beside(rest), key=_evidence, reverse=True)
        logs = np.array([_evidence(c) for c in rivals])
        shares = np.exp(logs - logsumexp(logs))
        count = int(np.searchsorted(np.cumsum(shares), SURE)) + 1
        mine = [next(kind for kind in c.kinds if kind not in rest) for c in rivals]
        kept = [n < count or could_stand_for(c, rivals[0], self._fit(rest)) for n, c in enumerate(rivals)]
        return {k.name: float(s) for k, s, keep in zip(mine, shares, kept, strict=True) if keep}

    def rests_on_one_setting(self, chosen: Candidate) -> bool:
        """Whether some effect of `chosen` would not be needed without the setting that shows it most.

        Another's form that is off there would look like it.
        """
        setting = self.problem.predictor.data.replicate_groups(apart=False, sessions_apart=False)
        scale = chosen.alone.scale
        of_all = remaining(chosen.around, scale, chosen.bent) ** 2
        for rest in self._rests(chosen):
            at_each = np.bincount(setting, remaining(rest.around, scale, rest.bent) ** 2 - of_all)
            total, adds = at_each.sum(), _evidence(chosen) - _evidence(rest)
            if total > 0.0 and adds * (1.0 - at_each.max() / total) + ANOTHER <= ANOTHER_NATS:
                return True
        return False

    def _rests(self, chosen: Candidate) -> list[Candidate]:
        """`chosen` without each of its effects in turn."""
        return [self._fit(_without(chosen.kinds, i)) for i in range(len(chosen.kinds))]

    @cached_property
    def _pairs(self) -> list[Kinds]:
        """The pairs that promise most: of the leading effects, each with what has a chance beside it."""
        leaders = sorted(self.singles, key=_evidence, reverse=True)[:FITTED]
        promise: dict[Kinds, float] = {}
        for c in leaders:
            for other, chi2 in self._likely(c.kinds).items():
                pair = (*c.kinds, other)
                pair = pair[::-1] if pair[::-1] in promise else pair
                promise[pair] = max(_evidence(c) + 0.5 * chi2, promise.get(pair, -np.inf))
        return sorted(promise, key=lambda pair: -promise[pair])[:FITTED]

    def _beside(self, kinds: Kinds) -> list[Candidate]:
        """Those effects with each other one beside them that has a chance."""
        others = [c.kinds[0] for c in self.singles if c.kinds[0] not in kinds]
        if kinds:
            likely = self._likely(kinds)
            others = [o for o in others if o in likely or frozenset((*kinds, o)) in self._fitted]
        return [self._fit((*kinds, other)) for other in others]

    def _likely(self, kinds: Kinds) -> dict[type[Effect], float]:
        """The effects whose signatures, at their best strength, have the shape of what those in `kinds` leave.

        With the chi^2 that each would explain, the most first. None that would not be worth its own prior.
        """
        key = frozenset(kinds)
        if key not in self._promising:
            chosen, others = self._fit(kinds), (c.kinds[0] for c in self.singles if c.kinds[0] not in kinds)
            scores = {other: self._score(chosen, other) for other in others}
            worth = [other for other in scores if 0.5 * scores[other] > -ANOTHER]
            best = sorted(worth, key=lambda other: -scores[other])[:FITTED]
            self._promising[key] = {other: scores[other] for other in best}
        return self._promising[key]

    def _score(self, chosen: Candidate, other: type[Effect]) -> float:
        """How much of what `chosen` leaves one more effect explains, in chi^2, at its best strength."""
        signatures = self._signatures(chosen.around, other)
        return float(np.max(explained(chosen.around, chosen.alone.scale, chosen.bent, signatures)))

    def _signatures(self, fit: Fit, other: type[Effect]) -> Array:
        """What one more effect adds [m, n], whitened: at each of STRENGTHS, and as it is fitted alone."""
        alone = self._fit((other,)).fit.vector[-len(other.parameters()) :]
        vectors = np.zeros((len(STRENGTHS) + 1, fit.vector.size + alone.size))
        vectors[:, : fit.vector.size] = fit.vector
        vectors[:-1, fit.vector.size], vectors[-1, fit.vector.size :] = STRENGTHS, alone
        return np.asarray(fit.residual - self.problem.whitened((*fit.kinds, other), vectors))

    def _fit(self, kinds: Kinds) -> Candidate:
        key = frozenset(kinds)
        if key not in self._fitted:
            self.progress("+".join(kind.name for kind in kinds))
            self._fitted[key] = with_one_more(self.problem, self._fit(kinds[:-1]), kinds)
        return self._fitted[key]


class Several(NamedTuple):
    """Several effects that explain the data, whether they fit, and why one may not be needed; empty where each is."""

    found: Candidate
    fits: bool
    doubt: str = ""


def is_explanation(several: Several, base: Candidate) -> bool:
    """Whether effects explain by their own form; more than are ever named, by the catalogue's exact one.

    So many imitate much that is in no catalogue where each may be of another form.
    """
    few = len(several.found.kinds) <= MOST_NAMED
    return of_its_form(several.found, base) and (few or (several.fits and of_exact_form(several.found)))


def several_effects(
    search: Search, weighed: Weighed, one_fits: bool, scan: Callable[[Candidate], Disagreement]
) -> Several | None:
    """The winner with what else is needed, where that fits or is of another form; None where one is enough.

    Beside a winner that fits alone, a second effect counts by what the data say in favour of its form, as one of two
    rivals would; beside one that does not fit, it must do more than a discrepancy of unknown shape, or be needed beside
    that as well. Either way it must do more than the first in a form far off. Where both act at one place by more, and
    by more still where their forms are not the catalogue's: another form of the one may look like the two. Effects that
    fit and do about as much as that discrepancy are in doubt, and so is one that shows at a single setting, that mends
    another's form (beside a winner that fits that is none), or, while a form is off, that adds little to what the first
    explains or that no measured current speaks for.
    """

    def fits(candidate: Candidate) -> bool:
        return adequate(candidate, scan(candidate).lack_of_fit_p)

    def doubt(candidate: Candidate) -> str:
        if not of_exact_form(candidate):
            if not search.problem.predictor.data.has_current:  # which what is in no catalogue would contradict
                return NO_CURRENT
            if search.adds_little(candidate):
                return OFF
        return A_SETTING if search.rests_on_one_setting(candidate) else ""

    chosen = weighed.winner
    while (more := search.best_with_one_more(chosen)) is not None:
        gain = search.gain(more)
        mends = search.mends_a_form(more)
        if gain <= ANOTHER_NATS or (one_fits and (mends or search.stands_for_a_form(more))):
            return None
        apart = len({kind.stage for kind in more.kinds}) == len(more.kinds)
        enough = NAMED_NATS if apart else NEAR_NATS if of_exact_form(more) else KIN_NATS
        far_off = np.log(MIMICS) + chosen.alone.rough
        if one_fits:
            over = more.alone.log_evidence - max(chosen.alone.log_evidence, far_off)
            return Several(more, fits(more), doubt(more)) if over + ANOTHER > enough else None
        best = max(more.alone.log_evidence, more.beside_discrepancy.log_evidence)
        unknown = max(np.log(PRIOR_UNKNOWN) + chosen.beside_discrepancy.log_evidence, far_off)
        odds = best + (len(more.kinds) - len(chosen.kinds)) * ANOTHER - unknown
        if odds <= -ANOTHER_NATS:
            return None
        chosen, fit = more, fits(more)
        if odds <= enough:
            return Several(chosen, fit, ANYTHING) if fit and gain > KIN_NATS else None
        if fit or of_another_form(chosen, weighed.base):
            return Several(chosen, fit, A_FORM if mends else doubt(chosen))
    return None


def _evidence(candidate: Candidate) -> float:
    return candidate.alone.log_evidence


def _without(kinds: Kinds, i: int) -> Kinds:
    return (*kinds[:i], *kinds[i + 1 :])
