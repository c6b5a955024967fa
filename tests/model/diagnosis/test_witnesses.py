"""Current and voltage at the electrode beside friction: as read, as predicted, and what they make
of a verdict.
"""

import json
from dataclasses import replace

import numpy as np
import pytest

from model.conditions import Conditions
from model.diagnosis.data import Measurements, read_measurements, together
from model.diagnosis.model_fit import Problem
from model.diagnosis.noise import noise_of
from model.diagnosis.space import AREA, NUISANCES, OPEN, REST, STRAY, Predictor, nuisances
from model.diagnosis.witness import (
    CURRENT,
    CURRENT_PHASE,
    FRICTION,
    VOLTAGE,
    VOLTAGE_PHASE,
    WITNESSES,
)
from model.diagnosis.workflow import Diagnosis, diagnose
from model.effects import BY_NAME
from model.parameters import Parameter
from model.reporting.report import write_report
from model.support.errors import ModelError
from model.touch_model import TouchModel
from tests.fingers import FINGER
from tests.model.diagnosis.electrode import STRAY_F, hidden, measured, with_stray

ELECTRICAL = (
    "current_a",
    "current_phase_rad",
    "electrode_voltage_v",
    "electrode_voltage_phase_rad",
)
HEADER = "frequency_hz,voltage_v,normal_force_n,cof,cof_std,finger," + ",".join(ELECTRICAL)


@pytest.fixture
def read(tmp_path):
    """Lines of a file, as the workflow reads them."""

    def run(*lines: str, header: str = HEADER) -> Measurements:
        path = tmp_path / "data.csv"
        path.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
        return read_measurements(path)

    return run


def test_a_row_has_an_observation_per_witness(read):
    data = read(
        "250,75,0.5,0.6,0.01,,,,,",
        "250,75,0.5,0.61,0.01,sliding,6e-5,0.5,,",
        "1000,5,0.5,,,resting,2e-5,1.1,4.5,-0.2",
        "1000,5,,,,none,9e-6,1.5,,",
        "250,0,0.5,0.51,0.01,,1e-9,0.3,,",
    )
    assert data.rows == 5
    assert [int(data.of(w).sum()) for w in range(5)] == [
        3,
        3,
        3,
        1,
        1,
    ]  # no current without voltage
    current = data.observed[data.of(CURRENT)]
    np.testing.assert_allclose(current, np.log([6e-5, 2e-5 / 4.5, 9e-6]))
    np.testing.assert_allclose(data.observed[data.of(CURRENT_PHASE)], [0.5, 1.3, 1.5])
    np.testing.assert_allclose(data.observed[data.of(VOLTAGE)], np.log([4.5]))
    np.testing.assert_allclose(data.observed[data.of(VOLTAGE_PHASE)], [-0.2])
    assert list(data.finger[data.of(CURRENT)]) == ["sliding", "resting", "none"]


def test_friction_alone_is_what_it_was(read):
    data = read("250,75,0.5,0.6,0.01,,,,,", "250,0,0.5,0.5,0.01,,,,,")
    assert data.witness is None
    assert data.witnesses == [FRICTION]
    assert nuisances(FINGER, data) == NUISANCES


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("250,75,0.5,,,,,,,", "line 2: cof is '', not a number, and no other witness speaks there"),
        (
            "250,75,0.5,0.6,0.01,resting,1e-5,0.1,,",
            "line 2: has a cof, but its finger does not slide",
        ),
        ("250,75,0.5,0.6,,,1e-5,0.1,,", "line 2: cof_std is ''"),
        ("250,75,0.5,,0.01,,1e-5,0.1,,", "line 2: cof is ''"),
        ("250,75,0.5,0.6,0.01,sitting,1e-5,0.1,,", "line 2: finger 'sitting' is unknown"),
        ("250,75,0.5,0.6,0.01,,-1e-5,0.1,,", "line 2: current_a = -1e-5 is out of range"),
        ("250,75,0.5,0.6,0.01,,1e-5,57,,", "line 2: current_phase_rad = 57 is out of range"),
        ("250,75,,0.6,0.01,sliding,1e-5,0.1,,", "line 2: normal_force_n is ''"),
    ],
)
def test_what_cannot_be_read_is_said(read, line, said):
    with pytest.raises(ModelError) as error:
        read(line, "250,75,0.5,0.6,0.01,,1e-5,0.1,,")
    assert said in error.value.message


