"""A discrepancy that is made at one place of the chain is learned at that place, and the gap
shrinks.

What is hidden has forms of its own (sines, bells, a hyperbolic tangent), none of which the learned
terms have.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from model.conditions import Conditions
from model.description import ModelDescription, read_model
from model.diagnosis.data import Measurements, read_measurements
from model.diagnosis.hypotheses import Candidate, candidate
from model.diagnosis.learned import LearnedTerm, learn
from model.diagnosis.model_fit import Problem
from model.diagnosis.noise import noise_of
from model.diagnosis.space import Predictor
from model.diagnosis.workflow import diagnose
from model.effects import Effect
from model.effects.learned import learned_kind
from model.reporting.report import write_report
from model.touch_model import TouchModel
from tests.fingers import FINGER
from tests.reports import without_pictures

FREQUENCIES = (10.0, 30.0, 100.0, 300.0, 1e3, 1e4)
SESSIONS, ROWS = 3, 45
NOISE = 0.01
ELECTRODE = ("current_a", "current_phase_rad", "electrode_voltage_v", "electrode_voltage_phase_rad")


@dataclass(frozen=True)
class AtDrive(Effect):
    """The electrode's voltage swings over frequency."""

    def drive(self, drive):
        return replace(
            drive,
            voltage_v=drive.voltage_v * np.exp(0.3 * np.sin(1.3 * np.log(drive.frequency_hz))),
        )


@dataclass(frozen=True)
class AtStack(Effect):
    """The insulator and skin, as one impedance, grow with the decades."""

    def stack(self, branch, parameters, drive):
        bell = np.exp(-((np.log10(drive.frequency_hz) - 2.5) ** 2))
        return replace(branch, series_length_m=1.2 * bell * branch.h_m(parameters))


@dataclass(frozen=True)
class AtGap(Effect):
    """The field in the air rises with speed."""

    def stack(self, branch, parameters, drive):
        return replace(branch, field_gain=1.0 + 0.3 * np.tanh((drive.speed_m_s - 0.02) / 0.01))


@dataclass(frozen=True)
class AtContact(Effect):
    """The contact is stiffer at some loads."""

    def contact(self, contact, parameters, drive):
        return replace(contact, modulus_factor=1.0 + 0.5 * np.sin(3.0 * drive.normal_force_n))


@dataclass(frozen=True)
class AtFriction(Effect):
    """The sensor resonates at a speed."""

    def friction(self, friction, drive):
        return replace(
            friction,
            cof_off_factor=1.0 + 0.15 * np.exp(-((np.log(drive.speed_m_s / 0.02) / 0.4) ** 2)),
        )


def measured(
    tmp_path: Path, hidden: Effect, touch: TouchModel, electrode: bool, seed: int = 5
) -> Measurements:
    rng = np.random.default_rng(seed)
    count = SESSIONS * ROWS
    columns = {
        "frequency_hz": rng.choice(FREQUENCIES, count),
        "voltage_v": rng.choice([0.0, 40.0, 60.0, 80.0], count, p=[0.1, 0.3, 0.3, 0.3]),
        "normal_force_n": rng.choice([0.25, 0.5, 1.0], count),
        "speed_m_s": rng.choice([0.005, 0.01, 0.02, 0.04, 0.08], count),
    }
    answer = touch.predict(Conditions(**columns))
    columns["cof"] = answer.cof * np.exp(NOISE * rng.standard_normal(count))
    columns["cof_std"] = NOISE * columns["cof"]
    columns["session"] = np.repeat(np.arange(SESSIONS) + 1, ROWS)
    if electrode:
        i, v = answer.electrode_current_a, answer.electrode_voltage_v
        for name, phasor in (("current", i), ("electrode_voltage", v)):
            amount = f"{name}_{'a' if name == 'current' else 'v'}"
            columns[amount] = np.abs(phasor) * np.exp(NOISE * rng.standard_normal(count))
            columns[f"{name}_phase_rad"] = np.angle(phasor) + NOISE * rng.standard_normal(count)
    lines = [",".join(columns)]
    for i in range(count):
        quiet = columns["voltage_v"][i] == 0.0
        lines.append(
            ",".join("" if quiet and n in ELECTRODE else f"{x[i]:.9g}" for n, x in columns.items())
        )
    path = tmp_path / "data.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_measurements(path)


