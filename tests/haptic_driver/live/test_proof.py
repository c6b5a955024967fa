"""Which windows judge a mended model."""

import pytest

from haptic_driver.live.proof import split
from haptic_driver.live.window import Window


def made(*strokes, session=1):
    """One window a second, so many in each stroke."""
    trials = [trial for trial, count in enumerate(strokes, start=1) for _ in range(count)]
    return [
        Window(200.0, 60.0, 0.5, 0.03, 0.6, 0.01, float(i), 1.0, session, trial)
        for i, trial in enumerate(trials)
    ]


@pytest.mark.parametrize(
    ("strokes", "unseen"), [((4, 4, 7), 7), ((4, 4, 4), 8), ((9, 2, 3), 5), ((3,), 3)]
)
def test_the_newest_strokes_judge_and_no_stroke_is_on_both_sides(strokes, unseen):
    known, judges = split(made(*strokes))
    assert len(judges) == unseen
    assert [*known, *judges] == made(*strokes)
    assert not {window.trial for window in known} & {window.trial for window in judges}


def test_strokes_of_two_sessions_are_not_one():
    first, second = made(6), made(6, session=2)
    assert split([*first, *second]) == (first, second)
