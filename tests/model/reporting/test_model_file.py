"""A fitted model, written and read back, is the same physics."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from model.description import read_model
from model.diagnosis.data import Array, Measurements
from model.diagnosis.decide import Decision, Verdict
from model.diagnosis.evidence import Evidence
from model.diagnosis.hypotheses import Candidate, Hypotheses
from model.diagnosis.model_fit import Fit, Problem
from model.diagnosis.noise import Noise
from model.diagnosis.posterior import Posterior
from model.diagnosis.proof import Proof
from model.diagnosis.space import FINGER, NUISANCES, Predictor
from model.diagnosis.where import Disagreement
from model.diagnosis.workflow import Diagnosis, Findings
from model.effects import BY_NAME, Effect
from model.electric.dielectrics import GABRIEL_WET, ColeCole, PowerLaw, Tabulated
from model.parameters import Parameter
from model.reporting.model_file import fitted_effects, fitted_nuisances, write_model
from model.support.errors import ModelError
from tests.fingers import REFERENCE

VECTOR = np.array([0.1, -0.5, 1.2, 2.0, 0.7, 0.3, -1.1])
POWER_LAW = PowerLaw(4.0, 1200.0, 0.35, 2e-5)
TABLE = Tabulated(
    "my skin",
    "user's table my skin.csv",
    (1.0, 1e3, 1e6),
    (5e3, 1.1e3, 0.1 + 0.2),
    (1e-5, 1e-4, 1e-2),
)


@pytest.fixture
def finger():
    return read_model(REFERENCE)


def measurements() -> Measurements:
    names = ("frequency_hz", "voltage_v", "normal_force_n", "cof")
    return Measurements(
        {n: np.ones(3) for n in names}, np.zeros(3, np.intp), ("1",), None, "ab" * 32
    )


def fit(kinds: tuple[type[Effect], ...], vector: Array) -> Fit:
    nothing = np.zeros(3)
    return Fit(
        kinds,
        vector,
        nothing,
        np.zeros((3, vector.size)),
        0.04 * np.eye(vector.size),
        3.0,
        1.0,
        0.0,
    )


def diagnosis(verdict: str | None, *names: str) -> Diagnosis:
    def found(kinds: tuple[type[Effect], ...]) -> Candidate:
        at = fit(kinds, VECTOR[: len(NUISANCES) + sum(len(k.parameters()) for k in kinds)])
        return Candidate(
            kinds,
            at,
            Evidence(5.0, 1.0, 0.0),
            at,
            np.zeros((1, 0)),
            lambda: Evidence(4.0, 1.0, 0.0),
        )

    kinds = tuple(BY_NAME[name] for name in names)
    base, chosen = found(()), found(kinds)
    data, findings = measurements(), None
    if verdict is not None:
        decision = Decision(verdict, names, {n: [] for n in names}, 0.98, "why")
        reached = Verdict(decision, Posterior({names: 0.98}, {}, ()), chosen, True)
        scan, nothing = Disagreement((), 1.0, 1.0, 0.0), np.empty(0)
        proof = Proof("block", (), nothing, nothing, nothing, 0.0, (0.0, 0.0), 0.0)
        noise = Noise(np.ones(3), np.eye(3), 6.0, "cof_std", 0, 0.0, np.ones(3))
        problem = Problem(Predictor(read_model(REFERENCE), data), np.zeros(3), noise)
        tried = Hypotheses(base, [], [], (), {}, {})
        findings = Findings(problem, tried, reached, scan, scan, proof, nothing)
    return Diagnosis(data, None, findings, (), 7)


@pytest.mark.parametrize(
    "dielectric", [GABRIEL_WET, POWER_LAW, TABLE], ids=["named", "power law", "user's own table"]
)
def test_every_kind_of_dielectric_reads_back_to_the_same_physics(finger, tmp_path, dielectric):
    given = replace(finger, dielectric=dielectric, friction_law="total_load")
    written = write_model(
        diagnosis("effect_found", "series_resistance"), given, tmp_path / "model.toml", "d.csv"
    )
    read = read_model(tmp_path / "model.toml")
    assert read.content_hash == written.content_hash
    assert read.dielectric == dielectric
    assert read.friction_law == "total_load"
    assert set(read.effect_parameters) == {"series_resistance"}


def test_the_file_predicts_what_the_fit_did(finger, tmp_path):
    found = diagnosis("effect_found", "amplifier_bandwidth")
    assert found.findings is not None
    chosen = found.findings.verdict.chosen.fit
    write_model(found, finger, tmp_path / "model.toml", "d.csv")
    expected = Predictor(finger, found.data).predicted(chosen.kinds, chosen.vector[None])
    read = Predictor(read_model(tmp_path / "model.toml"), found.data, FINGER).predicted(
        (), np.zeros((1, 4))
    )
    np.testing.assert_allclose(read, expected, rtol=1e-12)


def test_fitted_values_carry_their_error_and_their_data(finger, tmp_path):
    write_model(
        diagnosis("effect_found", "series_resistance"),
        finger,
        tmp_path / "model.toml",
        "/where/d.csv",
    )
    read = read_model(tmp_path / "model.toml")
    roughness = read.parameters["roughness_rms_m"]
    # half a prior unit below with a tail of 0.2: log factor 0.1 sinh(-0.1)/0.2; the covariance is
    # 0.2^2
    assert roughness.value == pytest.approx(20e-6 * np.exp(-0.1 * np.sinh(0.1) / 0.2), rel=1e-12)
    assert roughness.std == pytest.approx(roughness.value * 0.10 * np.cosh(0.1) * 0.2, rel=1e-12)
    # 0.7 prior units above a median of 3 nm, a factor e^2 each with a tail of 0.01
    gap_offset = read.parameters["gap_offset_m"]
    assert gap_offset.value == pytest.approx(3e-9 * np.exp(2.0 * np.sinh(0.007) / 0.01), rel=1e-12)
    assert gap_offset.std == pytest.approx(gap_offset.value * 2.0 * np.cosh(0.007) * 0.2, rel=1e-12)
    assert roughness.source == "fit to d.csv, sha256 abababababababab"
    resistance = read.effect_parameters["series_resistance"]["resistance_ohm"]
    assert resistance.value == pytest.approx(2e4 * 15.0**0.3)
    assert resistance.std == pytest.approx(resistance.value * np.log(15.0) * 0.2)
    assert read.parameters["screen_modulus_pa"] == finger.parameters["screen_modulus_pa"]


def test_a_linear_parameter_keeps_its_error_at_zero():
    kind = BY_NAME["contact_ageing"]
    share = fitted_effects(fit((kind,), np.zeros(len(NUISANCES) + 2)))["contact_ageing"]["share"]
    assert share.value == 0.0
    assert share.std == pytest.approx(0.35 * 0.2)


def test_fitted_parameters_stay_within_what_a_file_may_say(finger):
    found = fitted_nuisances(finger, fit((), np.array([6.0, 0.0, 0.0, 0.0, 0.0])), NUISANCES)
    assert found["cof_off"].value == 5.0


def test_effects_that_were_on_stay_on(finger, tmp_path):
    on = {"drive_gain_error": {"gain": Parameter(1.05, "1", 'measured "twice"\\\n', 0.01)}}
    given = replace(finger, effect_parameters=on)
    write_model(
        diagnosis("effect_found", "series_resistance"), given, tmp_path / "model.toml", "d.csv"
    )
    read = read_model(tmp_path / "model.toml")
    assert set(read.effect_parameters) == {"drive_gain_error", "series_resistance"}
    assert read.effect_parameters["drive_gain_error"]["gain"] == on["drive_gain_error"]["gain"]


@pytest.mark.parametrize("verdict", ["no_discrepancy", "unexplained"])
def test_no_name_no_effect(finger, tmp_path, verdict):
    write_model(diagnosis(verdict), finger, tmp_path / "model.toml", "d.csv")
    read = read_model(tmp_path / "model.toml")
    assert read.effect_parameters == {}
    assert read.values.roughness_rms_m != finger.values.roughness_rms_m


def test_untestable_data_leave_the_model_as_it_is(finger, tmp_path):
    write_model(diagnosis(None), finger, tmp_path / "model.toml", "d.csv")
    assert read_model(tmp_path / "model.toml").content_hash == finger.content_hash


def test_origin_says_from_what(finger, tmp_path):
    write_model(
        diagnosis("effect_found", "series_resistance"),
        finger,
        tmp_path / "model.toml",
        "/where/d.csv",
    )
    origin = tomllib.loads((tmp_path / "model.toml").read_text(encoding="utf-8"))["origin"]
    assert origin["data"] == "d.csv"
    assert origin["data_sha256"] == "ab" * 32
    assert origin["parent_hash"] == finger.content_hash
    assert origin["verdict"] == "effect_found"
    assert origin["probability"] == pytest.approx(0.98)
    assert {"log_evidence", "log_evidence_gain", "seed", "program", "date"} <= set(origin)


def test_older_versions_are_kept_in_order(finger, tmp_path):
    path = tmp_path / "model.toml"
    path.write_text("mine", encoding="utf-8")
    write_model(diagnosis("effect_found", "series_resistance"), finger, path, "d.csv")
    first = path.read_text(encoding="utf-8")
    write_model(diagnosis("effect_found", "floating_body"), finger, path, "d.csv")
    assert (tmp_path / "model-1.toml").read_text(encoding="utf-8") == "mine"
    assert (tmp_path / "model-2.toml").read_text(encoding="utf-8") == first
    assert "floating_body" in read_model(path).effect_parameters


def test_the_same_result_makes_no_new_version(finger, tmp_path):
    for _ in range(2):
        write_model(
            diagnosis("effect_found", "series_resistance"), finger, tmp_path / "model.toml", "d.csv"
        )
    assert [p.name for p in tmp_path.iterdir()] == ["model.toml"]


def test_a_table_of_the_same_name_is_not_overwritten(finger, tmp_path):
    path, found = tmp_path / "model.toml", diagnosis("no_discrepancy")
    write_model(found, replace(finger, dielectric=TABLE), path, "d.csv")
    other = replace(TABLE, eps_real=(9e3, 1e3, 10.0))
    write_model(found, replace(finger, dielectric=other), path, "d.csv")
    assert read_model(path).dielectric == other
    assert read_model(tmp_path / "model-1.toml").dielectric == TABLE


def test_a_dielectric_that_no_file_can_name_is_refused(finger, tmp_path):
    own = ColeCole("own", "made up", 4.0, (), 1e-4)
    with pytest.raises(ModelError, match="own"):
        write_model(
            diagnosis("no_discrepancy"),
            replace(finger, dielectric=own),
            tmp_path / "model.toml",
            "d.csv",
        )


def test_a_printed_model_that_nothing_could_test_stays_the_printed_one(finger, tmp_path):
    """The file did not say the variant, and read back as the corrected equations."""
    printed = replace(finger, variant="published", friction_law="total_load")
    write_model(diagnosis(None), printed, tmp_path / "model.toml", "d.csv")
    assert read_model(tmp_path / "model.toml").variant == "published"
    assert read_model(tmp_path / "model.toml").content_hash == printed.content_hash
