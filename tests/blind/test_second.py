"""Second and third alternatives and strangers: their limits, and that nothing else makes quite the
same.
"""

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
    FORMS,
    SECOND,
    SECOND_STRANGERS,
    THIRD,
    THIRD_STRANGERS,
    drawn,
)
from .generator.electrode import Rig, observe
from .generator.visibility import Whitener

EFFECTS = list(CATALOGUE_EFFECTS)
STRANGERS = {SECOND: SECOND_STRANGERS, THIRD: THIRD_STRANGERS}
EACH = pytest.mark.parametrize("form", STRANGERS)
# Of the logarithm of friction, at the row that changes most: 0.1, but the force hardly depends on
# the area that it acts over.
VISIBLE = {"contact_area_law": 0.03}
ELSEWHERE = 4e-4  # share of a trace's square: 2 % of it are no other form's, at any strength
CLEAR = 100.0  # lambda: ten standard deviations
NOISE = {"cof": 0.015, "current": 0.02, "current_phase": 0.03, "voltage": 0.006, "phase": 0.008}

LOW, SMALL = {"f": [10.0, 1e3]}, {"v": [1.0, 100.0]}
CONSTANT, SIGN = {"n": 0.7, "r_ct": 0.1}, {"sign": 1.0}


def state_of(f=250.0, v=75.0, n=0.5, speed=touch.STEADY_SPEED, time=0.0) -> touch.State:
    given = (np.atleast_1d(np.asarray(x, float)) for x in (f, v, n, speed, time))
    rows = touch.Rows(*(column.copy() for column in np.broadcast_arrays(*given)))
    return touch.prepare(rows, touch.Finger(), touch.Roughness())


def changed(name: str, strength: float, shape: dict, form: str, **rows) -> touch.State:
    """The state that an effect of this shape leaves."""
    effect, state = CATALOGUE_EFFECTS[name], state_of(**rows)
    if form in effect.own:
        effect.own[form].apply(state, strength, shape)
    else:
        effect.apply(state, strength, shape, form == ALTERNATIVE)
    return state


@pytest.mark.parametrize(
    ("only", "name", "shape", "strength", "what", "rows"),
    [
        ("", "johnsen_rahbek", {"n": 0.7, "f_c": 1e9, "barrier": 0}, 1e-8, "k_insulator", LOW),
        (SECOND, "electrode_polarization", CONSTANT | {"tau_s": 1e6}, 1e-4, "gap_admittance", {}),
        (THIRD, "electrode_polarization", CONSTANT | {"tau_s": 1e-12}, 1e-4, "gap_admittance", {}),
        ("", "humid_gap_conduction", {"power": 0.6, "v_sat": 1e9}, 1e-8, "k_gap", {}),
        ("", "trapped_charge", {"at_rest": 0.5, "power": 0.3}, 20.0, "bias_square", {}),
        ("", "capillary_adhesion", {"slope": 0.3, "v_c": 1e9}, 500.0, "load_add", {"n": [0.3, 1]}),
        ("", "electrowetting", {"v_sat": 1e4, "f_c": 1e6, "floor": 0}, 0.1, "load_add", SMALL),
        (
            "",
            "velocity_dependent_friction",
            SIGN | {"v_peak": 0.1, "v0": 0.1},
            0.3,
            "mu_factor",
            {},
        ),
        ("", "viscoelastic_skin", {"v_c": 0.1, "v_slow": 0.01, "v_fast": 1}, 0.3, "stiffness", {}),
        ("", "contact_area_law", {"f_0": 0.1}, 0.3, "spread", {}),
        (THIRD, "amplifier_bandwidth", {"order": 1, "load": 1e6}, 1e3, "drive", {"f": [500, 1e4]}),
        (THIRD, "amplifier_slew_limit", {"v_p": 1e6}, 1e3, "drive", {"f": [1e4, 1e5]}),
        (THIRD, "drive_gain_error", SIGN | {"share": 0, "f_p": 1e3}, 0.3, "drive", LOW),
        (THIRD, "series_resistance", {"c_touch": 1e-15}, 1e6, "stack_add", LOW),
        (THIRD, "floating_body", {"share": 1.0, "f_r": 1e-9}, 100.0, "stack_add", LOW),
    ],
)
def test_a_limit_is_the_catalogue_s_form(only, name, shape, strength, what, rows):
    base = getattr(state_of(**rows), what)
    first = getattr(changed(name, strength, shape, CATALOGUE, **rows), what)
    for form in [only] if only else STRANGERS:
        own = getattr(changed(name, strength, shape, form, **rows), what)
        assert own - base == pytest.approx(first - base, rel=2e-3, abs=1e-12), form


