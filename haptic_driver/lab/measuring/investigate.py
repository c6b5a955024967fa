"""An investigation: measure, diagnose, choose the most informative setting, and measure again,
until an effect is named.

Every round lies in a folder of its own: its plans, data and report. What is there already is not
measured again: an investigation that was interrupted goes on where it stopped.
"""

from __future__ import annotations

import datetime
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from haptic_driver.errors import BadInputError
from haptic_driver.files import write_text, writing
from haptic_driver.lab.measuring.benches import bench_for
from haptic_driver.lab.measuring.data_file import DataFile
from haptic_driver.lab.measuring.plan import Plan, Setting, write_plan
from haptic_driver.lab.measuring.pool import REPEATS, able, choices
from haptic_driver.lab.measuring.run import prepare, run
from haptic_driver.lab.measuring.spectra import mark_spectra
from haptic_driver.rig.config import RigConfig
from haptic_driver.simulation.finger_function import FingerFunction
from model.description import ModelDescription
from model.diagnosis.data import read_measurements, together
from model.diagnosis.priors import LOG_ODDS, SURE, words
from model.diagnosis.workflow import Diagnosis, diagnose
from model.effects.interventions import BY_INTERVENTION, NOTHING
from model.planning.design import Design, design, design_for_unseen
from model.planning.discrimination import Choice
from model.planning.separation import APART
from model.reporting.report import write_report
from model.touch_model import TouchModel

MOST_BLOCKS = 10  # of a later one
# chi^2 of a round, which ends once an effect is named: alternatives deviate more than expected
ENOUGH = 4.0 * APART
AT_ONCE = 2  # of these; then it is looked whether the rest is needed
ALIKE_HERE, SPENT = "cannot_be_told_apart", "budget_spent"
NAMED, NOTHING_SEEN, NOTHING_MISSING = "effect_found", "no_discrepancy", "nothing_missing"
UNTRIED = "untried"  # of a verdict that waits for what other effects need
OUTCOMES = {NAMED: "named", "unexplained": "unexplained"}


@dataclass(frozen=True)
class Budget:
    """At most so many rounds, and minutes of measuring."""

    rounds: int = 4
    minutes: float = 60.0


@dataclass(frozen=True)
class Subject:
    """What is investigated: a rig with a finger on it, and the model that it is compared with.

    `plan` is measured first. `finger` is a simulated one's function. `ask` shows a person at a real
    rig what to do, and returns whether it was done.
    """

    config: RigConfig
    description: ModelDescription
    plan: Plan
    finger: FingerFunction | None = None
    seed: int = 0
    ask: Callable[[str], bool] = lambda todo: False


@dataclass
class Investigation:
    """What has been found so far; `outcome` is empty while it goes on."""

    outcome: str = ""
    rounds: int = 0
    rows: int = 0
    measured_s: float = 0.0
    settings: list[Setting] = field(default_factory=list)
    history: list[dict[str, Any]] = field(default_factory=list)
    diagnosis: dict[str, Any] = field(default_factory=dict)

    def payload(self) -> dict[str, Any]:
        """As JSON holds it."""
        return {
            "outcome": self.outcome,
            "rounds": self.rounds,
            "rows": self.rows,
            "settings": [setting._asdict() for setting in self.settings],
            "minutes": self.measured_s / 60.0,
            "threshold": SURE,
            "history": self.history,
            "diagnosis": self.diagnosis,
        }


