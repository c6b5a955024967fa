"""Probabilities and names from made-up evidences, beside the same sums written out in plain numbers."""

from __future__ import annotations

from math import exp, inf, log
from types import SimpleNamespace

import numpy as np
import pytest

from model.diagnosis import verdict, weighing
from model.diagnosis.naming import (
    KIN_NATS,
    NEAR_NATS,
    PRIOR_EFFECTS,
    PRIOR_NONE,
    PRIOR_UNKNOWN,
    SAME_PLACE_NATS,
    SURE,
    could_stand_for,
)
from model.diagnosis.several import (
    A_FORM,
    A_SETTING,
    ANOTHER,
    ANOTHER_NATS,
    ANYTHING,
    NAMED_NATS,
    NO_CURRENT,
    OFF,
    is_explanation,
    several_effects,
)
from model.diagnosis.verdict import SEVERAL_CERTAIN
from model.diagnosis.weighing import (
    DISCREPANCY_WINS,
    HELD,
    MENDED,
    MIMICS,
    PARTICULAR,
    TIGHT,
    Weighed,
    among_alike,
    confusion,
    of_its_form,
)
from model.effects import BY_NAME

FAR = -1000.0  # evidence of what plays no part


def made(name: str, alone: float, beside: float = FAR, rough: float = FAR, **more: object) -> SimpleNamespace:
    """A candidate as far as the verdict looks at one."""
    return SimpleNamespace(
        name=name,
        alone=SimpleNamespace(log_evidence=alone, rough=rough, exact=alone),
        beside_discrepancy=SimpleNamespace(log_evidence=beside),
        **more,
    )


def posterior(base: SimpleNamespace, *singles: SimpleNamespace, **more: object) -> dict[str, float]:
    return Weighed(base, list(singles), [], **more).probabilities  # type: ignore[arg-type]


def named(
    found: SimpleNamespace, said: dict[str, float], group: tuple[str, ...] = (), smooth: float = FAR
) -> verdict.Verdict:
    """The verdict about one effect of these probabilities; `smooth`: log evidence of a discrepancy of any shape."""
    weighed = SimpleNamespace(winner=found, base=made("none", FAR, smooth), probabilities=said)
    return verdict._name_one(weighed, list(group))  # type: ignore[arg-type]


def expected(**weights: float) -> object:
    total = sum(weights.values())
    return pytest.approx({name: weight / total for name, weight in weights.items()}, rel=1e-9)


def test_what_an_effect_says_where_it_leaves_no_trace_counts_as_none() -> None:
    found = posterior(made("none", -11.0), made("a", -10.0), made("b", -12.0), unseen={"a": -10.7})
    each = PRIOR_EFFECTS / 2
    assert found == expected(
        a=each * (exp(-10.0) - exp(-10.7)),
        b=each * exp(-12.0),
        none=PRIOR_NONE * exp(-11.0) + each * exp(-10.7),
        unknown=0.0,
    )


@pytest.mark.parametrize("another_form", [True, False])
def test_a_discrepancy_beside_the_winner_is_its_own_only_where_it_mends_its_form(another_form: bool) -> None:
    mended, each = 8.0, PRIOR_EFFECTS / 2
    beside_base = -10.0 - MENDED * mended + (-0.1 if another_form else 0.1)
    found = posterior(made("none", -90.0, beside_base), made("a", -10.0, -10.0 + mended), made("b", -12.0))
    more = PRIOR_UNKNOWN * each * exp(-10.0 + mended)
    assert found == expected(
        a=each * exp(-10.0) + (more if another_form else 0.0),
        b=each * exp(-12.0),
        none=PRIOR_NONE * exp(-90.0),
        unknown=PRIOR_UNKNOWN * exp(beside_base) + (0.0 if another_form else more),
    )


