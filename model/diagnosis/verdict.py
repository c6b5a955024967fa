"""From evidences to one verdict, with the readiness to say that no name is earned."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from model.diagnosis.fit import Problem
from model.diagnosis.naming import (
    KIN_NATS,
    NEAR_NATS,
    NONE,
    PRIOR_EFFECTS,
    PRIOR_NONE,
    PRIOR_UNKNOWN,
    SURE,
    UNKNOWN,
    Candidate,
    could_stand_for,
    separation,
    words,
)
from model.diagnosis.rival import discrepancy_mean
from model.diagnosis.several import ANOTHER, Search
from model.diagnosis.where import Disagreement

NOTHING = 0.90
APART = 25.0  # lambda_ij from which two effects count as told apart
ALIKE = 9.0  # below which more of the same would hardly tell them apart
TOGETHER = 4.0  # and below which they are named together, whatever one data set says
DISCREPANCY_WINS = 1.0 / PRIOR_UNKNOWN  # Bayes factor from which one beside the effect is the more probable
LACK_OF_FIT = 5e-4  # pilot sets: clear effects of another form reach 0.001, strangers that only this test sees none
NAME_REMAINDER = 0.18  # of the effect's own signature: what may be left beside a name,
LIST_REMAINDER = 0.37  # and beside a list; pilot sets: strangers that effects half explain leave 0.2 and 0.38 up
MIMICS = PRIOR_UNKNOWN / PRIOR_EFFECTS  # of an effect's prior: something unknown that looks like it, but for its form
PARTICULAR = 0.25  # of a nat, what each nat beyond a discrepancy of any shape says against a look-alike; pilot sets
MENDED = 3.0  # times what a discrepancy beside an effect adds, the effect's own form says beyond any; pilot sets
ANOTHER_NATS = 3.0  # that one more effect must be worth, its prior counted; SURE has as many,
BESIDE_A_FIT_NATS = 6.0  # and that beside one that fits alone; pilot sets: none of 52 says 5, pairs 10 up
SEVERAL_CERTAIN = 0.98
MOST_NAMED = 2  # effects at once: of sets of three there are a thousand
MOST_ALIKE = 3  # effects that may stand in one place: where more could, several effects are no explanation
LEADERS = 6
FORM_IS_OFF = "; its form is not quite the catalogue's"
USUAL = 2.58  # prior standard deviations that hold 99 %


@dataclass(frozen=True)
class Verdict:
    """One verdict and what it rests on.

    `chosen` is the model that the data ask for (the base model without a name). `group` holds, for every effect of
    `chosen`, the names that this data set cannot tell from it.
    """

    verdict: str
    adequate: bool
    chosen: Candidate
    probabilities: dict[str, float]
    group: dict[str, list[str]]
    reasons: tuple[str, ...]

    @property
    def is_named(self) -> bool:
        """Whether it names effects, which the corrected model then carries."""
        return self.verdict in ("effect_found", "ambiguous")

    @property
    def suspects(self) -> list[str]:
        """The named effects, and what is not told apart from them."""
        kinds = self.chosen.kinds if self.is_named else ()
        return list(dict.fromkeys(name for kind in kinds for name in (kind.name, *self.group.get(kind.name, []))))

    @property
    def probability(self) -> float:
        """Probability of what it says: its effects and what is not told apart from them, none, or unknown."""
        if self.is_named:
            return min(1.0, float(sum(self.probabilities.get(name, 0.0) for name in self.suspects)))
        return float(self.probabilities[NONE if self.verdict == "no_discrepancy" else UNKNOWN])

    def presence(self, name: str) -> float:
        """Probability that an effect of `chosen` is there; of several they share the 1 of `probabilities` evenly."""
        return min(1.0, max(len(self.chosen.kinds), 1) * self.probabilities.get(name, self.probability))


@dataclass(frozen=True)
class Weighed:
    """All single-effect models of one data set beside the base model.

    `unseen`: log evidence of each effect where it is too weak to leave a trace.
    """

    base: Candidate
    singles: list[Candidate]
    untestable: list[str]
    unseen: dict[str, float] = field(default_factory=dict)

    @property
    def winner(self) -> Candidate:
        """The effect with the most evidence."""
        return max(self.singles, key=lambda c: c.alone.log_evidence)

    @property
    def probabilities(self) -> dict[str, float]:
        """Posterior of none, unknown and every effect of the catalogue, summing to 1, the largest first.

        An effect too weak to leave a trace counts as none.
        Unknown is a discrepancy of any shape: beside the base model; beside the winner, where it wins there and the
        winner is not the effect itself in another form; and one that looks like an effect of a form far off, which is
        the less likely the more the effect says in particular.
        """
        each = np.log(PRIOR_EFFECTS / (len(self.singles) + len(self.untestable)))
        base, winner = self.base, self.winner
        logs = {c.name: float(each + self._seen(c)) for c in self.singles}
        unknown = [np.log(PRIOR_UNKNOWN) + base.beside_discrepancy.log_evidence - PARTICULAR * tightness(winner)]
        unknown += [np.log(MIMICS) + each + mimic(c, base) for c in self.singles]
        more = np.log(PRIOR_UNKNOWN) + each + winner.beside_discrepancy.log_evidence
        if of_another_form(winner, base):
            logs[winner.name] = float(np.logaddexp(logs[winner.name], more))
        elif beside_wins(winner):
            unknown.append(more)
        none = [np.log(PRIOR_NONE) + base.alone.log_evidence, *(each + value for value in self.unseen.values())]
        logs |= {NONE: float(logsumexp(none)), UNKNOWN: float(logsumexp(unknown))}
        return _normalised(logs | {name: float(each + base.alone.log_evidence) for name in self.untestable})

    def _seen(self, candidate: Candidate) -> float:
        """log evidence of an effect where it leaves a trace."""
        share = 1.0 - np.exp(min(self.unseen.get(candidate.name, -np.inf) - candidate.alone.log_evidence, 0.0))
        return float(candidate.alone.log_evidence + np.log(max(share, 1e-300)))


def _normalised(logs: dict[str, float]) -> dict[str, float]:
    total = logsumexp(list(logs.values()))
    return _shares({name: float(np.exp(value - total)) for name, value in logs.items()})


def adequate(candidate: Candidate, lack_of_fit_p: float) -> bool:
    """Whether nothing of unknown shape needs to stand beside the model."""
    return not beside_wins(candidate) and lack_of_fit_p >= LACK_OF_FIT


def of_exact_form(candidate: Candidate) -> bool:
    """Whether the data do not refute the catalogue's own form, which a corrected model carries."""
    return bool(candidate.alone.log_evidence - candidate.alone.exact <= np.log(DISCREPANCY_WINS))


