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
