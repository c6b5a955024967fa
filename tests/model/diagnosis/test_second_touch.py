"""Another finger or a palm on the screen brings current, and no effect of the catalogue."""

from dataclasses import replace

import pytest

from model.diagnosis.data import read_measurements
from model.diagnosis.hypotheses import SECOND_TOUCH
from model.diagnosis.workflow import diagnose
from tests.fingers import FINGER
from tests.model.diagnosis.electrode import hidden, measured


# half a finger more; all the skin of 471 mm2 but the finger's
@pytest.mark.parametrize("ratio", [0.5, 3.7])
def test_another_touch_is_told_with_its_check(tmp_path, ratio):
    measured(tmp_path / "data.csv", hidden(), 5, other_touches=ratio)
    found = diagnose(FINGER, read_measurements(tmp_path / "data.csv"))
    assert found.findings is not None
    verdict = found.findings.verdict
    assert found.name == "unexplained"
    assert verdict.posterior.outside[SECOND_TOUCH] > 0.95
    assert "let one finger touch alone" in verdict.decision.reason
    assert found.findings.learned is None


def test_a_second_finger_just_as_large_doubles_the_current_as_another_unit_does(tmp_path):
    measured(tmp_path / "data.csv", hidden(), 5, other_touches=1.0)
    data = read_measurements(tmp_path / "data.csv")
    found = diagnose(FINGER, data)
    assert found.name == "unexplained"
    assert found.findings is not None
    outside = found.findings.verdict.posterior.outside
    assert outside[SECOND_TOUCH] + outside["a table with currents that are peak to peak"] > 0.95
    sure = diagnose(FINGER, replace(data, sure=frozenset(data.columns)))  # as of our own rig
    assert sure.findings is not None
    assert sure.findings.verdict.posterior.outside[SECOND_TOUCH] > 0.95


def test_one_finger_alone_is_not_doubted(tmp_path):
    measured(tmp_path / "data.csv", hidden(), 6)
    found = diagnose(FINGER, read_measurements(tmp_path / "data.csv"))
    assert found.name == "no_discrepancy"
    assert found.findings is not None
    assert found.findings.verdict.posterior.outside[SECOND_TOUCH] < 0.05


def test_friction_alone_says_nothing_of_other_touches(tmp_path):
    measured(tmp_path / "data.csv", hidden(), 7)
    data = read_measurements(tmp_path / "data.csv")
    friction = data.subset(data.of(0))
    found = diagnose(FINGER, friction)
    assert found.findings is not None
    assert found.findings.verdict.posterior.outside[SECOND_TOUCH] == 0.0
