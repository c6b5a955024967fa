"""What a form may be off: a share of its signature, or of what its strength changes where that is
more.

Or a strength that depends on frequency, which all witnesses see alike.
"""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from model.diagnosis.evidence import evidence, evidence_beside
from model.diagnosis.form import form_terms
from model.diagnosis.hypotheses import STARTS, WORTH_REFITTING, candidate, with_one_more
from model.diagnosis.model_fit import Fit, Problem
from model.diagnosis.witness import CURRENT, CURRENT_PHASE
from model.effects import BY_NAME
from model.support.arrays import Array

from .problems import read_rows

VOLTAGES = np.linspace(0.0, 100.0, 9)
NONLINEAR, GAIN = (
    BY_NAME["skin_nonlinearity"],
    BY_NAME["drive_gain_error"],
)  # strength on a log scale,
HYDRATED = BY_NAME["skin_hydration"]  # and on a linear one


def size(kind: Any, x: float, answer: Callable[[Any, Array], Array]) -> Array:
    """Size of what the form of a made-up effect may be off at x, where a smooth function is the
    same everywhere.
    """

    def predicted(kinds: Any, vectors: Array) -> Array:
        if not kinds:
            return np.zeros((len(vectors), VOLTAGES.size))
        value = kind.parameters()[0].from_normal(vectors[:, :1])
        return np.broadcast_to(answer(value, VOLTAGES), (len(vectors), VOLTAGES.size))

    data = SimpleNamespace(witness=None, row=None)
    predictor = SimpleNamespace(data=data, free=(), predicted=predicted, less=lambda a, b: a - b)
    problem: Any = SimpleNamespace(
        predictor=predictor,
        noise=SimpleNamespace(whiten=lambda v: v),
        smooth=np.ones((VOLTAGES.size, 1)),
        smooth_in_drive={
            name: np.zeros((VOLTAGES.size, 0)) for name in ("frequency_hz", "voltage_v")
        },
    )
    vector = np.zeros(len(kind.parameters()))
    vector[0] = x
    fit: Any = SimpleNamespace(kinds=(kind,), vector=vector, residual=np.zeros(VOLTAGES.size))
    apart = form_terms(problem, fit)[0]
    return np.abs(apart[:, 0])


@pytest.mark.parametrize("x", [-1.0, 0.0, 0.7])
@pytest.mark.parametrize(("power", "times"), [(0.5, 1.0), (1.5, 1.5), (2.0, 2.0), (4.0, 2.0)])
def test_an_effect_that_grows_faster_than_its_strength_may_be_off_by_more(x, power, times):
    """A tenth of the voltage scale of a nonlinear skin is a fifth of its signature: strong ones
    were unexplained.
    """
    scale = 4.0 * 8.0**x
    expected = times * (VOLTAGES / scale) ** power
    assert size(NONLINEAR, x, lambda v0, v: (v / v0) ** power) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("x", [-1.2, 0.8])
def test_a_strength_on_a_linear_scale_is_counted_from_where_it_is_off(x):
    wetness = 0.5 * x
    expected = np.maximum(np.abs(np.expm1(wetness)), np.abs(wetness) * np.exp(wetness)) * VOLTAGES
    assert size(HYDRATED, x, lambda w, v: v * np.expm1(w)) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("x", [-1.0, 0.2])
def test_a_gain_is_off_by_a_share_of_what_it_is_beyond_one(x):
    """A tenth of a gain of 1.05 is twice the effect: a gain that bends a little with the voltage
    was unexplained.
    """
    times = float(np.log(1.35)) * x
    expected = np.maximum(np.abs(np.expm1(times)), np.abs(times) * np.exp(times)) * VOLTAGES
    assert size(GAIN, x, lambda gain, v: v * (gain - 1.0)) == pytest.approx(expected, rel=0.01)


