import itertools
from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest

from model import solver
from model.conditions import Conditions
from model.effects import BY_NAME, CATALOGUE, Effect, EffectParameter
from model.electric.current import sliding_admittance_per_m
from model.touch_model import Prediction, cof, prepare

NAMES = [
    "amplifier_bandwidth", "amplifier_slew_limit", "drive_gain_error", "series_resistance", "floating_body",
    "skin_hydration", "skin_nonlinearity", "johnsen_rahbek", "electrode_polarization", "humid_gap_conduction",
    "sweat_film", "speed_dependent_gap", "trapped_charge", "air_breakdown", "capillary_adhesion", "electrowetting",
    "load_dependent_friction", "velocity_dependent_friction", "contact_ageing", "viscoelastic_skin",
]  # fmt: skip
STAGES = [
    "drive", "drive", "drive", "stack", "stack", "stack", "stack", "stack", "air gap", "air gap", "air gap", "air gap",
    "pressure", "pressure", "load", "load", "friction", "friction", "friction", "contact",
]  # fmt: skip
UNITS = {
    "cutoff_hz": "Hz", "slew_rate_v_per_s": "V/s", "resistance_ohm": "ohm", "body_capacitance_f": "F",
    "voltage_scale_v": "V", "insulator_conductivity_s_per_m": "S/m", "transfer_resistance_ohm_m2": "ohm m^2",
    "admittance_s_sn_per_m2": "S s^n/m^2", "gap_conductivity_s_per_m": "S/m", "sweat_conductivity_s_per_m": "S/m",
    "lift_m": "m", "gap_m": "m", "speed_scale_m_s": "m/s", "surface_voltage_v": "V", "breakdown_field_v_per_m": "V/m",
    "pressure_pa": "Pa", "coefficient_pa_per_v2": "Pa/V^2", "saturation_v": "V", "time_constant_s": "s",
}  # fmt: skip
EVERY_PARAMETER = [pytest.param(p, id=f"{e.name}.{p.name}") for e in CATALOGUE for p in e.parameters()]
every_effect = pytest.mark.parametrize("effect", CATALOGUE, ids=NAMES)

# Pairs whose order counts: a clipped amplitude before or after it is changed; a share of sweat in air that conducts
# before or after; and the skin's share of the voltage before or after another layer, or the gap, changes.
ORDERED = {
    frozenset(pair)
    for pair in [
        ("amplifier_bandwidth", "amplifier_slew_limit"),
        ("amplifier_slew_limit", "drive_gain_error"),
        ("humid_gap_conduction", "sweat_film"),
        ("skin_nonlinearity", "series_resistance"),
        ("skin_nonlinearity", "floating_body"),
        ("skin_nonlinearity", "skin_hydration"),
        ("skin_nonlinearity", "johnsen_rahbek"),
        ("skin_nonlinearity", "humid_gap_conduction"),
        ("skin_nonlinearity", "sweat_film"),
    ]
}


def assert_same(one: Prediction, other: Prediction, rtol: float) -> None:
    for f in fields(Prediction):
        np.testing.assert_allclose(getattr(one, f.name), getattr(other, f.name), rtol=rtol, err_msg=f.name)


def test_the_catalogue_holds_the_twenty_in_their_order() -> None:
    assert [e.name for e in CATALOGUE] == NAMES
    assert [e.stage for e in CATALOGUE] == STAGES
    assert list(BY_NAME.items()) == list(zip(NAMES, CATALOGUE, strict=True))


@every_effect
def test_every_effect_says_what_it_is(effect: type[Effect]) -> None:
    assert effect.physics
    assert effect.source
    assert effect.signature
    assert effect.check
    assert 1 <= len(effect.parameters()) <= 3
    assert [p.name for p in effect.parameters()] == [f.name for f in fields(effect)]
    assert set(effect.needs) <= {"speed_m_s", "time_s"}


@every_effect
def test_every_effect_acts_at_its_stage_alone(effect: type[Effect]) -> None:
    """What is overridden: the fields of no other stage."""
    methods = {name for name in ("drive", "stack", "contact", "friction") if name in vars(effect)}
    expected = {
        "speed_dependent_gap": {"contact"},
        "trapped_charge": {"drive"},
        "air_breakdown": {"contact"},
        "capillary_adhesion": {"contact"},
        "electrowetting": {"contact"},
    }.get(effect.name, {"stack"} if effect.stage == "air gap" else {effect.stage})
    assert methods == expected


