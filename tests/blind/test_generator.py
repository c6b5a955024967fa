"""The generator of blind sets: right physics, honest labels, nothing shared with the model it
tests.
"""

import hashlib
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from .generator import build, designs, families, nuisance, touch, visibility
from .generator.__main__ import csv_text, write
from .generator.effects import (
    ALTERNATIVE,
    CATALOGUE,
    CATALOGUE_EFFECTS,
    FORMS,
    STRANGERS,
    UNFELT,
    Hidden,
    drawn,
)

ROOT = Path(__file__).resolve().parents[2]
CONTRACT = {
    "frequency_hz",
    "voltage_v",
    "normal_force_n",
    "cof",
    "cof_std",
    "speed_m_s",
    "time_s",
    "session",
    "trial",
}
FELT = {"contact_area_law": 0.03}  # the force hardly depends on the area that it acts over
# published check values of the corrected model, code roughness: Hz, V, N, electrostatic force in N
FORCES = [
    (1.0, 10.0, 0.25, 0.00024370118),
    (10.0, 125.0, 0.25, 0.12934649),
    (50.0, 150.0, 1.0, 0.84366365),
    (250.0, 25.0, 1.0, 0.018102526),
    (250.0, 75.0, 0.5, 0.1008),
    (1e3, 125.0, 1.0, 0.63665429),
    (1e5, 100.0, 1.0, 0.15683543),
    (1e6, 25.0, 1.0, 0.0082651839),
]


def conditions(f, v, n, speed=0.02, time=0.0):
    columns = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(x, float)) for x in (f, v, n, speed, time))
    )
    return touch.Rows(*(column.copy() for column in columns))


def sight_of(name, seed=3, sigma=0.03):
    design = designs.DESIGNS[name](np.random.default_rng(seed))
    return visibility.Visibility(design, nuisance.REFERENCE, np.full(design.session.size, sigma))


@pytest.fixture(scope="module")
def small_sets():
    wanted = [
        build.Spec("F0", 0, design="paper"),
        build.Spec("F1", 0, (("trapped_charge", 50.0),), design="timed"),
    ]
    return [build.build(spec, 4) for spec in wanted]


def test_force_matches_reference_values():
    f, v, n, expected = np.array(FORCES).T
    force = touch.force(touch.prepare(conditions(f, v, n), touch.Finger(), touch.Roughness()))
    assert force == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", list(CATALOGUE_EFFECTS))
def test_off_strength_gives_base_and_small_strength_changes_little(name, form):
    design = designs.six_sessions(np.random.default_rng(1))
    effect = CATALOGUE_EFFECTS[name]
    hidden = drawn(effect, np.random.default_rng(2), form)
    base = visibility.clean_friction(design, nuisance.REFERENCE, ())
    assert np.array_equal(
        visibility.clean_friction(design, nuisance.REFERENCE, (hidden.at(0.0),)), base
    )
    weak, strong = (
        visibility.clean_friction(design, nuisance.REFERENCE, (hidden.at(hidden.knob[k]),))
        for k in (0, 1)
    )
    assert np.abs(np.log(weak / base)).max() < 0.05
    assert np.abs(np.log(strong / base)).max() > FELT.get(name, 0.05)
    assert np.all(np.isfinite(strong) & (strong > 0))


@pytest.mark.parametrize("name", list(CATALOGUE_EFFECTS))
def test_the_first_two_forms_differ(name):
    design = designs.six_sessions(np.random.default_rng(1))
    effect = CATALOGUE_EFFECTS[name]
    shape = effect.draw(np.random.default_rng(2))
    middle = float(np.sqrt(effect.knob[0] * effect.knob[1]))
    one, other = (
        visibility.clean_friction(
            design, nuisance.REFERENCE, (Hidden(effect, middle, shape, form),)
        )
        for form in (CATALOGUE, ALTERNATIVE)
    )
    assert np.abs(np.log(one / other)).max() > 1e-5


@pytest.mark.parametrize("name", [name for name in STRANGERS if name not in UNFELT])
def test_strangers_off_at_zero_and_visible_at_full(name):
    effect = STRANGERS[name]
    sight = sight_of("six_sessions")
    hidden = Hidden(effect, 0.0, effect.draw(np.random.default_rng(2)))
    assert sight.of((hidden,)) == pytest.approx(0.0, abs=1e-6)
    assert any(sight.of((hidden.at(s),)) > 40 for s in np.geomspace(*effect.knob[::-1], 6))


@pytest.mark.parametrize(
    ("name", "design", "target", "form"),
    [
        ("amplifier_bandwidth", "voltage_frequency", 100.0, "alternative"),
        ("contact_ageing", "timed", 25.0, "catalogue"),
        ("speed_dependent_gap", "speed_sweep", 75.0, "alternative"),
        ("load_dependent_friction", "factorial", 400.0, "catalogue"),
    ],
)
def test_bisection_hits_the_wanted_visibility(name, design, target, form):
    effect = CATALOGUE_EFFECTS[name]
    sight = sight_of(design)
    hidden, reached = sight.reach(
        Hidden(effect, 1.0, effect.draw(np.random.default_rng(5)), form), target
    )
    assert reached == pytest.approx(target, rel=0.1)
    assert sight.of((hidden,)) == pytest.approx(reached)


