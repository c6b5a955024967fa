"""A finger's numbers recovered from the blind generator, which shares no code with the model."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom

from model.analysis.calibration import calibrate, write_calibration
from model.analysis.uncertainty import uncertain_numbers
from model.description import read_model
from model.diagnosis.data import Measurements, read_measurements
from model.diagnosis.witness import CURRENT, FRICTION
from model.effects.skin_hydration import SkinHydration
from model.support.errors import ModelError
from model.touch_model import TouchModel
from tests.blind.generator import build, designs, nuisance
from tests.blind.generator.__main__ import csv_text

TRUTH = {
    "cof_off": "mu_off",
    "roughness_rms_m": "h_rms",
    "skin_thickness_m": "skin",
    "leak_scale": "leak",
}
DESIGNS = list(designs.GOOD)
SEED = 4321


def finger_data(folder: Path, index: int) -> tuple[Measurements, dict[str, float]]:
    """One finger's measurements with nothing hidden, and its true numbers."""
    made = build.build(build.Spec("F0", index, design=DESIGNS[index % len(DESIGNS)]), SEED)
    path = folder / f"{index}.csv"
    path.write_text(csv_text(made.columns))
    return read_measurements(path), {name: made.label["finger"][key] for name, key in TRUTH.items()}


def hits(description, folder: Path, count: int, also=()) -> tuple[np.ndarray, np.ndarray]:
    """Whether each interval held the truth [set, parameter of `TRUTH`], at 68 and 95 %."""
    found = []
    for index in range(count):
        data, truth = finger_data(folder, index)
        fitted = calibrate(description, data, also).parameters
        inside = [
            [low <= truth[p.name] <= high for low, high in (p.interval_68, p.interval_95)]
            for p in fitted
            if p.name in truth
        ]
        found.append(inside)
    all_hits = np.array(found)
    return all_hits[:, :, 0], all_hits[:, :, 1]


@pytest.fixture(scope="module")
def reference(models):
    return models["reference"].description


@pytest.fixture(scope="module")
def rich(tmp_path_factory):
    return finger_data(tmp_path_factory.mktemp("rich"), DESIGNS.index("rich"))


@pytest.fixture(scope="module")
def found(reference, rich):
    return calibrate(reference, rich[0])


@pytest.mark.soak
@pytest.mark.timeout(1800)
def test_intervals_hold_the_truth_over_many_fingers(reference, tmp_path):
    """Parameter by parameter; the Gaussian posterior may be a few per cent off either way."""
    in_68, in_95 = hits(reference, tmp_path, 200)
    assert (np.abs(in_68.mean(axis=0) - 0.68) < 0.12).all()
    assert (in_95.mean(axis=0) > 0.95 - 0.05).all()


@pytest.mark.soak
def test_an_area_that_differs_is_to_be_fitted(reference, tmp_path, monkeypatch):
    """Held at 100 mm2 while people's differ by 22 %, intervals hold the truth too seldom."""
    draw = nuisance.draw_finger

    def with_area(rng, width=1.0):
        finger = draw(rng, width)
        z = np.random.default_rng(int(1e12 * finger.h_rms)).normal()
        return replace(finger, area=finger.area * np.exp(0.22 * np.clip(z, -2.5, 2.5)))

    monkeypatch.setattr(nuisance, "draw_finger", with_area)
    together = [list(TRUTH).index(name) for name in ("roughness_rms_m", "leak_scale")]
    held, fitted = (
        hits(reference, tmp_path, 48, also)[1][:, together] for also in ((), ("contact_area_m2",))
    )
    assert held.sum() < binom.ppf(1e-3, held.size, 0.95)
    assert fitted.sum() >= binom.ppf(1e-3, fitted.size, 0.95)


def test_the_finger_is_known_better_than_before_and_the_data_are_explained(found, rich):
    data, truth = rich
    assert found.chi2_per_point == pytest.approx(1.0, abs=0.35)
    assert found.residual.shape == (data.count,)
    by_name = {p.name: p for p in found.parameters}
    assert set(by_name) == set(truth)
    assert by_name["cof_off"].learnt < 0.2
    for p in found.parameters:
        assert p.interval_95[0] < p.interval_68[0] < p.value < p.interval_68[1] < p.interval_95[1]
        assert p.learnt < 1.0
    assert (found.warnings, found.at_an_end) == ((), ())


def test_numbers_held_in_the_fit_lose_their_own_spread(reference, found):
    before = {u.name for u in uncertain_numbers(reference)}
    after = {u.name for u in uncertain_numbers(found.model)}
    assert before - after >= {"skin_modulus_pa", "contact_area_m2"}
    assert after >= set(TRUTH)


def test_data_that_say_nothing_of_a_number_leave_it_at_its_prior(reference, rich):
    """Without voltage only friction without voltage is known; a few volts are next to none."""
    data, _ = rich
    weak = data.columns | {"voltage_v": np.where(data.columns["voltage_v"] > 0.0, 1.0, 0.0)}
    weak["cof"] = np.where(
        data.driven, np.median(data.columns["cof"][~data.driven]), data.columns["cof"]
    )
    found = calibrate(reference, replace(data, columns=weak))
    learnt = {p.name: p.learnt for p in found.parameters}
    assert learnt["leak_scale"] > 0.9
    assert any("leak_scale" in w and "next to nothing" in w for w in found.warnings)
    prior = {p.name: p.prior_68 for p in found.parameters}["leak_scale"]
    assert prior == pytest.approx(
        (1.0 / 1.5, 1.5), rel=0.05
    )  # a factor 1.5, but for the longer tails


