"""What holds of every effect, whatever it is: a new one is tested by standing in the catalogue."""

from __future__ import annotations

import itertools
import re
from dataclasses import fields, replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from model import effects, solver
from model.conditions import Conditions
from model.effects import BY_NAME, CATALOGUE, Effect
from model.effects.base import Stage
from model.effects.interventions import INTERVENTIONS, removed
from model.electric.current import sliding_admittance_per_m
from model.touch import Drive
from model.touch_model import Prediction, cof, prepare

STAGES = get_args(Stage)  # in the order of the chain
METHODS = {
    "drive": {"drive"},
    "stack": {"stack"},
    "air gap": {"stack", "contact"},  # what fills it, or how wide it is
    "pressure": {"drive", "contact"},  # a voltage of the surface's own, or what the field may be
    "load": {"contact"},
    "friction": {"friction"},
    "contact": {"contact"},
}
SYMBOLS = ("Hz", "V", "A", "ohm", "S", "F", "C", "N", "Pa", "J", "W", "K", "kg", "m", "s", "rad")
SHORT = {"m/s": "m_s"}  # as columns of data have it
PAIRS = list(itertools.combinations(CATALOGUE, 2))
ORDERED = {frozenset((kind.name, other)) for kind in CATALOGUE for other in kind.order_counts_with}
STRENGTHS = np.linspace(-2.0, 2.0, 5)  # standard deviations of a prior

every_effect = pytest.mark.parametrize("effect", CATALOGUE, ids=lambda effect: effect.name)
every_parameter = pytest.mark.parametrize(
    "parameter",
    [pytest.param(p, id=f"{e.name}.{p.name}") for e in CATALOGUE for p in e.parameters()],
)


def assert_same(one: Prediction, other: Prediction, rtol: float) -> None:
    for f in fields(Prediction):
        a, b = getattr(one, f.name), getattr(other, f.name)
        np.testing.assert_allclose(a, b, rtol=rtol, err_msg=f.name)


@pytest.fixture(scope="module")
def both_kinds(unbiased, biased):
    return unbiased, biased


def overridden(effect: type[Effect]) -> set[str]:
    return {"drive", "stack", "contact", "friction"} & set(vars(effect))


class TestTheList:
    def test_names_are_unique(self):
        assert len({effect.name for effect in CATALOGUE}) == len(CATALOGUE)
        assert list(BY_NAME.values()) == list(CATALOGUE)
        assert all(effect.name == name for name, effect in BY_NAME.items())

    def test_it_follows_the_chain(self):
        places = [STAGES.index(effect.stage) for effect in CATALOGUE]
        assert places == sorted(places)

    def test_it_leaves_no_file_out(self):
        files = {path.stem for path in Path(effects.__file__).parent.glob("*.py")}
        others = {"__init__", "base", "interventions", "learned", "second_touch"}
        assert files - others == set(BY_NAME)

    def test_every_intervention_removes_something(self):
        assert all(removed(known.name) for known in INTERVENTIONS)


@every_effect
class TestWhatItSays:
    def test_it_is_a_file_of_its_own_name(self, effect):
        assert re.fullmatch(r"[a-z]+(_[a-z]+)*", effect.name)
        assert effect.__module__ == f"model.effects.{effect.name}"
        assert effect.__name__ == effect.name.title().replace("_", "")

    def test_it_says_what_it_is_in_its_own_words(self, effect):
        assert effect.source
        for said in ("physics", "signature", "check"):
            assert getattr(effect, said) not in ("", getattr(Effect, said))

    def test_it_has_a_few_parameters(self, effect):
        assert 1 <= len(effect.parameters()) <= 3
        assert [p.name for p in effect.parameters()] == [f.name for f in fields(effect)]

    def test_it_acts_at_one_place_of_its_stage(self, effect):
        (method,) = overridden(effect)
        assert method in METHODS[effect.stage]

    def test_it_needs_and_bends_with_columns_that_may_be_given(self, effect):
        optional = {f.name for f in fields(Conditions) if f.default is None}
        known = {f.name for f in fields(Drive)}
        assert set(effect.needs) <= known & optional
        assert set(effect.bends_with()) <= known

    def test_interventions_that_remove_it_are_known(self, effect):
        assert set(effect.removed_by) <= {known.name for known in INTERVENTIONS}

    def test_its_order_counts_with_effects_of_the_same_place(self, effect):
        """All effects act on one place of the chain before any acts on the next."""
        for other in effect.order_counts_with:
            assert overridden(BY_NAME[other]) == overridden(effect)
            assert other != effect.name


def spelled(unit: str) -> str:
    """A unit as names end with it: `v_per_s` for V/s."""
    assert re.fullmatch(r"[^/]+(/[^/]+)?", unit)
    for word in re.split(r"[ /]", unit):
        assert re.fullmatch(rf"({'|'.join(SYMBOLS)})(\^(\d|n))?", word), unit
    return SHORT.get(unit, unit.lower().replace("^", "").replace("/", "_per_").replace(" ", "_"))


