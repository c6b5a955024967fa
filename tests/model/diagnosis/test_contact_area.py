"""The area of contact beside friction: as read, as predicted, and what it makes of a verdict."""

from __future__ import annotations

import numpy as np
import pytest

from model.conditions import Conditions
from model.diagnosis.data import Measurements, read_measurements
from model.diagnosis.model_fit import Problem
from model.diagnosis.noise import noise_of
from model.diagnosis.space import AREA, Predictor, nuisances
from model.diagnosis.witness import CONTACT_AREA, FRICTION
from model.diagnosis.workflow import diagnose
from model.support.errors import ModelError
from model.touch_model import TouchModel
from tests.fingers import FINGER

HEADER = "frequency_hz,voltage_v,normal_force_n,cof,cof_std,contact_area_m2,contact_area_std_m2"
LOADS = (0.25, 0.5, 1.0)


@pytest.fixture
def read(tmp_path):
    def run(*lines: str) -> Measurements:
        path = tmp_path / "data.csv"
        path.write_text("\n".join([HEADER, *lines]) + "\n", encoding="utf-8")
        return read_measurements(path)

    return run


def lines_of(area_m2) -> list[str]:
    """Friction of the reference finger, as it is under the seen area of each load; 2 % noise."""
    random = np.random.default_rng(6)
    lines = []
    for f in (10.0, 100.0, 250.0, 1e3, 1e4):
        for v in (0.0, 60.0, 100.0):
            for n in LOADS:
                true_m2 = area_m2(n)
                c = Conditions(*(np.array([x]) for x in (f, v, n)), contact_area_m2=[true_m2])
                cof = TouchModel(FINGER).predict(c).cof[0] * (1 + 0.01 * random.standard_normal())
                seen = true_m2 * (1 + 0.015 * random.standard_normal())
                lines.append(f"{f},{v},{n},{cof},{0.01 * cof},{seen},{0.015 * seen}")
    return lines


def test_an_area_is_an_observation_with_and_without_voltage(read):
    data = read(
        "250,75,0.5,0.6,0.01,1.1e-4,2e-6", "250,0,0.5,0.51,0.01,9e-5,", "250,0,0.5,0.5,0.01,,"
    )
    assert [int(data.of(w).sum()) for w in (FRICTION, CONTACT_AREA)] == [3, 2]
    np.testing.assert_allclose(data.observed[data.of(CONTACT_AREA)], np.log([1.1e-4, 9e-5]))
    assert AREA in nuisances(FINGER, data)


def test_without_an_area_none_is_fitted(read):
    assert AREA not in nuisances(FINGER, read("250,75,0.5,0.6,0.01,,"))


def test_an_area_in_mm2_is_refused(read):
    with pytest.raises(ModelError, match=r"contact_area_m2 = 105 is out of range"):
        read("250,75,0.5,0.6,0.01,105,2")


def test_the_free_area_becomes_what_was_seen(read):
    """15 % were free; a hundred and thirty square millimetres were seen, to 3 % of a session."""
    data = read(*lines_of(lambda load_n: 1.3e-4))
    predictor = Predictor(FINGER, data)
    noise = noise_of(data)
    assert noise is not None
    fit = Problem(predictor, data.observed, noise).fit((), np.zeros(predictor.size(())))
    place = predictor.free.index(AREA)
    assert AREA.value(1e-4, fit.vector[place]) == pytest.approx(1.3e-4, rel=0.04)
    assert AREA.log_std * np.sqrt(fit.covariance[place, place]) < 0.035


def test_an_area_that_grows_with_load_is_named(read):
    """A finger that spreads by another law than the catalogue's: A goes on as a logarithm."""
    found = diagnose(
        FINGER, read(*lines_of(lambda load_n: 1e-4 * (1.0 + 0.4 * np.log(load_n / 0.5)))), seed=1
    )
    assert found.findings.verdict.decision.verdict == "effect_found"
    assert found.findings.verdict.decision.names == ("contact_area_law",)


def test_a_steady_area_is_no_effect(read):
    found = diagnose(FINGER, read(*lines_of(lambda load_n: 1.1e-4)), seed=1)
    assert found.findings.verdict.decision.verdict == "no_discrepancy"
