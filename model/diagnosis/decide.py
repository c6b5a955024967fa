"""One rule from probabilities to a verdict.

An effect is named where its inclusion probability reaches SURE. Else nothing is missing, or it is
unknown what, where either has more than half. Else the fewest hypotheses that hold SURE together
make a list.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from model.diagnosis.hypotheses import Candidate, Hypotheses
from model.diagnosis.posterior import Names, Posterior
from model.diagnosis.priors import NONE, PRIOR_UNKNOWN, SURE, UNKNOWN, words

WITHOUT_NAME = (NONE, UNKNOWN)


class Decision(NamedTuple):
    """A verdict by names alone.

    `names`: the effects of the model that the data ask for. `group`: for each of these what may
    stand in its place. `probability`: of what the verdict says.
    """

    verdict: str
    names: Names
    group: dict[str, list[str]]
    probability: float
    reason: str


def decide(found: Posterior) -> Decision:
    named = tuple(n for n, p in found.inclusion.items() if p >= SURE and n not in WITHOUT_NAME)
    if named:
        group: dict[str, list[str]] = {name: [] for name in named}
        return Decision("effect_found", named, group, found.having(named), _named(found, named))
    if found.inclusion[NONE] > 0.5:
        reason = "no effect is worth its parameters"
        return Decision("no_discrepancy", (), {}, found.inclusion[NONE], reason)
    if found.inclusion[UNKNOWN] > 0.5:
        return Decision("unexplained", (), {}, found.inclusion[UNKNOWN], _unknown(found))
    return _list(found)


def _named(found: Posterior, named: Names) -> str:
    """Why, and what may stand beside the names."""
    who = "it" if len(named) == 1 else "each of the two"
    likely = [n for n, p in found.inclusion.items() if p > 0.5 and n not in named]
    perhaps = "".join(f"; perhaps {words(name)} as well" for name in likely)
    return f"the models that hold {who} have {SURE:.0%} of the probability or more{perhaps}"


def _unknown(found: Posterior) -> str:
    """That no effect explains the data, and what outside of the touch may."""
    reason = "the data disagree with the model, and no effect of the catalogue explains how"
    return reason + "".join(f"; {said}" for said in found.looks_like)


def _list(found: Posterior) -> Decision:
    """The most probable effects, and for each what may stand in its place."""
    no_model = {*WITHOUT_NAME, *found.untestable}
    listed = [names for names in found.credible() if not no_model & set(names)]
    best = next(names for names in found.hypotheses if not no_model & set(names))
    group = {}
    for name in best:
        others = (other for names in listed if name not in names for other in names)
        group[name] = [other for other in dict.fromkeys(others) if other not in best]
    probability = found.having_any(_all_of(group))
    reason = "these data cannot tell the members of the list apart"
    if probability < SURE:
        reason += f"; {words(NONE)} has {found.inclusion[NONE]:.0%}"
        reason += f" of the probability, {words(UNKNOWN)} {found.inclusion[UNKNOWN]:.0%}"
    return Decision("ambiguous", best, group, probability, reason)


def _all_of(group: dict[str, list[str]]) -> list[str]:
    """Every name of a group once."""
    return list(dict.fromkeys(n for name, alike in group.items() for n in (name, *alike)))


@dataclass(frozen=True)
class Verdict:
    """The decision with the models that it rests on.

    `chosen` is the model that the data ask for, the base model where no effect has a name.
    `adequate`: whether neither another form of its effects nor anything unknown beside them is
    asked for.
    """

    decision: Decision
    posterior: Posterior
    chosen: Candidate
    adequate: bool

    @property
    def verdict(self) -> str:
        """One of the contract's words."""
        return self.decision.verdict

    @property
    def group(self) -> dict[str, list[str]]:
        """For each effect of the chosen model, what may stand in its place."""
        return self.decision.group

    @property
    def probability(self) -> float:
        """Of what it says."""
        return self.decision.probability

    @property
    def is_sure_of_some(self) -> bool:
        """Whether some effect of the catalogue is there for sure, be it one or another."""
        no_effect = sum(self.posterior.hypotheses[name,] for name in WITHOUT_NAME)
        return self.is_named and 1.0 - no_effect >= SURE

    @property
    def is_named(self) -> bool:
        """Whether it gives effects, which the corrected model then carries."""
        return bool(self.decision.names)

    @property
    def suspects(self) -> list[str]:
        """The effects of the chosen model, and what may stand in their place."""
        return _all_of(self.group)

    @property
    def reason(self) -> str:
        off = "; its form is not quite the catalogue's" if form_is_off(self.chosen) else ""
        withheld = " with ".join(words(name) for name in self.posterior.withheld)
        if withheld:
            off += f"; no name for {withheld}, which closes little of the gap on data left out"
        return self.decision.reason + off


def verdict_of(found: Hypotheses, posterior: Posterior) -> Verdict:
    """Apply the rule to fitted models."""
    decision = decide(posterior)
    chosen = found.of(decision.names or (NONE,))
    adequate = decision.verdict != "unexplained" and is_adequate(chosen)
    return Verdict(decision, posterior, chosen, adequate)


def is_adequate(chosen: Candidate) -> bool:
    """Whether a model needs no other form of its effects, and nothing unknown beside them."""
    beside = chosen.beside_discrepancy.log_evidence - chosen.alone.log_evidence
    return not form_is_off(chosen) and bool(beside < np.log(1.0 / PRIOR_UNKNOWN - 1.0))


def form_is_off(chosen: Candidate) -> bool:
    """Whether a form that is not the catalogue's has SURE of the probability."""
    return bool(chosen.alone.exact_share < 1.0 - SURE)