def beside_wins(candidate: Candidate) -> bool:
    """Whether the data ask for a discrepancy of unknown shape beside the model."""
    factor = candidate.beside_discrepancy.log_evidence - candidate.alone.log_evidence
    return bool(factor > np.log(DISCREPANCY_WINS))


def tightness(candidate: Candidate) -> float:
    """What the data say, in nats, against a form that is far off; 0 where they want one."""
    return max(candidate.alone.log_evidence - candidate.alone.rough, 0.0)


def of_another_form(candidate: Candidate, base: Candidate) -> bool:
    """Whether effects explain most by their own form, and a discrepancy that wins beside them only mends that."""
    own = candidate.alone.log_evidence - base.beside_discrepancy.log_evidence
    mended = candidate.beside_discrepancy.log_evidence - candidate.alone.log_evidence
    return beside_wins(candidate) and bool(own > MENDED * mended)


def mimic(candidate: Candidate, base: Candidate) -> float:
    """log evidence of something unknown that looks like a model's effects, but for a form far off.

    What a discrepancy of any shape explains nearly as well could be anything; what it does not is the effects' own.
    """
    rough = candidate.alone.rough
    return float(rough - PARTICULAR * max(rough - base.beside_discrepancy.log_evidence, 0.0))


def of_its_form(candidate: Candidate, base: Candidate) -> bool:
    """Whether effects explain the data by their own form, rather than something unknown that looks like them."""
    odds = candidate.alone.log_evidence - mimic(candidate, base) - np.log(MIMICS)
    return bool(odds >= np.log(SURE / (1.0 - SURE)))