@pytest.mark.parametrize("tight", [20.0, 3.0, -5.0])
def test_a_form_that_the_data_hold_tight_speaks_against_a_discrepancy_of_any_shape(tight: float) -> None:
    """`tight`: nats against a form far off. A gain that bends was unexplained: any discrepancy said as much."""
    found = posterior(made("none", -90.0, -10.0), made("a", -10.0, rough=-10.0 - tight), made("b", -60.0))
    each = PRIOR_EFFECTS / 2
    mimic = MIMICS * each * exp(-10.0 - tight)
    if tight < 0.0:
        mimic *= exp(PARTICULAR * tight)  # what looks like it says more than any discrepancy
    assert found == expected(
        a=each * exp(-10.0),
        b=0.0,
        none=PRIOR_NONE * exp(-90.0),
        unknown=PRIOR_UNKNOWN * exp(-10.0 - HELD * max(tight, 0.0)) + mimic,
    )


@pytest.mark.parametrize(("has_current", "near"), [(False, ["b", "c"]), (True, ["b"])])
def test_what_imitates_is_refuted_sooner_where_current_was_measured(
    monkeypatch: pytest.MonkeyPatch, has_current: bool, near: list[str]
) -> None:
    """A film of sweat was listed with an electrowetting 5 nats behind, a conducting gap with a breakdown 7 behind."""
    singles = [made(name, -behind) for name, behind in (("a", 0.0), ("b", 3.9), ("c", 7.9), ("d", 8.1))]
    monkeypatch.setattr(weighing, "separation", lambda *_: 1.0)
    assert list(confusion(measured(has_current), singles[0], singles)) == near  # type: ignore[arg-type]


@pytest.mark.parametrize("fits", [True, False])
@pytest.mark.parametrize("other", ["amplifier_slew_limit", "load_dependent_friction"])
@pytest.mark.parametrize("lead", [x + d for x in (SAME_PLACE_NATS, KIN_NATS) for d in (-0.1, 0.1)])
def test_another_form_of_a_rival_may_be_the_winner(lead: float, other: str, fits: bool) -> None:
    """Where both act at one place; and any rival, from farther off, where the winner itself is of another form.

    Electrowetting was named, in another form, 8 nats before the film of sweat that was there.
    """
    best = made("amplifier_bandwidth", 0.0, kinds=(BY_NAME["amplifier_bandwidth"],))
    rival, base = made(other, -lead, kinds=(BY_NAME[other],)), made("none", -90.0, kinds=())
    near = lead < SAME_PLACE_NATS and other == "amplifier_slew_limit" if fits else lead < KIN_NATS
    assert could_stand_for(rival, best, base, fits) is near  # type: ignore[arg-type]
    assert not could_stand_for(rival, best, made("none", -1.9 * lead), fits)  # type: ignore[arg-type]


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize(("beyond", "is_own"), [(0.01, True), (-0.01, False)])
def test_a_form_is_the_effects_own_from_sure_odds_against_a_look_alike_up(
    beyond: float, is_own: bool, count: int
) -> None:
    """Of two either may be one: a sensor that saturates was named a breakdown of the air with a film of sweat."""
    look_alike = -50.0 - PARTICULAR * 50.0  # 50 nats more than a discrepancy of any shape
    alone = look_alike + log(count * MIMICS) + log(SURE / (1.0 - SURE)) + beyond
    found = made("a", alone, rough=-50.0, kinds=(kind("a"),) * count)
    assert of_its_form(found, made("none", -200.0, -100.0)) is is_own  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("count", "fits", "exact", "explains"),
    [(2, False, False, True), (3, True, True, True), (3, False, True, False), (3, True, False, False)],
)
def test_three_effects_explain_only_by_the_catalogues_exact_form(
    count: int, fits: bool, exact: bool, explains: bool
) -> None:
    """Three of other forms were listed for a resonance of the sensor."""
    found = made("a", 0.0, kinds=(kind("a"),) * count)
    found.alone.exact = 0.0 if exact else -10.0
    several = SimpleNamespace(found=found, fits=fits)
    assert is_explanation(several, made("none", -200.0, -100.0)) is explains  # type: ignore[arg-type]


