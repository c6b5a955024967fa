"""A finger sliding on the screen: friction that follows its instantaneous value with a lag."""

from __future__ import annotations

import math
from collections.abc import Callable

FrictionForce = Callable[[float, float, float, float], float]
"""(frequency_hz, voltage_v, normal_force_n, speed_m_s) -> lateral force in N that would be there
after a long time.
"""


class FingerPlant:
    """Lateral force on a finger, from an injected steady friction force and a first-order lag.

    Friction on an electroadhesive screen follows a change with a first-order lag. The lag's cut-off
    is proportional to the sliding speed, 13.8 Hz per mm/s (arXiv 2505.11162). The step is the lag's
    exact solution, 1 - exp(-2 pi f_c dt). So the result does not depend on the step while inputs
    are constant. At zero speed the friction is frozen. Every contact starts from its friction at
    zero voltage, at `touched_s` of its clock `time_s`.
    """

    def __init__(self, friction: FrictionForce, *, cutoff_hz_per_mm_s: float = 13.8) -> None:
        self._friction = friction
        self._cutoff_hz_per_mm_s = cutoff_hz_per_mm_s
        self._lagged_n: float | None = None
        self.time_s = 0.0
        self.touched_s = 0.0
        self.normal_force_n = 0.0
        self.lateral_force_n = 0.0

    def step(
        self,
        dt_s: float,
        frequency_hz: float,
        voltage_v: float,
        normal_force_n: float,
        speed_m_s: float,
    ) -> float:
        """Hold the inputs for `dt_s` and return the lateral force at its end, N; 0 without contact.

        `voltage_v` is the peak at the electrode, `normal_force_n` <= 0 means no contact, the sign
        of `speed_m_s` does not matter to the lag.
        """
        before_s, self.time_s = self.time_s, self.time_s + dt_s
        self.normal_force_n = max(normal_force_n, 0.0)
        if normal_force_n <= 0.0:
            self._lagged_n, self.lateral_force_n = None, 0.0
            return 0.0
        if self._lagged_n is None:
            self.touched_s = before_s
            self._lagged_n = self._friction(frequency_hz, 0.0, normal_force_n, speed_m_s)
        steady_n = self._friction(frequency_hz, voltage_v, normal_force_n, speed_m_s)
        cutoff_hz = self._cutoff_hz_per_mm_s * abs(speed_m_s) * 1e3
        self._lagged_n -= (steady_n - self._lagged_n) * math.expm1(
            -2.0 * math.pi * cutoff_hz * dt_s
        )
        self.lateral_force_n = self._lagged_n
        return self.lateral_force_n