def confusion(problem: Problem, winner: Candidate, rivals: list[Candidate]) -> dict[str, float]:
    """min(lambda_ij, lambda_ji) of the winner with each rival that comes near it in evidence."""
    best = winner.alone.log_evidence
    near = [c for c in rivals if c is not winner and best - c.alone.log_evidence < NEAR_NATS]
    return {c.name: separation(problem, winner, c) for c in near}


def decide(
    problem: Problem,
    weighed: Weighed,
    base_scan: Disagreement,
    scan: Callable[[Candidate], Disagreement],
    progress: Callable[[str], None],
) -> Verdict:
    """Weigh what was fitted; fits second effects where one is not enough."""
    winner, base = weighed.winner, weighed.base
    probabilities = weighed.probabilities
    if probabilities[NONE] >= NOTHING and not base_scan.alarm and adequate(base, base_scan.lack_of_fit_p):
        return Verdict("no_discrepancy", True, base, probabilities, {}, ("no effect is worth its parameters",))

    one_fits = adequate(winner, scan(winner).lack_of_fit_p)
    search = Search(problem, weighed.singles, progress)
    several = _several(search, weighed, one_fits, scan)
    if several is not None and _is_explanation(several, base):
        found = several.found
        places = [search.places(found, i) for i in range(len(found.kinds))]
        if max(len(place) for place in places) <= MOST_ALIKE:
            return _name_several(several, places, probabilities)
    if one_fits and (settled := _of_no_effect(weighed, probabilities)):
        return settled

    alike = confusion(problem, winner, weighed.singles)
    group = [name for name, value in alike.items() if value < TOGETHER]
    group += [
        c.name
        for c in weighed.singles
        if c.name not in (winner.name, *group) and could_stand_for(c, winner, base, one_fits)
    ]
    if one_fits:
        return _name_one(winner, group, probabilities, _perhaps(search, winner))

    needed = _needed_beside_discrepancy(weighed, group)
    is_other_form = of_another_form(winner, base)
    remainder = 0.0 if is_other_form else _remainder(problem, winner, base)
    if winner.name in needed and remainder <= LIST_REMAINDER and probabilities[UNKNOWN] < 0.5:
        left = "its form is another" if is_other_form else f"what remains is {remainder:.0%} of its signature"
        why = f"needed even beside a discrepancy of unknown shape; {left}"
        for name in (*needed, *_credible(probabilities)):  # what is named alone has to be probable, too
            group += [name] if name not in (winner.name, *group) else []
        verdict = "ambiguous" if group or remainder > NAME_REMAINDER else "effect_found"
        return Verdict(verdict, False, winner, probabilities, {winner.name: group}, (why,))
    return Verdict(
        "unexplained",
        False,
        base,
        probabilities,
        {},
        ("the data disagree with the model, and no effect of the catalogue explains how",),
    )


def _effects(probabilities: dict[str, float]) -> dict[str, float]:
    return {name: value for name, value in probabilities.items() if name not in (NONE, UNKNOWN)}


def _of_no_effect(weighed: Weighed, probabilities: dict[str, float]) -> Verdict | None:
    """The verdict where no effect is certain and something else is the most probable."""
    if sum(_effects(probabilities).values()) >= SURE:
        return None
    if probabilities[UNKNOWN] >= 0.5:
        reason = "a discrepancy of unknown shape is the most probable"
        return Verdict("unexplained", False, weighed.base, probabilities, {}, (reason,))
    if probabilities[NONE] >= 0.5:
        reason = "nothing is certain; none is the most probable"
        return Verdict("no_discrepancy", True, weighed.base, probabilities, {}, (reason,))
    return None


