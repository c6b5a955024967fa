"""Which touches count, whether they agree, and what a file of places may say."""

from __future__ import annotations

import datetime
import math
import os
import re

import numpy as np
import pytest

from haptic_driver.errors import HapticError
from haptic_driver.lab.measuring.touched_places import (
    HOLD_S,
    LIFT_S,
    TouchedPlace,
    TouchFit,
    fit_calibration,
    fit_touches,
    read_places,
    touch_places,
)
from hw.finger.touch_screen import TouchEvents, TouchReports
from tests.haptic_driver.lab.measuring.touching import (
    CORNERS,
    MATRIX_M,
    SIX,
    NoisyPanel,
    User,
    at,
    away,
    drag,
    touches,
)
from tests.haptic_driver.lab.refusal import refused

TODAY = datetime.date(2026, 1, 31)
SPREAD_RAW = (20.0, 15.0)
COUNT_M = 5e-5


def run(user: User, places: list[tuple[float, float]]) -> tuple[TouchFit, list[str]]:
    said: list[str] = []
    descriptor = user.screen.descriptor
    reports = TouchReports(
        descriptor,
        TouchEvents(user.screen.current_slot),
        name="screen",
        close=lambda: os.close(descriptor),
    )
    try:
        found = touch_places(
            np.array(places),
            reports.read,
            SPREAD_RAW,
            said.append,
            TODAY,
            clock=user.clock,
            sleep=user.sleep,
        )
    finally:
        reports.close()
        user.screen.unplug()
    return found, said


MOMENTS = {
    "touch place": "TOUCH",
    "lifted too early": "LIFTED_EARLY",
    "it moves by": "RESTLESS",
    "held at": "HELD",
}


def moments(said: list[str]) -> list[tuple[int, str]]:
    """What was said, in a word, and of which place, counted from 0."""
    found: list[tuple[int, str]] = []
    for line in said:
        named = re.search(r"place (\d+) of", line)
        number = int(named[1]) - 1 if named else found[-1][0]
        found.append((number, next(MOMENTS[words] for words in MOMENTS if words in line)))
    return found


def counts_of(x_m: float, y_m: float) -> np.ndarray:
    return np.linalg.solve(MATRIX_M[:, :2], np.array([x_m, y_m]) - MATRIX_M[:, 2])


def touched(
    places: list[tuple[float, float]], missed_m: dict[int, tuple[float, float]]
) -> list[TouchedPlace]:
    """Touched to the count, except where the finger missed the place."""
    missed = [np.add(place, missed_m.get(i, (0.0, 0.0))) for i, place in enumerate(places)]
    return [
        TouchedPlace(*place, *map(float, counts_of(*there)))
        for place, there in zip(places, missed, strict=True)
    ]


def same_map(found: TouchFit, tolerance_m: float) -> None:
    """Every corner of the screen is mapped to where it is."""
    for place in [(0.0, 0.0), (0.2, 0.0), (0.2, 0.1), (0.0, 0.1)]:
        assert found.calibration.apply(*counts_of(*place)) == pytest.approx(place, abs=tolerance_m)


def test_places_touched_in_turn_give_the_screens_own_map_by_averages():
    """Even noise of +-5 counts, 3.2 rms, averaged over about 60 reports: within two counts with six
    places.
    """
    found, said = run(User(touches(SIX), panel=NoisyPanel()), SIX)
    same_map(found, 2 * COUNT_M)
    assert moments(said) == [(i, name) for i in range(6) for name in ("TOUCH", "HELD")]
    assert found.agrees
    assert (found.calibration.measured_on, found.calibration.placeholder) == (TODAY, False)
    assert [place[:2] for place in found.touched] == SIX
    for place in found.touched:
        assert (place.x_raw, place.y_raw) == pytest.approx(tuple(counts_of(*place[:2])), abs=2.0)


def test_a_finger_that_slides_counts_only_once_it_holds_still():
    there = [(0.05, 0.05), (0.15, 0.05), (0.1, 0.09)]
    script = [away(), drag(0.0, 0.05, 2.5), at(0.05, 0.05), away(), *touches(there[1:])]
    found, said = run(User(script), there)
    assert moments(said) == [(i, name) for i in range(3) for name in ("TOUCH", "HELD")]
    same_map(found, 4 * COUNT_M)  # the end of the slide is within SPREAD_RAW, and counts


