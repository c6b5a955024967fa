"""Investigations on simulated rigs: what is hidden in the finger gets its name, and what is
proposed is allowed.
"""

from __future__ import annotations

import json
import shutil
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from haptic_driver.lab.measuring import investigate as rounds
from haptic_driver.lab.measuring import pool
from haptic_driver.lab.measuring.benches import carried_out
from haptic_driver.lab.measuring.check import check
from haptic_driver.lab.measuring.investigate import Budget, Investigation, Subject, investigate
from haptic_driver.lab.measuring.plan import Plan, Setting, load_plan
from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import RigConfig, load_rig
from model.diagnosis.decide import Decision, Verdict
from model.diagnosis.posterior import Posterior
from model.effects.interventions import INTERVENTIONS
from model.planning.design import Design
from model.planning.discrimination import Choice
from model.touch_model import TouchModel
from tests.haptic_driver.lab.measuring.test_run import hiding as rig_hiding
from tests.haptic_driver.lab.refusal import refused
from tests.reports import without_pictures

# Two effects that no setting tells apart: sweat in columns is a conducting gap. A share of 1e-3
# that conducts 1e-4 S/m is so unusual, 4 standard deviations of its prior, that the gap is named
# alone, with 15 nats between them; 1e-2 that conducts 1.6e-4 S/m with 8.
SWEAT = {"sweat_film": {"share": 1e-2, "sweat_conductivity_s_per_m": 6e-4, "arrangement": 0.9}}
HUMID = {"humid_gap_conduction": {"gap_conductivity_s_per_m": 8e-9}}
PLAN = """
name = "short"
voltage_off_every = 4
settle_s = 0.2
average_s = 0.25
pause_s = 0.0
[[points]]
frequency_hz = [20.0, 100.0, 250.0]
voltage_v = [75.0, 110.0]
normal_force_n = [0.25, 1.0]
speed_m_s = 0.02
[[sweep]]
frequency_hz = { low = 10.0, high = 1e5, per_decade = 2 }
normal_force_n = 0.5
finger = ["none", "resting", "sliding"]
"""


def hiding(effects: dict[str, dict[str, float]]) -> RigConfig:
    return rig_hiding(load_rig("simulated"), effects)


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "short.toml"
    path.write_text(PLAN)
    return load_plan(str(path))


@pytest.fixture(scope="module")
def found(short, tmp_path_factory):
    out = tmp_path_factory.mktemp("investigation")
    subject = Subject(hiding(SWEAT), load_model("reference"), short)
    with without_pictures():
        return investigate(subject, out, Budget(rounds=3)), out


@pytest.mark.timeout(600)
@pytest.mark.soak
def test_what_settings_cannot_tell_apart_an_intervention_does(found):
    """Once every round chose settings of which the same was expected again, and the budget was
    spent on them.
    """
    investigation, _ = found
    assert investigation.outcome == "named"
    (effect,) = investigation.diagnosis["effects"]
    assert effect["name"] == "sweat_film"
    alike = {"humid_gap_conduction", "sweat_film"}  # columns of sweat conduct as humid air does
    assert alike in [set(told["suspects"][:2]) for told in investigation.history]
    done = {setting.intervention for setting in investigation.settings}
    assert done & {"wipe", "dry_air"}


@pytest.mark.timeout(600)
@pytest.mark.soak
def test_a_plan_that_sees_nothing_is_not_the_end(tmp_path):
    """At one speed nothing shows that friction depends on speed; it was called nothing missing."""
    settings = product((20.0, 100.0, 250.0), (0.0, 75.0, 110.0), (0.25, 1.0), (0.02,))
    plan = Plan(name="one speed", settings=tuple(Setting(*each) for each in settings), repeats=2)
    with without_pictures():
        subject = Subject(
            hiding({"velocity_dependent_friction": {"exponent": 0.1}}),
            load_model("reference"),
            plan,
        )
        found = investigate(subject, tmp_path, Budget(rounds=2))
    assert found.history[0]["verdict"] == "no_discrepancy"
    assert [effect["name"] for effect in found.diagnosis["effects"]] == [
        "velocity_dependent_friction"
    ]


