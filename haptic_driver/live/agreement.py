"""Whether felt friction agrees with what the model expects: a map over the conditions, and a test
that runs along.

Every window falls into one cell per condition. A cell keeps the mean residual of its windows, with
forgetting, and two cumulative sums of log likelihood ratios (Page, Biometrika 41 (1954) 100). The
two sums are for CHANGE more and CHANGE less friction than expected. With normal noise a sum takes
at least exp(THRESHOLD) windows on average to a false alarm (Lorden, Ann. Math. Stat. 42 (1971)
1897). The finger's own gain, of which every session has another, is no disagreement: the residuals
are taken against their mean over the last minutes.

The numbers hold for windows of 0.5 s with normal scatter that each knows to 8 degrees of freedom.
False alarms are 6 in 160 h at 4 % scatter, none in 160 h at 2 %. A change of 5 % above 50 V is
reported after 29 and 12 s of sliding in the median. It takes 54 and 20 s in 95 of 100.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, floor, log
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from haptic_driver.live.window import Window

CHANGE = 0.05  # of friction, that is looked for
# 14 for less than an alarm in the million of sums of 8 h; windows know their scatter badly
THRESHOLD = 17.0
MEMORY_S = 600.0  # of the finger's gain and of the map
# a window that is farther off counts as so far: scatter is known from the window alone
MOST_SIGMAS = 3.0
QUIET_S = 300.0  # after an alarm the same cell reports nothing
# of each condition the unit, and from edge to edge of a cell a factor; of the voltage a difference
AXES: dict[str, tuple[str, float]] = {
    "frequency_hz": ("Hz", 10.0 ** (1.0 / 3.0)),
    "voltage_v": ("V", 25.0),
    "normal_force_n": ("N", 2.0**0.5),
    "speed_m_s": ("m/s", 2.0),
}


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
        place = f"{self.low:.3g}..{self.high:.3g} {AXES[self.axis][0]}"
        return f"{abs(self.share):.0%} {side} friction than expected at {place}"


class Share(NamedTuple):
    """By how much friction is off in a cell, relative, and the weight of that: 1 over variance."""

    axis: str
    low: float
    high: float
    share: float
    weight: float


@dataclass
class Mean:
    """A weighted mean that forgets."""

    value: float = 0.0
    weight: float = 0.0
    time_s: float = 0.0

    def add(self, time_s: float, value: float, std: float) -> None:
        kept = self.weight * exp((self.time_s - time_s) / MEMORY_S) if self.weight else 0.0
        self.weight, self.time_s = kept + std**-2.0, time_s
        self.value += (value - self.value) / (self.weight * std**2)


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
        gained = CHANGE * (self.side * bounded - 0.5 * CHANGE) / std**2
        self.evidence = max(0.0, self.evidence + gained)
        self.seen += residual / std**2
        self.weight += std**-2.0
        if self.evidence < THRESHOLD:
            return None
        self.evidence = 0.0
        return exp(self.seen / self.weight) - 1.0


class Cell:
    """One range of one condition."""

    def __init__(self) -> None:
        self.mean, self.sums, self.quiet_until_s = Mean(), (Sum(1.0), Sum(-1.0)), 0.0


class Agreement:
    """What is known of one finger against one model; begin anew with another."""

    def __init__(self) -> None:
        self._gain = Mean()
        self._cells: dict[tuple[str, int], Cell] = {}

    def add(self, window: Window, residual: float, std: float) -> list[Disagreement]:
        """What is found out with one more window, later than those before; see `compared`."""
        is_known = self._gain.weight >= (CHANGE / 20.0) ** -2.0
        time_s, residual = window.time_s, residual - self._gain.value
        self._gain.add(time_s, residual + self._gain.value, std)
        found = []
        for axis, value in zip(AXES, window[:4], strict=True):
            place = _place(axis, value)
            if place is None or not is_known:
                continue
            cell = self._cells.setdefault((axis, place), Cell())
            cell.mean.add(time_s, residual, std)
            for evidence in cell.sums:
                share = evidence.add(time_s, residual, std)
                if share is not None and time_s >= cell.quiet_until_s:
                    cell.quiet_until_s = time_s + QUIET_S
                    found.append(Disagreement(axis, *_range(axis, place), share, evidence.since_s))
        return found

    def map(self) -> list[Share]:
        """The mean residual of each cell."""
        return [
            Share(axis, *_range(axis, place), exp(cell.mean.value) - 1.0, cell.mean.weight)
            for (axis, place), cell in sorted(self._cells.items())
        ]


def _place(axis: str, value: float) -> int | None:
    """The cell of a value; None where it means nothing, such as a carrier without voltage."""
    _, step = AXES[axis]
    if axis == "voltage_v":
        return floor(value / step)
    return floor(log(value) / log(step)) if value > 0.0 else None


def _range(axis: str, place: int) -> tuple[float, float]:
    _, step = AXES[axis]
    if axis == "voltage_v":
        return place * step, (place + 1) * step
    return step**place, step ** (place + 1)
