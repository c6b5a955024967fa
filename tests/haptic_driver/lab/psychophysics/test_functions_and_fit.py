"""Psychometric functions against scipy's distributions, and their fit against answers of known
functions.
"""

import math

import numpy as np
import pytest
from scipy import stats

from haptic_driver.errors import BadInputError
from haptic_driver.lab.psychophysics.fit import fit
from haptic_driver.lab.psychophysics.functions import Psychometric

LEVELS = np.array([0.0, 0.03, 0.1, 0.15, 0.3, 0.9])


def test_functions_are_those_of_the_distributions_they_are_named_for():
    weibull = Psychometric("weibull", 0.15, 3.0, 0.5, 0.02)
    scale = 0.15 / math.log(2.0) ** (1.0 / 3.0)  # scipy's is reached at 1 - 1/e
    expected = 0.5 + 0.48 * stats.weibull_min(3.0, scale=scale).cdf(LEVELS)
    np.testing.assert_allclose(weibull.at(LEVELS), expected, rtol=1e-12)
    normal = Psychometric("normal", 0.1, 8.0, 0.0, 0.05)
    expected = 0.95 * stats.norm(0.1, 1.0 / 8.0).cdf(LEVELS - 0.2)
    np.testing.assert_allclose(normal.at(LEVELS - 0.2), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("truth", "levels", "guess"),
    [
        (
            Psychometric("weibull", 0.15, 3.0, 0.5, 0.02),
            [0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.6],
            0.5,
        ),
        (
            Psychometric("weibull", 0.02, 1.5, 1 / 3, 0.0),
            [0.005, 0.01, 0.02, 0.04, 0.08, 0.2],
            1 / 3,
        ),
        (
            Psychometric("weibull", 0.2, 2.0, 0.15, 0.03),
            [0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.6],
            None,
        ),
        (
            Psychometric("normal", -0.03, 12.0, 0.0, 0.01),
            [-0.3, -0.15, -0.05, 0.0, 0.05, 0.15, 0.3],
            0.0,
        ),
    ],
)
def test_answers_in_the_shares_of_a_function_give_it_back(truth, levels, guess):
    each = np.arange(4000)
    positive = [each < round(4000 * float(truth.at(x))) for x in levels]
    found = fit(np.repeat(levels, 4000).tolist(), np.ravel(positive).tolist(), truth.form, guess)
    scale = abs(truth.threshold)
    assert found.function.threshold == pytest.approx(truth.threshold, abs=0.01 * max(scale, 0.1))
    assert found.function.slope == pytest.approx(truth.slope, rel=0.04)
    assert found.function.guess == pytest.approx(truth.guess, abs=0.01)
    assert found.function.lapse == pytest.approx(truth.lapse, abs=0.005)
    low, high = found.interval_95
    assert low < truth.threshold < high
    assert high - low < 0.1 * max(scale, 0.3)
    assert found.deviance < 1.0  # the shares are the function's, but for rounding


@pytest.mark.soak
def test_intervals_hold_the_truth_about_as_often_as_they_say():
    """Of 40 at 95 %, fewer than 34 would come up once in 100."""
    truth, rng = Psychometric("weibull", 0.15, 3.0, 0.5, 0.02), np.random.default_rng(5)
    levels = np.repeat([0.05, 0.1, 0.15, 0.2, 0.3, 0.5], 40)
    held = 0
    for _ in range(40):
        low, high = fit(
            levels, rng.random(levels.size) < truth.at(levels), "weibull", 0.5
        ).interval_95
        held += low <= 0.15 <= high
    assert held >= 34


ASKED = np.repeat([0.05, 0.1, 0.15, 0.2, 0.3, 0.4], 10)
SIGNED = np.repeat([-0.3, -0.15, -0.05, 0.0, 0.05, 0.15, 0.3], 10)
BELOW, ABOVE = "below 0.05, the lowest level", "above 0.4, the highest level"
FALLS = "fewer as the level rises: are keys or intervals swapped?"


@pytest.mark.parametrize(
    ("levels", "positive", "form", "guess", "why"),
    [
        (ASKED, ASKED > 0.0, "weibull", 0.5, BELOW),
        (ASKED, ASKED > 0.0, "weibull", None, BELOW),
        (ASKED, np.arange(60) % 2 == 0, "weibull", 0.5, ABOVE),  # chance: nothing is felt
        (ASKED, ASKED < 0.18, "weibull", 0.5, FALLS),  # keys swapped
        (SIGNED, SIGNED > -1.0, "normal", 0.0, "below -0.3, the lowest level"),
        (SIGNED, SIGNED > 1.0, "normal", 0.0, "above 0.3, the highest level"),
        (SIGNED, SIGNED < 0.0, "normal", 0.0, FALLS),
        (np.full(20, 0.1), np.arange(20) % 4 > 0, "weibull", 0.5, "open on both sides"),
    ],
)
def test_answers_that_hold_no_threshold_give_no_number(levels, positive, form, guess, why):
    found = fit(list(levels), list(positive), form, guess)
    assert math.isnan(found.threshold)
    assert why in found.why_none


def test_what_is_left_of_a_threshold_is_a_one_sided_interval():
    """Where all answers are right, by a grid over slopes, lapses being none."""
    everything = fit(list(ASKED), [True] * 60, "weibull", 0.5)
    low, high = everything.interval_95
    assert everything.open_ends == (True, False)
    assert low == 0.0
    price = [
        np.log(slope / 3.0) ** 2
        - 2.0 * np.log(Psychometric("weibull", high, slope, 0.5).at(ASKED)).sum()
        for slope in np.geomspace(0.5, 15.0, 2000)
    ]
    assert min(price) == pytest.approx(stats.chi2.isf(0.10, 1), rel=0.02)  # the root's 1e-3
    nothing = fit(list(ASKED), [x % 2 == 0 for x in range(60)], "weibull", 0.5)
    assert nothing.open_ends == (False, True)
    assert nothing.interval_95[0] > 0.3


def test_answers_below_chance_are_flagged():
    """3 of 60 where half are right by guessing: p = 3e-14."""
    swapped = fit(list(ASKED), [i in (3, 24, 51) for i in range(60)], "weibull", 0.5)
    said = "3 of 60 answers are positive, fewer than by chance (50 %)"
    assert any(said in note for note in swapped.notes)
    lucky = fit(list(ASKED), [i % 5 > 2 for i in range(60)], "weibull", 0.5)  # 24 of 60: p = 0.08
    assert not any("chance" in note for note in lucky.notes)


def test_a_slope_or_lapses_at_their_end_are_said():
    steep = fit(list(np.tile(ASKED, 10)), list(np.tile(ASKED, 10) > 0.12), "weibull", 0.0)
    assert any("the slope is 15 or more" in note for note in steep.notes)
    lapses = [(x > 0.12) and i % 5 > 0 for i, x in enumerate(np.tile(ASKED, 10))]
    lapsed = fit(list(np.tile(ASKED, 10)), lapses, "weibull", 0.0)
    assert any("lapses are 10 % or more" in note for note in lapsed.notes)


@pytest.mark.parametrize(
    ("levels", "positive"), [([0.1] * 7, [True] * 7), ([0.0] * 20, [True] * 20), ([], [])]
)
def test_too_few_trials_are_refused(levels, positive):
    with pytest.raises(BadInputError, match="too few"):
        fit(levels, positive, "weibull", 0.5)
