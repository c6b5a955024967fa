"""From evidences to one verdict, with the readiness to say that no name is earned."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from model.diagnosis.data import Measurements
from model.diagnosis.fit import Problem
from model.diagnosis.naming import NONE, PRIOR_NONE, PRIOR_UNKNOWN, UNKNOWN, Candidate, fit_candidates, separation
from model.diagnosis.rival import discrepancy_mean
from model.diagnosis.where import Disagreement
from model.support.arrays import Array

SURE = 0.95
NOTHING = 0.90
APART = 25.0  # lambda_ij from which two effects count as told apart
ALIKE = 9.0  # and below which they are one group
DISCREPANCY_WINS = 3.0  # Bayes factor of effect + discrepancy against the effect alone
LACK_OF_FIT = 5e-4  # pilot sets: clear effects of another form reach 0.001, strangers that only this test sees none
NEAR_NATS = 12.0  # rivals farther behind in evidence are refuted by these very data
NAME_REMAINDER = 0.18  # of the effect's own signature: what may be left beside a name,
LIST_REMAINDER = 0.37  # and beside a list; pilot sets: strangers that effects half explain leave 0.2 and 0.38 up
# No finger or device has quite the catalogue's form, so evidence between effects counts little more than half, and less
# the more there is of it: a form that is a tenth off spoils a hundredth of the gain. Something unknown that looks the
# same keeps a share of what effects explain, a larger one where more may remain. Pilot sets: so weighed, stated
# probabilities are kept to within chance; unweighed, names that were given 0.99 were right in 85 %.
FORM_TRUST = 0.6
FORM_ERROR = 0.02
MIMICS = 0.03
MIMICS_OF_ROUGH = 0.25
PAIR_GAIN_NATS = 3.0
PAIR_CERTAIN = 0.98
LEADERS = 6
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


@dataclass(frozen=True)
class Weighed:
    """All single-effect models of one data set beside the base model."""

    base: Candidate
    singles: list[Candidate]
    untestable: list[str]

    @property
    def winner(self) -> Candidate:
        """The effect with the most evidence."""
        return max(self.singles, key=lambda c: c.alone.log_evidence)

    @property
    def trust(self) -> float:
        """What a nat of evidence between two effects counts."""
        gain = max(self.winner.alone.log_evidence - self.base.alone.log_evidence, 0.0)
        return FORM_TRUST / (1.0 + FORM_ERROR * gain)

    @property
    def apart(self) -> float:
        """lambda_ij that on average makes the better of two effects as probable as a name must be; at least APART."""
        return max(APART, 2.0 * float(np.log(SURE / (1.0 - SURE))) / self.trust)

    def probabilities(self, remainder: float) -> dict[str, float]:
        """Posterior of none, unknown and every effect of the catalogue, summing to 1, the largest first.

        `remainder`: size of what may remain beside the winner, as a share of what it explains. A large one makes the
        winner with a discrepancy beside it one more form of the unknown.
        """
        each = np.log((1.0 - PRIOR_NONE - PRIOR_UNKNOWN) / (len(self.singles) + len(self.untestable)))
        base, winner = self.base, self.winner
        evidences = np.array([c.alone.log_evidence for c in self.singles])
        together = each + logsumexp(evidences)
        shares = self.trust * evidences
        shares -= logsumexp(shares)
        mimics = np.log(MIMICS if remainder <= NAME_REMAINDER else MIMICS_OF_ROUGH)
        if remainder > LIST_REMAINDER:
            mimics += max(winner.beside_discrepancy.log_evidence - winner.alone.log_evidence, 0.0)
        unknown = np.log(PRIOR_UNKNOWN) + base.beside_discrepancy.log_evidence
        logs = {
            NONE: np.log(PRIOR_NONE) + base.alone.log_evidence,
            UNKNOWN: float(np.logaddexp(unknown, mimics + together)),
        }
        logs |= {c.name: float(together + share) for c, share in zip(self.singles, shares, strict=True)}
        logs |= {name: float(each + base.alone.log_evidence) for name in self.untestable}
        return _normalised(logs)


def _normalised(logs: dict[str, float]) -> dict[str, float]:
    total = logsumexp(list(logs.values()))
    return _shares({name: float(np.exp(value - total)) for name, value in logs.items()})


def adequate(candidate: Candidate, lack_of_fit_p: float) -> bool:
    """Whether nothing of unknown shape needs to stand beside the model."""
    factor = candidate.beside_discrepancy.log_evidence - candidate.alone.log_evidence
    return factor <= np.log(DISCREPANCY_WINS) and lack_of_fit_p >= LACK_OF_FIT


def confusion(problem: Problem, winner: Candidate, rivals: list[Candidate]) -> dict[str, float]:
    """min(lambda_ij, lambda_ji) of the winner with each rival that comes near it in evidence."""
    best = winner.alone.log_evidence
    near = [c for c in rivals if c is not winner and best - c.alone.log_evidence < NEAR_NATS]
    return {c.name: separation(problem, winner, c) for c in near}


def decide(
    data: Measurements,
    problem: Problem,
    discrepancy: list[Array],
    weighed: Weighed,
    base_scan: Disagreement,
    scan: Callable[[Candidate], Disagreement],
    progress: Callable[[str], None],
) -> Verdict:
    """Weigh what was fitted; fits second effects where one is not enough."""
    winner, base = weighed.winner, weighed.base
    remainder = _remainder(discrepancy, winner, base)
    probabilities = weighed.probabilities(remainder)
    if probabilities[NONE] >= NOTHING and not base_scan.alarm and adequate(base, base_scan.lack_of_fit_p):
        return Verdict("no_discrepancy", True, base, probabilities, {}, ("no effect is worth its parameters",))

    alike = confusion(problem, winner, weighed.singles)
    group = [name for name, value in alike.items() if value < APART]
    if adequate(winner, scan(winner).lack_of_fit_p):
        return _name_one(weighed, winner, group, probabilities, remainder)

    pair = _best_pair(problem, discrepancy, weighed, winner, progress)
    needed = _needed_beside_discrepancy(weighed, group)
    pair_fits = pair is not None and adequate(pair, scan(pair).lack_of_fit_p)
    pair_gain = (
        -np.inf if pair is None else pair.alone.log_evidence + np.log(0.05) - winner.beside_discrepancy.log_evidence
    )
    if pair is not None and pair_fits and pair_gain > PAIR_GAIN_NATS:
        return _name_pair(pair, probabilities, _remainder(discrepancy, pair, base))
    if winner.name in needed and remainder <= LIST_REMAINDER and probabilities[UNKNOWN] < 0.5:
        why = f"needed even beside a discrepancy of unknown shape; what remains is {remainder:.0%} of its signature"
        group += [name for name in needed if name not in (winner.name, *group)]
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


def _name_one(
    weighed: Weighed, winner: Candidate, group: list[str], probabilities: dict[str, float], remainder: float
) -> Verdict:
    effects = {name: value for name, value in probabilities.items() if name not in (NONE, UNKNOWN)}
    certain = sum(effects.values()) >= SURE
    if not certain and probabilities[UNKNOWN] >= 0.5:
        reason = "a discrepancy of unknown shape is the most probable"
        return Verdict("unexplained", False, weighed.base, probabilities, {}, (reason,))
    if not certain and probabilities[NONE] >= 0.5:
        reason = "nothing is certain; none is the most probable"
        return Verdict("no_discrepancy", True, weighed.base, probabilities, {}, (reason,))
    members = dict.fromkeys([winner.name, *group, *_credible(_shares(effects))])
    rivals = [name for name in members if name != winner.name]
    reason = "these data cannot tell the group's members apart" if certain else "no candidate is certain; ranked"
    if not rivals and _unusual(winner):
        reason = f"{winner.name} would have to be stronger than 99 % of what is expected of it"
    elif not rivals and remainder > NAME_REMAINDER:
        reason = f"what {winner.name} may leave is {remainder:.0%} of its signature"
    elif not rivals and probabilities[winner.name] >= SURE:
        reason = "probability and separation are high"
        return Verdict("effect_found", True, winner, probabilities, {winner.name: []}, (reason,))
    return Verdict("ambiguous", True, winner, probabilities, {winner.name: rivals}, (reason,))


def _shares(probabilities: dict[str, float]) -> dict[str, float]:
    """The same summing to 1, the largest first."""
    total = sum(probabilities.values())
    ordered = sorted(probabilities.items(), key=lambda item: -item[1])
    return {name: value / total for name, value in ordered}


def _unusual(winner: Candidate) -> bool:
    """Whether some parameter of the effect lies outside the central 99 % of its prior."""
    count = sum(len(kind.parameters()) for kind in winner.kinds)
    return bool(np.any(np.abs(winner.fit.vector[-count:]) > USUAL))


def _best_pair(
    problem: Problem, discrepancy: list[Array], weighed: Weighed, winner: Candidate, progress: Callable[[str], None]
) -> Candidate | None:
    """The best second effect beside the winner, if it stands out among all second effects."""
    leaders = sorted(weighed.singles, key=lambda c: -c.alone.log_evidence)
    kinds = [(winner.kinds[0], c.kinds[0]) for c in leaders if c is not winner]
    fits = []
    for pair in kinds:
        progress("+".join(k.name for k in pair))
        fits.append(fit_candidates(problem, discrepancy, winner.fit, [pair], lambda _: None)[0])
    if not fits:
        return None
    best = max(fits, key=lambda c: c.alone.log_evidence)
    others = logsumexp([c.alone.log_evidence for c in fits])
    return best if np.exp(best.alone.log_evidence - others) >= SURE else None


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
    effects = [name for name in probabilities if name not in (NONE, UNKNOWN)]
    shares = np.cumsum([probabilities[name] for name in effects])
    enough = np.flatnonzero(shares >= SURE)
    return effects[: enough[0] + 1] if enough.size else []


def _remainder(discrepancy: list[Array], winner: Candidate, base: Candidate) -> float:
    """Size of what only the discrepancy beside the winner explains, as a share of what the winner does.

    Both whitened; directions in which the winner's own parameters move the prediction do not count.
    """
    left = discrepancy_mean(winner.fit, winner.beside_discrepancy, discrepancy)
    own, _ = np.linalg.qr(winner.fit.jacobian)
    left = left - own @ (own.T @ left)
    explained = max(base.fit.chi2 - winner.fit.chi2, 1e-9)
    return float(np.sqrt(left @ left / explained))


def _name_pair(pair: Candidate, probabilities: dict[str, float], remainder: float) -> Verdict:
    names = [kind.name for kind in pair.kinds]
    others = {name: value * (1.0 - PAIR_CERTAIN) for name, value in probabilities.items() if name not in names}
    updated = _shares(dict.fromkeys(names, PAIR_CERTAIN / len(names)) | others)
    verdict, reason = "ambiguous", f"two effects fit, which may leave {remainder:.0%} of their signature"
    if _unusual(pair):
        reason = "two effects fit, one of which would have to be stronger than 99 % of what is expected of it"
    elif remainder <= NAME_REMAINDER:
        verdict, reason = "effect_found", "two effects are needed"
    return Verdict(verdict, True, pair, updated, {name: [] for name in names}, (reason,))
