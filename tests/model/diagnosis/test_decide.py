"""One posterior and one rule, on evidences that were logged once: 80 sets, judged in a second."""

from __future__ import annotations

import json
from collections import Counter
from math import exp, log
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from model.diagnosis.decide import decide
from model.diagnosis.hypotheses import FORCE_SENSOR, Evidences
from model.diagnosis.posterior import Posterior, held_against, posterior
from model.diagnosis.priors import NONE, PRIOR_EFFECTS, PRIOR_NONE, PRIOR_UNKNOWN, SURE, UNKNOWN

FROZEN = json.loads(Path(__file__).with_name("frozen_evidences.json").read_text())
VISIBLE = 25.0  # lambda
NAMES = "abcdef"


def evidences(frozen: dict[str, Any]) -> Evidences:
    return Evidences(
        {tuple(name.split("+")): log for name, log in frozen["alone"].items()},
        tuple(frozen["untestable"]),
        frozen["unseen"],
        {(name,): log for name, log in frozen["beside"].items()},
        frozen["outside"],
    )


def counted(with_current: bool) -> Counter[str]:
    """What the rule makes of the sets."""
    found = Counter[str]()
    for frozen in FROZEN:
        if frozen["set"].endswith("-friction") is with_current:
            continue
        decision = decide(posterior(evidences(frozen)))
        true = {name for name, visible in frozen["truth"].items() if visible >= VISIBLE}
        named = set(decision.names) if decision.verdict == "effect_found" else set()
        known = set() if frozen["kind"] == "unknown" else set(frozen["truth"])
        found["wrong"] += not named <= known
        if frozen["kind"] == "unknown":
            found["unexplained"] += decision.verdict == "unexplained"
        elif frozen["kind"] == "nothing":
            found["nothing"] += decision.verdict == "no_discrepancy"
        elif frozen["kind"] == "pair":
            found["pairs"] += named == known
        elif true:
            listed = {*decision.names, *(n for alike in decision.group.values() for n in alike)}
            found["visible"] += 1
            found["named"] += named == true
            found["right"] += true <= listed
    return found


def test_names_where_current_was_measured():
    """Of 5 sets of nothing, 8 of something unknown, 10 pairs and 17 single effects."""
    found = counted(with_current=True)
    assert (found["nothing"], found["unexplained"], found["pairs"]) == (5, 8, 10)
    assert (found["visible"], found["named"], found["right"]) == (17, 15, 16)
    assert found["wrong"] == 0


def test_names_by_friction_alone():
    """The same fingers. Pairs are hardly ever told by friction."""
    found = counted(with_current=False)
    assert (found["nothing"], found["unexplained"], found["pairs"]) == (5, 8, 0)
    assert (found["visible"], found["named"], found["right"]) == (11, 6, 11)
    assert found["wrong"] == 0


def summed(found: Evidences, name: str) -> float:
    """Inclusion probability by plain sums; of effects, none and unknown without `unseen`."""
    each = PRIOR_EFFECTS / (len(found.untestable) + sum(len(n) == 1 for n in found.alone) - 1)
    top = max(found.alone.values())
    weight: dict[tuple[str, ...], float] = {}
    for names, value in found.alone.items():
        prior = PRIOR_NONE if names == (NONE,) else each ** len(names)
        weight[names] = prior * exp(value - top)
    for untestable in found.untestable:
        weight[untestable,] = each * exp(found.alone[NONE,] - top)
    unknown = sum(each * exp(value - top) for value in found.outside.values())
    for names, value in found.beside.items():
        own = 1.0 if names == (NONE,) else each
        unknown += PRIOR_UNKNOWN * own * exp(value - top)
    weight[UNKNOWN,] = unknown
    return sum(w for names, w in weight.items() if name in names) / sum(weight.values())