def test_where_an_effect_does_nothing_its_form_is_not_off():
    assert size(NONLINEAR, 0.0, lambda v0, v: np.where(v > 50.0, v / v0, 0.0))[
        VOLTAGES <= 50.0
    ] == pytest.approx(0.0)


# A resistance in series with the electrode, as friction, current and its phase see it.
FREQUENCIES = np.logspace(1.0, 5.5, 19)
RESISTANCE, NOISE = BY_NAME["series_resistance"], 0.01
STRENGTH = float(
    np.log(1.28e6 / RESISTANCE.parameters()[0].median) / RESISTANCE.parameters()[0].std
)  # of a worn film


def observed(tmp_path: Path, off: complex) -> tuple[Problem, Array]:
    """A problem of a resistance with a share of itself more that swings with frequency, 1 % noise;
    and its vector.
    """
    header = "frequency_hz,voltage_v,normal_force_n,cof,cof_std,current_a,current_phase_rad"
    scatter = (NOISE, -NOISE) * 3  # as replicates tell
    rows = [
        f"{f:.8g},75,0.5,0.5,{0.5 * NOISE},{1e-5 * (1.0 + s)},{1.0 + s}"
        for f in FREQUENCIES
        for s in scatter
    ]
    rows += ["250,0,0.5,0.5,0.005,,"] * 4
    predictor, noise = read_rows(tmp_path, header, rows)
    data = predictor.data
    vector = np.append(np.zeros(len(predictor.free)), STRENGTH)
    values = predictor.predicted((RESISTANCE,), vector[None])[0]
    # of the logarithm of the resistance: small enough to be linear, so that a complex one is as
    # well
    shift = 0.01
    step = np.append(np.zeros(len(predictor.free)), shift / RESISTANCE.parameters()[0].std)
    change = (predictor.predicted((RESISTANCE,), (vector + step)[None])[0] - values) / shift
    more = off * np.sin(np.log10(np.maximum(data.columns["frequency_hz"], 1.0)))
    current, angle = data.of(CURRENT), data.of(CURRENT_PHASE)
    values += np.real(more) * change
    values[current] -= np.imag(more[current]) * change[angle]
    values[angle] += np.imag(more[angle]) * change[current]
    values += noise.own_std * np.random.default_rng(5).standard_normal(values.size)
    return Problem(predictor, values, noise), vector


@pytest.mark.parametrize("turn", [1.0, 1j], ids=["amount", "phase"])
def test_a_strength_that_depends_on_frequency_is_seen_by_all_witnesses_alike(tmp_path, turn):
    """A body that loses a little was named with a Johnsen-Rahbek effect, which gave its current the
    phase.
    """
    problem, vector = observed(tmp_path, 0.2 * turn)
    found = candidate(problem, (RESISTANCE,), problem.fit((RESISTANCE,), vector))
    apart, together = form_terms(problem, found.around)
    logs = [
        evidence(found.around, problem.noise, ways).log_evidence
        for ways in ((), (apart,), (together,))
    ]
    assert logs[2] == max(logs)
    assert found.alone.way == 1
    assert found.alone.log_evidence > found.alone.exact + 5.0
    shifts = [
        np.linalg.norm(fit.vector[: len(problem.predictor.free)])
        for fit in (found.fit, found.around)
    ]
    assert shifts[1] < shifts[0]  # the finger need not make up for what the form is off