def test_numbers_known_only_together_are_named(reference, rich):
    """Roughness and modulus both scale the pressure that the contact needs."""
    found = calibrate(reference, rich[0], also=["skin_modulus_pa"])
    assert {"roughness_rms_m", "skin_modulus_pa"} in [{a, b} for a, b, _ in found.correlated]
    for _, _, correlation in found.correlated:
        assert 0.9 < abs(correlation) <= 1.0
    assert any("known only together" in w for w in found.warnings)
    assert found.parameters[-1].name == "skin_modulus_pa"


def test_a_poor_fit_is_said_to_be_one(reference, rich):
    data, _ = rich
    f = data.columns["frequency_hz"]
    bent = data.columns["cof"] * np.where(data.driven & (f > 1e3), 1.4, 1.0)
    found = calibrate(reference, replace(data, columns=data.columns | {"cof": bent}))
    assert any("haptic diagnose" in w for w in found.warnings)


def test_the_file_written_is_the_model(reference, found, tmp_path):
    path = tmp_path / "fingers" / "one.toml"
    write_calibration(found, reference, path, "rich.csv")
    read = read_model(path)
    assert read.content_hash == found.model.content_hash
    assert read.parameters["leak_scale"].std == found.model.parameters["leak_scale"].std
    assert 'data = "rich.csv"' in path.read_text()
    assert [p.name for p in path.parent.iterdir()] == ["one.toml"]


def test_what_cannot_be_fitted_is_refused(reference, rich):
    data, _ = rich
    with pytest.raises(ModelError, match="too few"):
        calibrate(reference, data.subset(np.arange(data.count) < 5))
    with pytest.raises(ModelError, match="too few"):
        calibrate(reference, data.subset(~data.driven))
    with pytest.raises(ModelError) as unknown:
        calibrate(reference, data, also=["skin_modulus"])
    assert "skin_modulus_pa" in unknown.value.hint
    with pytest.raises(ModelError, match="in any case"):
        calibrate(reference, data, also=["cof_off"])
    with pytest.raises(ModelError, match="printed"):
        calibrate(replace(reference, variant="published"), data)


def test_data_without_any_noise_are_refused(reference):
    n = 10
    columns = {
        "frequency_hz": np.geomspace(10.0, 1e4, n),
        "voltage_v": np.linspace(0.0, 90.0, n),
        "normal_force_n": np.full(n, 0.5),
        "cof": np.full(n, 0.5),
    }
    data = Measurements(columns, np.zeros(n, np.intp), ("1",), None, "none")
    with pytest.raises(ModelError, match="noise"):
        calibrate(reference, data)


def test_what_a_finger_keeps_is_believed_as_far_as_its_model_says(found, rich):
    """The same data again: a finger that was calibrated moves no farther than its own
    uncertainty.
    """
    own = found.model.parameters["roughness_rms_m"]
    sure = replace(
        found.model,
        parameters=found.model.parameters | {"roughness_rms_m": replace(own, std=1e-3 * own.value)},
    )
    wrong = replace(
        rich[0], columns=rich[0].columns | {"voltage_v": 0.9 * rich[0].columns["voltage_v"]}
    )
    moved = [
        calibrate(sure, wrong, same_finger=same).model.parameters["roughness_rms_m"].value
        / own.value
        - 1.0
        for same in (False, True)
    ]
    assert abs(moved[0]) > 0.03
    assert abs(moved[1]) < 0.01


def test_an_effect_is_fitted_with_the_finger(reference, rich):
    """Of a finger without any it stays off; with one that is on in the model the fit begins
    anew.
    """
    fitted = calibrate(reference, rich[0], kinds=(SkinHydration,))
    wetness = fitted.model.effect_parameters["skin_hydration"]["wetness"]
    assert abs(wetness.value) < 3.0 * wetness.std < 1.0
    again = calibrate(fitted.model, rich[0], kinds=(SkinHydration,)).model.effect_parameters[
        "skin_hydration"
    ]["wetness"]
    assert again.value == pytest.approx(wetness.value, abs=wetness.std)
    np.testing.assert_allclose(
        TouchModel(fitted.model).predict(rich[0].conditions()).cof, fitted.predicted_cof, rtol=1e-9
    )


def test_only_friction_is_used(reference, rich, found):
    """Currents beside it, however wrong, change nothing."""
    data, _ = rich
    twice = np.tile(np.arange(data.count), 2)
    columns = {name: values[twice] for name, values in data.columns.items()} | {
        "current_a": np.ones(twice.size)
    }
    witness = np.repeat([FRICTION, CURRENT], data.count)
    mixed = replace(data.subset(twice), columns=columns, witness=witness, row=twice)
    np.testing.assert_array_equal(calibrate(reference, mixed).fit.vector, found.fit.vector)