def _perhaps(search: Search, winner: Candidate) -> list[str]:
    """What the data favour beside the winner, though not enough for a name."""
    more = search.best_with_one_more(winner)
    if more is None or search.gain(more) <= 0.0:
        return []
    return [kind.name for kind in more.kinds if kind not in winner.kinds]


def _name_one(winner: Candidate, group: list[str], probabilities: dict[str, float], perhaps: list[str]) -> Verdict:
    """The winner, or a list that it leads; `perhaps` stands beside it."""
    effects = _effects(probabilities)
    certain = sum(effects.values()) >= SURE
    members = dict.fromkeys([winner.name, *group, *_credible(_shares(effects))])
    rivals = [name for name in members if name != winner.name]
    reason = "these data cannot tell the group's members apart" if certain else "no candidate is certain; ranked"
    verdict, exact = "ambiguous", of_exact_form(winner)
    if not rivals and probabilities[winner.name] >= SURE:
        verdict, reason = "effect_found", "probability and separation are high" + _how_unusual(winner)
    reason += "" if exact else FORM_IS_OFF
    reason += f"; perhaps {' and '.join(words(name) for name in perhaps)} as well" if perhaps else ""
    return Verdict(verdict, exact and not perhaps, winner, probabilities, {winner.name: rivals}, (reason,))


def _shares(probabilities: dict[str, float]) -> dict[str, float]:
    """The same summing to 1, the largest first."""
    total = sum(probabilities.values())
    ordered = sorted(probabilities.items(), key=lambda item: -item[1])
    return {name: value / total for name, value in ordered}


def _how_unusual(found: Candidate) -> str:
    """What to say where some effect lies outside the central 99 % of its prior, but for a weak effect.

    Its evidence has paid for that already. Where a parameter switches the effect off at an end, it may come as near to
    that as the data can see.
    """
    known = [p for kind in found.kinds for p in kind.parameters()]
    x = found.fit.vector[-len(known) :]
    weak = [np.inf if p.off == np.inf else -np.inf if p.scale == "log" and p.off == 0.0 else 0.0 for p in known]
    unusual = bool(np.any((np.abs(x) > USUAL) & (np.sign(x) != np.sign(weak))))
    return ", though stronger than 99 % of what is expected" if unusual else ""


class _Several(NamedTuple):
    """Several effects that explain the data, whether they fit, and whether each of them is certain to be needed."""

    found: Candidate
    fits: bool
    certain: bool = True


def _is_explanation(several: _Several, base: Candidate) -> bool:
    """Whether effects explain by their own form; more than are ever named, by the catalogue's exact one.

    So many imitate much that is in no catalogue where each may be of another form.
    """
    few = len(several.found.kinds) <= MOST_NAMED
    return of_its_form(several.found, base) and (few or (several.fits and of_exact_form(several.found)))


def _several(
    search: Search, weighed: Weighed, one_fits: bool, scan: Callable[[Candidate], Disagreement]
) -> _Several | None:
    """The winner with what else is needed, where that fits or is of another form; None where one is enough.

    Beside a winner that fits alone, a second effect counts by what the data say in favour of its form, as one of two
    rivals would; beside one that does not fit, it must do more than a discrepancy of unknown shape, or be needed beside
    that as well. Where both act at one place by more: another form of the one may look like the two. Effects that fit
    and do about as much as that discrepancy are not certain.
    """

    def fits(candidate: Candidate) -> bool:
        return adequate(candidate, scan(candidate).lack_of_fit_p)

    chosen = weighed.winner
    while (more := search.best_with_one_more(chosen)) is not None:
        gain = search.gain(more)
        if gain <= ANOTHER_NATS:
            return None
        least = BESIDE_A_FIT_NATS if one_fits else ANOTHER_NATS
        enough = KIN_NATS if len({kind.stage for kind in more.kinds}) < len(more.kinds) else least
        if one_fits:
            over = more.alone.log_evidence - chosen.alone.log_evidence
            return _Several(more, fits(more)) if over + ANOTHER > enough else None
        best = max(more.alone.log_evidence, more.beside_discrepancy.log_evidence)
        unknown = np.log(PRIOR_UNKNOWN) + chosen.beside_discrepancy.log_evidence
        odds = best + (len(more.kinds) - len(chosen.kinds)) * ANOTHER - unknown
        if odds <= -ANOTHER_NATS:
            return None
        chosen, fit = more, fits(more)
        if odds <= enough:
            return _Several(chosen, fit, certain=False) if fit and gain > KIN_NATS else None
        if fit or of_another_form(chosen, weighed.base):
            return _Several(chosen, fit)
    return None