def investigate(
    subject: Subject, out: Path, budget: Budget, tell: Callable[[str], None] = lambda what: None
) -> Investigation:
    """Rounds until there is an outcome; `investigation.json` and a folder per round are in `out`.

    Raises HapticError for a rig that fails, with everything measured so far on the disk.
    BadInputError: the first plan wants something done that nobody did.
    """
    model, found = TouchModel(subject.description), Investigation()
    doable = list(able(subject.finger is not None))
    plans, files, asked = [subject.plan], list[Path](), ""
    while not found.outcome:
        found.rounds += 1
        folder, number = out / f"round-{found.rounds}", 0
        while plans:
            plan, *plans = plans
            if not _is_done(subject, plan):
                if not files:
                    raise _nothing_begun(plan)
                doable.remove(plan.intervention)
                continue
            tell(f"round {found.rounds}: measuring")
            files.append(_measure(subject, model, plan, folder, found, number))
            diagnosis = diagnose(
                subject.description,
                together([(str(path), read_measurements(path)) for path in files]),
                subject.seed,
                lambda step: tell(f"round {found.rounds}: {step}"),
            )
            number, answer = number + 1, _answer(diagnosis)
            if _is_answered(asked, answer):
                plans = (
                    []
                    if answer in OUTCOMES
                    else _next(subject, model, diagnosis, found, doable, budget)
                )
                asked = answer
        with writing(folder):
            found.diagnosis = write_report(
                diagnosis, subject.description, folder, f"{len(files)} files of {out.name}"
            )
        asked = answer
        found.outcome = found.outcome or OUTCOMES.get(answer, "")
        plans = [] if found.outcome else _next(subject, model, diagnosis, found, doable, budget)
        if not found.outcome and found.rounds >= budget.rounds:
            found.outcome = _at_the_end(diagnosis)
        write_text(out / "investigation.json", json.dumps(found.payload(), indent=1) + "\n")
    return found


def _nothing_begun(plan: Plan) -> BadInputError:
    said = f"plan {plan.name}: not begun, since nobody did this: {_todo(plan)}"
    return BadInputError("not_done", said, "Do it and answer y, or begin with another --plan")


def _todo(plan: Plan) -> str:
    return BY_INTERVENTION[plan.intervention].todo


def _answer(diagnosis: Diagnosis) -> str:
    """The verdict, or that it is too early for one: what other effects need has not been varied
    yet.
    """
    return UNTRIED if _untested(diagnosis) and diagnosis.name in OUTCOMES else diagnosis.name


def _at_the_end(diagnosis: Diagnosis) -> str:
    """The outcome where nothing more is measured."""
    return (
        NOTHING_MISSING if diagnosis.name == NOTHING_SEEN else OUTCOMES.get(diagnosis.name, SPENT)
    )


def _untested(diagnosis: Diagnosis) -> list[str]:
    return list(diagnosis.findings.hypotheses.untestable) if diagnosis.findings else []


def _is_answered(asked: str, now: str) -> bool:
    """Whether a round has its answer: a name is earned, or there is more to see than where it
    began.

    What shows is then separated in the same round.
    """
    return now == NAMED or (asked in (NOTHING_SEEN, UNTRIED) and now != asked)


def _is_done(subject: Subject, plan: Plan) -> bool:
    """Whether the rig is as the plan wants it: simulated ones do by themselves what a person is
    asked for.
    """
    if plan.intervention == NOTHING or subject.config.simulated:
        return True
    return subject.ask(_todo(plan))


def _measure(
    subject: Subject, model: TouchModel, plan: Plan, folder: Path, found: Investigation, number: int
) -> Path:
    """Measure what of a plan is not there yet; the data file."""
    suffix = f"-{number + 1}" if number else ""
    path = folder / f"data{suffix}.csv"
    experiment = prepare(
        subject.config, model, plan, 1000 * (100 * subject.seed + found.rounds) + number
    )
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    write_plan(folder / f"plan{suffix}.toml", plan)
    hidden = subject.finger.source if subject.finger else ""
    with DataFile.resume(path, experiment.identity(hidden), experiment.rows) as data:
        if data.done < len(experiment.rows):
            bench = bench_for(experiment, data.done, subject.finger, lambda what: None)
            with bench:
                run(experiment, bench, data)
    mark_spectra(path, datetime.date.today())
    found.rows += len(experiment.rows)
    found.measured_s += experiment.duration_s
    found.settings = list(
        dict.fromkeys([*found.settings, *(row.setting for row in experiment.rows)])
    )
    return path