def test_nuisances_are_refitted_away():
    design = designs.factorial(np.random.default_rng(0))
    finger = replace(nuisance.REFERENCE, h_rms=22e-6, skin=230e-6, leak=0.7, mu_off=0.4)
    sight = visibility.Visibility(design, finger, np.full(design.session.size, 0.03))
    theta = visibility.coordinates(finger)
    assert 0 <= sight.null <= theta @ theta + 1e-6  # at worst the prior cost of the truth itself


def test_whitening_is_the_inverse_root_of_the_covariance():
    design = designs.paper(np.random.default_rng(0))
    sigma = np.linspace(0.02, 0.05, design.session.size)
    r = np.random.default_rng(1).normal(size=sigma.size)
    same = design.session[:, None] == design.session[None, :]
    covariance = np.diag(sigma**2) + nuisance.SESSION_GAIN_SD**2 * same
    white = visibility.whitener(design, sigma)(r)
    assert white @ white == pytest.approx(r @ np.linalg.solve(covariance, r), rel=1e-9)


def test_columns_are_those_of_the_contract(small_sets):
    for one in small_sets:
        assert list(one.columns)[:4] == ["frequency_hz", "voltage_v", "normal_force_n", "cof"]
        assert set(one.columns) <= CONTRACT
        assert np.all(one.columns["cof"] > 0)
    assert "time_s" in small_sets[1].columns
    assert "time_s" not in small_sets[0].columns


def test_good_designs_interleave_rows_without_voltage():
    for make in designs.GOOD.values():
        off = make(np.random.default_rng(7)).rows.v == 0
        thirds = [part.any() for part in np.array_split(off, 3)]
        assert all(thirds)


def test_same_seed_same_bytes_and_other_seed_other_bytes():
    spec = build.Spec("F0", 2, design="timed")
    texts = [csv_text(build.build(spec, seed).columns) for seed in (9, 9, 10)]
    assert texts[0] == texts[1] != texts[2]


def test_a_set_does_not_depend_on_the_scale():
    few, many = families.specs(3, 0.01), families.specs(3, 0.05)
    assert set(few) <= set(many)


def test_file_names_say_nothing_and_labels_are_sealed(small_sets, tmp_path):
    many = [small_sets[0]] * 10 + [small_sets[1]] * 10
    write(many, tmp_path, seed=1)
    names = sorted(p.name for p in (tmp_path / "sets").iterdir())
    assert names == [f"{i:03d}.csv" for i in range(1, 21)]
    text = (tmp_path / "labels.json").read_text()
    assert (tmp_path / "labels.sha256").read_text().split()[0] == hashlib.sha256(
        text.encode()
    ).hexdigest()
    order = [json.loads(text)[n]["family"] for n in names]
    assert order not in (["F0"] * 10 + ["F1"] * 10, ["F1"] * 10 + ["F0"] * 10)
    head = (tmp_path / "sets" / names[0]).read_text().splitlines()[0]
    assert set(head.split(",")) <= CONTRACT


@pytest.mark.process
def test_generator_loads_nothing_of_the_project():
    code = (
        "import sys, tests.blind.generator.__main__\n"
        "bad = [m for m in sys.modules if m.split('.')[0] in ('model', 'hw', 'haptic_driver')]\n"
        "sys.exit(' '.join(bad) or 0)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_measured_loads_scatter_by_trial_and_a_trials_rows_share_its_gain():
    """What was drawn, read off the rows: loads, gains, and rows without voltage of one finger."""
    spec = build.Spec("F0", 4, design="factorial", measured=True)
    made = build.build(spec, 3)
    told, columns = made.label["trials"], made.columns
    pairs = {name: values.reshape(-1, 2) for name, values in columns.items()}
    load_n = pairs["normal_force_n"]
    assert (load_n[:, 0] == load_n[:, 1]).all()
    assert np.unique(load_n).size > 0.9 * len(load_n)
    undriven = np.log(pairs["cof"][pairs["voltage_v"][:, 0] == 0.0])
    between = undriven.mean(axis=1).std()
    # A session's gain adds to it; so few trials tell a spread to a fifth or so.
    assert 0.6 * told["gain"] < between < 1.7 * np.hypot(told["gain"], 0.05)
    within = np.diff(undriven, axis=1).std()
    sigma = made.label["relative_sigma"]
    assert within == pytest.approx(np.hypot(np.sqrt(2.0) * sigma, told["drift"]), rel=0.5)


def test_the_same_specification_has_commanded_loads_or_bare_ones():
    made = [build.build(build.Spec("F0", i, design="paper", measured=True), 3) for i in range(8)]
    for each in made:
        told = each.label["trials"]["columns"] == "commanded"
        assert ("commanded_normal_force_n" in each.columns) == told == ("trial" in each.columns)
    assert len({each.label["trials"]["columns"] for each in made}) == 2
