"""Weights of interpolation against scipy's interpolators and exact polynomials."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from scipy.interpolate import RegularGridInterpolator

from model.support.interpolation import linear_weights, polynomial_weights

X, Y = np.array([0.0, 1.0, 4.0]), np.array([-2.0, 0.5, 1.0, 3.0])


def test_linear_in_two_directions_is_scipys():
    rng = np.random.default_rng(0)
    table, at = (
        rng.standard_normal((X.size, Y.size)),
        rng.uniform([0.0, -2.0], [4.0, 3.0], (100, 2)),
    )
    found = np.einsum(
        "mx,my,xy->m", linear_weights(X, at[:, 0]), linear_weights(Y, at[:, 1]), table
    )
    np.testing.assert_allclose(found, RegularGridInterpolator((X, Y), table)(at), atol=1e-14)


def test_linear_takes_any_shape_and_keeps_the_ends():
    assert linear_weights(X, np.zeros((2, 5))).shape == (2, 5, 3)
    np.testing.assert_array_equal(
        linear_weights(X, np.array([-1.0, 9.0])), [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    )


@given(
    nodes=st.lists(st.integers(-50, 50), min_size=2, max_size=9, unique=True).map(sorted),
    coefficients=st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=5),
)
def test_a_polynomial_of_lower_degree_is_met_exactly(nodes, coefficients):
    x, curve = np.array(nodes) / 50.0, Polynomial(coefficients[: len(nodes)])
    at = np.linspace(x[0], x[-1], 17)
    weights = polynomial_weights(x, at, 5)
    scale = np.abs(weights).sum(axis=1).max()  # how far rounding is carried
    np.testing.assert_allclose(weights @ curve(x), curve(at), atol=1e-13 * scale)


def test_only_the_nearest_nodes_count_and_a_node_itself_alone():
    nodes = np.arange(10.0)
    weights = polynomial_weights(nodes, np.array([4.0, 6.5, 0.1, 9.0]), 4)
    np.testing.assert_array_equal(weights[0], np.eye(10)[4])
    np.testing.assert_array_equal(weights[3], np.eye(10)[9])
    assert [np.flatnonzero(row).tolist() for row in weights[1:3]] == [[5, 6, 7, 8], [0, 1, 2, 3]]
    assert weights.sum(axis=1) == pytest.approx(1.0)