@pytest.mark.parametrize(("share", "names"), [(1.1, ["a"]), (0.9, [])])
def test_an_effect_is_needed_beside_a_discrepancy_from_sure_odds_up(share: float, names: list[str]) -> None:
    """`share` of the odds that are sure; b is too far off to matter, c cannot be tested but has its prior."""
    each = PRIOR_EFFECTS / 3
    beside = log(share * SURE / (1.0 - SURE) * PRIOR_UNKNOWN / each)
    weighed = Weighed(made("none", -90.0, 0.0), [made("a", 0.0, beside), made("b", -1.0)], ["c"])  # type: ignore[list-item, arg-type]
    assert verdict._needed_beside_discrepancy(weighed, []) == names


def kind(name: str, off: float = 0.0, scale: str = "linear", stage: str = "") -> SimpleNamespace:
    return SimpleNamespace(name=name, stage=stage, parameters=lambda: [SimpleNamespace(off=off, scale=scale)])


def certain(*x: float) -> SimpleNamespace:
    """Two effects, fitted: the base model's one parameter and then theirs, in standard deviations of their priors."""
    fit = SimpleNamespace(vector=np.array([9.0, *x]))
    return SimpleNamespace(found=made("a+b", 0.0, kinds=(kind("a"), kind("b")), fit=fit), fits=True, doubt="")


def test_each_of_two_effects_has_its_half_and_shares_it_with_what_may_stand_there() -> None:
    before = {"a": 0.3, "b": 0.2, "c": 0.2, "none": 0.2, "unknown": 0.1}
    found = verdict._name_several(certain(0.0, 0.0), [{"a": 0.6, "c": 0.2}, {"b": 0.4}], before)  # type: ignore[arg-type]
    half, left = SEVERAL_CERTAIN / 2, 1.0 - SEVERAL_CERTAIN
    shares = {"a": 0.75 * half, "c": 0.25 * half, "b": half, "none": left * 2 / 3, "unknown": left / 3}
    assert found.probabilities == pytest.approx(shares, rel=1e-9)
    assert (found.verdict, found.group) == ("ambiguous", {"a": ["c"], "b": []})


@pytest.mark.parametrize(("x", "unusual"), [(2.5, False), (2.7, True), (-2.7, True)])
def test_two_names_say_so_where_one_is_stronger_than_usual(x: float, unusual: bool) -> None:
    before = {"a": 0.5, "b": 0.4, "none": 0.1}
    found = verdict._name_several(certain(0.0, x), [{"a": 1.0}, {"b": 1.0}], before)  # type: ignore[arg-type]
    assert (found.verdict, found.adequate) == ("effect_found", True)
    doubted = SimpleNamespace(**vars(certain(0.0, x)) | {"doubt": A_SETTING})
    listed = verdict._name_several(doubted, [{"a": 1.0}, {"b": 1.0}], before)  # type: ignore[arg-type]
    assert (listed.verdict, "shows at a single setting" in listed.reasons[0]) == ("ambiguous", True)
    assert ("stronger than 99 %" in found.reasons[0]) is unusual


@pytest.mark.parametrize(("odds", "exact"), [(0.99, True), (1.01, False)])
def test_a_name_is_not_adequate_where_the_data_refute_the_catalogues_own_form(odds: float, exact: bool) -> None:
    """The model that is written has that form. `odds` in units of those from which they do."""
    found = made("a", -10.0, fit=SimpleNamespace(vector=np.zeros(1)), kinds=(kind("a"),))
    found.alone.exact = -10.0 - log(odds * DISCREPANCY_WINS)
    said = named(found, {"a": 0.99, "none": 0.01})
    assert (said.verdict, said.adequate) == ("effect_found", exact)
    assert ("not quite the catalogue's" in said.reasons[0]) is not exact


@pytest.mark.parametrize(("own", "tight", "sure"), [(0.51, -0.1, True), (0.49, -0.1, False), (0.49, 0.1, True)])
def test_no_name_where_a_form_that_is_off_explains_most(own: float, tight: float, sure: bool) -> None:
    """`own` in units of what that adds, `tight` beyond what must speak against a form far off.

    A resonance of the screen was called trapped charge of another form.
    """
    found = made("a", -10.0, rough=-10.0 - TIGHT - tight, kinds=(kind("a"),), fit=SimpleNamespace(vector=np.zeros(1)))
    found.alone.exact = -10.0 - 40.0
    said = named(found, {"a": 0.995, "unknown": 0.005}, smooth=-10.0 - own * 40.0)
    assert (said.verdict, said.suspects) == ("effect_found" if sure else "ambiguous", ["a"])
    assert ("off by more than speaks for it" in said.reasons[0]) is not sure


