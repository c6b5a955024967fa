"""What a form may be off: a share of its signature, or of what its strength changes where that is more."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from model.diagnosis.form import form_terms
from model.effects import BY_NAME
from model.support.arrays import Array

VOLTAGES = np.linspace(0.0, 100.0, 9)
NONLINEAR, GAIN = BY_NAME["skin_nonlinearity"], BY_NAME["drive_gain_error"]  # strength on a log scale,
HYDRATED = BY_NAME["skin_hydration"]  # and on a linear one


def size(kind: Any, x: float, answer: Callable[[Any, Array], Array]) -> Array:
    """Size of what the form of a made-up effect may be off at x, where a smooth function is the same everywhere."""

    def predicted(kinds: Any, vectors: Array) -> Array:
        if not kinds:
            return np.zeros((len(vectors), VOLTAGES.size))
        value = kind.parameters()[0].from_normal(vectors[:, :1])
        return np.broadcast_to(answer(value, VOLTAGES), (len(vectors), VOLTAGES.size))

    data = SimpleNamespace(witness=None, row=None)
    predictor = SimpleNamespace(data=data, free=(), predicted=predicted, less=lambda a, b: a - b)
    problem: Any = SimpleNamespace(
        predictor=predictor, noise=SimpleNamespace(whiten=lambda v: v), smooth=np.ones((VOLTAGES.size, 1))
    )
    vector = np.zeros(len(kind.parameters()))
    vector[0] = x
    fit: Any = SimpleNamespace(kinds=(kind,), vector=vector, residual=np.zeros(VOLTAGES.size))
    return np.abs(form_terms(problem, fit)[:, 0])


@pytest.mark.parametrize("x", [-1.0, 0.0, 0.7])
@pytest.mark.parametrize(("power", "times"), [(0.5, 1.0), (1.5, 1.5), (2.0, 2.0), (4.0, 2.0)])
def test_an_effect_that_grows_faster_than_its_strength_may_be_off_by_more(x: float, power: float, times: float) -> None:
    """A tenth of the voltage scale of a nonlinear skin is a fifth of its signature: strong ones were unexplained."""
    scale = 50.0 * 6.0**x
    expected = times * (VOLTAGES / scale) ** power
    assert size(NONLINEAR, x, lambda v0, v: (v / v0) ** power) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("x", [-1.2, 0.8])
def test_a_strength_on_a_linear_scale_is_counted_from_where_it_is_off(x: float) -> None:
    wetness = 0.5 * x
    expected = np.maximum(np.abs(np.expm1(wetness)), np.abs(wetness) * np.exp(wetness)) * VOLTAGES
    assert size(HYDRATED, x, lambda w, v: v * np.expm1(w)) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("x", [-1.0, 0.2])
def test_a_gain_is_off_by_a_share_of_what_it_is_beyond_one(x: float) -> None:
    """A tenth of a gain of 1.05 is twice the effect: a gain that bends a little with the voltage was unexplained."""
    times = float(np.log(1.35)) * x
    expected = np.maximum(np.abs(np.expm1(times)), np.abs(times) * np.exp(times)) * VOLTAGES
    assert size(GAIN, x, lambda gain, v: v * (gain - 1.0)) == pytest.approx(expected, rel=0.01)


def test_where_an_effect_does_nothing_its_form_is_not_off() -> None:
    assert size(NONLINEAR, 0.0, lambda v0, v: np.where(v > 50.0, v / v0, 0.0))[VOLTAGES <= 50.0] == pytest.approx(0.0)
