"""Strokes: cut where something is unknown, averaged within themselves."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_driver.fidelity.sliding import runs
from haptic_driver.fidelity.strokes import known_pieces, moving_average, without_line
from tests.haptic_driver.fidelity.strokes_of import stroke_of

FRICTIONS = st.lists(st.floats(0.2, 2.0), min_size=1, max_size=60)


@given(values=FRICTIONS, ticks=st.integers(1, 25))
def test_an_average_is_the_mean_of_what_lies_in_the_window(values, ticks):
    half = ticks // 2
    by_hand = [np.mean(values[max(i - half, 0) : i + half + 1]) for i in range(len(values))]
    assert moving_average(np.array(values), ticks) == pytest.approx(by_hand)


@given(mask=st.lists(st.booleans(), max_size=40))
def test_runs_cover_what_is_true_and_nothing_else(mask):
    found = runs(np.array(mask, bool))
    covered = np.zeros(len(mask), bool)
    for start, end in found:
        covered[start:end] = True
    assert covered.tolist() == mask
    assert all(second[0] > first[1] for first, second in pairwise(found))


@given(values=st.lists(st.floats(-5.0, 5.0), min_size=2, max_size=60))
def test_what_is_left_of_a_line_is_that_of_a_fit(values):
    place = np.arange(len(values))
    fit = np.polynomial.Polynomial.fit(place, values, 1)
    assert without_line(np.array(values)) == pytest.approx(values - fit(place), abs=1e-9)


def test_a_line_through_uneven_places_is_taken_out():
    place = np.array([0.0, 1.0, 4.0, 9.0])
    assert without_line(3.0 - 0.5 * place, place) == pytest.approx(np.zeros(4), abs=1e-12)


def test_a_stroke_is_cut_where_target_or_forces_are_unknown():
    stroke = stroke_of(np.full(10, 0.6), np.full(10, 0.5))
    stroke.asked_cof[2] = np.nan
    stroke.lateral_n[5] = np.nan
    stroke.normal_n[8] = 0.0
    stroke.asked_cof[0] = 0.0  # no friction is none that a texture asks for
    pieces = known_pieces([stroke])
    assert [piece.asked_cof.size for piece in pieces] == [1, 2, 2, 1]
    assert all(np.isfinite(piece.felt_cof).all() for piece in pieces)