class Set(NamedTuple):
    """What `learn` starts from."""

    description: ModelDescription
    data: Measurements
    problem: Problem
    base: Candidate

    def learned(self) -> LearnedTerm | None:
        return learn(*self, seed=0, progress=lambda _: None)


@pytest.fixture
def made(tmp_path, with_effects):
    def make(hidden: Effect, electrode: bool) -> Set:
        data = measured(tmp_path, hidden, with_effects(hidden), electrode)
        noise = noise_of(data)
        problem = Problem(Predictor(FINGER, data), data.observed, noise)
        base = candidate(problem, (), problem.fit((), np.zeros(len(problem.predictor.free))))
        return Set(FINGER, data, problem, base)

    return make


@pytest.mark.parametrize(
    ("hidden", "electrode", "place", "inputs"),
    [
        (AtDrive(), True, "drive", {"frequency_hz"}),
        pytest.param(
            AtStack(), True, "stack", {"frequency_hz"}, marks=pytest.mark.soak
        ),  # long: 10 s each
        pytest.param(AtGap(), True, "air gap", {"speed_m_s"}, marks=pytest.mark.soak),
        pytest.param(AtContact(), True, "contact", {"normal_force_n"}, marks=pytest.mark.soak),
        pytest.param(AtFriction(), True, "friction", {"speed_m_s"}, marks=pytest.mark.soak),
        pytest.param(AtGap(), False, "air gap", {"speed_m_s"}, marks=pytest.mark.soak),
        # friction alone: as below, whole
        pytest.param(AtFriction(), False, "friction", {"speed_m_s"}, marks=pytest.mark.soak),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, Effect) else None,
)
def test_a_discrepancy_is_learned_where_it_acts(made, hidden, electrode, place, inputs):
    found = made(hidden, electrode).learned()
    assert place in found.alike
    assert found.form.place in found.alike
    assert sum(found.places.values()) == pytest.approx(1.0)
    assert inputs <= {name for term in found.form.terms for name in term.inputs}
    assert found.is_proved
    assert found.proof.by == "session"
    assert found.proof.gap_closed > 0.8


@pytest.mark.soak
def test_friction_alone_cannot_tell_the_drive_from_the_field_it_makes(made):
    found = made(AtDrive(), False).learned()
    assert {"drive", "air gap"} <= set(found.alike)
    assert found.proof.gap_closed > 0.8


def test_where_nothing_is_hidden_nothing_is_learned(made):
    found = made(Effect(), True).learned()
    assert found is None or not found.is_proved


@pytest.mark.soak
def test_a_model_that_has_learned_once_learns_no_second_term(made):
    given = made(AtFriction(), False)
    found = given.learned()
    numbers = {
        p.name: replace(given.description.parameters["cof_off"], value=0.0)
        for p in learned_kind(found.form).parameters()
    }
    again = replace(
        given.description, effect_parameters={"learned": numbers}, learned_form=found.form
    )
    assert given._replace(description=again).learned() is None


def test_what_no_effect_explains_goes_into_the_model_file_as_learned(tmp_path, with_effects):
    hidden = AtFriction()
    data = measured(tmp_path, hidden, with_effects(hidden), electrode=False)
    found = diagnose(FINGER, data)
    with without_pictures():
        report = write_report(found, FINGER, tmp_path / "out", "data.csv")
    assert report["verdict"] == "unexplained"
    assert [effect["name"] for effect in report["effects"]] == ["learned"]
    assert report["learned"]["place"] == "friction"
    assert report["learned"]["in_model"]
    assert set(report["learned"]["range"]) == {"speed_m_s"}
    assert report["fit"]["gap_closed"] > 0.8
    assert (
        report["fit"]["held_out_chi2_per_point"]["after"]
        < 0.2 * report["fit"]["held_out_chi2_per_point"]["before"]
    )
    assert "learned" not in {entry["name"] for entry in report["alternatives"]}
    assert json.loads((tmp_path / "out" / "report.json").read_text()) == json.loads(
        json.dumps(report)
    )
    assert "Learned term" in (tmp_path / "out" / "report.html").read_text()

    corrected, new = (
        read_model(tmp_path / "out" / "model.toml"),
        measured(tmp_path, hidden, with_effects(hidden), False, 6),
    )
    assert corrected.learned_form == found.findings.learned.form
    cof = new.columns["cof"]
    before, after = (
        np.std(np.log(TouchModel(model).predict(new.conditions()).cof / cof))
        for model in (FINGER, corrected)
    )
    assert after < 0.4 * before  # data of another day; noise alone is a fifth of it
