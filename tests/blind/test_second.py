"""Second alternatives and strangers: their limits, and that nothing else makes quite the same."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from .generator import designs, families, nuisance, touch, visibility, witnesses
from .generator.__main__ import main
from .generator.effects import (
    ALTERNATIVE,
    CATALOGUE,
    CATALOGUE_EFFECTS,
    FIRST_STRANGERS,
    SECOND,
    SECOND_STRANGERS,
    drawn,
)
from .generator.electrode import Rig, observe
from .generator.visibility import Whitener

EFFECTS = list(CATALOGUE_EFFECTS)
# Of the logarithm of friction, at the row that changes most: 0.1, but the force hardly depends on
# the area that it acts over.
VISIBLE = {"contact_area_law": 0.03}
ELSEWHERE = 4e-4  # share of a trace's square: 2 % of it are no other form's, at any strength
CLEAR = 100.0  # lambda: ten standard deviations
NOISE = {"cof": 0.015, "current": 0.02, "current_phase": 0.03, "voltage": 0.006, "phase": 0.008}


def state_of(f=250.0, v=75.0, n=0.5, speed=touch.STEADY_SPEED, time=0.0) -> touch.State:
    given = (np.atleast_1d(np.asarray(x, float)) for x in (f, v, n, speed, time))
    rows = touch.Rows(*(column.copy() for column in np.broadcast_arrays(*given)))
    return touch.prepare(rows, touch.Finger(), touch.Roughness())


def changed(name: str, strength: float, shape: dict, form: str = SECOND, **rows) -> touch.State:
    """The state that an effect of this shape leaves."""
    effect, state = CATALOGUE_EFFECTS[name], state_of(**rows)
    if form == SECOND:
        effect.second.apply(state, strength, shape)
    else:
        effect.apply(state, strength, shape, form == ALTERNATIVE)
    return state


def gain(state: touch.State) -> np.ndarray:
    return state.drive / state.rows.v * np.exp(1j * state.drive_phase)


def impedance(state: touch.State) -> np.ndarray:
    """What stands in series with the touch, ohm."""
    return state.stack_add / (1j * state.omega * touch.VACUUM * touch.AREA)


@pytest.mark.parametrize("order", [2, 3, 4])
def test_a_bessel_filter_is_a_delay_and_has_lost_3_db_at_its_corner(order):
    f = np.array([1.0, 300.0, 600.0, 3e3])
    got = gain(changed("amplifier_bandwidth", 1e6 / 3e3, {"order": order}, f=f))
    assert abs(got[-1]) ** 2 == pytest.approx(0.5, rel=1e-3)  # corners are given with five digits
    lag = -np.angle(got[:3]) / f[:3]
    assert lag == pytest.approx(np.full(3, lag[0]), rel=0.01)


def test_a_soft_slew_limit_ends_in_a_triangle_and_begins_as_a_pole():
    slew, wide = 1e5, {"range_v": 0.3}
    far = changed("amplifier_slew_limit", 5e8 / slew, wide, f=1e4, v=100.0)
    assert far.drive == pytest.approx(8 / np.pi**2 * slew / (4 * 1e4), rel=1e-3)
    f = np.array([1e3, 1e5])
    near = gain(changed("amplifier_slew_limit", 5e8 / slew, wide, f=f, v=1e-3))
    assert near == pytest.approx(1 / (1 + 2j * np.pi * f * 0.3 / slew), rel=1e-3)


def test_a_body_of_iec_60990_falls_from_its_resistance_to_a_quarter():
    z = impedance(changed("series_resistance", 8e3, {}, f=[0.01, 1e7]))
    assert z == pytest.approx([8e3, 2e3], rel=1e-3)


def test_a_shoe_conducts_below_its_corner_and_the_body_holds_above():
    z = impedance(changed("floating_body", 50.0, {"shoe_hz": 100.0}, f=[0.01, 1e6]))
    farad = 1e-8 / 50.0
    assert z[0] == pytest.approx(1 / (2 * np.pi * 100.0 * farad), rel=1e-3)
    assert z[1] == pytest.approx(1 / (2j * np.pi * 1e6 * farad), rel=1e-3)


def test_fully_wet_skin_has_the_catalogue_s_factors_and_is_swollen():
    wet, dry = changed("skin_hydration", 1.0, {}), changed("skin_hydration", 1.0, {}, CATALOGUE)
    assert wet.k_skin == pytest.approx(dry.k_skin)
    assert wet.skin_stack(wet.k_skin) == pytest.approx(1.25 * touch.Finger().skin / dry.k_skin)


def test_skin_in_a_strong_field_saturates_and_in_a_weak_one_follows_the_square():
    law = changed("skin_nonlinearity", 10.0, {"most": 7.0}).skin_law
    assert law(np.array([0.1, 1e6])) == pytest.approx([1 + 1e-4, 8.0], rel=1e-4)


@pytest.mark.parametrize(
    ("name", "shape", "strength", "what", "rows"),
    [
        ("johnsen_rahbek", {"n": 0.7, "f_c": 1e9}, 1e-8, "k_insulator", {"f": [10.0, 1e3]}),
        (
            "electrode_polarization",
            {"n": 0.7, "r_ct": 0.1, "tau_s": 1e6},
            1e-4,
            "gap_admittance",
            {},
        ),
        ("humid_gap_conduction", {"power": 0.6}, 1e-8, "k_gap", {"n": 0.5}),
        ("trapped_charge", {"at_rest": 0.5, "power": 0.3}, 20.0, "bias_square", {"n": 0.5}),
        ("capillary_adhesion", {"slope": 0.3}, 500.0, "load_add", {"n": [0.3, 1.0]}),
        ("electrowetting", {"v_sat": 1e4, "f_c": 1e6}, 0.1, "load_add", {"v": [1.0, 100.0]}),
        ("velocity_dependent_friction", {"v_peak": 0.1, "sign": 1.0}, 0.3, "mu_factor", {}),
        ("viscoelastic_skin", {"v_c": 0.1}, 0.3, "stiffness", {}),
        ("contact_area_law", {}, 0.3, "spread", {"n": [0.5]}),
    ],
)
def test_a_limit_is_the_catalogue_s_form(name, shape, strength, what, rows):
    forms = (SECOND, CATALOGUE)
    second, first = (getattr(changed(name, strength, shape, f, **rows), what) for f in forms)
    base = getattr(state_of(**rows), what)
    assert second - base == pytest.approx(first - base, rel=2e-3, abs=1e-12)


def test_a_wetting_film_fills_narrow_gaps_and_keeps_its_depth_in_wide_ones():
    film = changed("sweat_film", 1e-7, {"sigma_s": 0.3}).film
    assert film(np.array([[1e-10, 1e-4]])) == pytest.approx(np.array([[1e-10, 1e-7]]), rel=2e-3)


def test_a_film_that_is_drawn_along_goes_as_speed_to_two_thirds():
    lift = changed("speed_dependent_gap", 1e-7, {}, speed=[0.0, 0.02, 0.16]).gap_add
    assert lift == pytest.approx([0.0, 1e-7, 4e-7])


def test_charge_acts_at_rest_by_its_share():
    shape = {"at_rest": 0.3, "power": 0.3}
    charge = changed("trapped_charge", 20.0, shape, v=[75.0, 0.0]).bias_square
    assert charge == pytest.approx([400.0, 120.0])


def test_narrow_air_holds_more():
    cap = changed("air_breakdown", 20.0, {}).field_cap
    held = cap(np.full(3, 1e12), np.array([1e-6, 40e-6, 1.0]))
    assert held == pytest.approx([2.66e8, 5e7, 9.57e6], rel=5e-3)
    assert cap(np.full(1, 1e3), np.array([40e-6])) == pytest.approx(1e3)


def test_bridges_pull_less_at_speed():
    speed = 0.02 * np.exp([-1.0, 0.0, 1.0])
    pull = changed("capillary_adhesion", 500.0, {"slope": 0.3}, speed=speed).load_add
    assert pull == pytest.approx([650.0, 500.0, 350.0])


def test_electrowetting_ends_at_its_saturation():
    shape = {"v_sat": 50.0, "f_c": 1e9}
    pull = changed("electrowetting", 0.1, shape, v=1e5).load_add
    assert pull == pytest.approx(0.1 * 50.0**2, rel=1e-5)


@pytest.mark.parametrize(("bulge_n", "power"), [(1e5, 1.0), (1e-9, 0.8)])
def test_friction_goes_from_proportional_to_a_power(bulge_n, power):
    law = changed("load_dependent_friction", 0.2, {"sign": 1.0, "bulge_n": bulge_n}).load_law
    load, extra = np.array([0.3, 1.0]), np.array([0.1, 0.2])
    assert law(load, extra) == pytest.approx(0.5 / load * ((load + extra) / 0.5) ** power, rel=5e-3)


def test_a_touch_that_saturates_has_the_power_s_slope_at_the_reference_load():
    spread = changed("contact_area_law", 0.4, {}, n=[0.5, 0.505, 1e6]).spread
    assert np.log(spread[1] / spread[0]) / np.log(1.01) == pytest.approx(0.4, rel=5e-3)
    assert spread[2] == pytest.approx(1 / 0.6, rel=1e-5)


def test_absorbed_charge_screens_what_its_volts_inject():
    shape = {"tau_s": 0.5, "end_s": 20.0, "f_b": 10.0, "v_half": 25.0}
    rows = {"f": [1e-6, 1e-6, 1e9], "v": [75.0, 75.0, 75.0], "time": [0.0, 1e9, 1e9]}
    kept = changed("charge_build_up", 0.4, shape, **rows).kept
    assert kept == pytest.approx([1.0, 1 - 0.4 * 0.75, 1.0], rel=1e-5)


def test_ageing_begins_as_a_logarithm_and_ends():
    shape = {"tau_s": 10.0, "end_s": 1000.0, "sign": -1.0}
    aged = changed("contact_ageing", 0.4, shape, time=[0.0, 10.0, 1e9]).mu_factor
    assert aged == pytest.approx([1.0, 1 - 0.4 * np.log(2) / np.log(101), 0.6], rel=2e-3)


def trace(design, hidden) -> np.ndarray:
    base = visibility.clean_friction(design, nuisance.REFERENCE, ())
    return np.log(visibility.clean_friction(design, nuisance.REFERENCE, (hidden,)) / base)


def left_over(of: np.ndarray, others: np.ndarray) -> float:
    """Share of a trace's square that no multiple of one of the others has."""
    length = np.maximum(np.einsum("ij,ij->i", others, others), 1e-300)
    return float(1 - np.max((others @ of) ** 2 / length) / (of @ of))