@pytest.mark.parametrize(("bends", "way"), [(0.2, 1), (0.0, None)])
def test_a_gain_may_depend_on_the_amplitude(tmp_path, bends, way):
    """Of ten gains that bend by a fifth from the volts of a spectrum to those of friction two were
    named.
    """
    header = "frequency_hz,voltage_v,normal_force_n,cof,cof_std,current_a,electrode_voltage_v"
    scatter = (NOISE, -NOISE) * 3
    rows = [
        f"{f:.8g},5,0.5,,,{1e-6 * (1.0 + s)},{5.0 * (1.0 + s)}"
        for f in FREQUENCIES
        for s in scatter
    ]
    rows += [
        f"250,{v},0.5,{0.5 * (1.0 + s)},{0.5 * NOISE},,{v * (1.0 + s)}"
        for v in (75, 100, 125)
        for s in scatter
    ]
    rows += ["250,0,0.5,0.5,0.005,,"] * 4
    predictor, noise = read_rows(tmp_path, header, rows)
    data = predictor.data
    vector = np.append(np.zeros(len(predictor.free)), -1.0)
    weaker = vector * (1.0 - bends)  # the logarithm of a gain, from 1 on
    values = np.where(
        data.columns["voltage_v"] == 5.0,
        *(predictor.predicted((GAIN,), x[None])[0] for x in (weaker, vector)),
    )
    values += noise.own_std * np.random.default_rng(5).standard_normal(values.size)
    problem = Problem(predictor, values, noise)
    found = candidate(problem, (GAIN,), problem.fit((GAIN,), vector))
    assert (found.alone.way if found.alone.bend else None) == way
    assert (found.alone.log_evidence > found.alone.exact + 5.0) is (way is not None)


def test_a_form_that_is_not_off_is_the_exact_one(tmp_path):
    problem, vector = observed(tmp_path, 0.0)
    found = candidate(problem, (RESISTANCE,), problem.fit((RESISTANCE,), vector))
    assert found.alone.log_evidence < found.alone.exact
    assert found.around.vector == pytest.approx(found.fit.vector, abs=0.3)


def test_a_discrepancy_that_adds_nothing_changes_no_evidence(tmp_path):
    """It had the advantage of knowing how far the form is off: a gain that bends was unexplained
    for two nats.
    """
    problem, vector = observed(tmp_path, 0.2)
    found = candidate(problem, (RESISTANCE,), problem.fit((RESISTANCE,), vector))
    assert found.alone.bend > 0.0
    none = [np.zeros((found.around.residual.size, 0))]
    beside = evidence_beside(found.around, problem.noise, none, found.bent, found.alone)
    assert beside.log_evidence == pytest.approx(found.alone.log_evidence, abs=1e-6)


def test_a_model_whose_form_is_off_is_refitted_for_as_long_as_that_says_more(tmp_path):
    """A film of sweat said 4 nats less after one refit, and a polarization beside it 8: neither was
    named.
    """
    problem, vector = observed(tmp_path, 0.4j)
    start = problem.fit((RESISTANCE,), vector)
    found = candidate(problem, (RESISTANCE,), start)
    once = evidence_of(problem, problem.refitted(start, evidence_of(problem, start)[1]))[0]
    again = evidence_of(problem, problem.refitted(found.around, found.bent))[0]
    assert found.alone.log_evidence > once + WORTH_REFITTING
    assert again < found.alone.log_evidence + WORTH_REFITTING
    assert found.alone.exact == evidence_of(problem, start)[2]


def test_one_more_effect_is_fitted_beside_a_form_as_it_is_off(tmp_path):
    """In the exact form alone a polarization beside a film of sweat was as strong as mends the
    film's form best.
    """
    problem, vector = observed(tmp_path, 0.6)
    first = candidate(problem, (RESISTANCE,), problem.fit((RESISTANCE,), vector))
    both = (RESISTANCE, GAIN)
    exact = problem.best_fit(both, first.fit.vector, STARTS)
    alone, found = candidate(problem, both, exact), with_one_more(problem, first, (GAIN,))
    assert found.alone.log_evidence >= alone.alone.log_evidence
    assert found.fit.vector == pytest.approx(exact.vector)
    assert found.alone.exact == alone.alone.exact


def evidence_of(problem: Problem, fit: Fit) -> tuple[float, Array, float]:
    """The evidence around a fit, what its form is off there, and the evidence of the exact form."""
    forms = form_terms(problem, fit)
    found = evidence(fit, problem.noise, forms)
    return found.log_evidence, found.bend * forms[found.way], found.exact
