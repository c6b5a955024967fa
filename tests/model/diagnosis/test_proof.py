"""Errors on data that no fit has seen: what counts as a fold, and in which units."""

from __future__ import annotations

import numpy as np
import pytest

from model.conditions import Conditions
from model.diagnosis.data import Measurements
from model.diagnosis.hypotheses import Candidate, Kinds, candidate
from model.diagnosis.model_fit import Problem
from model.diagnosis.noise import noise_of
from model.diagnosis.proof import Proof, _error, prove
from model.diagnosis.space import Predictor
from model.effects import BY_NAME
from model.touch_model import TouchModel
from tests.fingers import FINGER

from .problems import read_rows

NOISE = 0.02


def data(rows_per_session: list[int], power: float = 0.0) -> Measurements:
    """The model's own friction at some settings times a `power` of the load, with noise."""
    rng = np.random.default_rng(4)
    count = sum(rows_per_session)
    columns = {
        "frequency_hz": rng.choice([10.0, 250.0, 1e4], count),
        "voltage_v": rng.choice([0.0, 60.0, 120.0], count),
        "normal_force_n": rng.choice([0.3, 1.0], count),
    }
    cof = TouchModel(FINGER).predict(Conditions(**columns)).cof * np.exp(
        NOISE * rng.standard_normal(count) + power * np.log(columns["normal_force_n"])
    )
    session = np.repeat(np.arange(len(rows_per_session)), rows_per_session)
    names = tuple("abcdef"[: len(rows_per_session)])
    return Measurements({**columns, "cof": cof, "cof_std": NOISE * cof}, session, names, None, "00")


def held_out(measured: Measurements, scale: float = 1.0, kinds: Kinds = ()) -> Proof:
    """With every effect of these alone beside them."""
    noise = noise_of(measured)
    assert noise is not None
    problem = Problem(Predictor(FINGER, measured), measured.observed, noise)

    def fitted(kinds: Kinds) -> Candidate:
        return candidate(
            problem, kinds, problem.fit(kinds, np.zeros(problem.predictor.size(kinds)))
        )

    alone = [fitted((kind,)) for kind in kinds]
    return prove(FINGER, measured, noise, fitted(kinds), alone, scale, 0, lambda _: None)


def test_a_session_of_one_row_is_no_fold_and_leaves_the_others_their_names():
    """The names of all sessions stood beside the errors of some: session c's error under b's
    name.
    """
    found = held_out(data([15, 1, 15, 15]))
    assert found.by == "session"
    assert found.folds == ("a", "c", "d")
    assert found.before.shape == found.after.shape == (3,)


def test_rows_of_which_a_model_says_nothing_are_far_off(tmp_path):
    """Five priors of `trapped_charge` add a steady voltage at which the touch has no solution."""
    rows = ["10,50,0.5,0.6,0.01", "10,150,0.5,0.9,0.01", "1e4,50,0.5,1,0.01"]
    predictor, _ = read_rows(tmp_path, "frequency_hz,voltage_v,normal_force_n,cof,cof_std", rows)
    kinds, lower = (BY_NAME["trapped_charge"],), 0.02 * np.eye(3)
    vector = np.zeros(predictor.size(kinds))
    said = _error(predictor, predictor.data, kinds, vector, lower)
    vector[len(predictor.free)] = 5.0
    assert not np.isfinite(predictor.predicted(kinds, vector[None])).all()
    assert said < _error(predictor, predictor.data, kinds, vector, lower) < np.inf


def test_errors_are_counted_in_the_noise_that_is_asked_for():
    """The rival's error was counted in its own noise, and compared with the chosen model's in that
    one's.
    """
    measured = data([15, 15, 15])
    once, twice = held_out(measured), held_out(measured, 2.0)
    assert twice.before == pytest.approx(once.before / 4.0, rel=1e-9)
    assert 0.3 < float(np.mean(once.before)) < 2.5  # the data are the model's own, with this noise


def test_an_effect_that_is_there_closes_the_gap_and_another_closes_nothing():
    """Friction depends on load otherwise than the model says; the drive is as it says."""
    law, off = BY_NAME["load_dependent_friction"], BY_NAME["drive_gain_error"]
    shares = held_out(data([30] * 6, -0.2), kinds=(law, off)).shares
    assert shares["load_dependent_friction",][0].closed == pytest.approx(1.0, abs=0.1)
    assert shares["drive_gain_error",][0].closed < 0.1
    of_law, of_off = shares["load_dependent_friction", "drive_gain_error"]
    assert (of_law.effect, of_off.effect) == ("load_dependent_friction", "drive_gain_error")
    assert of_law.closed == pytest.approx(1.0, abs=0.1)
    assert not of_off.closed > 0.5  # of next to nothing