@pytest.mark.parametrize("name", EFFECTS)
def test_no_strength_of_the_first_forms_is_the_second(name):
    design, effect = designs.rich(np.random.default_rng(1)), CATALOGUE_EFFECTS[name]
    second = drawn(effect, np.random.default_rng(2), SECOND)
    traces = (trace(design, second.at(strength)) for strength in np.geomspace(*second.knob, 25))
    of = next(one for one in traces if np.abs(one).max() > VISIBLE.get(name, 0.1))
    others = [
        trace(design, drawn(effect, np.random.default_rng(draw), form).at(strength))
        for form in (CATALOGUE, ALTERNATIVE)
        for draw in range(2)
        for strength in np.geomspace(*effect.knob, 4)
    ]
    assert left_over(of, np.array(others)) > ELSEWHERE


@pytest.fixture(scope="module")
def seen():
    """Traces over all witnesses, whitened, less what finger, rig and gains of sessions take up."""
    design = designs.witnesses(np.random.default_rng(1))
    finger, rig = touch.Finger(), Rig()
    base = witnesses.stacked(observe(design, finger, rig, ()))

    def whole(finger, rig, hidden=()):
        parts = []
        for name, values in witnesses.stacked(observe(design, finger, rig, hidden)).items():
            there = np.isfinite(base[name])
            session = design.session[there]
            groups = tuple(np.flatnonzero(session == s) for s in np.unique(session))
            sigma = np.full(session.size, NOISE[name])
            white = Whitener(sigma, groups, witnesses.GAIN_SD[name])
            parts.append(white((values - base[name])[there]))
        return np.concatenate(parts)

    step = 0.02

    def moved(one, name):
        return replace(one, **{name: getattr(one, name) * (1 + step)})

    fingers = [moved(finger, name) for name in ("h_rms", "skin", "leak", "mu_off", "area")]
    rigs = [moved(rig, name) for name in ("stray_f", "softness")]
    tangent = np.array([whole(one, rig) for one in fingers] + [whole(finger, one) for one in rigs])
    basis = np.linalg.qr(tangent.T)[0]

    def beside(hidden):
        got = whole(finger, rig, (hidden,))
        return got - basis @ (basis.T @ got)

    known = [
        beside(drawn(effect, np.random.default_rng(draw)).at(strength))
        for effect in CATALOGUE_EFFECTS.values()
        for draw in range(2)
        for strength in np.geomspace(*effect.knob, 5)[1:-1]
    ]
    return SimpleNamespace(beside=beside, known=np.array(known))


