"""From evidences to one verdict, with the readiness to say that no name is earned."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from model.diagnosis.fit import Problem
from model.diagnosis.naming import (
    NONE,
    PRIOR_EFFECTS,
    PRIOR_UNKNOWN,
    SURE,
    TOGETHER,
    UNKNOWN,
    Candidate,
    could_stand_for,
    words,
)
from model.diagnosis.rival import discrepancy_mean
from model.diagnosis.several import ANOTHER_NATS, MOST_NAMED, Search, Several, is_explanation, several_effects
from model.diagnosis.weighing import (
    Weighed,
    adequate,
    among_alike,
    confusion,
    is_mostly_bent,
    of_another_form,
    of_exact_form,
    posterior,
    ranked,
)
from model.diagnosis.where import Disagreement

NOTHING = 0.8  # probability of none from which nothing else is looked at,
LIKELY_NONE = 0.35  # and from which it is the verdict where no effect is certain
NAME_REMAINDER = 0.18  # of the effect's own signature: what may be left beside a name,
LIST_REMAINDER = 0.37  # and beside a list; pilot sets: strangers that effects half explain leave 0.2 and 0.38 up
SEVERAL_CERTAIN = 0.98
MOST_ALIKE = 3  # effects that may stand in one place: where more could, several effects are no explanation
LEADERS = 6
MOSTLY_BENT = "its form would have to be off by more than speaks for it"
LIKE_FORCE_SENSOR = "; a force sensor that reads the load looks like this: tare it, and press without sliding"
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

    @property
    def is_sure_of_some(self) -> bool:
        """Whether some effect of the catalogue is there for sure, be it one or another."""
        return self.is_named and 1.0 - self.probabilities[NONE] - self.probabilities[UNKNOWN] >= SURE

    def presence(self, name: str) -> float:
        """Probability that an effect of `chosen` is there; of several they share the 1 of `probabilities` evenly."""
        return min(1.0, max(len(self.chosen.kinds), 1) * self.probabilities.get(name, self.probability))


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
    search = Search(problem, base, weighed.singles, progress)
    several = several_effects(search, weighed, one_fits, scan)
    if several is not None and is_explanation(several, base):
        found = several.found
        places = [search.places(found, i) for i in range(len(found.kinds))]
        if max(len(place) for place in places) <= MOST_ALIKE:
            return _name_several(several, places, probabilities)
    if one_fits and (settled := _of_no_effect(weighed, probabilities)):
        return settled

    group = _alike(problem, weighed, one_fits)
    if one_fits:
        return _with_a_second(search, scan, _name_one(weighed, group))

    if beside := _name_beside_discrepancy(problem, weighed, group):
        return beside
    return _unexplained(weighed, "the data disagree with the model, and no effect of the catalogue explains how")


def _unexplained(weighed: Weighed, reason: str) -> Verdict:
    reason += LIKE_FORCE_SENSOR if weighed.is_like_force_sensor else ""
    return Verdict("unexplained", False, weighed.base, weighed.probabilities, {}, (reason,))


def _alike(problem: Problem, weighed: Weighed, fits: bool) -> list[str]:
    """What imitates the winner, and what, in another form, could stand for it or for one of these."""
    found = [name for name, value in confusion(problem, weighed.winner, weighed.singles).items() if value < TOGETHER]
    listed = {c.name: c for c in weighed.singles if c.name in (weighed.winner.name, *found)}
    others = [c for c in weighed.singles if c.name not in listed]
    return found + [c.name for c in others if any(could_stand_for(c, o, weighed.base, fits) for o in listed.values())]


def _effects(probabilities: dict[str, float]) -> dict[str, float]:
    return {name: value for name, value in probabilities.items() if name not in (NONE, UNKNOWN)}


def _of_no_effect(weighed: Weighed, probabilities: dict[str, float]) -> Verdict | None:
    """The verdict where no effect is certain and something else is the most probable.

    Something unknown is not told apart from an effect without which it is not certain.
    """
    effects = _effects(probabilities)
    if probabilities[UNKNOWN] >= 0.5 and not any(name in effects for name in _fewest(probabilities)):
        return _unexplained(weighed, "a discrepancy of unknown shape is the most probable")
    if probabilities[NONE] >= LIKELY_NONE:
        reason = "nothing is certain; none is the most probable"
        return Verdict("no_discrepancy", True, weighed.base, probabilities, {}, (reason,))
    return None


def _with_a_second(search: Search, scan: Callable[[Candidate], Disagreement], one: Verdict) -> Verdict:
    """The same, and beside it what the data favour, though not enough for a name: both are listed.

    What would only mend the form of a name that is earned is no more than a word of caution; so is a place in which
    many may stand.
    """
    winner = one.chosen
    more = search.best_with_one_more(winner)
    if more is None or winner.kinds[0] not in more.kinds or (odds := search.gain(more)) <= 0.0:
        return one
    at = next(i for i, kind in enumerate(more.kinds) if kind not in winner.kinds)
    second, alike = more.kinds[at].name, search.places(more, at)
    mends = (odds > ANOTHER_NATS and search.mends_a_form(more)) or search.stands_for_a_form(more)
    if (mends and one.verdict == "effect_found") or max(len(alike), len(one.suspects)) > MOST_ALIKE:
        return replace(one, adequate=False, reasons=(f"{one.reasons[0]}; perhaps {words(second)} as well",))
    there = 1.0 / (1.0 + np.exp(-odds))
    shares = dict.fromkeys(one.probabilities, 0.0) | {name: one.probabilities[name] for name in one.suspects}
    for name, share in alike.items():
        shares[name] += there * share / sum(alike.values())
    group = one.group | {second: [name for name in alike if name != second]}
    reason = f"the data favour {words(second)} beside {words(winner.name)}, though not enough for a name"
    fits = adequate(more, scan(more).lack_of_fit_p) and of_exact_form(more)
    told = _shared({name: share / len(more.kinds) for name, share in shares.items()}, one.probabilities)
    return Verdict("ambiguous", fits, more, told, group, (reason + ("" if fits else FORM_IS_OFF),))


def _shared(shares: dict[str, float], probabilities: dict[str, float]) -> dict[str, float]:
    """The shares of what is listed; what is not has the rest, in proportion to what it had, the largest first."""
    others = {name: value for name, value in probabilities.items() if shares[name] == 0.0}
    left = (1.0 - sum(shares.values())) / max(sum(others.values()), 1e-300)
    return ranked({name: share or left * probabilities[name] for name, share in shares.items()})


def _name_one(weighed: Weighed, group: list[str]) -> Verdict:
    """The winner, or a list that it leads, of all that is certain only together."""
    winner, probabilities = weighed.winner, weighed.probabilities
    effects = _effects(probabilities)
    certain = sum(effects.values()) >= SURE
    members = dict.fromkeys([*group, *(name for name in _fewest(probabilities) if name in effects)])
    rivals = [name for name in members if name != winner.name]
    reason = "these data cannot tell the group's members apart" if certain else "no candidate is certain; ranked"
    verdict, exact = "ambiguous", of_exact_form(winner)
    sure = not rivals and probabilities[winner.name] >= SURE
    if sure and is_mostly_bent(winner, weighed.base):
        reason = MOSTLY_BENT
    elif sure:
        verdict, reason = "effect_found", "probability and separation are high" + _how_unusual(winner)
    reason += "" if exact else FORM_IS_OFF
    told = among_alike(probabilities, winner.name, rivals)
    return Verdict(verdict, exact, winner, told, {winner.name: rivals}, (reason,))


def _name_beside_discrepancy(problem: Problem, weighed: Weighed, group: list[str]) -> Verdict | None:
    """The winner, or a list that it leads, where it does not fit but is needed all the same."""
    winner, probabilities = weighed.winner, weighed.probabilities
    needed = _needed_beside_discrepancy(weighed, group)
    is_other_form = of_another_form(winner, weighed.base)
    remainder = 0.0 if is_other_form else _remainder(problem, winner, weighed.base)
    if winner.name not in needed or remainder > LIST_REMAINDER or probabilities[UNKNOWN] >= 0.5:
        return None
    left = "its form is another" if is_other_form else f"what remains is {remainder:.0%} of its signature"
    members = dict.fromkeys([*group, *needed, *_credible(probabilities)])  # what is named alone has to be probable, too
    rivals = [name for name in members if name != winner.name]
    sure = not rivals and remainder <= NAME_REMAINDER and probabilities[winner.name] >= SURE
    bent = sure and is_mostly_bent(winner, weighed.base)
    verdict = "effect_found" if sure and not bent else "ambiguous"
    told = among_alike(probabilities, winner.name, rivals)
    reason = f"needed even beside a discrepancy of unknown shape; {MOSTLY_BENT if bent else left}"
    return Verdict(verdict, False, winner, told, {winner.name: rivals}, (reason,))


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


def _needed_beside_discrepancy(weighed: Weighed, group: list[str]) -> list[str]:
    """The fewest effects of which one is needed even with a discrepancy of unknown shape beside every model."""
    each = PRIOR_EFFECTS / (len(weighed.singles) + len(weighed.untestable))
    logs = {UNKNOWN: np.log(PRIOR_UNKNOWN) + weighed.base.beside_discrepancy.log_evidence}
    leaders = sorted(weighed.singles, key=lambda c: -c.alone.log_evidence)[:LEADERS]
    leaders += [c for c in weighed.singles if c.name in group and c not in leaders]
    logs |= {c.name: np.log(each) + c.beside_discrepancy.log_evidence for c in leaders}
    return _credible(posterior(logs))


def _credible(probabilities: dict[str, float]) -> list[str]:
    """The fewest effects that hold SURE of the probability together; none where all do not."""
    effects = _effects(probabilities)
    return _fewest(effects) if sum(effects.values()) >= SURE else []


def _fewest(probabilities: dict[str, float]) -> list[str]:
    """The first of these, the largest first, that hold SURE together."""
    enough = int(np.searchsorted(np.cumsum(list(probabilities.values())), SURE))
    return list(probabilities)[: enough + 1]


def _remainder(problem: Problem, winner: Candidate, base: Candidate) -> float:
    """Size of what only the discrepancy beside the winner explains, as a share of what the winner does.

    In the witness where that is most: each adds directions in which the discrepancy follows the noise. Both whitened;
    directions in which the winner's own parameters move the prediction do not count.
    """
    left = discrepancy_mean(winner.around, winner.beside_discrepancy, problem.discrepancy)
    data = problem.predictor.data
    own, _ = np.linalg.qr(winner.around.jacobian)
    left = left - own @ (own.T @ left)
    explained = max(base.fit.chi2 - winner.fit.chi2, 1e-9)
    return float(np.sqrt(max(np.sum(left[data.of(w)] ** 2) for w in data.witnesses) / explained))


def _name_several(several: Several, places: list[dict[str, float]], probabilities: dict[str, float]) -> Verdict:
    """Each effect by its own name, with what may stand in its place."""
    found = several.found
    names = [kind.name for kind in found.kinds]
    shares = dict.fromkeys(probabilities, 0.0)
    for place in places:
        for name, share in place.items():
            shares[name] += SEVERAL_CERTAIN / len(names) * share / sum(place.values())
    updated = _shared(shares, probabilities)
    group = {name: [other for other in place if other != name] for name, place in zip(names, places, strict=True)}
    count = {2: "two", 3: "three"}[len(names)]
    verdict = "ambiguous"
    if several.doubt:
        reason = f"{count} effects fit, but one of them {several.doubt}"
    elif len(names) > MOST_NAMED:
        reason = f"{count} effects fit, but so many imitate much that is in no catalogue"
    elif any(group.values()):
        reason = f"{count} effects are needed; these data cannot tell the members of a group apart"
    else:
        verdict, reason = "effect_found", f"{count} effects are needed{_how_unusual(found)}"
    is_adequate = several.fits and of_exact_form(found)
    reason += "" if is_adequate else FORM_IS_OFF
    return Verdict(verdict, is_adequate, found, updated, group, (reason,))
