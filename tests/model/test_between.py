"""Voltages filled in between solved ones: exact where they should be, and never where something is not smooth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from model.between import CHECKED, SMOOTH, between, fill_between, rough_places, twice

STRIDE = 4
COUNTS = st.integers(STRIDE * CHECKED + 1, 140)


def fill(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What becomes of `values` [v] of which only those asked for are told, and the places asked for."""
    steps = twice(values.size, STRIDE)
    known, told = np.full((values.size, 1), -1e300), steps[0].solved
    known[told, 0] = values[told]
    for way in steps:
        uneven, rough = np.zeros((len(way.miss), 1), dtype=np.bool_), np.empty(values.size, dtype=np.int64)
        fill_between(way, known, uneven)
        rough = rough[: rough_places(way, uneven, np.zeros_like(known, dtype=np.bool_), rough)]
        assert np.intersect1d(rough, told).size == 0
        known[rough, 0] = values[rough]
        told = np.append(told, rough)
    return known[:, 0], told


@given(count=COUNTS, scale=st.floats(-2.0, 2.0))
def test_a_quartic_is_filled_in_as_it_is(count: int, scale: float) -> None:
    x = np.arange(count) / count
    values = 1.0 + x - 0.5 * x**2 + scale * (x**3 - x**4)
    filled, told = fill(values)
    np.testing.assert_array_equal(np.sort(told), between(count, STRIDE).solved)
    np.testing.assert_allclose(filled, values, rtol=1e-12)  # rounding


@given(count=COUNTS, place=st.floats(0.0, 1.0), bend=st.floats(0.0, 0.1))
def test_a_kink_is_never_bridged(count: int, place: float, bend: float) -> None:
    x = np.arange(count, dtype=np.float64)
    values = 1.0 + 1e-3 * x + bend * np.maximum(x - place * count, 0.0)
    # next to a kink the quartic misses more than the check does: up to three times as much
    np.testing.assert_allclose(fill(values)[0], values, rtol=3.0 * SMOOTH)


@given(count=COUNTS, place=st.floats(0.0, 1.0))
def test_next_to_a_kink_most_is_filled_in(count: int, place: float) -> None:
    x = np.arange(count, dtype=np.float64)
    told = fill(1.0 + 1e-3 * x + 0.1 * np.maximum(x - place * count, 0.0))[1]
    asked = np.setdiff1d(told, between(count, STRIDE).solved)
    assert asked.size <= 18  # one place in each of six intervals, then of twelve


@given(count=COUNTS, data=st.data())
def test_what_has_no_answer_leaves_its_neighbours_to_be_solved(count: int, data: st.DataObject) -> None:
    values = np.ones(count)
    solved = between(count, STRIDE).solved
    missing = data.draw(st.sampled_from(list(solved)))
    values[missing] = np.nan
    filled, told = fill(values)
    np.testing.assert_allclose(np.delete(filled, missing), 1.0, rtol=1e-12)  # rounding
    for v in range(missing - STRIDE + 1, missing + STRIDE):
        if 0 <= v < count:
            assert v in told


@pytest.mark.parametrize("count", [1, 4, 5, STRIDE * CHECKED])
def test_few_voltages_are_all_solved(count: int) -> None:
    np.testing.assert_array_equal(between(count, STRIDE).solved, np.arange(count))
    filled, told = fill(np.linspace(1.0, 2.0, count) ** -3.0)
    np.testing.assert_array_equal(told, np.arange(count))
    np.testing.assert_array_equal(filled, np.linspace(1.0, 2.0, count) ** -3.0)
