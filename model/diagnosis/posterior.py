"""Probabilities of all hypotheses, and of what each of them holds.

The probability that an effect is there is the sum over all hypotheses that hold it: its inclusion
probability (Barbieri and Berger, 10.1214/009053604000000238). The priors stand in
`priors`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from model.diagnosis.hypotheses import Evidences
from model.diagnosis.priors import NONE, PRIOR_EFFECTS, PRIOR_NONE, PRIOR_UNKNOWN, SURE, UNKNOWN
from model.diagnosis.readings import CHECKS

Names = tuple[str, ...]


@dataclass(frozen=True)
class Posterior:
    """Probability of each hypothesis by what it holds, the most probable first, summing to 1.

    `outside`: what of `unknown` is not of the touch, by its name. `untestable`: effects that no
    column could show. `withheld`: effects that are less probable for what held-out data say, and
    not sure.
    """

    hypotheses: dict[Names, float]
    outside: dict[str, float]
    untestable: Names
    withheld: Names = ()

    @property
    def looks_like(self) -> list[str]:
        """What is not of the touch and likelier than all else, with its check."""
        likely = [name for name, p in self.outside.items() if p > 0.5]
        return [f"{name} looks like this: {CHECKS[name]}" for name in likely]

    @cached_property
    def inclusion(self) -> dict[str, float]:
        """Probability that each effect is there; of none and unknown that they are the case."""
        return self._by_name(lambda names: 1.0)

    @cached_property
    def shares(self) -> dict[str, float]:
        """The same summing to 1: two effects share the probability that both are there."""
        return self._by_name(lambda names: 1.0 / len(names))

    def having(self, names: Iterable[str]) -> float:
        """Probability of all hypotheses that hold these."""
        return sum(p for held, p in self.hypotheses.items() if set(names) <= set(held))

    def having_any(self, names: Iterable[str]) -> float:
        """Probability of all hypotheses that hold any of these."""
        return sum(p for held, p in self.hypotheses.items() if set(names) & set(held))

    def credible(self) -> list[Names]:
        """The fewest hypotheses that hold SURE together."""
        reached = np.cumsum(list(self.hypotheses.values()))
        return list(self.hypotheses)[: int(np.searchsorted(reached, SURE)) + 1]

    def _by_name(self, weight: Callable[[Names], float]) -> dict[str, float]:
        """Sum over hypotheses, the most probable first."""
        total = Counter[str]()
        for names, p in self.hypotheses.items():
            total.update(dict.fromkeys(names, weight(names) * p))
        return dict(total.most_common())


def posterior(found: Evidences) -> Posterior:
    """Priors times evidences.

    A pair has both priors. Something unknown may stand alone, or beside the best effect or pair. An
    effect too weak to leave a trace counts as none; one that no column could show keeps its prior.
    """
    count = len(found.untestable) + sum(len(names) == 1 for names in found.alone) - 1
    each = np.log(PRIOR_EFFECTS / count)
    none = found.alone[NONE,]
    logs = {names: len(names) * each + log for names, log in found.alone.items()}
    logs |= {(name,): each + none for name in found.untestable}
    logs[NONE,] = np.log(PRIOR_NONE) + none
    unknown = [_prior(names, each) + log for names, log in found.beside.items()]
    outside = {name: each + log for name, log in found.outside.items()}
    logs[UNKNOWN,] = float(logsumexp([*unknown, *outside.values()]))
    total = logsumexp(list(logs.values()))
    p = {names: float(np.exp(log - total)) for names, log in logs.items()}
    for name, log in found.unseen.items():
        moved = min(float(np.exp(each + log - total)), p[name,])
        p[name,] -= moved
        p[NONE,] += moved
    ranked = dict(sorted(p.items(), key=lambda item: -item[1]))
    shares = {name: float(np.exp(log - total)) for name, log in outside.items()}
    return Posterior(ranked, shares, found.untestable)


def held_against(found: Posterior, odds: Mapping[Names, float]) -> Posterior:
    """What held-out data add: `odds` for some hypotheses, that they and not others are true."""
    weights = {names: p * odds.get(names, 1.0) for names, p in found.hypotheses.items()}
    total = sum(weights.values())
    ranked = dict(sorted(weights.items(), key=lambda item: -item[1]))
    held = replace(found, hypotheses={names: w / total for names, w in ranked.items()})
    withheld = (n for n, p in found.inclusion.items() if p >= SURE > held.inclusion[n])
    before, after = found.inclusion[UNKNOWN], held.inclusion[UNKNOWN]
    outside = {name: p * after / before if before else p for name, p in found.outside.items()}
    return replace(held, outside=outside, withheld=tuple(withheld))


def _prior(names: Names, each: float) -> float:
    """log prior of something unknown beside these."""
    return float(np.log(PRIOR_UNKNOWN)) + (0.0 if names == (NONE,) else each * len(names))
