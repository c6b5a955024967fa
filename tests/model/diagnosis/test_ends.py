"""Fitted numbers at an end of their range, against the ranges that files and effects state."""

from __future__ import annotations

import numpy as np
import pytest

from model.diagnosis.ends import at_an_end
from model.diagnosis.model_fit import Fit
from model.diagnosis.space import FINGER, GAP_OFFSET
from model.effects.skin_hydration import SkinHydration

FREE = (*FINGER, GAP_OFFSET)
NAMES = [nuisance.name for nuisance in FREE]


def fit_at(**moved: float) -> Fit:
    """A fit with these parameters so many prior standard deviations off, all others at none."""
    vector = np.array([moved.get(name, 0.0) for name in (*NAMES, "wetness")])
    empty, square = np.zeros(0), np.eye(vector.size)
    return Fit((SkinHydration,), vector, empty, empty[None], square, 0.0, 1.0, 0.0)


@pytest.fixture(scope="module")
def reference(models):
    return models["reference"].description


def test_numbers_within_their_ranges_are_none(reference):
    assert at_an_end(reference, FREE, fit_at(roughness_rms_m=5.0, wetness=-1.0)) == {}
    # No film at all, six prior deviations down, is as good as an end can be: nothing to say of 0.
    assert at_an_end(reference, FREE, fit_at(gap_offset_m=-5.0)) == {}


@pytest.mark.parametrize("x", [-6.0, 6.0])
def test_what_is_as_far_as_is_looked_is_at_an_end(reference, x):
    found = at_an_end(reference, FREE, fit_at(roughness_rms_m=x))
    assert list(found) == ["roughness_rms_m"]
    assert "the end of its range: that is a bound, and no measurement" in found["roughness_rms_m"]


def test_what_a_file_may_not_say_is_at_the_end_that_it_may(reference):
    """Friction of 0.5 times e^(0.6 x 4.5) is 7.4: a file may say 5."""
    found = at_an_end(reference, FREE, fit_at(cof_off=4.5))
    assert found["cof_off"].startswith("cof_off stands at 5, the end of its range")


def test_an_effects_own_bounds_count(reference):
    (wetness,) = SkinHydration.parameters()
    beyond = (wetness.high - wetness.median) / wetness.std + 0.1
    if wetness.scale == "log":
        beyond = np.log(wetness.high / wetness.median) / wetness.std + 0.1
    found = at_an_end(reference, FREE, fit_at(wetness=min(float(beyond), 6.0)))
    assert list(found) == ["skin_hydration.wetness"]