@pytest.mark.parametrize("parameter", EVERY_PARAMETER)
class TestParameters:
    def test_bounds_prior_and_off_value_are_sound(self, parameter: EffectParameter) -> None:
        p = parameter
        assert np.isfinite([p.low, p.high, p.median, p.std]).all()
        assert p.low < p.median < p.high
        assert p.std > 0.0
        assert p.unit == UNITS.get(p.name, "1")
        assert p.scale in ("log", "linear")
        if p.scale == "log":
            assert p.low > 0.0
            assert p.off in (0.0, np.inf) or p.low <= p.off <= p.high  # the limits that a logarithm nears
        else:
            assert p.low <= p.off <= p.high

    def test_three_standard_deviations_move_it(self, parameter: EffectParameter) -> None:
        values = parameter.from_normal(np.array([-3.0, -1.0, 0.0, 1.0, 3.0]))
        assert values[2] == parameter.median
        assert (np.diff(values) >= 0.0).all()
        assert values[1] < values[2] < values[3]
        step = values[3] / values[2] if parameter.scale == "log" else values[3] - values[2]
        expected = np.exp(parameter.std) if parameter.scale == "log" else parameter.std
        assert step == pytest.approx(expected, rel=1e-12)  # rounding
        np.testing.assert_array_equal(
            parameter.from_normal(np.array([-1e6, 1e6])), [parameter.low, parameter.high]
        )  # never out of bounds


@every_effect
class TestOff:
    def test_the_base_model_comes_back(self, effect, with_effects, models, unbiased, biased) -> None:
        off = with_effects(effect.off())
        for conditions in (unbiased, biased):
            got, base = (m.predict(conditions) for m in (off, models["reference"]))
            assert_same(got, base, 1e-12)
            assert np.isfinite(base.cof).all()

    def test_without_speed_time_or_waveforms_too(self, effect, with_effects, models, unbiased) -> None:
        plain = replace(unbiased, waveform=None, speed_m_s=None, time_s=None)
        assert_same(with_effects(effect.off()).predict(plain), models["reference"].predict(plain), 1e-12)

    def test_an_off_effect_leaves_another_alone(self, effect, with_effects, median, biased) -> None:
        for other in ("skin_hydration", "sweat_film", "capillary_adhesion"):
            both = with_effects(effect.off(), median(BY_NAME[other], 0.5)).predict(biased)
            if other != effect.name:
                assert_same(both, with_effects(median(BY_NAME[other], 0.5)).predict(biased), 1e-12)

    def test_a_standard_deviation_from_the_prior_median_changes_something(
        self, effect, with_effects, models, median, unbiased
    ) -> None:
        base = models["reference"].predict(unbiased).cof
        moved = [with_effects(median(effect, x)).predict(unbiased).cof for x in (-1.0, 1.0)]
        assert np.nanmax(np.abs(np.array(moved) / base - 1.0)) > 1e-4


@pytest.mark.parametrize("table", ["reference", "table1"])
def test_no_effect_is_no_effect(models, with_effects, biased, table: str) -> None:
    assert_same(with_effects(Effect(), base=models[table]).predict(biased), models[table].predict(biased), 0.0)


@pytest.fixture(scope="module")
def found(models) -> Callable[..., tuple]:
    """Pressure, friction, current of one call of the chain, in the shape of the conditions."""

    def run(effects: tuple[Effect, ...], conditions: Conditions) -> tuple[np.ndarray, ...]:
        d, table = models["reference"].description, models["reference"].table
        drive = conditions.drive()
        touch = prepare(d.values, d.dielectric, effects, drive)
        p_e, _ = solver.solve(table, touch.circuit)
        friction = cof(d.friction_law, d.values, touch, p_e, drive.normal_force_n)
        total = touch.circuit.load_pa + p_e + touch.circuit.added_pa
        admittance = np.abs(sliding_admittance_per_m(table, touch.circuit, total) * touch.omega).sum(axis=1)
        return p_e.reshape(touch.shape), friction, admittance.reshape(touch.shape)

    return run