@pytest.mark.parametrize("frozen", FROZEN[::4], ids=lambda frozen: str(frozen["set"]))
def test_an_effect_is_there_with_the_sum_of_all_that_hold_it(frozen):
    found = evidences(frozen)._replace(unseen={})
    inclusion = posterior(found).inclusion
    for name in (NONE, UNKNOWN, *found.untestable, *(n for names in found.alone for n in names)):
        assert inclusion[name] == pytest.approx(summed(found, name), abs=1e-12)


@st.composite
def made(draw: st.DrawFn) -> Evidences:
    """Any evidences of up to six effects."""
    value = st.floats(-30.0, 30.0)
    count = draw(st.integers(1, len(NAMES)))
    tested, rest = NAMES[:count], NAMES[count:]
    alone = {(name,): draw(value) for name in (NONE, *tested)}
    couples = [(a, b) for a in tested for b in tested if a < b]
    chosen = draw(st.lists(st.sampled_from(couples), unique=True)) if couples else []
    alone |= {pair: draw(value) for pair in chosen}
    unseen = {name: alone[name,] - draw(st.floats(0.0, 30.0)) for name in tested}
    beside = {(NONE,): draw(value), (tested[0],): draw(value)}
    return Evidences(alone, tuple(rest), unseen, beside, {FORCE_SENSOR: draw(value)})


@given(made())
def test_probabilities_sum_to_one_and_a_list_holds_sure(found):
    weighed = posterior(found)
    assert sum(weighed.hypotheses.values()) == pytest.approx(1.0)
    assert sum(weighed.shares.values()) == pytest.approx(1.0)
    fewest = weighed.credible()
    held = sum(weighed.hypotheses[names] for names in fewest)
    assert held >= SURE - 1e-9
    assert held - weighed.hypotheses[fewest[-1]] < SURE


@given(made(), st.floats(0.0, 10.0))
def test_more_evidence_for_an_effect_never_makes_it_less_likely(found, more):
    better = found._replace(alone=found.alone | {("a",): found.alone["a",] + more})
    assert posterior(better).inclusion["a"] >= posterior(found).inclusion["a"] - 1e-12


@given(made())
def test_every_name_is_sure_and_every_sure_effect_is_named(found):
    weighed = posterior(found)
    decision = decide(weighed)
    sure = {n for n, p in weighed.inclusion.items() if p >= SURE} - {NONE, UNKNOWN}
    assert (set(decision.names) if decision.verdict == "effect_found" else set()) == sure
    if decision.verdict == "no_discrepancy":
        assert weighed.inclusion[NONE] > 0.5
    if decision.verdict == "unexplained":
        assert weighed.inclusion[UNKNOWN] > 0.5
    assert not set(decision.names) & set(found.untestable) or decision.verdict == "effect_found"


@given(made(), st.floats(-5.0, 5.0), st.floats(-5.0, 5.0))
def test_held_out_data_multiply_the_odds_of_what_they_are_about(found, of_a, of_none):
    stated = posterior(found)
    held = held_against(stated, {("a",): exp(of_a), (NONE,): exp(of_none)})
    assert sum(held.hypotheses.values()) == pytest.approx(1.0)
    for names, p in stated.hypotheses.items():
        more = {("a",): of_a, (NONE,): of_none}.get(names, 0.0)
        expected = p * exp(more) * stated_of(stated, held)
        assert held.hypotheses[names] == pytest.approx(expected)


def stated_of(stated: Posterior, held: Posterior) -> float:
    """By how much all that nothing is said about became more probable."""
    return held.hypotheses[UNKNOWN,] / stated.hypotheses[UNKNOWN,]


def of(alone: dict[str, float], unknown: float = -90.0, sensor: float = -90.0) -> Evidences:
    """Evidences by joined names; 20 effects are in the catalogue."""
    logs = {tuple(name.split("+")): value for name, value in alone.items()}
    others = tuple(f"other {i}" for i in range(20 - sum(len(n) == 1 for n in logs) + 1))
    return Evidences(logs, others, {}, {(NONE,): unknown}, {FORCE_SENSOR: sensor})


