"""Proposed settings are allowed ones, and tell the leading models apart when measured."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from model.conditions import Conditions
from model.diagnosis.data import Array, Measurements
from model.diagnosis.model_fit import Problem
from model.diagnosis.noise import noise_of
from model.diagnosis.space import NUISANCES, Predictor
from model.diagnosis.workflow import diagnose
from model.effects import BY_NAME
from model.planning import next_experiment as design
from model.planning.design import leading
from model.planning.next_experiment import next_experiments, out_of_sight
from model.planning.separation import imitate
from model.touch_model import TouchModel
from tests.fingers import FINGER, hiding

NOISE = 0.02
FREQUENCIES, VOLTAGES, LOADS = (1.0, 10.0, 100.0, 1e3, 1e4, 1e6), (50.0, 100.0), (0.3, 1.0)
HIDDEN = {"load_dependent_friction": {"exponent": 0.8}}
SETTING = ("frequency_hz", "voltage_v", "normal_force_n")


def _friction(settings: Array, **effects: dict[str, float]) -> Array:
    return TouchModel(hiding(FINGER, **effects)).predict(Conditions(*settings.T)).cof


def _measured(cof: Array, settings: Array, session: Array) -> Measurements:
    rng = np.random.default_rng(0)
    noisy = cof * np.exp(
        NOISE * rng.normal(size=cof.size) + 0.03 * rng.normal(size=9)[session.astype(int)]
    )
    columns = dict(zip(SETTING, settings.T, strict=True)) | {"cof": noisy, "cof_std": NOISE * noisy}
    names = tuple(str(i) for i in range(int(session.max()) + 1))
    return Measurements(columns, session.astype(np.intp), names, None, "00")


def _design() -> tuple[Array, Array]:
    one = [(f, v, n) for f in FREQUENCIES for v in VOLTAGES for n in LOADS] + [
        (250.0, 0.0, n) for n in LOADS
    ] * 2
    return np.tile(np.array(one), (3, 1)), np.repeat(np.arange(3.0), len(one))


@pytest.fixture(scope="module")
def separable():
    """Two loads alone confuse a load exponent with capillary adhesion; a third load does not."""
    settings, session = _design()
    found = diagnose(FINGER, _measured(_friction(settings, **HIDDEN), settings, session))
    return found, next_experiments(found, FINGER)


def test_proposals_are_settings_that_the_rig_was_near(separable):
    found, proposed = separable
    assert found.name == "ambiguous"
    assert 1 <= len(proposed) <= 6
    for setting in proposed:
        assert setting["kind"] == "setting"
        assert setting["frequency_hz"] is None or 1.0 <= setting["frequency_hz"] <= 1e6
        assert setting["voltage_v"] in (0.0, *VOLTAGES)
        assert (setting["frequency_hz"] is None) == (setting["voltage_v"] == 0.0)
        assert 0.3 / 1.5 <= setting["normal_force_n"] <= 1.5
        assert setting["separates"] == ["load_dependent_friction", "capillary_adhesion"]
        assert setting["lambda_now"] < 25.0 <= setting["lambda_after"]


def test_measuring_the_proposals_tells_which(separable):
    """On average they make a name; in any one case noise may leave the truth a little short of
    it.
    """
    found, proposed = separable
    settings, session = _design()
    rows = [[s["frequency_hz"] or 250.0, s["voltage_v"], s["normal_force_n"]] for s in proposed]
    new = np.repeat(np.array(rows), proposed[0]["repeats"], axis=0)
    every = np.vstack([settings, new])
    cof = _friction(every, **HIDDEN)
    again = diagnose(FINGER, _measured(cof, every, np.append(session, np.full(len(new), 3.0))))
    assert found.findings is not None
    assert again.findings is not None
    before, after = found.findings.verdict, again.findings.verdict
    assert after.chosen.name == "load_dependent_friction"
    assert before.posterior.inclusion["capillary_adhesion"] > 0.1
    assert (
        after.posterior.inclusion["capillary_adhesion"]
        < 0.5 * before.posterior.inclusion["capillary_adhesion"]
    )
    assert after.posterior.inclusion["load_dependent_friction"] > 0.8


def test_proposals_beat_settings_taken_at_random(separable):
    found, proposed = separable
    assert found.findings is not None
    (first, _), (second, _) = leading(found.findings)[:2]
    allowed = design._settings(design._axes(found.data, (*first.kinds, *second.kinds))).observations
    rng, reached = np.random.default_rng(0), []
    for _ in range(12):
        rows = np.isin(
            np.arange(allowed.count), rng.choice(allowed.count, len(proposed), replace=False)
        )
        measured = design._extended(
            found.data, FINGER, found.findings.problem, allowed.subset(rows)
        )
        reached.append(design.separation(measured, first, second))
    assert proposed[0]["lambda_after"] > 2.0 * np.median(reached)
    assert proposed[0]["lambda_after"] > 0.9 * max(reached)


def test_the_expected_gain_is_what_a_refit_finds(separable):
    """Within 30 %: the gains are linear around both fits, the refit is not."""
    _, proposed = separable
    gained = proposed[0]["lambda_after"] - proposed[0]["lambda_now"]
    assert sum(s["separation"] for s in proposed) == pytest.approx(gained, rel=0.3)


def test_settings_to_come_leave_the_measured_rows_as_they_were():
    """Where an effect showed in some sessions only, it was on in all of them as soon as settings
    were added.
    """
    settings, session = _design()
    measured = replace(_measured(_friction(settings), settings, session), effects_on=session == 1.0)
    noise = noise_of(measured)
    assert noise is not None
    problem = Problem(Predictor(FINGER, measured), measured.observed, noise)
    chosen = Measurements(
        dict(zip(SETTING, settings[:2].T, strict=True)), np.zeros(2, np.intp), ("n",), None, ""
    )
    wider = design._extended(measured, FINGER, problem, chosen)
    gain = BY_NAME["drive_gain_error"]
    vector = np.append(np.zeros(len(NUISANCES)), 2.0)[None]
    before, after = (p.predictor.predicted([gain], vector)[0] for p in (problem, wider))
    np.testing.assert_allclose(after[: measured.count], before, rtol=1e-12)
    alone = wider.predictor.predicted([], vector[:, :-1])[0]
    assert np.all(
        after[measured.count :] > alone[measured.count :]
    )  # and the effect is on in what is to come


def test_what_stayed_out_of_sight_shows_in_the_sweep_that_is_named():
    """Two frequencies below an amplifier's corner hide that; by refits of its noiseless signal."""
    one = [(f, v, n) for f in (20.0, 100.0) for v in (0.0, *VOLTAGES) for n in LOADS]
    settings, session = np.tile(np.array(one), (3, 1)), np.repeat(np.arange(3.0), len(one))
    found = diagnose(FINGER, _measured(_friction(settings), settings, session))
    assert found.findings is not None
    hidden = found.findings.hypotheses.hidden
    listed = {row["name"]: row for row in out_of_sight(found)}
    slow = listed["amplifier_bandwidth"]
    assert {name for name in hidden if hidden[name].usual < design.ALIKE} == set(listed)
    assert all(
        row["sweep"] or (row["lambda_after"] is None and row["check"]) for row in listed.values()
    )
    assert slow["sweep"]["axis"] == "frequency_hz"
    problem, base = found.findings.problem, found.findings.hypotheses.base
    there = SimpleNamespace(
        kinds=(BY_NAME["amplifier_bandwidth"],), vector=hidden["amplifier_bandwidth"].vector
    )
    pool = design._sweeps(design._axes(found.data, there.kinds))
    (block,) = (b for b in range(pool.cost_s.size) if design._sweep(pool, b) == slow["sweep"])
    measured = design._extended(
        found.data, FINGER, problem, pool.observations.subset(pool.block == block)
    )
    left = [imitate(p, there, base).chi2 / base.fit.scale2 for p in (problem, measured)]
    assert left[0] < design.ALIKE
    assert left[1] == pytest.approx(slow["lambda_after"], rel=0.3)  # linear about the base model


def test_what_has_one_level_is_not_swept():
    """A finger at rest: the speed of all settings is zero."""
    axes = {
        "frequency_hz": [10.0, 100.0],
        "voltage_v": [75.0],
        "normal_force_n": [0.5, 1.0],
        "speed_m_s": [0.0],
    }
    pool = design._sweeps(axes)
    sweeps = [design._sweep(pool, block) for block in range(pool.cost_s.size)]
    assert {sweep["axis"] for sweep in sweeps} == {"frequency_hz", "voltage_v", "normal_force_n"}
    assert {sweep["low"] for sweep in sweeps if sweep["axis"] == "voltage_v"} == {0.0}
