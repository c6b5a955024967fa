"""The way of samples through the stages while something renders, as they come."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_driver.limits import OperatingLimits
from haptic_driver.live.agreement import Agreement, Disagreement, Share
from haptic_driver.live.comparison import by_surface, compared
from haptic_driver.live.drive import SETTLING_S
from haptic_driver.live.swap import Proposal, Word
from haptic_driver.live.window import NONE_YET, Window, windows
from haptic_driver.lookup.build import build_surface
from haptic_driver.lookup.file import SurfaceFile
from haptic_driver.processes.samples import SAMPLE
from haptic_driver.simulation.finger_model import surface_friction
from model.description import ModelDescription

ATTEMPT_S = 5.0  # between attempts, of the windows' time
MOST_WINDOWS = 400  # the newest: older ones would cost time and say little


@dataclass(frozen=True)
class FollowSettings:
    """What is expected, by the name of its model too, and when a command is felt."""

    model: str
    surface: SurfaceFile
    limits: OperatingLimits
    latency_budget_s: dict[str, float]
    period_s: float = 2.0  # between looks: a ring holds 16 s


class Observed(NamedTuple):
    """What came of the samples since the last time; times on CLOCK_MONOTONIC."""

    windows: Sequence[Window]
    found: Sequence[Disagreement]
    cells: Sequence[Share]
    proposal: Proposal | None


class Version(NamedTuple):
    """A model and its surface."""

    model: ModelDescription
    surface: SurfaceFile


class Following:
    """Holds samples against the surface that render goes by, and proposes better ones."""

    def __init__(self, settings: FollowSettings, description: ModelDescription) -> None:
        self._settings = settings
        self._own = Version(description, settings.surface)
        self._kept = np.empty(0, SAMPLE)  # what the next samples still answer to
        self._counted = NONE_YET
        self._adapts = False
        self._go_by_own()
        self._law(1e3, 50.0, 0.5, 0.02, 0.0)  # compiled from here on

    def begin(self) -> None:
        """Somebody armed: nothing is known of the finger."""
        self._agreement = Agreement()

    def hear(self, word: Word) -> None:
        if word is Word.TAKEN:
            self._go_by(self._offered)
        elif word is Word.BASE:
            self._go_by_own()
        else:
            self._adapts = word is Word.ADAPT

    def add(self, samples: NDArray[np.void]) -> Observed:
        """What some more samples of SAMPLE [n], later ones, tell and lead to."""
        samples = np.concatenate([self._kept, samples])
        latency_s = self._settings.latency_budget_s
        new, self._counted = windows(samples, latency_s, self._counted)
        found: list[Disagreement] = []
        if samples.size:
            until_s = samples["time_s"][-1] - latency_s["total"] - SETTLING_S
            self._kept = samples[samples["time_s"] > until_s]
        if new:
            residuals = np.transpose(compared(new, by_surface(self._law, new))).tolist()
            for window, residual in zip(new, residuals, strict=True):
                found += self._agreement.add(window, *residual)
        proposal = self._proposal(new) if new and self._adapts else None
        return Observed(new, found, self._agreement.map(), proposal)

    def _go_by_own(self) -> None:
        self._newest: deque[Window] = deque(maxlen=MOST_WINDOWS)
        self._tried_s = -inf
        self._go_by(self._own)

    def _go_by(self, version: Version) -> None:
        self._present = self._offered = version
        self._law = surface_friction(version.surface, self._settings.limits)
        self.begin()

    def _proposal(self, new: Sequence[Window]) -> Proposal | None:
        """What more windows lead to; None where there is nothing to try yet."""
        # slow to import, and who does not adapt does without
        from haptic_driver.live.proof import attempt, split  # noqa: PLC0415

        self._newest.extend(new)
        every, now_s = list(self._newest), new[-1].time_s
        known, unseen = split(every)
        if not known or now_s - self._tried_s < ATTEMPT_S:
            return None
        self._tried_s = now_s
        said, model = attempt(known, unseen, self._own.model, self._present.model)
        if model is None:
            return Proposal(said)
        self._offered = Version(model, build_surface(model, self._settings.limits))
        rows = [told(each) for each in every]
        return Proposal(said, self._offered.surface, numbers(model), rows)


def numbers(model: ModelDescription) -> dict[str, float]:
    """Every number of a model and of its effects."""
    of_effects = {
        f"{effect}.{name}": p.value
        for effect, values in model.effect_parameters.items()
        for name, p in values.items()
    }
    return {name: p.value for name, p in model.parameters.items()} | of_effects


def told(window: Window) -> list[float]:
    """A window as frequency, voltage, load, speed, friction, its standard error and its time."""
    return [*(float(f"{value:.5g}") for value in window[:6]), round(window.time_s, 3)]
