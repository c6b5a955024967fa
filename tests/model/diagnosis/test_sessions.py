"""Sessions that are noisier than the others are told from sessions that have an effect which the
others do not.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from model.conditions import Conditions
from model.diagnosis.audit import audited
from model.diagnosis.data import Measurements, read_measurements
from model.diagnosis.sessions import inflation, unlike_sessions
from model.diagnosis.setting import fitted
from model.diagnosis.space import NUISANCES, Predictor
from model.diagnosis.witness import CURRENT, FRICTION
from model.diagnosis.workflow import diagnose
from model.effects import BY_NAME
from model.touch_model import TouchModel
from tests.fingers import FINGER, hiding

SESSIONS = 5


def sessions_only(count: int = 20) -> Measurements:
    session = np.repeat(np.arange(SESSIONS), count)
    return Measurements({}, session, tuple("abcde"), None, "")


def test_equal_sessions_are_not_singled_out():
    data = sessions_only()
    found = [
        unlike_sessions(data, np.random.default_rng(i).standard_normal(data.session.size))
        for i in range(200)
    ]
    assert sum(map(bool, found)) <= 1  # 200 x 1e-4 expected


@pytest.mark.parametrize("loud", [[1], [0, 3]])
def test_loud_sessions_are_found_with_their_loudness(loud):
    data = sessions_only(40)
    true = np.where(np.isin(data.session, loud), 4.0, 1.0)
    found = unlike_sessions(data, true * np.random.default_rng(3).standard_normal(true.size))
    assert sorted(found) == loud
    assert inflation(data, found) == pytest.approx(true, rel=0.3)


def test_never_half_of_the_sessions_or_more():
    data = sessions_only(40)
    loud = np.where(np.isin(data.session, [0, 1, 2]), 9.0, 1.0) * np.random.default_rng(
        3
    ).standard_normal(200)
    assert len(unlike_sessions(data, loud)) <= 2
    two = data.subset(data.session < 2)
    assert unlike_sessions(two, loud[data.session < 2]) == {}


def test_a_predictor_switches_effects_on_only_where_the_data_say_so(tmp_path):
    data = read_measurements(write(tmp_path, np.zeros(SESSIONS, bool), 1.0))
    on = data.session == 2
    gain = BY_NAME["drive_gain_error"]
    vector = np.append(np.zeros(len(NUISANCES)), 2.0)[None]
    partly = Predictor(FINGER, replace(data, effects_on=on)).predicted([gain], vector)[0]
    everywhere = Predictor(FINGER, data).predicted([gain], vector)[0]
    nowhere = Predictor(FINGER, data).predicted([], vector[:, :-1])[0]
    np.testing.assert_array_equal(partly, np.where(on, everywhere, nowhere))
    assert np.any(everywhere[data.driven] != nowhere[data.driven])


def write(folder: Path, hidden: np.ndarray, noisier: float) -> Path:
    """Five sessions of a voltage x frequency grid; a roll-off of the drive in some, more noise in
    the last.
    """
    rng = np.random.default_rng(8)
    f, v = (
        a.ravel()
        for a in np.meshgrid(np.geomspace(50, 2e4, 8), [0.0, 60.0, 100.0, 140.0], indexing="ij")
    )
    model = TouchModel(FINGER)
    lines = ["frequency_hz,voltage_v,normal_force_n,cof,cof_std,session"]
    for s in range(SESSIONS):
        drive_v = v / np.sqrt(1 + (f / 2e3) ** 2) if hidden[s] else v
        cof = model.predict(Conditions(f, drive_v, np.full(f.size, 0.5))).cof
        noise = 0.008 * (noisier if s == SESSIONS - 1 else 1.0) * rng.standard_normal(f.size)
        measured = cof * np.exp(0.03 * rng.standard_normal() + noise)
        lines += [
            f"{a:.6g},{b:g},0.5,{c:.6f},{0.008 * c:.6f},{'abcde'[s]}"
            for a, b, c in zip(f, v, measured, strict=True)
        ]
    path = folder / "data.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_an_effect_in_two_of_five_sessions_is_named_with_its_sessions(tmp_path):
    hidden = np.array([False, True, False, True, False])
    found = diagnose(FINGER, read_measurements(write(tmp_path, hidden, 1.0)))
    assert found.findings is not None
    verdict = found.findings.verdict
    named = {verdict.chosen.name, *verdict.group.get(verdict.chosen.name, [])}
    assert "amplifier_bandwidth" in named
    assert found.name in ("effect_found", "ambiguous")
    assert any("shows in b, d only" in warning for warning in found.warnings)


def test_a_noisy_session_is_given_less_weight_and_no_name(tmp_path):
    found = diagnose(FINGER, read_measurements(write(tmp_path, np.zeros(SESSIONS, bool), 5.0)))
    assert found.name == "no_discrepancy"
    assert any("noisier than the others: session e" in warning for warning in found.warnings)


def test_noise_that_hardly_forgets_is_taken_into_account_once(tmp_path):
    """What correlation was left after the first was taken out took its place: 0.8, then 0.31, was
    0.31.
    """
    data = read_measurements(write(tmp_path, np.zeros(SESSIONS, bool), 1.0))
    wander = np.cumsum(np.random.default_rng(25).standard_normal(data.count))
    cof = data.columns["cof"] * np.exp(0.02 * wander)
    slow = replace(data, columns=data.columns | {"cof": cof, "cof_std": 0.02 * cof})
    found = fitted(FINGER, audited(FINGER, slow), lambda _: None)
    assert found.problem.noise.correlation > 0.6
    assert sum("correlated" in said for said in found.warnings) == 1


def test_a_model_with_every_effect_in_it_leaves_nothing_to_test(tmp_path):
    """It ended in a bare error about an empty sequence."""
    on = {kind.name: {p.name: p.median for p in kind.parameters()} for kind in BY_NAME.values()}
    found = diagnose(
        hiding(FINGER, **on), read_measurements(write(tmp_path, np.zeros(SESSIONS, bool), 1.0))
    )
    assert found.name == "not_testable"
    assert "in the model already" in found.warnings[0]


def test_a_session_of_sweeps_is_no_worse_for_being_unlike():
    """Three sessions of friction, one of currents that fit six times worse; of friction, such a one
    is found.
    """
    session = np.repeat(np.arange(4), 30)
    columns = {"voltage_v": np.ones(120), "frequency_hz": np.ones(120)}
    left = np.random.default_rng(0).standard_normal(120)
    left[session == 3] *= 6.0
    data = Measurements(
        columns, session, tuple("abcd"), None, "", witness=np.where(session == 3, CURRENT, FRICTION)
    )
    assert unlike_sessions(data, left) == {}
    assert list(unlike_sessions(replace(data, witness=None), left)) == [3]
