"""Errors on data that no fit has seen: what counts as a fold, and in which units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from model.conditions import Conditions
from model.description import read_model
from model.diagnosis.data import Measurements
from model.diagnosis.hypotheses import Candidate, Kinds, candidate
from model.diagnosis.model_fit import Problem
from model.diagnosis.noise import noise_of
from model.diagnosis.proof import Proof, prove, surely_smaller
from model.diagnosis.space import Predictor
from model.effects import BY_NAME
from model.touch_model import TouchModel

FINGER = read_model(Path(__file__).parents[3] / "configs" / "models" / "reference.toml")
NOISE = 0.02


def data(rows_per_session: list[int], gain: float = 1.0) -> Measurements:
    """The model's own friction at some settings under `gain` times the voltage, with noise."""
    rng = np.random.default_rng(4)
    count = sum(rows_per_session)
    columns = {
        "frequency_hz": rng.choice([10.0, 250.0, 1e4], count),
        "voltage_v": rng.choice([0.0, 60.0, 120.0], count),
        "normal_force_n": rng.choice([0.3, 1.0], count),
    }
    applied = columns | {"voltage_v": gain * columns["voltage_v"]}
    cof = TouchModel(FINGER).predict(Conditions(**applied)).cof * np.exp(
        NOISE * rng.standard_normal(count)
    )
    session = np.repeat(np.arange(len(rows_per_session)), rows_per_session)
    names = tuple("abcdef"[: len(rows_per_session)])
    return Measurements({**columns, "cof": cof, "cof_std": NOISE * cof}, session, names, None, "00")


def held_out(measured: Measurements, scale: float = 1.0, kinds: Kinds = ()) -> Proof:
    noise = noise_of(measured)
    assert noise is not None
    problem = Problem(Predictor(FINGER, measured), measured.observed, noise)
    start = np.zeros(problem.predictor.size(kinds))
    chosen: Candidate = candidate(problem, kinds, problem.fit(kinds, start))
    return prove(FINGER, measured, noise, chosen, [], scale, 0, lambda _: None)


def test_a_session_of_one_row_is_no_fold_and_leaves_the_others_their_names():
    """The names of all sessions stood beside the errors of some: session c's error under b's
    name.
    """
    found = held_out(data([15, 1, 15, 15]))
    assert found.by == "session"
    assert found.folds == ("a", "c", "d")
    assert found.before.shape == found.after.shape == (3,)


def test_errors_are_counted_in_the_noise_that_is_asked_for():
    """The rival's error was counted in its own noise, and compared with the chosen model's in that
    one's.
    """
    measured = data([15, 15, 15])
    once, twice = held_out(measured), held_out(measured, 2.0)
    assert twice.before == pytest.approx(once.before / 4.0, rel=1e-9)
    assert 0.3 < float(np.mean(once.before)) < 2.5  # the data are the model's own, with this noise


def test_an_effect_that_is_there_surely_shrinks_the_error_and_another_does_not():
    """The drive is off by half; how friction depends on load is as the model says."""
    off, law = BY_NAME["drive_gain_error"], BY_NAME["load_dependent_friction"]
    rows = [30] * 6
    assert held_out(data(rows, 1.5), kinds=(off,)).shrinks["drive_gain_error"] >= 0.95
    assert held_out(data(rows), kinds=(law,)).shrinks["load_dependent_friction"] < 0.95
    both = held_out(data(rows, 1.5), kinds=(off, law)).shrinks
    assert both["drive_gain_error"] >= 0.95 > both["load_dependent_friction"]


def test_how_sure_a_smaller_error_is_by_hand():
    """Of three folds two gain 2 and one loses 1: seven of 27 draws gain nothing."""
    other, rows = np.array([4.0, 4.0, 4.0]), np.full(3, 10.0)
    # Three standard deviations of what 2000 draws say.
    assert surely_smaller(other - [2, 2, -1], other, rows, 1) == pytest.approx(13 / 27, abs=0.06)
    assert surely_smaller(other - 2.0, other, rows, 1) == 1.0
    assert surely_smaller(other, other, rows, 1) == 0.0