def test_a_first_plan_that_nobody_prepares_is_refused_before_anything_is_measured(tmp_path):
    """Once it was an UnboundLocalError: there was no diagnosis to report."""
    setting = Setting(100.0, 75.0, 0.5, 0.02, intervention="wipe")
    plan = Plan(name="wiped", settings=(setting,), intervention="wipe")
    real = load_rig("simulated").model_copy(update={"simulated": False})
    with refused("not_done"):
        investigate(Subject(real, load_model("reference"), plan), tmp_path, Budget())
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_is_not_measured_again(tmp_path):
    """As if it had been killed in its first round, after so many rows; one frequency tells little
    apart.
    """
    few = Plan(
        name="few",
        settings=tuple(Setting(100.0, 75.0, n, 0.02) for n in (0.25, 0.5, 1.0)),
        repeats=2,
    )
    subject = Subject(hiding(SWEAT), load_model("reference"), few)

    def stop_when_measured(what: str) -> None:
        if not what.endswith("measuring"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        investigate(subject, tmp_path / "first", Budget(rounds=1), stop_when_measured)
    lines = (tmp_path / "first" / "round-1" / "data.csv").read_text().splitlines(keepends=True)
    cells = lines[2].split(",")
    cells[lines[0].split(",").index("cof")] = "0.5"  # measured again it is not
    kept = [*lines[:2], ",".join(cells), lines[3]]
    folder = tmp_path / "again" / "round-1"
    folder.mkdir(parents=True)
    (folder / "data.csv").write_text("".join(kept))
    shutil.copy(tmp_path / "first" / "round-1" / "data.csv.meta.json", folder)
    with without_pictures():
        again = investigate(subject, tmp_path / "again", Budget(rounds=1))
    now = (folder / "data.csv").read_text().splitlines(keepends=True)
    assert now[:4] == kept
    assert again.rows == len(now) - 1 == len(lines) - 1
    assert (folder / "report.html").is_file()
    said = json.loads((tmp_path / "again" / "investigation.json").read_text())
    assert (said["rounds"], said["rows"]) == (1, again.rows)
    assert said["diagnosis"]["verdict"] == again.diagnosis["verdict"]


def test_nothing_is_proposed_that_the_rig_refuses(short):
    config, model = load_rig("simulated"), TouchModel(load_model("reference"))
    possible = pool.choices(config, model, short, pool.able(has_function=False))
    settings = [setting for block in possible.blocks for setting in block]
    points, refusals = check(settings, short, config, model)
    assert refusals == []
    assert max(setting.peak_v for setting in settings) <= config.limits.voltage_v
    assert {setting.intervention for setting in settings} == {
        "none",
        *(known.name for known in INTERVENTIONS),
    }
    assert possible.pool.block.max() == len(possible.blocks) - 1
    assert len(points) == len(set(settings))


def test_a_setting_never_comes_alone(short):
    """Beside the gain of its session one setting tells nothing: none was chosen once they came one
    by one.
    """
    config, model = load_rig("simulated"), TouchModel(load_model("reference"))
    possible = pool.choices(config, model, short, ())
    assert all(len(block) >= 2 for block in possible.blocks)
    known = [setting for block in possible.blocks[:50] for setting in block]
    assert len(pool.choices(config, model, short, (), known).blocks) == len(possible.blocks) - 50


def test_a_round_is_measured_in_parts_of_two_and_whole_after_an_intervention():
    wiped = Setting(20.0, 75.0, 0.5, 0.02, intervention="wipe")
    blocks = [(pool.REFERENCE, Setting(f, 75.0, 0.5, 0.02)) for f in (10.0, 20.0, 30.0)] + [
        (wiped,),
        (wiped._replace(frequency_hz=50.0),),
    ]
    pair = ("a", "b")
    order = [Choice(block, pair, 1.0) for block in (3, 2, 0, 4, 1)]
    parts = rounds._parts(Design(tuple(order), {}), blocks)
    settings = [[s.frequency_hz for s in settings] for _, settings in parts]
    assert settings == [[20.0, 50.0], [0.0, 30.0, 10.0], [0.0, 20.0]]


def test_no_name_is_earned_before_what_other_effects_need_was_varied():
    """At one speed a gap that widens with speed was called air breakdown."""

    def after(name: str, *untestable: str) -> Any:
        return SimpleNamespace(
            name=name, findings=SimpleNamespace(hypotheses=SimpleNamespace(untestable=untestable))
        )

    assert rounds._answer(after("effect_found", "speed_dependent_gap")) == rounds.UNTRIED
    assert rounds._answer(after("unexplained", "speed_dependent_gap")) == rounds.UNTRIED
    assert rounds._answer(after("effect_found")) == "effect_found"
    assert rounds._answer(after("ambiguous", "speed_dependent_gap")) == "ambiguous"


def test_an_intervention_takes_its_effects_away_and_no_others():
    config = hiding(HUMID | {"floating_body": {"body_capacitance_f": 2e-10}})
    assert set(carried_out(config, "dry_air").simulation.hide) == {"floating_body"}
    assert set(carried_out(config, "strap").simulation.hide) == set(HUMID)
    assert carried_out(config, "none") == config


def outcome_of_a_list(
    monkeypatch: pytest.MonkeyPatch,
    none: float = 0.04,
    reach: float = 1.0,
    behind: float = 0.0,
    proposed: bool = False,
    beside: bool = False,
) -> str:
    """Of a list of two, of which the second is `behind` in evidence; one block takes 5 s of the
    hour that is left.

    Of which either may be the one, or the second may be there `beside` the first.
    """
    first: Any = SimpleNamespace(
        name="a", kinds=(SimpleNamespace(name="a"),), alone=SimpleNamespace(log_evidence=0.0)
    )
    second = SimpleNamespace(name="b", alone=SimpleNamespace(log_evidence=-behind))
    effects = {("a",): 0.6 * (1.0 - none), ("b",): 0.4 * (1.0 - none)}
    group: dict[str, list[str]] = {"a": [], "b": []} if beside else {"a": ["b"]}
    posterior = Posterior(effects | {("none",): none, ("unknown",): 0.0}, {}, ())
    verdict = Verdict(
        Decision("ambiguous", tuple(group), group, 1.0 - none, "why"), posterior, first, True
    )
    pool = SimpleNamespace(cost_s=np.array([5.0]))
    made_up: dict[str, Any] = {
        "choices": SimpleNamespace(pool=pool, blocks=()),
        "design": SimpleNamespace(choices=(1,) * proposed, reach={"b": reach}),
        "_told": {},
        "_parts": [],
    }
    for name, answer in made_up.items():
        monkeypatch.setattr(rounds, name, lambda *_, answer=answer: answer)
    subject: Any = SimpleNamespace(
        config=None, plan=SimpleNamespace(model_copy=lambda update: None)
    )
    hypotheses = SimpleNamespace(untestable=(), of=lambda names: {("b",): second}[names])
    findings = SimpleNamespace(verdict=verdict, hypotheses=hypotheses)
    diagnosis: Any = SimpleNamespace(name="ambiguous", findings=findings)
    found, model = Investigation(rounds=1), SimpleNamespace()
    assert rounds._next(subject, model, diagnosis, found, (), Budget()) == []  # type: ignore[arg-type]
    return found.outcome


@pytest.mark.parametrize(
    ("found", "outcome"),
    [
        # eleven effects were said to be all that is left where nothing was hidden
        ({"none": 0.04}, "cannot_be_told_apart"),
        ({"none": 0.06}, "budget_spent"),
        # SURE takes odds of 19, log odds of 2.94: what the data say, and half of the chi^2 to come
        ({"reach": 5.8, "proposed": True}, "cannot_be_told_apart"),
        ({"reach": 5.9, "proposed": True}, ""),
        ({"reach": 2.0, "behind": 1.9, "proposed": True}, "cannot_be_told_apart"),
        ({"reach": 2.0, "behind": 2.0, "proposed": True}, ""),
        # no setting is worth its time; it was called a spent budget, in the first round
        ({"reach": 11.0}, "cannot_be_told_apart"),
        # a second effect has a place of its own, and no rival there
        ({"beside": True}, "cannot_be_told_apart"),
    ],
)
def test_effects_are_alike_where_nothing_that_is_left_to_measure_would_tell_them(
    monkeypatch, found, outcome
):
    assert outcome_of_a_list(monkeypatch, **found) == outcome


def without_a_rig(monkeypatch: pytest.MonkeyPatch, out: Path, **made_up: Any) -> Investigation:
    """Two rounds of which what is measured, said and proposed is made up."""
    silent = {
        "able": lambda *_: [],
        "_is_done": lambda *_: True,
        "_measure": lambda *_: out,
        "write_report": lambda *_: {},
        "read_measurements": lambda path: path,
        "together": lambda files: files,
    }
    for name, fake in (silent | made_up).items():
        monkeypatch.setattr(rounds, name, fake)
    subject = SimpleNamespace(config=None, finger=None, description=None, plan="first", seed=0)
    return investigate(subject, out, Budget(rounds=2))  # type: ignore[arg-type]


def test_what_shows_is_told_apart_in_the_same_round(monkeypatch, tmp_path):
    """A round ended where something showed, and four were spent on a friction that 16 settings
    named.
    """
    answers = iter(["no_discrepancy", "no_discrepancy", "ambiguous", "ambiguous", "effect_found"])
    plans = iter([["look", "look further", "for nothing"], ["tell", "tell further", "for nothing"]])
    measured: list[tuple[str, str, int]] = []
    asked: list[tuple[str, int]] = []

    def measure(
        subject: object, model: object, plan: str, folder: Path, found: Investigation, number: int
    ) -> Path:
        measured.append((folder.name, plan, number))
        return folder / "data.csv"

    def propose(*given: Any) -> list[str]:
        asked.append((given[2].name, given[3].rounds))
        return next(plans)

    found = without_a_rig(
        monkeypatch,
        tmp_path,
        _measure=measure,
        _next=propose,
        diagnose=lambda *_: SimpleNamespace(name=next(answers), findings=None),
    )
    looked = [("round-2", "look", 0), ("round-2", "look further", 1)]
    assert measured == [
        ("round-1", "first", 0),
        *looked,
        ("round-2", "tell", 2),
        ("round-2", "tell further", 3),
    ]
    assert (found.outcome, found.rounds) == ("named", 2)
    assert asked == [("no_discrepancy", 1), ("ambiguous", 2)]  # in the last round, too


@pytest.mark.parametrize(
    ("verdict", "outcome"), [("no_discrepancy", "nothing_missing"), ("ambiguous", "budget_spent")]
)
def test_the_last_round_ends_with_what_it_has(monkeypatch, tmp_path, verdict, outcome):
    said = SimpleNamespace(name=verdict, findings=None)
    found = without_a_rig(
        monkeypatch, tmp_path, diagnose=lambda *_: said, _next=lambda *_: ["more"]
    )
    assert (found.outcome, found.rounds) == (outcome, 2)