def _next(
    subject: Subject,
    model: TouchModel,
    diagnosis: Diagnosis,
    found: Investigation,
    doable: Sequence[str],
    budget: Budget,
) -> list[Plan]:
    """What to measure next, most telling first; nothing, and the outcome, where there is no point
    in any.
    """
    procedure = subject.plan.model_copy(update={"repeats": REPEATS, "sessions": 1})
    left_s = 60.0 * budget.minutes - found.measured_s
    answer = _answer(diagnosis)
    unseen = answer in (NOTHING_SEEN, UNTRIED)
    possible = choices(subject.config, model, procedure, doable, found.settings if unseen else ())
    if unseen:  # so far: there may be more to see than where it was looked
        only = _untested(diagnosis) if answer == UNTRIED else None
        chosen = design_for_unseen(diagnosis, possible.pool, MOST_BLOCKS, left_s, only)
    else:
        chosen = design(diagnosis, possible.pool, MOST_BLOCKS, left_s, _stubborn(found), ENOUGH)
    found.history.append(_told(found, diagnosis, chosen, possible.blocks))
    is_sure = _is_sure_of_some(diagnosis)
    alike = [name for names in _group(diagnosis).values() for name in names] if is_sure else []
    if alike and not any(
        _can_be_told(diagnosis, name, chosen.reach[name]) for name in alike if name in chosen.reach
    ):
        found.outcome = ALIKE_HERE
    elif not chosen.choices:
        found.outcome = (
            ALIKE_HERE
            if is_sure and left_s >= possible.pool.cost_s.min()
            else _at_the_end(diagnosis)
        )
    if found.outcome:
        return []
    return [
        procedure.model_copy(
            update={
                "name": f"round {found.rounds + 1}",
                "intervention": settings[0].intervention,
                "settings": settings,
                "about": f"tells {' from '.join(words(name) for name in separates)}",
            }
        )
        for separates, settings in _parts(chosen, possible.blocks)
    ]


def _parts(
    chosen: Design, blocks: Sequence[tuple[Setting, ...]]
) -> list[tuple[tuple[str, str], tuple[Setting, ...]]]:
    """The settings of a round in the order of their worth, and what they tell: a few, or all after
    an intervention.
    """
    parts: dict[tuple[str, int], list[Choice]] = {}
    for choice in chosen.choices:
        done = blocks[choice.block][0].intervention
        alike = sum(len(part) for (of, _), part in parts.items() if of == done)
        parts.setdefault((done, alike // AT_ONCE if done == NOTHING else 0), []).append(choice)
    return [
        (
            part[0].separates,
            tuple(dict.fromkeys(s for choice in part for s in blocks[choice.block])),
        )
        for part in parts.values()
    ]


def _can_be_told(diagnosis: Diagnosis, alternative: str, reach: float) -> bool:
    """Whether an alternative may be separated from the leading effect: the remaining measurements
    separate it, or its evidence is far behind.

    `reach`: the chi^2 that everything left would add; half of it in evidence.
    """
    assert diagnosis.findings is not None
    leader, found = diagnosis.findings.verdict.chosen, diagnosis.findings.hypotheses
    behind = leader.alone.log_evidence - found.of((alternative,)).alone.log_evidence
    return (behind if len(leader.kinds) == 1 else 0.0) + 0.5 * reach >= LOG_ODDS


def _is_sure_of_some(diagnosis: Diagnosis) -> bool:
    return diagnosis.findings is not None and diagnosis.findings.verdict.is_sure_of_some


def _group(diagnosis: Diagnosis) -> dict[str, list[str]]:
    return diagnosis.findings.verdict.group if diagnosis.findings else {}


def _stubborn(found: Investigation) -> set[frozenset[str]]:
    """Pairs that an earlier round was to tell apart, and which are open still; what was only looked
    for is none.
    """
    rounds = [told["proposals"] for told in found.history if told["verdict"] == "ambiguous"]
    return {frozenset(proposal["separates"]) for proposals in rounds for proposal in proposals}


def _told(
    found: Investigation,
    diagnosis: Diagnosis,
    chosen: Design,
    blocks: Sequence[tuple[Setting, ...]],
) -> dict[str, Any]:
    """One round in words and numbers: its verdict, what is proposed, and what even everything could
    tell.
    """
    return {
        "round": found.rounds,
        "verdict": diagnosis.name,
        "suspects": diagnosis.findings.verdict.suspects if diagnosis.findings else [],
        "proposals": [
            {
                "settings": len(blocks[choice.block]),
                "setting": blocks[choice.block][-1]._asdict(),
                "separates": choice.separates,
                "gain": choice.gain,
            }
            for choice in chosen.choices
        ],
        "reach": chosen.reach,
    }