def test_a_force_sensor_that_reads_the_load_is_as_likely_as_an_effect() -> None:
    """Three of 640 sets were called load-dependent friction for a share of the load in the sensor's reading."""
    found = posterior(made("none", -90.0), made("a", -10.0), made("b", -12.0), force_sensor=-11.0)
    each = PRIOR_EFFECTS / 2
    assert found == expected(
        a=each * exp(-10.0), b=each * exp(-12.0), none=PRIOR_NONE * exp(-90.0), unknown=each * exp(-11.0)
    )


@pytest.mark.parametrize(("sensor", "told"), [(-9.0, True), (-11.0, False)])
def test_unexplained_says_where_the_force_sensor_would_do(sensor: float, told: bool) -> None:
    weighed = Weighed(made("none", -90.0, -10.0), [made("a", -12.0)], [], force_sensor=sensor)  # type: ignore[list-item, arg-type]
    said = verdict._unexplained(weighed, "the data disagree")
    assert ("tare it" in said.reasons[0]) is told


def test_a_list_holds_the_fewest_that_are_certain_together() -> None:
    """It held what has 95 % among the effects, up to nineteen, however sure it was that there is none of them."""
    found = made("a", -10.0, kinds=(kind("a"),), fit=SimpleNamespace(vector=np.zeros(1)))
    said = {"a": 0.5, "none": 0.25, "b": 0.15, "unknown": 0.06, "c": 0.03, "d": 0.01}
    listed = named(found, said)
    assert (listed.verdict, listed.group) == ("ambiguous", {"a": ["b"]})
    assert named(found, said, ("d",)).group == {"a": ["d", "b"]}


@pytest.mark.parametrize(
    ("said", "unexplained"),
    [
        ({"unknown": 0.71, "a": 0.29, "none": 0.0}, False),
        ({"unknown": 0.96, "a": 0.04, "none": 0.0}, True),
        ({"unknown": 0.70, "none": 0.26, "a": 0.04}, True),
    ],
)
def test_something_unknown_is_not_told_apart_from_an_effect_without_which_it_is_not_certain(
    said: dict[str, float], unexplained: bool
) -> None:
    """Of ten pilot sets of friction alone where it had 0.5 to 0.95, nine hid an effect of the catalogue."""
    settled = verdict._of_no_effect(Weighed(made("none", 0.0), [made("a", 0.0)], []), said)  # type: ignore[arg-type]
    assert (settled is not None) is unexplained
    assert settled is None or settled.verdict == "unexplained"


def test_nothing_missing_is_the_verdict_where_it_is_more_probable_than_something_unknown() -> None:
    said = {"none": 0.6, "unknown": 0.38, "a": 0.02}
    settled = verdict._of_no_effect(Weighed(made("none", 0.0), [made("a", 0.0)], []), said)  # type: ignore[arg-type]
    assert settled is not None
    assert settled.verdict == "no_discrepancy"