@pytest.fixture(scope="module")
def trace():
    """What of friction a hidden effect changes, in a rich design."""
    design = designs.rich(np.random.default_rng(1))
    base = visibility.clean_friction(design, nuisance.REFERENCE, ())

    def of(hidden) -> np.ndarray:
        return np.log(visibility.clean_friction(design, nuisance.REFERENCE, (hidden,)) / base)

    return of


def left_over(of: np.ndarray, others: np.ndarray) -> float:
    """Share of a trace's square that no multiple of one of the others has."""
    length = np.maximum(np.einsum("ij,ij->i", others, others), 1e-300)
    return float(1 - np.max((others @ of) ** 2 / length) / (of @ of))


@EACH
@pytest.mark.parametrize("name", EFFECTS)
def test_no_strength_of_earlier_forms_is_this(trace, name, form):
    effect = CATALOGUE_EFFECTS[name]
    own = drawn(effect, np.random.default_rng(2), form)
    traces = (trace(own.at(strength)) for strength in np.geomspace(*own.knob, 25))
    of = next(one for one in traces if np.abs(one).max() > VISIBLE.get(name, 0.1))
    others = [
        trace(other.at(strength))
        for earlier in FORMS[: FORMS.index(form)]
        for other in (drawn(effect, np.random.default_rng(draw), earlier) for draw in range(2))
        for strength in np.geomspace(*other.knob, 4)
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


@pytest.mark.parametrize("name", [*SECOND_STRANGERS, *THIRD_STRANGERS])
def test_no_effect_of_the_catalogue_is_a_stranger(seen, name):
    hidden = drawn((SECOND_STRANGERS | THIRD_STRANGERS)[name], np.random.default_rng(2))
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


@EACH
def test_sets_have_the_promised_mix(form):
    first = families.specs(3, 1.0, counts=families.SECOND_COUNTS)
    wanted = [families.anew(spec, form) for spec in first]
    names = [name for spec in wanted for name, _ in spec.effects]
    single = [spec.effects[0][0] for spec in wanted if spec.family == "W1"]
    assert len(wanted) == 126
    assert {single.count(name) for name in EFFECTS} == {3}
    assert min(names.count(name) for name in STRANGERS[form]) >= 2
    assert not set(names) & set(FIRST_STRANGERS)
    assert {spec.form for spec in wanted if spec.family != "W4"} == {form}
    assert [[level for _, level in spec.effects] for spec in wanted] == [
        [level for _, level in s.effects] for s in first
    ]


def test_the_command_writes_one_form_and_its_strangers_alone(tmp_path):
    sets = ["--seed", "4", "--third", "--counts", "W1=1,W4=1", "--workers", "1"]
    main(["--out", str(tmp_path), *sets])
    labels = json.loads((tmp_path / "labels.json").read_text()).values()
    assert sorted(label["witnesses"] for label in labels) == ["all", "all", "friction", "friction"]
    hidden = {label["effects"][0]["name"]: label["effects"][0] for label in labels}
    strange = [name for name, effect in hidden.items() if effect["stranger"]]
    assert len(strange) == 1
    assert set(strange) <= set(THIRD_STRANGERS)
    assert {hidden[name]["form"] for name in hidden if name not in strange} == {THIRD}