def test_two_effects_are_both_named_where_every_likely_pair_holds_them():
    decision = decide(posterior(of({NONE: -90.0, "a": -20.0, "b": -30.0, "a+b": 0.0})))
    assert (decision.verdict, decision.names) == ("effect_found", ("a", "b"))


def test_one_is_named_and_what_may_stand_beside_it_is_said():
    """The second effect does nine times what its prior costs: probable, and not sure."""
    cost = -log(PRIOR_EFFECTS / 20)
    decision = decide(posterior(of({NONE: -90.0, "a": 0.0, "b": -60.0, "a+b": cost + log(9.0)})))
    assert decision.names == ("a",)
    assert "perhaps b as well" in decision.reason


def test_what_cannot_be_told_apart_is_listed_by_its_place():
    """Beside `b` both `a` and `c` explain the rest; without `b` nothing does."""
    logs = {NONE: -90.0, "a": -50.0, "b": -50.0, "c": -50.0, "a+b": 0.5, "b+c": 0.0}
    decision = decide(posterior(of(logs)))
    assert (decision.verdict, decision.names) == ("effect_found", ("b",))
    assert "perhaps a as well" in decision.reason
    listed = decide(posterior(of({NONE: -90.0, "a": 0.5, "b": 0.0, "c": -50.0})))
    assert (listed.verdict, listed.names) == ("ambiguous", ("a",))
    assert listed.group == {"a": ["b"]}
    assert listed.probability == pytest.approx(1.0)


def test_an_effect_that_closes_too_little_has_no_name():
    """It was 99 times as probable as something unknown, and loses nine tenths of that."""
    unknown = log(PRIOR_EFFECTS / 20 / PRIOR_UNKNOWN / 99.0)
    stated = posterior(of({NONE: -90.0, "a": 0.0}, unknown=unknown))
    assert decide(held_against(stated, {("a",): 0.9})).names == ("a",)
    held = held_against(stated, {("a",): 0.1})
    assert held.inclusion[UNKNOWN] == pytest.approx(1.0 / (1.0 + 9.9))
    assert decide(held).verdict == "ambiguous"
    assert (held.withheld, stated.withheld) == (("a",), ())


def test_of_two_effects_the_one_that_closes_what_the_other_leaves_keeps_its_name():
    """The pair was 99 times as probable as its first effect alone."""
    each = PRIOR_EFFECTS / 20
    stated = posterior(of({NONE: -90.0, "a": 0.0, "b": -60.0, "a+b": log(99.0 / each)}))
    assert decide(stated).names == ("a", "b")
    decision = decide(held_against(stated, {("a", "b"): 0.1}))
    assert (decision.verdict, decision.names) == ("effect_found", ("a",))
    assert "perhaps b as well" in decision.reason


def test_what_is_not_of_the_touch_is_said_and_never_named():
    decision = decide(posterior(of({NONE: -90.0, "a": -40.0}, sensor=0.0)))
    assert (decision.verdict, decision.names) == ("unexplained", ())
    assert "tare it" in decision.reason


def test_an_effect_that_leaves_no_trace_counts_as_none():
    """Twenty effects of which the data say nothing would share 0.56 with none; half is unseen."""
    names = [f"effect {i}" for i in range(20)]
    plain = Evidences({(n,): 0.0 for n in (NONE, *names)}, (), {}, {(NONE,): -90.0}, {})
    shares = posterior(plain).inclusion
    assert shares[NONE] == pytest.approx(PRIOR_NONE / (PRIOR_NONE + PRIOR_EFFECTS))
    hidden = plain._replace(unseen=dict.fromkeys(names, log(0.5)))
    moved = posterior(hidden).inclusion
    expected = (PRIOR_NONE + 0.5 * PRIOR_EFFECTS) / (PRIOR_NONE + PRIOR_EFFECTS)
    assert moved[NONE] == pytest.approx(expected)
    assert moved["effect 3"] == pytest.approx(0.5 * shares["effect 3"])
