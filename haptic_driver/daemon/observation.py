"""Felt friction held against what the model expects, as samples come: rows as recordings are cut
into, and agreement.

What friction the rows should have is the surface's, without the gains that feedback has learnt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, auto
from math import inf, log
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_driver.daemon.agreement import UNITS, Agreement, Disagreement, Window
from haptic_driver.daemon.judge import JudgeSettings
from haptic_driver.experiments.recorded import PAUSE_S, SETTLING_S, Recorded, cut
from haptic_driver.limits import OperatingLimits
from haptic_driver.processes.samples import SAMPLE
from haptic_driver.recording.read import Run
from haptic_driver.simulation.finger_model import surface_friction
from haptic_driver.surface.file import SurfaceFile


class Word(Enum):
    """What control tells the process: whether to mend, and by which surface render goes from here
    on.
    """

    ADAPT = auto()
    REST = auto()
    TAKEN = auto()  # the one that was proposed last
    BASE = auto()  # the model's own


@dataclass(frozen=True)
class ObserverSettings:
    """What is expected, by the name of its model too, and when a command is felt.

    `judge`: how friction is compared with what was asked. `period_s` between looks.
    """

    model: str
    surface: SurfaceFile
    limits: OperatingLimits
    latency_budget_s: dict[str, float]
    judge: JudgeSettings
    period_s: float = 2.0  # a ring holds 16 s


class Proposal(NamedTuple):
    """What came of an attempt to mend the model, in words; with a better one its surface, its
    numbers and the rows it came from.
    """

    said: str
    surface: SurfaceFile | None = None
    numbers: dict[str, float] | None = None
    rows: Sequence[Sequence[float]] = ()


class Observed(NamedTuple):
    """What came of the samples since the last time; times on CLOCK_MONOTONIC."""

    rows: Sequence[Recorded]
    found: Sequence[Disagreement]
    cells: Sequence[dict[str, str | float]]
    proposal: Proposal | None = None


class Observation:
    """What the process does, without its surroundings; samples come in the order of time."""

    def __init__(self, settings: ObserverSettings) -> None:
        self._latency_s = settings.latency_budget_s
        self._settings = settings
        self._kept = np.empty(0, SAMPLE)  # what the next samples still answer to
        self._session, self._stroke, self._ended_s = 0, 0, -inf
        self.expect(settings.surface)
        self._expected_n(1e3, 50.0, 0.5, 0.02, 0.0)  # compiled from here on

    def begin(self) -> None:
        """Somebody armed: nothing is known of the finger."""
        self._agreement = Agreement()

    def expect(self, surface: SurfaceFile) -> None:
        """Hold friction against another surface, from here on."""
        self._expected_n = surface_friction(surface, self._settings.limits)
        self.begin()

    def add(self, samples: NDArray[np.void]) -> Observed:
        """What some more samples of SAMPLE [n] tell."""
        samples = np.concatenate([self._kept, samples])
        rows: list[Recorded] = []
        if samples.size:
            until_s = samples["time_s"][-1] - self._latency_s["total"] - SETTLING_S
            self._kept = samples[samples["time_s"] > until_s]
            found = cut(Run("now", {"latency_budget_s": self._latency_s}, {}, samples, []))
            rows = [self._numbered(each, float(samples["time_s"][0])) for each in found]
            self._stroke = rows[-1].row.trial if rows else self._stroke
        said = [one for each in rows for one in self._agreement.add(self._window(each))]
        return Observed(rows, said, self._agreement.map())

    def _numbered(self, each: Recorded, start_s: float) -> Recorded:
        """The row at its time, with sessions and strokes that go on from those before."""
        time_s = start_s + each.measured.time_s
        self._session += time_s - self._ended_s > PAUSE_S
        self._ended_s = time_s
        row = each.row._replace(session=self._session, trial=self._stroke + each.row.trial)
        return Recorded(row, each.measured._replace(time_s=time_s))

    def _window(self, each: Recorded) -> Window:
        """One row beside what the surface expects."""
        setting, (cof, std, _, time_s) = each.row.setting, each.measured
        told = {name: getattr(setting, name) for name in UNITS}
        expected_n = self._expected_n(*told.values(), time_s)
        return Window(time_s, told, log(cof * setting.normal_force_n / expected_n), std / cof)
