"""Errors on data that no fit has seen: what counts as a fold, and in which units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from model.conditions import Conditions
from model.description import read_model
from model.diagnosis.data import Measurements
from model.diagnosis.hypotheses import Candidate, candidate
from model.diagnosis.model_fit import Problem
from model.diagnosis.noise import noise_of
from model.diagnosis.proof import Proof, prove
from model.diagnosis.space import NUISANCES, Predictor
from model.touch_model import TouchModel

FINGER = read_model(Path(__file__).parents[3] / "configs" / "models" / "reference.toml")
NOISE = 0.02


def data(rows_per_session: list[int]) -> Measurements:
    """The model's own friction at some settings, with noise."""
    rng = np.random.default_rng(4)
    count = sum(rows_per_session)
    columns = {
        "frequency_hz": rng.choice([10.0, 250.0, 1e4], count),
        "voltage_v": rng.choice([0.0, 60.0, 120.0], count),
        "normal_force_n": rng.choice([0.3, 1.0], count),
    }
    cof = TouchModel(FINGER).predict(Conditions(**columns)).cof * np.exp(
        NOISE * rng.standard_normal(count)
    )
    session = np.repeat(np.arange(len(rows_per_session)), rows_per_session)
    names = tuple("abcdef"[: len(rows_per_session)])
    return Measurements({**columns, "cof": cof, "cof_std": NOISE * cof}, session, names, None, "00")


def held_out(measured: Measurements, scale: float = 1.0) -> Proof:
    noise = noise_of(measured)
    assert noise is not None
    problem = Problem(Predictor(FINGER, measured), measured.observed, noise)
    base: Candidate = candidate(problem, (), problem.fit((), np.zeros(len(NUISANCES))))
    return prove(FINGER, measured, noise, base, [], scale, 0, lambda _: None)


def test_a_session_of_one_row_is_no_fold_and_leaves_the_others_their_names() -> None:
    """The names of all sessions stood beside the errors of some: session c's error under b's
    name.
    """
    found = held_out(data([15, 1, 15, 15]))
    assert found.by == "session"
    assert found.folds == ("a", "c", "d")
    assert found.before.shape == found.after.shape == (3,)


def test_errors_are_counted_in_the_noise_that_is_asked_for() -> None:
    """The rival's error was counted in its own noise, and compared with the chosen model's in that
    one's.
    """
    measured = data([15, 15, 15])
    once, twice = held_out(measured), held_out(measured, 2.0)
    assert twice.before == pytest.approx(once.before / 4.0, rel=1e-9)
    assert 0.3 < float(np.mean(once.before)) < 2.5  # the data are the model's own, with this noise
