"""A user who touches a simulated screen by a script, in time that passes only while the program
waits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from hw.finger.simulated_touch_screen import Panel
from tests.hw.testing.touch_screens import touch_screen

# Counts to metres of a screen that is mirrored, turned a little and not square: (x, y) = MATRIX_M @
# (x_raw, y_raw, 1).
MATRIX_M = np.array([[5e-5, 2e-6, -0.004], [1e-6, -4e-5, 0.11]])
SPAN_RAW = (4000, 3000)
CORNERS = [(0.02, 0.01), (0.18, 0.01), (0.18, 0.09), (0.02, 0.09)]
SIX = [*CORNERS, (0.1, 0.05), (0.1, 0.01)]

Where = Callable[
    [float], tuple[float, float] | None
]  # where the finger is after so many seconds of an action
Script = Sequence[tuple[float, Where]]


class SkewPanel(Panel):
    """Counts by the inverse of MATRIX_M, off by up to `noise_raw`."""

    noise_raw = 0
    rng = np.random.default_rng(5)

    def counts(self, x_m: float, y_m: float) -> tuple[int, int]:
        x_raw, y_raw = np.linalg.solve(MATRIX_M[:, :2], np.array([x_m, y_m]) - MATRIX_M[:, 2])
        noise = (
            self.rng.integers(-self.noise_raw, self.noise_raw + 1, 2) if self.noise_raw else (0, 0)
        )
        return round(float(x_raw)) + int(noise[0]), round(float(y_raw)) + int(noise[1])


class NoisyPanel(SkewPanel):
    noise_raw = 5


class User:
    """Touches by a script while the program sleeps; when it is over and the program still waits,
    that is an error.
    """

    def __init__(self, script: Script, *, slots: int = 10, panel: Panel | None = None) -> None:
        self.now_s = 1000.0
        self.screen = touch_screen(panel or SkewPanel(), slots=slots > 0, clock=self.clock)
        self._script = list(script)
        self._began_s = self.now_s

    def clock(self) -> float:
        return self.now_s

    def sleep(self, duration_s: float) -> None:
        self.now_s += duration_s
        while self._script and self.now_s - self._began_s >= self._script[0][0]:
            self._began_s += self._script.pop(0)[0]
        if not self._script:
            raise AssertionError("the program waits for a touch that nobody means to make")
        place = self._script[0][1](self.now_s - self._began_s)
        if place is None:
            self.screen.lift()
        else:
            self.screen.put(*place)


def away(duration_s: float = 0.4) -> tuple[float, Where]:
    return duration_s, lambda _: None


def at(x_m: float, y_m: float, duration_s: float = 0.8) -> tuple[float, Where]:
    return duration_s, lambda _: (x_m, y_m)


def drag(x_m: float, y_m: float, duration_s: float, speed_m_s: float = 0.02) -> tuple[float, Where]:
    return duration_s, lambda t_s: (x_m + speed_m_s * t_s, y_m)


def ctrl_c() -> tuple[float, Where]:
    def interrupt(_: float) -> None:
        raise KeyboardInterrupt

    return math.inf, interrupt


def touches(places: Sequence[tuple[float, float]]) -> list[tuple[float, Where]]:
    """Each place held and lifted, in turn."""
    return [action for place in places for action in (away(), at(*place))] + [away()]
