"""A force sensor whose lateral reading has its zero off, or some of the load in it, beside the law
it looks like.
"""

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from model.diagnosis.hypotheses import STARTS, candidate, force_sensor
from model.diagnosis.model_fit import Problem
from model.diagnosis.priors import LOG_ODDS
from model.effects import BY_NAME

from .problems import read_rows

LOAD = BY_NAME["load_dependent_friction"]
NOISE = 0.01
HEADER = "frequency_hz,voltage_v,normal_force_n,cof,cof_std"


def read(
    folder: Path,
    loads: tuple[float, ...],
    zero_n: float = 0.0,
    share: float = 0.0,
    law: float = 0.0,
) -> Problem:
    """What such a sensor reads of a finger with a law of load, `law` prior deviations strong."""
    scatter = (NOISE, 0.0, -NOISE)  # as replicates tell
    conditions = product(loads, (0.0, 40.0, 80.0, 120.0), scatter)
    rows = [f"100,{v:g},{n:g},{0.5 * (1.0 + s):.4g},{0.5 * NOISE}" for n, v, s in conditions]
    predictor, noise = read_rows(folder, HEADER, rows)
    vector = np.append(np.zeros(len(predictor.free)), law)
    cof = np.exp(predictor.predicted((LOAD,), vector[None])[0])
    seen = np.log(cof + zero_n / predictor.data.columns["normal_force_n"] + share)
    return Problem(
        predictor, seen + NOISE * np.random.default_rng(3).standard_normal(seen.size), noise
    )


def gains(problem: Problem) -> tuple[float, float]:
    """What such a sensor and the law add to the base model, in nats."""
    base_fit = problem.fit((), np.zeros(len(problem.predictor.free)))
    base = candidate(problem, (), base_fit)
    law = candidate(problem, (LOAD,), problem.best_fit((LOAD,), base_fit.vector, STARTS))
    nothing = base.alone.log_evidence
    return force_sensor(problem, base) - nothing, law.alone.log_evidence - nothing


@pytest.mark.parametrize(
    ("zero_n", "share"), [(0.05, 0.0), (-0.05, 0.0), (-0.06, 0.12), (0.06, -0.12)]
)
def test_the_sensor_is_certain_where_it_does_it(tmp_path, zero_n, share):
    """Three of 640 blind sets were called friction that depends on load, with 0.95 to 0.99."""
    sensor, law = gains(read(tmp_path, (0.25, 0.5, 1.0), zero_n, share))
    assert law > 50.0
    assert sensor - law > LOG_ODDS


@pytest.mark.parametrize("strength", [-1.0, 0.5, 1.0])
def test_the_law_is_certain_where_it_is_there(tmp_path, strength):
    sensor, law = gains(read(tmp_path, (0.25, 0.5, 1.0), law=strength))
    assert sensor > 30.0
    assert law - sensor > LOG_ODDS


def test_it_is_not_worth_its_numbers_where_it_does_nothing(tmp_path):
    """What it would add to friction as observed, noise and all, gained 80 nats on three sessions of
    nothing.
    """
    sensor, _ = gains(read(tmp_path, (0.25, 0.5, 1.0)))
    assert -5.0 < sensor < 0.0


def test_one_load_says_nothing_of_it(tmp_path):
    problem = read(tmp_path, (0.5,), zero_n=0.05)
    base = candidate(problem, (), problem.fit((), np.zeros(len(problem.predictor.free))))
    assert force_sensor(problem, base) == -np.inf
