"""Voltages filled in between solved ones: exact where they should be, and never where something is not smooth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from model.between import CHECKED, SMOOTH, between, fill_between, rough_places

STRIDE = 4
COUNTS = st.integers(STRIDE * CHECKED + 1, 140)


def fill(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What `fill_between` makes of `values` [v] of which only the solved ones are known, and what it leaves."""
    way = between(values.size, STRIDE)
    known = np.full((values.size, 1), -1e300)
    known[way.solved, 0] = values[way.solved]
    uneven, rough = np.zeros(len(way.miss), dtype=np.int64), np.empty(values.size, dtype=np.int64)
    fill_between(way, known, uneven)
    return known[:, 0], rough[: rough_places(way, uneven, rough)]


@given(count=COUNTS, scale=st.floats(-2.0, 2.0))
def test_a_quartic_is_filled_in_as_it_is(count: int, scale: float) -> None:
    x = np.arange(count) / count
    values = 1.0 + x - 0.5 * x**2 + scale * (x**3 - x**4)
    filled, rough = fill(values)
    assert rough.size == 0
    np.testing.assert_allclose(filled, values, rtol=1e-12)  # rounding


@given(count=COUNTS, place=st.floats(0.0, 1.0), bend=st.floats(0.0, 0.1))
def test_a_kink_is_never_bridged(count: int, place: float, bend: float) -> None:
    x = np.arange(count, dtype=np.float64)
    values = 1.0 + 1e-3 * x + bend * np.maximum(x - place * count, 0.0)
    filled, rough = fill(values)
    smooth = np.setdiff1d(np.arange(count), rough)
    # next to a kink the quartic misses more than the check does: up to three times as much
    np.testing.assert_allclose(filled[smooth], values[smooth], rtol=3.0 * SMOOTH)


@given(count=COUNTS, data=st.data())
def test_what_has_no_answer_leaves_its_neighbours_to_be_solved(count: int, data: st.DataObject) -> None:
    values = np.ones(count)
    solved = between(count, STRIDE).solved
    missing = data.draw(st.sampled_from(list(solved)))
    values[missing] = np.nan
    filled, rough = fill(values)
    np.testing.assert_allclose(np.delete(filled, [missing, *rough]), 1.0, rtol=1e-12)  # rounding
    for v in range(missing - STRIDE + 1, missing + STRIDE):
        if 0 <= v < count and v not in solved:
            assert v in rough


@pytest.mark.parametrize("count", [1, 4, 5, STRIDE * CHECKED])
def test_few_voltages_are_all_solved(count: int) -> None:
    np.testing.assert_array_equal(between(count, STRIDE).solved, np.arange(count))
    filled, rough = fill(np.linspace(1.0, 2.0, count) ** -3.0)
    assert rough.size == 0
    np.testing.assert_array_equal(filled, np.linspace(1.0, 2.0, count) ** -3.0)