def test_files_with_other_witnesses_go_together(read):
    friction = read(
        "250,75,0.5,0.6,0.01", header="frequency_hz,voltage_v,normal_force_n,cof,cof_std"
    )
    sweep = read(
        "1000,5,0.5,2e-5,0.3",
        header="frequency_hz,voltage_v,normal_force_n,current_a,current_phase_rad",
    )
    both = together([("a", friction), ("b", sweep)])
    assert both.rows == 2
    assert both.witnesses == [FRICTION, CURRENT, CURRENT_PHASE]
    np.testing.assert_allclose(both.observed, [np.log(0.6), np.log(2e-5), 0.3])
    assert both.session_names == ("file 1, 1", "file 2, 1")


class TestNoise:
    def test_what_is_assumed_is_said(self, read):
        noise = noise_of(
            read("250,75,0.5,0.6,0.012,,6e-5,0.5,,", "100,75,0.5,0.6,0.012,,5e-5,0.5,,")
        )
        np.testing.assert_allclose(noise.own_std, [0.02, 0.02, 0.02, 0.02, 0.035, 0.035])
        assert (
            "current_a has neither current_std_a nor replicates: 0.02 of the value is assumed"
            in noise.warnings
        )
        assert any("current_phase_rad" in warning for warning in noise.warnings)

    def test_replicates_tell(self, read):
        lines = [
            f"250,75,0.5,0.6,0.012,,{6e-5 * np.exp(x):.9g},0.5,,"
            for x in (0.05, -0.05, 0.05, -0.05)
        ]
        data = read(*lines)
        noise = noise_of(data)
        np.testing.assert_allclose(
            noise.own_std[data.of(CURRENT)], np.sqrt(4 * 0.0025 / 3), rtol=1e-6
        )

    def test_a_current_carries_the_noise_of_what_it_is_taken_against(self, read):
        header = HEADER + ",current_std_a,electrode_voltage_std_v"
        data = read("250,75,0.5,0.6,0.012,,6e-5,0.5,70,0,1.8e-6,2.8", header=header)
        noise = noise_of(data)
        assert noise.own_std[data.of(CURRENT)] == pytest.approx(0.05)  # 3 and 4 %

    def test_sessions_share_a_gain_per_witness_and_the_area_of_the_touch(self, read):
        """Once an open circuit was taken to share what a touch's area does: real effects were
        unexplained.
        """
        header, open_a = HEADER + ",session", 2.0 * np.pi * 250.0 * 200e-12 * 75.0
        lines = [f"{f},75,0.5,0.6,0.012,sliding,6e-5,0.5,,,{s}" for s in "ab" for f in (100, 250)]
        lines += [f"250,75,0,,,none,{open_a:.9g},{0.5 * np.pi:.9g},,,{s}" for s in "ab"]
        data = read(*lines, header=header)
        noise = noise_of(data)
        frequency_hz = data.columns["frequency_hz"]
        share = 1.0 - 2j * np.pi * frequency_hz * 200e-12 * 75.0 / (6e-5 * np.exp(0.5j))
        share[data.finger == "none"] = 0.0
        area = 0.03 * np.select(
            [data.of(CURRENT), data.of(CURRENT_PHASE)], [share.real, share.imag], 0.0
        )
        gain = np.array([WITNESSES[w].gain_std for w in data.witness])
        same = (data.session[:, None] == data.session) & (data.witness[:, None] == data.witness)
        shared = np.where(same, np.outer(gain, gain) + np.outer(area, area), 0.0)
        covariance = noise.lower @ noise.lower.T
        np.testing.assert_allclose(
            covariance, np.diag(noise.own_std**2) + shared, rtol=1e-6, atol=1e-12
        )
        white = noise.whiten(covariance)
        np.testing.assert_allclose(noise.whiten(white.T), np.eye(data.count), atol=1e-9)

    @pytest.mark.parametrize(("claimed", "shares"), [(1e-4, True), (4e-3, False)])
    def test_readings_that_claim_more_than_a_monitor_is_believed_to_share_its_response(
        self, read, claimed, shares
    ):
        """Smooth over log frequency, of unit spread here, by 0.3 % in current and voltage."""
        header = HEADER + ",electrode_voltage_std_v"
        data = read(
            *(f"{f},75,0.5,,,sliding,,,75,,{75 * claimed:.9g}" for f in (100, 1000)), header=header
        )
        noise = noise_of(data)
        covariance = (
            noise.lower @ noise.lower.T - np.diag(noise.own_std**2) - 0.01**2
        )  # and the gain of the session
        likeness = np.exp(-0.5 * (2.0 / 0.8) ** 2)
        np.testing.assert_allclose(
            covariance, shares * 0.003**2 * np.array([[1, likeness], [likeness, 1]]), atol=1e-12
        )

    def test_what_drifts_between_readings_is_no_noise(self, read):
        """Friction read early and five minutes later: that it had aged by a third was taken for its
        scatter.
        """
        early, late = ([0.30, 0.303, 0.297], [0.20, 0.202, 0.198])
        lines = [
            f"0,0,0.5,{c},0.003,{t}"
            for c, t in zip(early + late, (5, 8, 11, 300, 303, 306), strict=True)
        ]
        noise = noise_of(
            read(*lines, header="frequency_hz,voltage_v,normal_force_n,cof,cof_std,time_s")
        )
        assert noise.own_std == pytest.approx(
            np.repeat([0.01, 0.015], 3), rel=0.3
        )  # as stated, not 0.2
        assert noise.warnings == ()

    def test_a_setting_is_no_better_known_for_being_read_in_every_session(self, read):
        """A touch with nothing missing was called a film of sweat: a reference had been read in
        every session.
        """
        header = HEADER + ",electrode_voltage_std_v,electrode_voltage_phase_std_rad,session"
        line = "1000,75,0.5,,,resting,,,75,0,1e-4,1e-6,"
        data = read(
            *(line + session for session in "abcd"),
            line.replace("1000", "2000") + "a",
            header=header,
        )
        own_std, least = noise_of(data).own_std[data.of(VOLTAGE)], WITNESSES[VOLTAGE].least_std
        assert (np.sum(own_std[:4] ** -2.0) ** -0.5, own_std[4]) == pytest.approx((least, least))

    def test_what_is_better_than_any_model_says_nothing_of_the_scale(self, read):
        """Once a voltage that a monitor resolves to a hundredth of a per mille made all other noise
        look small.
        """
        header = HEADER + ",electrode_voltage_std_v,electrode_voltage_phase_std_rad"
        frequencies, off = np.linspace(50.0, 500.0, 12), 0.03 * np.sin(np.arange(12.0) ** 2)
        said = (
            TouchModel(FINGER)
            .predict(Conditions(frequencies, np.full(12, 75.0), np.full(12, 0.5)))
            .cof
        )
        cof = [
            f"{f},75,0.5,{c:.9g},0.012,,"
            for f, c in zip(frequencies, said * np.exp(off), strict=True)
        ]
        scales = []
        for ending in (",,,,,", ",,75,0,1e-4,1e-6"):
            data = read(*(line + ending for line in cof), header=header)
            problem = Problem(Predictor(FINGER, data), data.observed, noise_of(data))
            scales.append(problem.fit((), np.zeros(len(problem.predictor.free))).scale2)
        assert scales[1] == pytest.approx(scales[0], rel=0.02)