def unit_in(name: str) -> str:
    """What of a name is its unit: all words at its end that are symbols, or `per`."""
    symbols = "|".join(symbol.lower() for symbol in SYMBOLS)
    words = name.split("_")
    rest = itertools.dropwhile(re.compile(rf"per|({symbols})(\d|n)?").fullmatch, reversed(words))
    return "_".join(words[len(list(rest)) :])


@every_parameter
class TestParameters:
    def test_the_unit_is_of_si_and_in_the_name(self, parameter):
        unit = parameter.unit
        assert unit_in(parameter.name) == ("" if unit == "1" else spelled(unit))

    def test_bounds_prior_and_off_value_are_sound(self, parameter):
        p = parameter
        assert np.isfinite([p.low, p.high, p.median, p.std]).all()
        assert p.low < p.median < p.high
        assert p.std > 0.0
        assert p.scale in ("log", "linear")
        if p.scale == "log":
            assert p.low > 0.0
            limits = (0.0, np.inf)  # that a logarithm nears
            assert p.off in limits or p.low <= p.off <= p.high
        else:
            assert p.low <= p.off <= p.high

    def test_three_standard_deviations_move_it(self, parameter):
        values = parameter.from_normal(np.array([-3.0, -1.0, 0.0, 1.0, 3.0]))
        assert values[2] == parameter.median
        assert (np.diff(values) >= 0.0).all()
        assert values[1] < values[2] < values[3]
        is_log = parameter.scale == "log"
        step = values[3] / values[2] if is_log else values[3] - values[2]
        expected = np.exp(parameter.std) if is_log else parameter.std
        assert step == pytest.approx(expected, rel=1e-12)  # rounding
        far = parameter.from_normal(np.array([-1e6, 1e6]))
        np.testing.assert_array_equal(far, [parameter.low, parameter.high])  # never out of bounds


@every_effect
class TestOff:
    def test_the_base_model_comes_back(self, effect, with_effects, models, both_kinds):
        off = with_effects(effect.off())
        for conditions in both_kinds:
            got, base = (m.predict(conditions) for m in (off, models["reference"]))
            assert_same(got, base, 1e-12)
            assert np.isfinite(base.cof).all()

    def test_without_optional_columns_too(self, effect, with_effects, models, unbiased):
        plain = replace(unbiased, waveform=None, speed_m_s=None, time_s=None)
        got = with_effects(effect.off()).predict(plain)
        assert_same(got, models["reference"].predict(plain), 1e-12)

    def test_an_off_effect_leaves_another_alone(self, effect, with_effects, median, biased):
        for name in ("skin_hydration", "sweat_film", "capillary_adhesion"):
            if name != effect.name:
                other = median(BY_NAME[name], 0.5)
                both = with_effects(effect.off(), other).predict(biased)
                assert_same(both, with_effects(other).predict(biased), 1e-12)

    def test_a_standard_deviation_from_the_prior_median_changes_something(
        self, effect, with_effects, models, median, unbiased
    ):
        base = models["reference"].predict(unbiased).cof
        moved = [with_effects(median(effect, x)).predict(unbiased).cof for x in (-1.0, 1.0)]
        assert np.nanmax(np.abs(np.array(moved) / base - 1.0)) > 1e-4


@every_effect
class TestOn:
    def test_what_it_does_not_need_does_not_matter(self, effect, found, median, biased):
        rng = np.random.default_rng(4)
        other = {
            "speed_m_s": rng.permutation(biased.speed_m_s),
            "time_s": rng.permutation(biased.time_s),
        }
        elsewhere = replace(biased, **{n: v for n, v in other.items() if n not in effect.needs})
        on = (median(effect, 1.0),)
        for one, same in zip(found(on, biased), found(on, elsewhere), strict=True):
            np.testing.assert_allclose(one, same, rtol=1e-9)  # the loop is closed to 1e-10

    def test_it_leaves_alone_what_its_stage_cannot_reach(
        self, effect, with_effects, models, median, unbiased
    ):
        """Friction attracts nothing, and what acts on the voltage needs one."""
        got = with_effects(median(effect, 1.0)).predict(unbiased)
        base = models["reference"].predict(unbiased)
        if effect.stage == "friction":
            cof = {"cof": base.cof}
            assert_same(replace(got, **cof), base, 1e-12)
        if effect.stage in ("drive", "stack", "air gap"):
            undriven = unbiased.voltage_v == 0.0
            assert undriven.any()
            np.testing.assert_allclose(got.cof[undriven], base.cof[undriven], rtol=1e-12)


@pytest.mark.parametrize("table", ["reference", "table1"])
def test_no_effect_is_no_effect(models, with_effects, biased, table):
    got = with_effects(Effect(), base=models[table]).predict(biased)
    assert_same(got, models[table].predict(biased), 0.0)