def test_a_finger_that_does_not_hold_still_is_told_by_how_much_it_moves_and_once_per_touch():
    script = [away(), drag(0.0, 0.05, 6.0), away(), *touches(CORNERS)]
    _, said = run(User(script), CORNERS)
    assert moments(said)[:4] == [(0, "TOUCH"), (0, "RESTLESS"), (0, "LIFTED_EARLY"), (0, "HELD")]
    x_raw, y_raw = map(float, re.findall(r"(\d+) x (\d+) counts", said[1])[0])
    assert x_raw == pytest.approx(0.02 * HOLD_S / COUNT_M, rel=0.1)  # speed times time
    assert y_raw < 10.0


def test_a_contact_that_flickers_is_no_lift():
    """Else the next place would be given the counts of this one."""
    flicker = [at(*CORNERS[0]), away(LIFT_S / 4), at(*CORNERS[0], 2.0)]
    found, said = run(User([away(), *flicker, *touches(CORNERS[1:])]), CORNERS)
    assert moments(said) == [(i, name) for i in range(4) for name in ("TOUCH", "HELD")]
    same_map(found, COUNT_M)


def test_a_place_touched_where_another_was_is_refused():
    """Three places fit whatever was touched: a finger that never moved would give a map of its
    noise.
    """
    with refused("same_counts", "place 2 was touched where place 1 was", kind=HapticError):
        run(User(touches([CORNERS[0]] * 3), panel=NoisyPanel()), CORNERS[:3])


def test_touches_on_a_line_are_no_map():
    on_a_line = [(0.02, 0.02), (0.06, 0.04), (0.1, 0.06)]
    with refused("touches_on_a_line", kind=HapticError):
        run(User(touches(on_a_line)), CORNERS[:3])


# --- whether touches agree
# -------------------------------------------------------------------------------------


def test_four_places_tell_that_one_is_wrong_but_not_which():
    """One corner of a rectangle off by e: the map is e/4 off at each, and the error of a touch is
    e/2.
    """
    found = fit_touches(touched(CORNERS, {3: (0.006, 0.0)}), TODAY)
    assert found.off_m == pytest.approx([0.0015] * 4, rel=0.1)
    assert found.touch_error_m == pytest.approx(0.003, rel=0.1)
    assert not found.agrees


@pytest.mark.parametrize("wrong", range(6))
def test_six_places_tell_which_one_is_wrong(wrong):
    found = fit_touches(touched(SIX, {wrong: (0.006, -0.008)}), TODAY)
    assert found.worst == wrong
    assert not found.agrees


def test_the_error_of_a_touch_is_that_of_the_finger():
    """On average over many screens, whatever the fit took up of it."""
    rng = np.random.default_rng(7)
    squares = []
    for _ in range(400):
        missed = {i: tuple(rng.normal(0.0, 0.5e-3, 2)) for i in range(4)}
        squares.append((fit_touches(touched(CORNERS, missed), TODAY).touch_error_m or 0.0) ** 2)
    assert math.sqrt(np.mean(squares)) == pytest.approx(math.sqrt(2.0) * 0.5e-3, rel=0.08)


# --- files
# ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "code", "said"),
    [
        ("x_m\n0.1\n", "missing_column", "column y_m is missing"),
        ("x_m,y_m\n0,0\n0.1,0\n", "bad_places", "has 2 places"),
        ("x_m,y_m\n0,0\n0.1,0\n0.2,0.001\n", "bad_places", "on a line, or nearly"),
        ("x_m,y_m\n0,0\n0,0\n0,0\n", "bad_places", "on a line"),
        ("x_m,y_m\n0,0\n100,0\n0,60\n", "bad_places", "line 3: x_m = 100 is out of range"),
        ("x_m,y_m\n0,0\n0.1,here\n0,0.1\n", "not_a_number", "line 3: y_m is 'here'"),
    ],
)
def test_a_file_that_cannot_be_used_says_what_is_wrong_where(tmp_path, text, code, said):
    (tmp_path / "places.csv").write_text(text)
    with refused(code, said):
        read_places(tmp_path / "places.csv")


@pytest.mark.parametrize(
    ("raw", "place"),
    [
        ([[0, 0], [1000, 1000], [2000, 2000]], [[0, 0], [1, 0], [0, 1]]),
        ([[0, 0], [1000, 0], [0, 1000]], [[0, 0], [0.1, 0], [0.2, 0]]),  # places on a line
        ([[0, 0], [1000, 0], [0, math.nan]], [[0, 0], [0.1, 0], [0, 0.1]]),
    ],
)
def test_points_that_tell_no_map_are_refused(raw, place):
    with pytest.raises(ValueError, match=r"give \[n, 2\]|points|maps"):
        fit_calibration(np.array(raw), np.array(place), TODAY)