class TestPrediction:
    def test_is_the_models(self, read):
        """Against the phasors that the model gives of the same conditions."""
        data = read(
            "250,75,0.5,0.6,0.01,sliding,6e-5,0.5,70,0.1",
            "1e4,20,0.25,0.6,0.01,sliding,6e-5,0.5,,",
            "1000,5,0.5,,,resting,2e-5,1.1,4.5,-0.2",
            "1000,5,,,,none,9e-6,1.5,,",
        )
        finger = with_stray(FINGER, STRAY_F)
        got = Predictor(finger, data, NUISANCES[:4]).predicted([], np.zeros((2, 4)))
        conditions = Conditions(
            np.array([250.0, 1e4, 1e3, 1e3]),
            np.array([75.0, 20.0, 5.0, 5.0]),
            np.array([0.5, 0.25, 0.5, 0.5]),
            finger=np.array(["sliding", "sliding", "resting", "none"]),
        )
        answer = TouchModel(finger).predict(conditions)
        current, voltage = answer.electrode_current_a, answer.electrode_voltage_v
        np.testing.assert_array_equal(got[0], got[1])
        np.testing.assert_allclose(got[0][data.of(FRICTION)], np.log(answer.cof[:2]), rtol=1e-9)
        expected = np.log(
            np.abs(current) / np.where([True, False, True, False], np.abs(voltage), 1.0)
        )
        np.testing.assert_allclose(got[0][data.of(CURRENT)], expected, rtol=1e-9)
        np.testing.assert_allclose(got[0][data.of(CURRENT_PHASE)], np.angle(current), rtol=1e-9)
        np.testing.assert_allclose(got[0][data.of(VOLTAGE)], np.log([75.0, 5.0]), rtol=1e-12)

    def test_the_amplifier_cancels_beside_a_measured_voltage(self, read):
        """At 1 mV nothing is attracted: the current follows the voltage."""
        header = HEADER.replace("cof,cof_std,", "")
        data = read(*(f"{f},1e-3,0.5,,1e-9,0.5,9e-4,-0.1" for f in (1e3, 1e5)), header=header)
        predictor = Predictor(FINGER, data, ())
        slow = np.array([[-1.0, 0.0]])
        change = predictor.predicted([BY_NAME["amplifier_bandwidth"]], slow) - predictor.predicted(
            [], np.zeros((1, 0))
        )
        seen = {w: change[0][data.of(w)] for w in (CURRENT, CURRENT_PHASE, VOLTAGE, VOLTAGE_PHASE)}
        assert np.abs(seen[CURRENT]).max() < 1e-6
        assert np.abs(seen[CURRENT_PHASE]).max() < 1e-6
        assert seen[VOLTAGE][1] < -1.0
        assert seen[VOLTAGE_PHASE][1] < -1.0

    def test_beside_a_voltage_without_a_phase_the_currents_counts_from_that(self, read):
        """As a card writes it that sees both monitors and not the generator: the amplifier's own
        lag does not show.
        """
        header = HEADER.replace("cof,cof_std,", "")
        data = read("1e5,1e-3,0.5,,1e-9,0.5,9e-4,", header=header)
        predictor, slow = Predictor(FINGER, data, ()), np.array([[-1.0, 0.0]])
        change = predictor.predicted([BY_NAME["amplifier_bandwidth"]], slow) - predictor.predicted(
            [], np.zeros((1, 0))
        )
        assert abs(change[0][data.of(CURRENT_PHASE)][0]) < 1e-6
        unseen = Predictor(FINGER, read("1e5,1e-3,0.5,,1e-9,0.5,,", header=header), ())
        lag = unseen.predicted([BY_NAME["amplifier_bandwidth"]], slow) - unseen.predicted(
            [], np.zeros((1, 0))
        )
        assert lag[0][1] < -1.0

    def test_angles_differ_by_half_a_turn_at_most(self, read):
        data = read("250,75,0.5,0.6,0.01,,6e-5,3.1,,")
        predictor = Predictor(FINGER, data)
        less = predictor.less(np.array([0.1, 7.0, 3.1]), np.array([[0.0, 0.0, -3.1]]))
        np.testing.assert_allclose(less, [[0.1, 7.0, 6.2 - 2.0 * np.pi]])

    def test_what_differs_between_rigs_and_fingers_is_free(self, read):
        data = read("250,75,0.5,,,resting,6e-5,3.1,,")
        assert nuisances(FINGER, data) == (*NUISANCES, AREA, STRAY, REST)
        known = nuisances(with_stray(FINGER, STRAY_F, 3e-12), data)[len(NUISANCES) + 1]
        assert known.value(STRAY_F, np.array(1.0)) == pytest.approx(
            STRAY_F * np.exp(0.01), rel=1e-6
        )

    def test_an_open_circuit_is_believed_within_a_percent_or_as_the_model_file_says(self, read):
        """It took a polarization's current for stray, 4 % of it, and left no name for a lambda of
        300 (seed 8921).
        """
        data = read("250,75,0.5,,,none,6e-5,3.1,,\n250,75,0.5,,,resting,6e-5,3.1,,")
        usual = nuisances(FINGER, data)[-2]
        assert (usual, usual.value(1.0, np.array(2.0))) == (OPEN, pytest.approx(1.01, rel=1e-3))
        wider = replace(
            FINGER, parameters=FINGER.parameters | {"open_circuit": Parameter(1.0, "1", "", 0.03)}
        )
        known = nuisances(wider, data)[-2]
        assert known.value(1.0, np.array(1.0)) == pytest.approx(1.03, rel=1e-3)


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    """A diagnosis, and the data."""
    folder = tmp_path_factory.mktemp("witnesses")

    def run(name: str, seed: int, **effects: dict[str, float]) -> tuple[Diagnosis, Measurements]:
        path = folder / f"{name}.csv"
        measured(path, hidden(**effects), seed)
        data = read_measurements(path)
        return diagnose(FINGER, data), data

    return run


