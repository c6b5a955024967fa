"""Sobol indices against closed forms, and what the physics says must or must not matter."""

from dataclasses import replace

import numpy as np
import pytest

from model.analysis.sensitivity import force_sensitivity, sobol
from model.support.errors import ModelError
from tests.model.touches import touches

SAMPLED = 0.02  # of an index, with 2048 draws


def test_an_additive_function_has_the_shares_of_its_variance():
    """y = 3 + x1 + 2 x2 + 0.5 x3: shares 1, 4 and 0.25 of 5.25, and no interactions."""
    first, total = sobol(lambda x: (3.0 + x @ [1.0, 2.0, 0.5])[:, None], 3, 2048)
    expected = np.array([1.0, 4.0, 0.25]) / 5.25
    np.testing.assert_allclose(first[0], expected, atol=SAMPLED)
    np.testing.assert_allclose(total[0], expected, atol=SAMPLED)


def test_an_interaction_is_in_the_total_index_only():
    """y = x1 + x2 x3 has variance 1 + 1; the product's share is of neither factor by itself."""
    first, total = sobol(lambda x: np.stack([x[:, 0] + x[:, 1] * x[:, 2]], axis=1), 3, 4096)
    np.testing.assert_allclose(first[0], [0.5, 0.0, 0.0], atol=0.05)
    np.testing.assert_allclose(total[0], [0.5, 0.5, 0.5], atol=0.05)


def test_what_matters_where(models):
    found = force_sensitivity(
        models["reference"].description, touches([10.0, 250.0, 1e4], 75.0), draws=512
    )
    by_name = dict(zip(found.names, found.total.T, strict=True))
    assert "cof_off" not in by_name  # the force does not know it
    assert by_name["leak_scale"][0] > 0.1  # leakage takes the force away at 10 Hz
    assert by_name["leak_scale"][2] < 0.01
    assert (
        by_name["skin_thickness_m"][2] > 10.0 * by_name["skin_thickness_m"][0]
    )  # at high frequency skin insulates
    assert (found.first.sum(axis=1) < 1.05).all()
    assert (found.relative_std > 0.2).all()


def test_pull_in_and_printed_equations_are_refused(models):
    with pytest.raises(ModelError, match="pulls in"):
        force_sensitivity(models["reference"].description, touches(250.0, 3000.0), draws=64)
    with pytest.raises(ModelError, match="printed"):
        force_sensitivity(
            replace(models["reference"].description, variant="published"),
            touches(250.0, 75.0),
            draws=64,
        )


def test_no_voltage_has_no_force_to_be_sensitive(models):
    """The logarithm of zero went through as NaN in every index."""
    with pytest.raises(ModelError, match="nothing attracts"):
        force_sensitivity(models["reference"].description, touches(250.0, 0.0), draws=8)
