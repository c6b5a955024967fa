"""The diagnosis, stage by stage: audit, fit, evidence, posterior, proof, decision.

Each stage takes the record of the one before. Where no effect of the catalogue explains the data, a
term is learned instead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

from model.description import ModelDescription
from model.diagnosis.audit import Audit, audited
from model.diagnosis.changed import changed
from model.diagnosis.data import Measurements
from model.diagnosis.decide import WITHOUT_NAME, Verdict, verdict_of
from model.diagnosis.ends import at_an_end
from model.diagnosis.forms import share_odds
from model.diagnosis.hidden import unseen
from model.diagnosis.hypotheses import (
    FORCE_SENSOR,
    SECOND_TOUCH,
    Candidate,
    Hypotheses,
    fit_pairs,
    force_sensor,
    second_touch,
)
from model.diagnosis.learned import LearnedTerm, learn
from model.diagnosis.model_fit import Problem
from model.diagnosis.noise import Noise
from model.diagnosis.posterior import Posterior, held_against, posterior
from model.diagnosis.proof import Proof, prove
from model.diagnosis.setting import Setting, fitted, nuisance_warnings, otherwise_read
from model.diagnosis.where import Disagreement, disagreement
from model.support.arrays import Array

LEADERS = 4  # models that take part in the held-out proof, at the least
Progress = Callable[[str], None]


@dataclass(frozen=True)
class Findings:
    """What was fitted and what it says.

    `before` scans the base model's residuals, `after` those of the chosen one. `learned`: the
    empirical term that stands in where the verdict is `unexplained`, if there is any. `changed`
    [n]: probability that an observation is friction that is changed by more than its noise.
    """

    problem: Problem
    hypotheses: Hypotheses
    verdict: Verdict
    before: Disagreement
    after: Disagreement
    proof: Proof
    changed: Array
    learned: LearnedTerm | None = None

    @property
    def chosen(self) -> Candidate:
        """The model that the data ask for; with the learned term if held-out data prove it."""
        if self.learned is not None and self.learned.is_proved:
            return self.learned.candidate
        return self.verdict.chosen

    @property
    def adds_effects(self) -> bool:
        """Whether the corrected model carries what `chosen` has, named or learned."""
        return self.verdict.is_named or self.chosen is not self.verdict.chosen


@dataclass(frozen=True)
class Diagnosis:
    """Everything that one run found; without `findings` nothing could be tested, see `warnings`."""

    data: Measurements
    noise: Noise | None
    findings: Findings | None
    warnings: tuple[str, ...]
    seed: int

    @property
    def name(self) -> str:
        return "not_testable" if self.findings is None else self.findings.verdict.verdict


def diagnose(
    description: ModelDescription,
    data: Measurements,
    seed: int = 0,
    progress: Progress = lambda _: None,
) -> Diagnosis:
    """Run the whole workflow on one data set."""
    audit = audited(description, data)
    if audit.noise is None or audit.blocked:
        return Diagnosis(data, audit.noise, None, (audit.blocked, *audit.warnings), seed)
    setting = fitted(description, audit, progress)
    hypotheses = weighed(description, setting, audit, progress)
    judged = held_out_verdict(description, setting, hypotheses, seed, progress)
    findings = explored(description, setting, hypotheses, judged, seed, progress)
    far_off = nuisance_warnings(setting.problem.predictor.free, findings.chosen)
    ends = at_an_end(description, setting.problem.predictor.free, findings.chosen.fit)
    warnings = (*audit.warnings, *setting.warnings, *far_off, *ends.values())
    return Diagnosis(setting.data, setting.problem.noise, findings, warnings, seed)


def weighed(
    description: ModelDescription, setting: Setting, audit: Audit, progress: Progress
) -> Hypotheses:
    """Evidence of every hypothesis."""
    problem, base = setting.problem, setting.base
    progress("other readings of the table")
    besides = {FORCE_SENSOR: force_sensor(problem, base), SECOND_TOUCH: second_touch(problem, base)}
    return Hypotheses(
        base=base,
        singles=setting.singles,
        pairs=fit_pairs(problem, setting.singles, progress),
        untestable=audit.untestable,
        hidden={kind.name: unseen(problem, base.fit, kind) for kind in audit.kinds},
        outside=besides | otherwise_read(description, setting),
    )


class Judged(NamedTuple):
    """A verdict, and what sessions that no fit has seen say of it."""

    verdict: Verdict
    proof: Proof


def held_out_verdict(
    description: ModelDescription,
    setting: Setting,
    hypotheses: Hypotheses,
    seed: int,
    progress: Progress,
) -> Judged:
    """The verdict by all data, compared with data left out of the fit."""
    stated = posterior(hypotheses.evidences)
    first = verdict_of(hypotheses, stated)
    data, noise, chosen = setting.data, setting.problem.noise, first.chosen
    scale = chosen.beside_discrepancy.scale
    proof = prove(
        description, data, noise, chosen, leading(hypotheses, stated), scale, seed, progress
    )
    odds = {names: share_odds(shares) for names, shares in proof.shares.items()}
    return Judged(verdict_of(hypotheses, held_against(stated, odds)), proof)


def leading(hypotheses: Hypotheses, stated: Posterior) -> list[Candidate]:
    """All models with effects that may be the case, LEADERS or more, and each effect of them
    alone.
    """
    no_model = {*WITHOUT_NAME, *stated.untestable}
    models = [names for names in stated.hypotheses if not no_model & set(names)]
    most = models[: max(LEADERS, len(stated.credible()))]
    alone = [(name,) for names in most for name in names]
    return [hypotheses.of(names) for names in dict.fromkeys([*most, *alone])]


def explored(
    description: ModelDescription,
    setting: Setting,
    hypotheses: Hypotheses,
    judged: Judged,
    seed: int,
    progress: Progress,
) -> Findings:
    """Where the residuals disagree, and the learned term where nothing explains them."""
    data, problem, (verdict, proof) = setting.data, setting.problem, judged

    def scan(found: Candidate) -> Disagreement:
        return disagreement(data, problem.noise, found.around, found.bent, seed)

    before = scan(setting.base)
    rows = changed(problem, hypotheses, verdict.posterior)
    findings = Findings(problem, hypotheses, verdict, before, scan(verdict.chosen), proof, rows)
    if verdict.verdict != "unexplained" or verdict.posterior.looks_like:
        return findings
    learned = learn(description, data, problem, setting.base, seed, progress)
    findings = replace(findings, learned=learned)
    if learned is None or not learned.is_proved:
        return findings
    rows = changed(problem, hypotheses, verdict.posterior, findings.chosen)
    after = scan(findings.chosen)
    return replace(findings, after=after, proof=learned.proof, changed=rows)