@every_effect
def test_many_values_at_once_are_those_one_by_one(effect, found, biased) -> None:
    x = np.array([-1.0, 0.0, 0.5, 1.2])
    values = {p.name: p.from_normal(x) for p in effect.parameters()}
    together = found((effect(**{k: v[:, None] for k, v in values.items()}),), biased)
    for i in range(x.size):
        alone = found((effect(**{k: float(v[i]) for k, v in values.items()}),), biased)
        for many, one in zip(together, alone, strict=True):
            row = np.broadcast_to(many, (x.size, many.shape[-1]))[i]
            np.testing.assert_allclose(row, one, rtol=1e-9)  # the loop is closed to 1e-10


def test_all_effects_at_once_take_many_values(found, unbiased) -> None:
    shifts = np.linspace(-0.4, 0.4, 3)[:, None]
    many = tuple(e(**{p.name: p.from_normal(shifts) for p in e.parameters()}) for e in CATALOGUE)
    p_e, cof, current = found(many, unbiased)
    assert p_e.shape == cof.shape == current.shape == (3, 45)
    assert np.isfinite(p_e).all()
    assert np.isfinite(cof).all()
    assert np.isfinite(current).all()
    alone = tuple(e(**{p.name: float(p.from_normal(shifts[2, 0])) for p in e.parameters()}) for e in CATALOGUE)
    np.testing.assert_allclose(cof[2], found(alone, unbiased)[1], rtol=1e-9)


PAIRS = list(itertools.combinations(CATALOGUE, 2))


class TestPairs:
    def test_there_are_190(self) -> None:
        assert len(PAIRS) == 190

    @every_effect
    def test_at_their_medians_no_pair_loses_an_answer(self, effect, with_effects, median, unbiased, biased) -> None:
        """But of direct voltage on an insulator that conducts: there the contact pulls in from a few volts on."""
        for conditions in (unbiased, biased):
            offset = np.zeros(45) if conditions.voltage_offset_v is None else conditions.voltage_offset_v
            alternating = (conditions.waveform != "dc") & (offset == 0.0)
            assert alternating.sum() > 5
            for one, other in PAIRS:
                if one is effect:
                    got = with_effects(median(one), median(other)).predict(conditions)
                    asked = alternating if "johnsen_rahbek" in (one.name, other.name) else np.full(45, True)
                    for f in (f for f in fields(Prediction) if f.name != "notes"):
                        assert np.isfinite(getattr(got, f.name)[asked]).all(), (other.name, f.name)
                    assert (got.cof[asked] > 0.0).all(), other.name

    @every_effect
    def test_the_order_does_not_matter(self, effect, with_effects, median, unbiased) -> None:
        for one, other in PAIRS:
            if one is effect and frozenset((one.name, other.name)) not in ORDERED:
                first, second = median(one, 0.8), median(other, 0.8)
                here = with_effects(first, second).predict(unbiased)
                there = with_effects(second, first).predict(unbiased)
                assert_same(here, there, 1e-9)  # the loop is closed to 1e-10

    @pytest.mark.parametrize("pair", sorted(tuple(sorted(p)) for p in ORDERED), ids="-".join)
    def test_where_order_matters_the_catalogue_decides(self, pair, with_effects, median, unbiased) -> None:
        moved = {
            "amplifier_bandwidth": BY_NAME["amplifier_bandwidth"](cutoff_hz=3e5, order=2.0),
            "sweat_film": BY_NAME["sweat_film"](share=0.1, sweat_conductivity_s_per_m=1.0, arrangement=0.5),
            "amplifier_slew_limit": BY_NAME["amplifier_slew_limit"](slew_rate_v_per_s=1e5),
            "drive_gain_error": BY_NAME["drive_gain_error"](gain=2.0),
        }
        first, second = (moved.get(n) or median(BY_NAME[n], 0.8) for n in sorted(pair, key=NAMES.index))
        here = with_effects(first, second).predict(unbiased).cof
        there = with_effects(second, first).predict(unbiased).cof
        assert np.nanmax(np.abs(here / there - 1.0)) > 1e-9