@pytest.mark.parametrize("name", list(SECOND_STRANGERS))
def test_no_effect_of_the_catalogue_is_a_stranger(seen, name):
    hidden = drawn(SECOND_STRANGERS[name], np.random.default_rng(2))
    traces = (seen.beside(hidden.at(strength)) for strength in np.geomspace(*hidden.knob, 13))
    of = next(one for one in traces if one @ one > CLEAR)
    assert left_over(of, seen.known) > 0.1


def test_the_preceding_row_is_of_the_same_session():
    design = designs.timed(np.random.default_rng(4))
    for session in np.unique(design.session):
        mine = design.session == session
        order = np.argsort(design.rows.time[mine])
        v, before = design.rows.v[mine][order], design.rows.before[mine][order]
        assert before[0] == 0.0
        assert np.array_equal(before[1:], v[:-1])


def test_second_sets_have_the_promised_mix():
    first = families.specs(3, 1.0, counts=families.SECOND_COUNTS)
    wanted = [families.anew(spec) for spec in first]
    names = [name for spec in wanted for name, _ in spec.effects]
    single = [spec.effects[0][0] for spec in wanted if spec.family == "W1"]
    assert len(wanted) == 126
    assert {single.count(name) for name in EFFECTS} == {3}
    assert min(names.count(name) for name in SECOND_STRANGERS) >= 2
    assert not set(names) & set(FIRST_STRANGERS)
    assert {spec.form for spec in wanted if spec.family != "W4"} == {SECOND}
    assert [[level for _, level in spec.effects] for spec in wanted] == [
        [level for _, level in s.effects] for s in first
    ]


def test_the_command_writes_second_forms_and_strangers_alone(tmp_path):
    sets = ["--seed", "4", "--second", "--counts", "W1=1,W4=1", "--workers", "1"]
    main(["--out", str(tmp_path), *sets])
    labels = json.loads((tmp_path / "labels.json").read_text()).values()
    assert sorted(label["witnesses"] for label in labels) == ["all", "all", "friction", "friction"]
    hidden = {label["effects"][0]["name"]: label["effects"][0] for label in labels}
    strange = [name for name, effect in hidden.items() if effect["stranger"]]
    assert len(strange) == 1
    assert set(strange) <= set(SECOND_STRANGERS)
    assert {hidden[name]["form"] for name in hidden if name not in strange} == {SECOND}