def test_what_could_be_another_form_of_a_listed_effect_is_listed_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A slew limit that sets in softly looked like a roll-off, and that like a resistance, which led."""
    names = ("series_resistance", "amplifier_bandwidth", "amplifier_slew_limit", "contact_ageing")
    evidence = (0.0, -0.5, -4.3, -3.0)
    singles = [made(n, e, kinds=(BY_NAME[n],)) for n, e in zip(names, evidence, strict=True)]
    weighed = Weighed(made("none", -40.0, kinds=()), singles, [])  # type: ignore[arg-type]
    for imitates, listed in ((4.1, []), (3.9, ["amplifier_bandwidth", "amplifier_slew_limit"])):  # 4 is together
        said = {"amplifier_bandwidth": imitates, "contact_ageing": 4.1}
        monkeypatch.setattr(verdict, "confusion", lambda *_, said=said: said)
        assert verdict._alike(None, weighed, True) == listed  # type: ignore[arg-type]


def beside(
    gain: float, said: dict[str, float], mends: bool = False, alike: tuple[str, ...] = ("b",), stands: bool = False
) -> verdict.Verdict:
    """What is said of an effect `a` where the data favour `b`, or something like it, beside it by `gain`."""
    one = made("a", -10.0, kinds=(kind("a"),), fit=SimpleNamespace(vector=np.zeros(1)))
    two = made("b+a", 0.0, kinds=(kind("b"), *one.kinds))
    search = SimpleNamespace(
        best_with_one_more=lambda chosen: two,
        gain=lambda more: gain,
        mends_a_form=lambda more: mends,
        stands_for_a_form=lambda more: stands,
        places=lambda more, i: dict.fromkeys(alike, 1.0 / len(alike)),
    )
    scan = lambda found: SimpleNamespace(lack_of_fit_p=1.0)  # noqa: E731
    return verdict._with_a_second(search, scan, named(one, said))  # type: ignore[arg-type]


@pytest.mark.parametrize(("gain", "listed"), [(0.1, True), (-0.1, False)])
def test_what_is_favoured_beside_a_name_but_not_enough_for_one_is_listed_with_it(gain: float, listed: bool) -> None:
    """One of two effects was named and called adequate, with the odds of 100 for the other that is no name yet."""
    said = beside(gain, {"a": 0.99, "none": 0.006, "b": 0.003, "c": 0.001})
    assert (said.verdict, said.suspects) == (("ambiguous", ["b", "a"]) if listed else ("effect_found", ["a"]))
    if listed:
        assert said.presence("a") == pytest.approx(0.99)
        assert said.presence("b") == pytest.approx(1.0 / (1.0 + exp(-gain)))
        assert sum(said.probabilities.values()) == pytest.approx(1.0)
        assert said.probabilities["none"] == pytest.approx(6.0 * said.probabilities["c"])


def test_what_may_stand_beside_a_name_shares_its_place() -> None:
    said = beside(100.0, {"a": 0.98, "none": 0.01, "b": 0.005, "c": 0.005}, alike=("b", "c"))
    assert said.group == {"a": [], "b": ["c"]}
    assert said.presence("b") == said.presence("c") == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("gain", "mends", "alike", "name"),
    [
        (ANOTHER_NATS + 0.1, True, ("b",), True),
        (ANOTHER_NATS - 0.1, True, ("b",), False),
        (ANOTHER_NATS + 0.1, False, ("b",), False),
        (1.0, False, ("b", "c", "d"), False),
        (1.0, False, ("b", "c", "d", "e"), True),
    ],
)
def test_a_name_stays_beside_what_would_mend_its_form_or_what_many_may_be(
    gain: float, mends: bool, alike: tuple[str, ...], name: bool
) -> None:
    said = beside(gain, {"a": 0.99} | dict.fromkeys(("b", "c", "d", "e"), 0.0025), mends, alike)
    assert said.verdict == ("effect_found" if name else "ambiguous")
    assert not name or (said.adequate, "perhaps b as well" in said.reasons[0]) == (False, True)


def test_a_name_stays_beside_what_stands_for_a_form_that_is_off() -> None:
    said = beside(1.0, {"a": 0.99, "none": 0.005, "b": 0.005}, stands=True)
    assert (said.verdict, said.suspects, said.adequate) == ("effect_found", ["a"], False)


def test_a_list_is_told_with_what_would_mend_a_form_that_earns_no_name() -> None:
    """A film of sweat of a form far off led, and the skin without which it fits nothing was a word."""
    said = beside(ANOTHER_NATS + 20.0, {"a": 0.6, "none": 0.35, "b": 0.05}, mends=True)
    assert said.suspects == ["b", "a"]


def measured(has_current: bool) -> SimpleNamespace:
    """A problem of data with current, or without."""
    return SimpleNamespace(predictor=SimpleNamespace(data=SimpleNamespace(has_current=has_current)))


def looking(
    one: SimpleNamespace, two: SimpleNamespace, gain: float, mends: bool = False, little: bool = False,
    has_current: bool = True,
) -> SimpleNamespace:  # fmt: skip
    """A search that finds `two` effects beside `one`, and no third."""
    return SimpleNamespace(
        best_with_one_more=lambda chosen: two if chosen is one else None,
        gain=lambda more: gain,
        mends_a_form=lambda more: mends,
        adds_little=lambda more: little,
        stands_for_a_form=lambda more: False,
        rests_on_one_setting=lambda found: False,
        problem=measured(has_current),
    )


def needed(search: SimpleNamespace, one: SimpleNamespace, base: SimpleNamespace, one_fits: bool) -> object:
    """What is needed beside `one`, where nothing that is left has a pattern."""
    scan = SimpleNamespace(lack_of_fit_p=1.0)
    return several_effects(search, Weighed(base, [one], []), one_fits, lambda found: scan)  # type: ignore[arg-type, list-item, return-value]


@pytest.mark.parametrize(("own", "named"), [(1.01, True), (0.99, False)])
def test_two_effects_are_named_where_a_discrepancy_beside_them_only_mends_their_form(own: float, named: bool) -> None:
    """As one effect is; `own` in units of what they must say beyond any. Two clear effects were unexplained."""
    one = made("a", -300.0, -200.0, kinds=(kind("a", stage="drive"),))
    alone = -100.0
    two = made("a+b", alone, alone + 10.0, kinds=(kind("a", stage="drive"), kind("b", stage="contact")))
    base = made("none", -900.0, alone - own * MENDED * 10.0)
    search = looking(one, two, 90.0)
    found = needed(search, one, base, False)
    assert found == ((two, False, "") if named else None)


@pytest.mark.parametrize(("one_fits", "doubt"), [(True, None), (False, A_FORM)])
def test_a_second_effect_that_mends_a_form_is_none_beside_one_that_fits_and_never_certain(
    one_fits: bool, doubt: str | None
) -> None:
    one = made("a", -300.0, -200.0, kinds=(kind("a", stage="drive"),))
    two = made("a+b", -100.0, kinds=(*one.kinds, kind("b", stage="contact")))
    search = looking(one, two, 90.0, mends=True)
    found = needed(search, one, made("none", -900.0, -800.0), one_fits)
    assert found == (None if doubt is None else (two, True, doubt))


@pytest.mark.parametrize(
    ("odds", "doubt"),
    [
        (NAMED_NATS + 0.1, ""),
        (NAMED_NATS - 0.1, ANYTHING),
        (0.1 - ANOTHER_NATS, ANYTHING),
        (-0.1 - ANOTHER_NATS, None),
    ],
)
def test_two_effects_that_fit_are_certain_where_the_second_does_more_than_something_unknown(
    odds: float, doubt: str | None
) -> None:
    """A roll-off with trapped charge was unexplained: something unknown in place of the charge explained as much.

    A resistance of another form was named with an electrowetting, for 3.8 nats.
    """
    one = made("a", -300.0, -100.0, kinds=(kind("a", stage="drive"),))
    two = made("a+b", -100.0 + log(PRIOR_UNKNOWN) - ANOTHER + odds, kinds=(*one.kinds, kind("b", stage="contact")))
    search = looking(one, two, KIN_NATS + 0.1)
    found = needed(search, one, made("none", -900.0, -800.0), False)
    assert found == (None if doubt is None else (two, True, doubt))


@pytest.mark.parametrize(("place", "nats"), [("contact", NAMED_NATS), ("drive", NEAR_NATS)])
@pytest.mark.parametrize(("beyond", "named"), [(0.1, True), (-0.1, False)])
def test_beside_one_that_fits_a_second_effect_must_be_worth_more_than_a_form_that_is_off(
    place: str, nats: float, beyond: float, named: bool
) -> None:
    """Most where it acts at the place of the first. A moist skin was given a polarization beside it, for 4 nats."""
    one = made("a", -100.0, kinds=(kind("a", stage="drive"),))
    two = made("a+b", -100.0 - ANOTHER + nats + beyond, kinds=(*one.kinds, kind("b", stage=place)))
    search = looking(one, two, ANOTHER_NATS + 0.1)
    found = needed(search, one, made("none", -900.0, -800.0), True)
    assert found == ((two, True, "") if named else None)


@pytest.mark.parametrize("fits", [True, False])
@pytest.mark.parametrize(("beyond", "named"), [(0.1, True), (-0.1, False)])
def test_a_second_effect_must_do_more_than_the_first_in_a_form_far_off(fits: bool, beyond: float, named: bool) -> None:
    """A nonlinear skin whose form is off by more than a tenth was named with an error of gain, for 14 nats."""
    beside = -200.0 if fits else -90.0
    one = made("a", -100.0, beside, rough=-60.0, kinds=(kind("a", stage="drive"),))
    two = made(
        "a+b", -60.0 + log(MIMICS) - ANOTHER + NAMED_NATS + beyond, kinds=(*one.kinds, kind("b", stage="contact"))
    )
    search = looking(one, two, ANOTHER_NATS + 0.1)
    found = needed(search, one, made("none", -900.0, -800.0), fits)
    assert found == ((two, True, "") if named else None)


@pytest.mark.parametrize(("little", "off", "doubt"), [(True, 2.4, OFF), (True, 2.2, ""), (False, 2.4, "")])
@pytest.mark.parametrize("one_fits", [True, False])
def test_what_adds_no_more_than_a_form_may_be_off_is_listed_while_one_is(
    little: bool, off: float, doubt: str, one_fits: bool
) -> None:
    """A polarization of lambda 1005, of another form, was named with a moist skin beside it, for 25 nats of 148."""
    one = made("a", -300.0, FAR if one_fits else -290.0, kinds=(kind("a", stage="drive"),))
    two = made("a+b", -200.0, kinds=(*one.kinds, kind("b", stage="contact")))
    two.alone.exact -= off  # nats, of which a factor of ten has 2.3
    search = looking(one, two, 90.0, little=little)
    found = needed(search, one, made("none", -900.0, -800.0), one_fits)
    assert found == (two, True, doubt)


@pytest.mark.parametrize(("off", "doubt"), [(2.4, NO_CURRENT), (2.2, "")])
@pytest.mark.parametrize("one_fits", [True, False])
def test_two_effects_of_another_form_are_not_named_without_current(off: float, doubt: str, one_fits: bool) -> None:
    """Sensors that resonate at a frequency, lambda 800, were named as a trapped charge with a polarization."""
    one = made("a", -300.0, FAR if one_fits else -290.0, kinds=(kind("a", stage="drive"),))
    two = made("a+b", -200.0, kinds=(*one.kinds, kind("b", stage="contact")))
    two.alone.exact -= off
    found = needed(looking(one, two, 90.0, has_current=False), one, made("none", -900.0, -800.0), one_fits)
    assert found == (two, True, doubt)


@pytest.mark.parametrize(
    ("off", "scale", "x", "unusual"),
    [(inf, "log", 3.0, False), (inf, "log", -3.0, True), (0.0, "log", -3.0, False), (0.0, "log", 3.0, True)],
)
def test_a_weak_effect_is_not_unusual(off: float, scale: str, x: float, unusual: bool) -> None:
    """Towards the end at which a parameter switches its effect off."""
    found = made("a", 0.0, kinds=(kind("a", off, scale),), fit=SimpleNamespace(vector=np.array([x])))
    assert bool(verdict._how_unusual(found)) is unusual  # type: ignore[arg-type]


def test_the_first_of_a_list_is_as_sure_as_lists_have_shown_and_the_list_as_before() -> None:
    """0.98 was said of the first, and 10 of 14 such were right."""
    said = {"a": 0.96, "b": 0.015, "c": 0.005, "none": 0.01, "unknown": 0.01}
    told = among_alike(said, "a", ["b", "c"])
    assert told["a"] / (told["b"] + told["c"]) == pytest.approx((0.96 / 0.02) ** (1.0 / 3.0))
    assert told["b"] / told["c"] == pytest.approx(3.0)
    assert told["a"] + told["b"] + told["c"] == pytest.approx(0.98)
    assert (told["none"], told["unknown"]) == pytest.approx((0.01, 0.01))
    assert among_alike(said, "a", []) == said
    assert among_alike(said, "b", ["a"]) == said  # what does not lead is not made more of
