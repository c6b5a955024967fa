"""What is too weak to leave a trace counts as nothing missing."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from model.diagnosis.hidden import NO_TRACE, unseen
from model.diagnosis.space import FARTHEST
from model.effects import BY_NAME

EFFECT = BY_NAME["drive_gain_error"]  # of one parameter


def evidence_of_the_unseen(
    signature: np.ndarray, residual: np.ndarray, nuisance: np.ndarray, at: float = 0.0
) -> float:
    """`signature` [n] per prior standard deviation of an effect that is linear in its parameter;
    beside that of nothing missing.

    `at`: where the base model's one parameter was fitted.
    """

    def whitened(_: object, vectors: np.ndarray) -> np.ndarray:
        return residual - (vectors - np.array([at, 0.0])) @ np.stack([nuisance, signature])

    problem: Any = SimpleNamespace(whitened=whitened)
    base: Any = SimpleNamespace(
        vector=np.array([at]), residual=residual, jacobian=nuisance[:, None], scale2=1.0
    )
    return unseen(problem, base, EFFECT).log_odds


@pytest.mark.parametrize(("size", "residual"), [(0.5, 0.0), (2.0, 1.0), (20.0, -1.0)])
def test_it_is_the_posterior_where_lambda_is_small(size, residual):
    signature, nothing = np.array([size, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    edge = np.sqrt(NO_TRACE) / size
    expected, _ = quad(
        lambda x: norm.pdf(x) * np.exp(residual * size * x - 0.5 * (size * x) ** 2), -edge, edge
    )
    got = np.exp(evidence_of_the_unseen(signature, np.array([residual, 0.0, 0.0]), nothing))
    assert got == pytest.approx(expected, abs=0.03)  # some of 64 draws lie near the edge


def test_what_the_finger_can_take_up_leaves_no_trace():
    """A nuisance with a wide prior moves the prediction as the effect does."""
    signature = np.array([3.0, 3.0, 0.0])
    assert evidence_of_the_unseen(signature, np.zeros(3), 100.0 * signature) == pytest.approx(
        0.0, abs=0.01
    )
    assert evidence_of_the_unseen(signature, np.zeros(3), np.array([1.0, -1.0, 0.0])) < -0.5


def test_a_parameter_at_its_end_takes_nothing_up():
    """A body that floats was "nothing missing" with 1.00: the touch's area, at its end, left what
    the body explains.
    """
    signature = np.array([3.0, 3.0, 0.0])
    left = -0.5 * signature  # of what the parameter would explain beyond its end
    inside, outside = (
        evidence_of_the_unseen(signature, left, 10.0 * signature, at) for at in (0.0, -FARTHEST)
    )
    assert outside < 0.0 < inside
