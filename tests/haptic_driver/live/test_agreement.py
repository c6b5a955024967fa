"""The test that runs along: how often it alarms for nothing, how soon for something, and what it
says.
"""

import numpy as np
import pytest

from haptic_driver.live.agreement import Agreement
from haptic_driver.live.comparison import compared
from haptic_driver.live.window import Window

PERIOD_S = 0.5
HOURS_S = 3600.0
SCATTER = 0.04  # of a window
DEGREES = 8  # to which a window knows its own scatter


def windows(rng, duration_s, changed=lambda window: 0.0, gain=0.04):
    """A finger with a gain of its own, over carriers, voltages, loads and speeds as they come."""
    count = round(duration_s / PERIOD_S)
    f, v, n, s = (
        rng.uniform(*ends, count) for ends in ((1.5, 3.5), (0.0, 140.0), (0.3, 0.9), (0.01, 0.08))
    )
    noise = SCATTER * rng.standard_normal(count)
    stated = SCATTER * np.sqrt(rng.chisquare(DEGREES, count) / DEGREES)
    for i in range(count):
        at = 10.0 ** f[i], v[i], n[i], s[i]
        window = Window(*map(float, at), 1.0, 0.0, i * PERIOD_S, PERIOD_S, 1, 1)
        cof = float(np.exp(gain + noise[i] + changed(window)))
        yield window._replace(cof=cof, cof_std=float(stated[i]) * cof)


def alarms(made):
    """Each with the time of its window."""
    agreement = Agreement()
    return [(window.time_s, found) for window in made for found in seen(agreement, window)]


def seen(agreement, window):
    """What a window tells where friction of 1 is expected."""
    residual, std = compared([window], np.ones(1))
    return agreement.add(window, float(residual[0]), float(std[0]))


def test_false_alarms_are_fewer_than_one_in_eight_hours(rng):
    """No more than 3 where 1 is the mean: of a thousand such tests two would fail, were it as
    many.
    """
    assert len(alarms(windows(rng, 8.0 * HOURS_S))) <= 3


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_change_of_five_percent_is_told_within_a_minute_of_sliding(rng, side):
    begins_s = 600.0
    delays = []
    for _ in range(20):
        change = lambda window: (  # noqa: E731
            side * 0.05 * (window.time_s >= begins_s) * (window.voltage_v > 50.0)
        )
        told = [
            (t, found)
            for t, found in alarms(windows(rng, begins_s + 120.0, change))
            if t >= begins_s
        ]
        time_s, first = told[0]
        assert np.sign(first.share) == side
        assert first.since_s >= begins_s - 60.0
        delays.append(time_s - begins_s)
    assert np.mean(np.array(delays) <= 60.0) >= 0.9


def test_it_says_where_and_how_much(rng):
    def change(window):
        return -0.08 * (window.frequency_hz < 100.0) * (window.time_s > 300.0)

    told = [
        found for _, found in alarms(windows(rng, 900.0, change)) if found.axis == "frequency_hz"
    ]
    low = [found for found in told if found.high <= 101.0]
    assert low
    assert "less friction than expected at" in str(low[0])
    assert str(low[0]).endswith(f"{low[0].low:.3g}..{low[0].high:.3g} Hz")
    assert low[0].share == pytest.approx(-0.08, abs=0.03)


def test_the_map_shows_what_is_off(rng):
    agreement = Agreement()
    for window in windows(rng, 1800.0, lambda window: 0.06 * (window.normal_force_n > 0.7072)):
        seen(agreement, window)
    shares = {cell.low: cell.share for cell in agreement.map() if cell.axis == "normal_force_n"}
    assert max(shares, key=shares.get) > 0.7
