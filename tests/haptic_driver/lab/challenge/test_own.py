"""Simpler methods: which model they choose among fits, by criteria computed by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from haptic_driver.lab.challenge.own import _chosen


def fitted(chi2, parameters):
    return SimpleNamespace(fit=SimpleNamespace(chi2=chi2, vector=np.zeros(parameters)))


@pytest.mark.parametrize(
    ("method", "gain", "chosen"),
    [
        # one parameter more costs 2.22 with AICc and 4.6 with BIC at 100 observations
        ("aicc", 2.0, "base"),
        ("aicc", 2.5, "single"),
        ("bic", 4.0, "base"),
        ("bic", 5.0, "single"),
        ("base", 50.0, "base"),
    ],
)
def test_an_effect_is_chosen_where_it_gains_more_than_it_costs(method, gain, chosen):
    models = {"base": fitted(120.0, 4), "single": fitted(120.0 - gain, 5)}
    other = fitted(119.0, 6)
    found = SimpleNamespace(
        hypotheses=SimpleNamespace(base=models["base"], singles=[other, models["single"]])
    )
    assert _chosen(found, method, 100) is models[chosen]