def _needed_beside_discrepancy(weighed: Weighed, group: list[str]) -> list[str]:
    """The fewest effects of which one is needed even with a discrepancy of unknown shape beside every model."""
    each = (1.0 - PRIOR_NONE - PRIOR_UNKNOWN) / (len(weighed.singles) + len(weighed.untestable))
    logs = {UNKNOWN: np.log(PRIOR_UNKNOWN) + weighed.base.beside_discrepancy.log_evidence}
    leaders = sorted(weighed.singles, key=lambda c: -c.alone.log_evidence)[:LEADERS]
    leaders += [c for c in weighed.singles if c.name in group and c not in leaders]
    logs |= {c.name: np.log(each) + c.beside_discrepancy.log_evidence for c in leaders}
    return _credible(_normalised(logs))


def _credible(probabilities: dict[str, float]) -> list[str]:
    """The fewest effects that hold SURE of the probability together; none where all do not."""
    effects = _effects(probabilities)
    enough = np.flatnonzero(np.cumsum(list(effects.values())) >= SURE)
    return list(effects)[: enough[0] + 1] if enough.size else []


def _remainder(problem: Problem, winner: Candidate, base: Candidate) -> float:
    """Size of what only the discrepancy beside the winner explains, as a share of what the winner does.

    In the witness where that is most: each adds directions in which the discrepancy follows the noise. Both whitened;
    directions in which the winner's own parameters move the prediction do not count.
    """
    left = discrepancy_mean(winner.fit, winner.beside_discrepancy, problem.discrepancy)
    data = problem.predictor.data
    own, _ = np.linalg.qr(winner.fit.jacobian)
    left = left - own @ (own.T @ left)
    explained = max(base.fit.chi2 - winner.fit.chi2, 1e-9)
    return float(np.sqrt(max(np.sum(left[data.of(w)] ** 2) for w in data.witnesses) / explained))


def _name_several(several: _Several, places: list[dict[str, float]], probabilities: dict[str, float]) -> Verdict:
    """Each effect by its own name, with what may stand in its place."""
    found = several.found
    names = [kind.name for kind in found.kinds]
    shares = dict.fromkeys(probabilities, 0.0)
    for place in places:
        for name, share in place.items():
            shares[name] += SEVERAL_CERTAIN / len(names) * share / sum(place.values())
    others = {name: value for name, value in probabilities.items() if shares[name] == 0.0}
    left = (1.0 - SEVERAL_CERTAIN) / max(sum(others.values()), 1e-300)
    updated = _shares({name: share or left * probabilities[name] for name, share in shares.items()})
    group = {name: [other for other in place if other != name] for name, place in zip(names, places, strict=True)}
    count = {2: "two", 3: "three"}[len(names)]
    verdict = "ambiguous"
    if not several.certain:
        reason = f"{count} effects fit, but one of them does hardly more than something unknown would in its place"
    elif len(names) > MOST_NAMED:
        reason = f"{count} effects fit, but so many imitate much that is in no catalogue"
    elif any(group.values()):
        reason = f"{count} effects are needed; these data cannot tell the members of a group apart"
    else:
        verdict, reason = "effect_found", f"{count} effects are needed{_how_unusual(found)}"
    is_adequate = several.fits and of_exact_form(found)
    reason += "" if is_adequate else FORM_IS_OFF
    return Verdict(verdict, is_adequate, found, updated, group, (reason,))
