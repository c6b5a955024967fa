"""Whether felt friction agrees with what the model expects: a map over the conditions, and a test
that runs along.

Every window of steady sliding falls into one cell per condition. A cell keeps the mean residual of
its windows, with forgetting, and two cumulative sums of log likelihood ratios (Page, Biometrika 41
(1954) 100), for CHANGE more and less friction than expected. With normal noise a sum takes at least
exp(THRESHOLD) windows on average to a false alarm (Lorden, Ann. Math. Stat. 42 (1971) 1897). The
finger's own gain, of which every session has another, is no disagreement: the residuals are taken
against their mean over the last minutes.

Measured on windows of 0.5 s with normal scatter that each knows to 8 degrees of freedom: 6 false
alarms in 160 h at 4 % scatter, none in 160 h at 2 %; a change of 5 % above 50 V is told after 29
and 12 s of sliding in the median, 54 and 20 s in 95 of 100.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, floor, log
from typing import NamedTuple

CHANGE = 0.05  # of friction, that is looked for
# 14 for less than an alarm in the million of sums of 8 h; windows know their scatter badly
THRESHOLD = 17.0
MEMORY_S = 600.0  # of the finger's gain and of the map
KNOWN = 0.0025  # 1 sigma of the gain, from which on cells are tested: a twentieth of CHANGE
FLOOR = 0.01  # of friction: of a finger that is described, nothing better is claimed
MOST_SIGMAS = (
    3.0  # a window that is farther off counts as so far: scatter is known from the window alone
)
QUIET_S = 300.0  # after an alarm nothing is told of the same cell
FACTORS = {
    "frequency_hz": 10.0 ** (1.0 / 3.0),
    "normal_force_n": 2.0**0.5,
    "speed_m_s": 2.0,
}  # from edge to edge
VOLTAGE_STEP_V = 25.0
UNITS = {
    "frequency_hz": "Hz",
    "voltage_v": "V",
    "normal_force_n": "N",
    "speed_m_s": "m/s",
}  # of the conditions


class Window(NamedTuple):
    """A steady stretch of sliding at a time: friction felt over friction expected, as a logarithm,
    and its 1 sigma.
    """

    time_s: float
    conditions: dict[str, float]
    residual: float
    std: float


class Disagreement(NamedTuple):
    """Friction that is `share` off, relative, from `low` to `high` of a condition; `since_s` as the
    windows' times.
    """

    axis: str
    low: float
    high: float
    share: float
    since_s: float

    def __str__(self) -> str:
        side = "more" if self.share > 0.0 else "less"
        place = f"{self.low:.3g}..{self.high:.3g} {UNITS[self.axis]}"
        return f"{abs(self.share):.0%} {side} friction than expected at {place}"


@dataclass
class Mean:
    """A weighted mean that forgets."""

    value: float = 0.0
    weight: float = 0.0
    time_s: float = 0.0

    def add(self, time_s: float, value: float, weight: float) -> None:
        kept = self.weight * exp(-(time_s - self.time_s) / MEMORY_S) if self.weight else 0.0
        self.value = (kept * self.value + weight * value) / (kept + weight)
        self.weight, self.time_s = kept + weight, time_s


@dataclass
class Sum:
    """Evidence for a change to one side: its log likelihood ratio, what was seen while it was
    there, and since when.
    """

    side: float
    evidence: float = 0.0
    seen: float = 0.0
    weight: float = 0.0
    since_s: float = 0.0

    def add(self, time_s: float, residual: float, std: float) -> float | None:
        """The change, where the evidence is enough; it begins anew then."""
        if self.evidence == 0.0:
            self.seen, self.weight, self.since_s = 0.0, 0.0, time_s
        bounded = min(max(residual, -MOST_SIGMAS * std), MOST_SIGMAS * std)
        self.evidence = max(
            0.0, self.evidence + CHANGE * (self.side * bounded - 0.5 * CHANGE) / std**2
        )
        self.seen += residual / std**2
        self.weight += std**-2.0
        if self.evidence < THRESHOLD:
            return None
        self.evidence = 0.0
        return exp(self.seen / self.weight) - 1.0


@dataclass
class Cell:
    """One range of one condition."""

    mean: Mean
    sums: tuple[Sum, Sum]
    quiet_until_s: float


class Agreement:
    """What is known of one finger against one model; begin anew with another."""

    def __init__(self) -> None:
        self._gain = Mean()
        self._cells: dict[tuple[str, int], Cell] = {}

    def add(self, window: Window) -> list[Disagreement]:
        """What is found out with one more window, later than those before."""
        std = (window.std**2 + FLOOR**2) ** 0.5
        known, residual = self._gain.weight * KNOWN**2 >= 1.0, window.residual - self._gain.value
        self._gain.add(window.time_s, window.residual, std**-2.0)
        found = []
        for axis, value in window.conditions.items():
            place = _place(axis, value)
            if place is not None and known:
                found += self._told(axis, place, window.time_s, residual, std)
        return found

    def map(self) -> list[dict[str, str | float]]:
        """Mean residual by cell, and the weight that it has: 1 over its variance."""
        return [
            {
                "axis": axis,
                **dict(zip(("low", "high"), _range(axis, place), strict=True)),
                "share": exp(cell.mean.value) - 1.0,
                "weight": cell.mean.weight,
            }
            for (axis, place), cell in sorted(self._cells.items())
        ]

    def _told(
        self, axis: str, place: int, time_s: float, residual: float, std: float
    ) -> list[Disagreement]:
        cell = self._cells.setdefault((axis, place), Cell(Mean(), (Sum(1.0), Sum(-1.0)), time_s))
        cell.mean.add(time_s, residual, std**-2.0)
        found = []
        for evidence in cell.sums:
            share = evidence.add(time_s, residual, std)
            if share is not None and time_s >= cell.quiet_until_s:
                cell.quiet_until_s = time_s + QUIET_S
                found.append(Disagreement(axis, *_range(axis, place), share, evidence.since_s))
        return found


def _place(axis: str, value: float) -> int | None:
    """The cell of a value; None where it means nothing, such as a carrier without voltage."""
    if axis == "voltage_v":
        return floor(value / VOLTAGE_STEP_V)
    return floor(log(value) / log(FACTORS[axis])) if value > 0.0 else None


def _range(axis: str, place: int) -> tuple[float, float]:
    if axis == "voltage_v":
        return place * VOLTAGE_STEP_V, (place + 1) * VOLTAGE_STEP_V
    return FACTORS[axis] ** place, FACTORS[axis] ** (place + 1)
