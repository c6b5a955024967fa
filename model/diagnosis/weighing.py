"""What the evidences of one data set say: which model fits, of which form, and how probable each name is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import logsumexp

from model.diagnosis.fit import Problem
from model.diagnosis.naming import (
    NONE,
    PRIOR_EFFECTS,
    PRIOR_NONE,
    PRIOR_UNKNOWN,
    SURE,
    UNKNOWN,
    Candidate,
    near_nats,
    separation,
)

DISCREPANCY_WINS = 10.0  # Bayes factor from which one stands beside an effect
LACK_OF_FIT = 5e-4  # pilot sets: clear effects of another form reach 0.001, strangers that only this test sees none
MIMICS = PRIOR_UNKNOWN / PRIOR_EFFECTS  # of an effect's prior: something unknown that looks like it, but for its form
PARTICULAR = 0.25  # of a nat, what each nat beyond a discrepancy of any shape says against a look-alike; pilot sets
LIST_TELLS = 1.0 / 3.0  # of what data say of the first of a list against the rest; pilot sets, see docs/diagnosis.md
HELD = 0.5  # of a nat, what each nat against a form far off says against a discrepancy of any shape; pilot sets
BENT = 2.0  # times what effects say beyond a discrepancy of any shape: where a form that is off adds more,
TIGHT = 16.0  # nats against a form far off make a name; pilot sets
MENDED = 3.0  # times what a discrepancy beside an effect adds, the effect's own form says beyond any; pilot sets


@dataclass(frozen=True)
class Weighed:
    """All single-effect models of one data set beside the base model.

    `unseen`: log evidence of each effect where it is too weak to leave a trace; `force_sensor`: of one that reads the
    load.
    """

    base: Candidate
    singles: list[Candidate]
    untestable: list[str]
    unseen: dict[str, float] = field(default_factory=dict)
    force_sensor: float = -np.inf

    @property
    def winner(self) -> Candidate:
        """The effect with the most evidence."""
        return max(self.singles, key=lambda c: c.alone.log_evidence)

    @property
    def probabilities(self) -> dict[str, float]:
        """Posterior of none, unknown and every effect of the catalogue, summing to 1, the largest first.

        An effect too weak to leave a trace counts as none.
        Unknown is a discrepancy of any shape: beside the base model; beside the winner, where it wins there and the
        winner is not the effect itself in another form; one that looks like an effect of a form far off, which is
        the less likely the more the effect says in particular; and a force sensor that reads the load, as likely as any
        effect.
        """
        each = np.log(PRIOR_EFFECTS / (len(self.singles) + len(self.untestable)))
        base, winner = self.base, self.winner
        logs = {c.name: float(each + self._seen(c)) for c in self.singles}
        unknown = [np.log(PRIOR_UNKNOWN) + base.beside_discrepancy.log_evidence - HELD * tightness(winner)]
        unknown += [np.log(MIMICS) + each + mimic(c, base) for c in self.singles]
        unknown.append(each + self.force_sensor)
        more = np.log(PRIOR_UNKNOWN) + each + winner.beside_discrepancy.log_evidence
        if of_another_form(winner, base):
            logs[winner.name] = float(np.logaddexp(logs[winner.name], more))
        elif beside_wins(winner):
            unknown.append(more)
        none = [np.log(PRIOR_NONE) + base.alone.log_evidence, *(each + value for value in self.unseen.values())]
        logs |= {NONE: float(logsumexp(none)), UNKNOWN: float(logsumexp(unknown))}
        return posterior(logs | {name: float(each + base.alone.log_evidence) for name in self.untestable})

    @property
    def is_like_force_sensor(self) -> bool:
        """Whether a force sensor that reads the load explains more than any effect, or discrepancy of any shape."""
        others = self.winner.alone.log_evidence, self.base.beside_discrepancy.log_evidence
        return self.force_sensor > max(others)

    def _seen(self, candidate: Candidate) -> float:
        """log evidence of an effect where it leaves a trace."""
        share = 1.0 - np.exp(min(self.unseen.get(candidate.name, -np.inf) - candidate.alone.log_evidence, 0.0))
        return float(candidate.alone.log_evidence + np.log(max(share, 1e-300)))


def posterior(logs: dict[str, float]) -> dict[str, float]:
    """Probabilities from their unnormalised logarithms."""
    total = logsumexp(list(logs.values()))
    return ranked({name: float(np.exp(value - total)) for name, value in logs.items()})


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
    mended = candidate.beside_discrepancy.log_evidence - candidate.alone.log_evidence
    return beside_wins(candidate) and _own(candidate, base) > MENDED * mended


def is_mostly_bent(candidate: Candidate, base: Candidate) -> bool:
    """Whether effects explain most by a form that is off, and may be far off: much else that is smooth could."""
    bent = candidate.alone.log_evidence - candidate.alone.exact
    return bent > BENT * _own(candidate, base) and tightness(candidate) < TIGHT


def _own(candidate: Candidate, base: Candidate) -> float:
    """What effects say by their own form, in nats, beyond a discrepancy of any shape."""
    return candidate.alone.log_evidence - base.beside_discrepancy.log_evidence


def mimic(candidate: Candidate, base: Candidate) -> float:
    """log evidence of something unknown that looks like a model's effects, but for a form far off.

    What a discrepancy of any shape explains nearly as well could be anything; what it does not is the effects' own.
    """
    rough = candidate.alone.rough
    return float(rough - PARTICULAR * max(rough - base.beside_discrepancy.log_evidence, 0.0))


def of_its_form(candidate: Candidate, base: Candidate) -> bool:
    """Whether effects explain the data by their own form, rather than something unknown that looks like one of them."""
    odds = candidate.alone.log_evidence - mimic(candidate, base) - np.log(MIMICS * len(candidate.kinds))
    return bool(odds >= np.log(SURE / (1.0 - SURE)))


def confusion(problem: Problem, winner: Candidate, rivals: list[Candidate]) -> dict[str, float]:
    """min(lambda_ij, lambda_ji) of the winner with each rival that comes near it in evidence."""
    last = winner.alone.log_evidence - near_nats(problem.predictor.data)
    near = [c for c in rivals if c is not winner and c.alone.log_evidence > last]
    return {c.name: separation(problem, winner, c) for c in near}


def among_alike(probabilities: dict[str, float], first: str, rivals: Sequence[str]) -> dict[str, float]:
    """The same, where `first` leads a list: forms that nobody knows say much of what tells it from its rivals.

    What the list has together stays.
    """
    listed = probabilities[first] + sum(probabilities[name] for name in rivals)
    others = listed - probabilities[first]
    if not 0.0 < others < probabilities[first]:
        return probabilities
    share = listed / (1.0 + (others / probabilities[first]) ** LIST_TELLS)
    told = {name: probabilities[name] * (listed - share) / others for name in rivals}
    return ranked(probabilities | told | {first: share})


def ranked(probabilities: dict[str, float]) -> dict[str, float]:
    """The same summing to 1, the largest first."""
    total = sum(probabilities.values())
    ordered = sorted(probabilities.items(), key=lambda item: -item[1])
    return {name: value / total for name, value in ordered}
