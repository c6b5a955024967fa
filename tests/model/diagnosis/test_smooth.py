"""A discrepancy of unknown shape: of the electrostatic force, of friction while there is voltage,
or of friction.
"""

import warnings
from pathlib import Path

import numpy as np
import pytest

from model.conditions import Conditions
from model.diagnosis.data import Measurements, read_measurements
from model.diagnosis.evidence import evidence_beside
from model.diagnosis.hypotheses import Candidate, candidate, fit_candidates
from model.diagnosis.model_fit import Problem
from model.diagnosis.noise import noise_of
from model.diagnosis.smooth import compressed, discrepancy_terms
from model.diagnosis.space import Predictor
from model.diagnosis.witness import FRICTION
from model.effects import BY_NAME
from model.support.arrays import Array
from model.touch_model import TouchModel
from tests.fingers import FINGER

NOISE = 0.01
VOLTAGES = (0.0, 50.0, 75.0, 100.0, 125.0)


def measured(tmp_path: Path, drift: float, of_force: bool) -> Measurements:
    """Friction of the reference finger, 1 % noise; from first to last row the force, or friction,
    grows by `drift`.
    """
    chance = np.random.default_rng(3)
    rows = np.array(
        [(f, v) for f in (30.0, 100.0, 300.0, 1000.0) for v in VOLTAGES for _ in range(4)]
    )
    rows = chance.permutation(rows)
    load = np.full(len(rows), 0.5)
    cof, off = (
        TouchModel(FINGER).cof(Conditions(rows[:, 0], v, load))
        for v in (rows[:, 1], 0.0 * rows[:, 1])
    )
    ramp = 1.0 + drift * np.linspace(-0.5, 0.5, len(rows))
    cof = off + (cof - off) * ramp if of_force else cof * ramp
    cof *= np.exp(NOISE * chance.standard_normal(len(rows)))
    lines = [
        f"{f},{v},0.5,{c:.6g},{NOISE * c:.6g},{10.0 * i}"
        for i, ((f, v), c) in enumerate(zip(rows, cof, strict=True))
    ]
    path = tmp_path / "data.csv"
    path.write_text(
        "\n".join(["frequency_hz,voltage_v,normal_force_n,cof,cof_std,time_s", *lines]) + "\n"
    )
    return read_measurements(path)


def weighed(data: Measurements, *names: str) -> tuple[Candidate, list[Candidate]]:
    """The base model, and effects of these names."""
    noise = noise_of(data)
    assert noise is not None
    problem = Problem(Predictor(FINGER, data), data.observed, noise)
    base = candidate(problem, (), problem.fit((), np.zeros(len(problem.predictor.free))))
    return base, fit_candidates(
        problem, base.fit, [(BY_NAME[name],) for name in names], lambda _: None
    )


def beside(base: Candidate) -> float:
    """What a discrepancy of unknown shape adds to the evidence."""
    return base.beside_discrepancy.log_evidence - base.alone.log_evidence


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_force_that_drifts_shows_by_how_much_of_friction_is_the_forces(tmp_path, sign):
    """It was named trapped charge of another form, by a discrepancy that knew only whether there is
    voltage.
    """
    data = measured(tmp_path, 0.3 * sign, of_force=True)
    base, (charge,) = weighed(data, "trapped_charge")
    assert base.beside_discrepancy.log_evidence > charge.alone.log_evidence
    noise = noise_of(data)
    assert noise is not None
    terms = [noise.whiten(term) for term in discrepancy_terms(data, data.driven.astype(float))]
    unaware = [*terms, compressed(np.hstack(terms))]
    without = evidence_beside(base.fit, noise, unaware, np.zeros((data.count, 0)), base.alone)
    assert base.beside_discrepancy.log_evidence > without.log_evidence + 5.0


def test_a_friction_that_drifts_is_one_as_well(tmp_path):
    base, _ = weighed(measured(tmp_path, 0.1, of_force=False))
    assert beside(base) > 10.0


def test_nothing_that_drifts_is_none(tmp_path):
    base, _ = weighed(measured(tmp_path, 0.0, of_force=True))
    assert beside(base) < 0.0


def test_the_share_of_the_force_is_what_friction_has_more_than_without_voltage(tmp_path):
    data = measured(tmp_path, 0.0, of_force=True)
    share = Predictor(FINGER, data).force_share()
    frequency, voltage = data.columns["frequency_hz"], data.columns["voltage_v"]
    friction: list[Array] = [
        TouchModel(FINGER).cof(Conditions(frequency, v, np.full(data.count, 0.5)))
        for v in (voltage, 0.0 * voltage)
    ]
    expected = 1.0 - friction[1] / friction[0]
    assert np.all(share[voltage == 0.0] == 0.0)
    np.testing.assert_allclose(
        share, expected / expected.max(), rtol=0.01
    )  # the usual finger has 3 nm of dust
    assert share.max() == 1.0


def test_a_current_has_no_share_of_the_force(tmp_path):
    """Without a force there is no voltage to take it against: numpy said so on the terminal."""
    path = tmp_path / "data.csv"
    path.write_text(
        "frequency_hz,voltage_v,normal_force_n,cof,cof_std,current_a,current_phase_rad,electrode_voltage_v,"
        "electrode_voltage_phase_rad\n250,75,0.5,0.6,0.01,6e-5,0.5,70,0.1\n250,100,0.5,0.7,0.01,8e-5,0.5,95,0.1\n"
    )
    data = read_measurements(path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        share = Predictor(FINGER, data).force_share()
    assert list(share > 0.0) == list(data.of(FRICTION))


@pytest.mark.parametrize(("off", "is_one"), [(0.0025, False), (0.03, True)])
def test_a_monitors_response_within_what_it_is_believed_to_is_none(tmp_path, off, is_one):
    """A viscoelastic skin was unexplained, by what was off smoothly and by less than 0.3 % in
    precise readings.
    """
    frequency_hz = np.geomspace(10.0, 1e5, 41)
    said = TouchModel(FINGER).predict(Conditions(frequency_hz, np.full(41, 75.0), np.full(41, 0.5)))
    current_a = said.electrode_current_a * np.exp(off * np.exp(1j * np.log(frequency_hz)))
    amount, phase_rad = np.abs(current_a), np.angle(current_a)
    columns = (
        frequency_hz,
        said.cof,
        0.05 * said.cof,
        amount,
        1e-4 * amount,
        phase_rad,
        np.full(41, 1e-4),
    )
    header = (
        "frequency_hz,voltage_v,normal_force_n,cof,cof_std,"
        "current_a,current_std_a,current_phase_rad"
    )
    path = tmp_path / "data.csv"
    rows = (
        ",".join([f"{c[0]:.9g},75,0.5", *(f"{x:.9g}" for x in c[1:])])
        for c in zip(*columns, strict=True)
    )
    path.write_text("\n".join([f"{header},current_phase_std_rad", *rows]) + "\n")
    base, _ = weighed(read_measurements(path))
    assert (beside(base) > 1.0) is is_one