def names(found: Diagnosis) -> list[str]:
    return [kind.name for kind in found.findings.verdict.chosen.kinds]


@pytest.mark.timeout(300)
def test_nothing_hidden_but_leads(diagnosed):
    found, _ = diagnosed("null", 1)
    assert found.name == "no_discrepancy"
    free, fit = found.findings.problem.predictor.free, found.findings.hypotheses.base.fit
    i = free.index(STRAY)
    farads = STRAY.value(0.0, fit.vector[i])
    assert farads == pytest.approx(STRAY_F, rel=0.05)  # the monitor's gain: 3 %


@pytest.mark.timeout(300)
def test_a_resistance_that_friction_cannot_name(diagnosed, tmp_path):
    found, data = diagnosed("resistance", 2, series_resistance={"resistance_ohm": 3e4})
    assert diagnose(FINGER, data.subset(data.of(FRICTION))).name != "effect_found"
    assert (found.name, names(found)) == ("effect_found", ["series_resistance"])
    content = write_report(found, FINGER, tmp_path, "resistance.csv")
    assert {"spectrum.svg", "fingerprint.svg", "fingerprint_1.svg", "fingerprint_2.svg"} <= {
        path.name for path in (tmp_path / "pictures").iterdir()
    }
    assert content["data"]["witnesses"]["current_a"] > 0
    assert {region["witness"] for region in content["where"]} & {"current_a", "current_phase_rad"}
    assert (
        json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))["verdict"]
        == "effect_found"
    )


@pytest.mark.timeout(300)
def test_two_effects_are_named_one_by_one(diagnosed):
    found, _ = diagnosed(
        "two",
        3,
        drive_gain_error={"gain": 1.15},
        humid_gap_conduction={"gap_conductivity_s_per_m": 2e-8},
    )
    assert found.name == "effect_found"
    assert set(names(found)) == {"drive_gain_error", "humid_gap_conduction"}
    verdict = found.findings.verdict
    assert set(verdict.group) == set(names(found))
    assert all(verdict.posterior.inclusion[name] > 0.9 for name in names(found))


@pytest.mark.timeout(300)
@pytest.mark.soak
def test_sweeps_alone_can_be_diagnosed(diagnosed, tmp_path):
    path = tmp_path / "sweep.csv"
    measured(path, hidden(johnsen_rahbek={"insulator_conductivity_s_per_m": 1e-8}), 4)
    data = read_measurements(path)
    found = diagnose(FINGER, data.subset(~data.of(FRICTION)))
    write_report(found, FINGER, tmp_path / "out", "sweep.csv")
    assert "johnsen_rahbek" in found.findings.verdict.suspects
