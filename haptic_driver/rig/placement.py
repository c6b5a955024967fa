"""How far from the finger a rig renders its place, by its reports and its latency."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from haptic_driver.render.finger import INITIAL, FingerSettings, track
from haptic_driver.rig.parts.finger_trackers import Reports
from haptic_driver.signals import FingerSample

REPORTS = 200  # of one stroke: the filter has long settled
USUAL_SPEED_M_S = 0.137  # median of 1,308 strokes on a panel (github.com/xwhkkk/IHF)
FASTEST_REPORT_S = 1e-3  # a tick takes no more
FARTHEST, HALVINGS = 6.0, 40  # standard deviations, and how finely they are searched
AGES = 10  # of a report, from one to the next
SPEEDS_M_S = 0.05, USUAL_SPEED_M_S, 0.5  # the last: 95 % of those strokes are slower
BACK_AND_FORTH_HZ = 2.0  # 22 mm there and back at the usual speed
TURNS = 10


class Placement(NamedTuple):
    """Error of a rendered place along a straight stroke, by the filter's own standard deviation:
    `stds_m` [AGES], as a report grows older. What is rendered by time is `behind_m` instead.

    Fingers that turn or start are further off; what the latency's own error adds is not in it.
    """

    speed_m_s: float
    latency_s: float
    stds_m: tuple[float, ...]
    behind_m: float

    @property
    def median_m(self) -> float:
        return self._within(0.5)

    @property
    def most_m(self) -> float:
        """What 95 % of the errors stay within."""
        return self._within(0.95)

    def share_beyond(self, distance_m: float) -> float:
        """The share of time for which the error is greater: normal at each age of a report."""
        shares = [math.erfc(distance_m / (math.sqrt(2.0) * std_m)) for std_m in self.stds_m]
        return sum(shares) / len(shares)

    def _within(self, share: float) -> float:
        """What that share of the errors stays within."""
        low_m, high_m = 0.0, FARTHEST * max(self.stds_m)
        for _ in range(HALVINGS):
            middle_m = 0.5 * (low_m + high_m)
            if self.share_beyond(middle_m) > 1.0 - share:
                low_m = middle_m
            else:
                high_m = middle_m
        return high_m


def placement(settings: FingerSettings, reports: Reports, speed_m_s: float) -> Placement:
    """Of a steady stroke, from one report to the next."""
    interval_s = max(reports.interval_s, FASTEST_REPORT_S)
    state = INITIAL
    for k in range(REPORTS):
        time_s = k * interval_s
        there = FingerSample(time_s, speed_m_s * time_s, 0.0, settings.contact_on_n)
        state, _ = track(settings, state, there)
    ages_s = [(k + 0.5) / AGES * interval_s for k in range(AGES)]
    stds_m = tuple(state.std_m(age_s + settings.output_latency_s) for age_s in ages_s)
    latency_s = settings.output_latency_s + 0.5 * interval_s
    behind_m = speed_m_s * (settings.output_latency_s + interval_s)
    return Placement(speed_m_s, latency_s, stds_m, behind_m)


def at_turns(settings: FingerSettings, reports: Reports, speed_m_s: float) -> tuple[float, float]:
    """Error of a rendered place beside the turns of strokes back and forth, m: median, and what
    95 % are within.

    The finger goes back and forth twice a second by a sine whose highest speed is this; its panel
    rounds places. Beside a turn is one report before it and two after.
    """
    interval_s = max(reports.interval_s, FASTEST_REPORT_S)
    per_s = math.tau * BACK_AND_FORTH_HZ
    swing_m, turn_s = speed_m_s / per_s, 0.5 / BACK_AND_FORTH_HZ
    state, errors_m = INITIAL, []
    for k in range(int((TURNS + 1) * turn_s / interval_s)):
        time_s = k * interval_s
        there_m = swing_m * math.sin(per_s * time_s)
        told_m = reports.resolution_m * round(there_m / reports.resolution_m)
        seen = FingerSample(time_s, told_m, 0.0, settings.contact_on_n)
        state, _ = track(settings, state, seen)
        since_s = (time_s - 0.5 * turn_s + interval_s) % turn_s
        if time_s < turn_s or since_s > 3.0 * interval_s:
            continue
        for age in range(AGES):
            now_s = time_s + (age + 0.5) / AGES * interval_s
            _, finger = track(settings, state, seen._replace(now_s=now_s))
            acts_s = now_s + settings.output_latency_s
            errors_m.append(abs(finger.position_x_m - swing_m * math.sin(per_s * acts_s)))
    median_m, most_m = np.percentile(errors_m, [50.0, 95.0]).tolist()
    return median_m, most_m