@pytest.fixture(scope="module")
def found(models):
    """Pressure, friction, current of one call of the chain, in the shape of the conditions."""

    def run(effects: tuple[Effect, ...], conditions: Conditions) -> tuple[np.ndarray, ...]:
        d, table = models["reference"].description, models["reference"].table
        drive = conditions.drive()
        touch = prepare(d.values, d.dielectric, effects, drive)
        p_e, _ = solver.solve(table, touch.circuit)
        friction = cof(d.friction_law, d.values, touch, p_e, drive.normal_force_n)
        total = touch.circuit.load_pa + p_e + touch.circuit.added_pa
        per_m = sliding_admittance_per_m(table, touch.circuit, total)
        admittance = np.abs(per_m * touch.omega).sum(axis=1)
        return p_e.reshape(touch.shape), friction, admittance.reshape(touch.shape)

    return run


def at(effect: type[Effect], x: np.ndarray) -> Effect:
    """An effect as strong as each of `x`, in standard deviations of its prior."""
    return effect(**{p.name: p.from_normal(x) for p in effect.parameters()})


@every_effect
def test_many_values_at_once_are_those_one_by_one(effect, found, median, biased):
    x = np.array([-1.0, 0.0, 0.5, 1.2])
    together = found((at(effect, x[:, None]),), biased)
    for i in range(x.size):
        alone = found((median(effect, x[i]),), biased)
        for many, one in zip(together, alone, strict=True):
            row = np.broadcast_to(many, (x.size, many.shape[-1]))[i]
            np.testing.assert_allclose(row, one, rtol=1e-9)  # the loop is closed to 1e-10


def test_all_effects_at_once_take_many_values(found, median, unbiased):
    x = np.linspace(-0.4, 0.4, 3)
    together = found(tuple(at(effect, x[:, None]) for effect in CATALOGUE), unbiased)
    for many in together:
        assert many.shape == (3, 45)
        assert np.isfinite(many).all()
    alone = found(tuple(median(effect, x[2]) for effect in CATALOGUE), unbiased)
    np.testing.assert_allclose(together[1][2], alone[1], rtol=1e-9)


@pytest.fixture(scope="module")
def alone(with_effects, median, both_kinds):
    """What each effect at its medians answers, without bias and with."""
    models = {kind.name: with_effects(median(kind)) for kind in CATALOGUE}
    return {name: [model.predict(c) for c in both_kinds] for name, model in models.items()}


def alternating(conditions: Conditions) -> np.ndarray:
    """Touches [n] without direct voltage."""
    offset_v = 0.0 if conditions.voltage_offset_v is None else conditions.voltage_offset_v
    return (conditions.waveform != "dc") & (offset_v == 0.0)


@every_effect
class TestAnswers:
    def test_alone_it_loses_none_but_of_direct_voltage(self, effect, alone, both_kinds):
        for conditions, got in zip(both_kinds, alone[effect.name], strict=True):
            lost = np.isnan(got.cof)
            assert not lost[alternating(conditions)].any()
            assert not got.within_theory[lost].any()  # it says so

    def test_no_pair_loses_more(self, effect, with_effects, median, alone, both_kinds):
        """Than of direct voltage, and that only where one of the two loses some alone."""
        for i, conditions in enumerate(both_kinds):
            always = alternating(conditions)
            assert always.sum() > 5
            for one, other in PAIRS:
                if one is effect:
                    got = with_effects(median(one), median(other)).predict(conditions)
                    each = [alone[kind.name][i].cof for kind in (one, other)]
                    asked = always if np.isnan(each).any() else np.full(45, True)
                    for f in (f for f in fields(Prediction) if f.name != "notes"):
                        said = (other.name, f.name)
                        assert np.isfinite(getattr(got, f.name)[asked]).all(), said
                    assert (got.cof[asked] > 0.0).all(), other.name


class TestOrder:
    @every_effect
    def test_is_free_unless_said_otherwise(self, effect, with_effects, median, unbiased):
        for one, other in PAIRS:
            if one is effect and frozenset((one.name, other.name)) not in ORDERED:
                first, second = median(one, 0.8), median(other, 0.8)
                here = with_effects(first, second).predict(unbiased)
                there = with_effects(second, first).predict(unbiased)
                assert_same(here, there, 1e-9)  # the loop is closed to 1e-10

    @pytest.mark.parametrize("pair", sorted(tuple(sorted(p)) for p in ORDERED), ids="-".join)
    def test_matters_where_it_is_said(self, pair, found, unbiased):
        """At some strengths of the two."""
        x, y = (grid.reshape(-1, 1) for grid in np.meshgrid(STRENGTHS, STRENGTHS))
        first, second = at(BY_NAME[pair[0]], x), at(BY_NAME[pair[1]], y)
        here, there = (found(on, unbiased)[1] for on in ((first, second), (second, first)))
        assert np.nanmax(np.abs(here / there - 1.0)) > 1e-9
