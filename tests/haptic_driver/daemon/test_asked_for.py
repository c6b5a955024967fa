"""What was asked for a moment, against numpy's interpolation over all that was ever said."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_driver.daemon.asked_for import LENGTH, Asked, AskedFor

PERIOD_S = 0.001


@given(
    st.lists(st.integers(1, 5), min_size=1, max_size=3 * LENGTH),
    st.lists(st.floats(-0.1, 1.2), min_size=1, max_size=20),
    st.floats(-0.5, 0.5),
)
def test_it_is_what_numpy_interpolates_and_nothing_where_nobody_knows(steps, shares, jitter):
    """Ticks may be missed, and a lead that changes moves moments by less than a tick."""
    asked = AskedFor(PERIOD_S)
    moments = np.cumsum(steps) * PERIOD_S
    moments[len(moments) // 2 :] += jitter * PERIOD_S
    moments = np.sort(moments)
    values = np.sin(50.0 * moments)
    for moment_s, value in zip(moments.tolist(), values.tolist(), strict=True):
        asked.add(moment_s, Asked(value, 2.0 * value, True))
    kept = slice(max(moments.size - LENGTH, 0), None)
    low_s, high_s = moments[kept][[0, -1]].tolist()
    for share in [*shares, 0.0, 1.0]:
        at_s = low_s + share * (high_s - low_s)
        target, expected, reachable = asked.at(at_s)
        if low_s <= at_s <= high_s:
            assert target == pytest.approx(np.interp(at_s, moments[kept], values[kept]), abs=1e-9)
            assert expected == pytest.approx(2.0 * target, abs=1e-12)
        else:
            assert math.isnan(target)
            assert not reachable


def test_what_is_forgotten_was_not_asked():
    asked = AskedFor(PERIOD_S)
    asked.add(1.0, Asked(0.6, 0.6, True))
    asked.forget()
    assert math.isnan(asked.at(1.0)[0])
