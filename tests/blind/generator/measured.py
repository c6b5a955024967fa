"""Data as a lab's sensors give them: loads as measured, gains of trials, drifts inside trials.

Each planned row becomes a trial, a touch of its own, read in some windows. The finger presses by a
share more or less than commanded; all that it feels in a trial has one gain, and drifts by a trial
in a direction of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .designs import Design

WINDOWS = 2  # of a trial, a row each
WINDOW_S = 0.5
SMALL = ("paper", "factorial", "speed_sweep", "timed", "six_sessions", "voltage_frequency")
COMMANDED, BARE = "commanded", "bare"  # with columns of trial and commanded load, or without


@dataclass(frozen=True)
class Trials:
    """Standard deviations, of logarithms: of loads, of a trial's gain, and of its drift from the
    first window to the last.
    """

    load: float
    gain: float
    drift: float
    columns: str

    def of_trial(self, sigma: np.ndarray) -> np.ndarray:
        """What the mean of a trial's rows has, whose own is `sigma`."""
        return np.sqrt(sigma**2 / WINDOWS + self.gain**2)

    def label(self) -> dict:
        return {"load": self.load, "gain": self.gain, "drift": self.drift, "columns": self.columns}


def drawn_trials(rng: np.random.Generator) -> Trials:
    """Loads scatter by 5 to 20 %, trials by 5 to 15 %, and drift by 0.5 to 2 %."""
    load, gain = rng.uniform(0.05, 0.20), rng.uniform(0.05, 0.15)
    columns = str(rng.choice([COMMANDED, BARE]))
    return Trials(load, gain, rng.uniform(0.005, 0.02), columns)


def in_windows(
    rng: np.random.Generator, design: Design, trials: Trials
) -> tuple[Design, np.ndarray]:
    """The design with a row per window at the loads that were pressed, and each row's factor."""
    count = design.session.size
    trial = np.repeat(np.arange(count), WINDOWS)
    window = np.tile(np.arange(WINDOWS), count)
    pressed = design.rows.n * np.exp(trials.load * rng.normal(size=count))
    factor = (trials.gain * rng.normal(size=count))[trial]
    along = window / (WINDOWS - 1) - 0.5
    factor = factor + (trials.drift * rng.normal(size=count))[trial] * along
    rows = design.rows.take(trial)
    rows = replace(rows, n=np.round(pressed, 6)[trial], time=rows.time + WINDOW_S * window)
    split = replace(design, rows=rows, session=design.session[trial], trial=trial + 1)
    return split, np.exp(factor)
