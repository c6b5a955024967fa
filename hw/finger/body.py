"""A finger's body between its bone and the screen: the load that an indentation gives.

What a force sensor under the screen feels is this load. Attraction between skin and screen is a
force inside the touch, so it adds nothing to the load. It draws the skin closer, and the tissue
expands by as much. Friction shears the tissue, and a share of it shows along the normal.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass

Elastic = Callable[[float], float]
"""Indentation in m, > 0 -> force in N of tissue that was pressed an instant ago; rising."""


@dataclass(frozen=True)
class PowerLaw:
    """Tissue that stiffens: `force_n` at `indentation_m`, with `exponent` between 1.5 and 2."""

    force_n: float = 1.0
    indentation_m: float = 1.75e-3
    exponent: float = 1.75

    def __call__(self, indentation_m: float) -> float:
        """Force in N."""
        return self.force_n * math.pow(indentation_m / self.indentation_m, self.exponent)


@dataclass(frozen=True)
class BodySettings:
    """What a finger does beside its elasticity; sizes are assumptions, for a finger in a holder.

    `relaxation` holds pairs of a share of the force and the time in s within which it is lost. The
    pulse is a share of the force, the tremor a movement of the bone (1 sigma). `drawn_m_per_n` is
    how much closer the skin comes by attraction, `shear_share` what of friction shows along the
    normal.
    """

    relaxation: tuple[tuple[float, float], ...] = ((0.1, 0.4), (0.15, 4.0))
    pulse_share: float = 0.02
    pulse_hz: float = 1.0
    tremor_m: float = 15e-6
    tremor_hz: tuple[float, float] = (8.0, 12.0)
    drawn_m_per_n: float = 10e-6
    shear_share: float = 0.03
    seed: int = 1


class FingerBody:
    """Load over indentation as time passes; `step` holds its inputs for one step.

    The tissue is quasi-linear viscoelastic (Fung): each share of the elastic force fades with its
    own time constant. Lifted tissue recovers with the same constants.
    """

    TREMOR_PARTS = 8  # sines that beat, so that the tremor comes and goes

    def __init__(
        self, elastic: Elastic | None = None, settings: BodySettings | None = None
    ) -> None:
        self._elastic: Elastic = elastic or PowerLaw()
        self.settings = settings or BodySettings()
        self.time_s = 0.0
        self.load_n = 0.0
        self._faded_n = [0.0] * len(self.settings.relaxation)
        draw = random.Random(self.settings.seed)
        low_hz, high_hz = self.settings.tremor_hz
        part_hz = (high_hz - low_hz) / self.TREMOR_PARTS
        self._tremor = [
            (low_hz + (i + draw.uniform(0.1, 0.9)) * part_hz, draw.uniform(0.0, 2.0 * math.pi))
            for i in range(self.TREMOR_PARTS)
        ]

    def step(
        self,
        dt_s: float,
        indentation_m: float,
        *,
        attraction_n: float = 0.0,
        friction_n: float = 0.0,
    ) -> float:
        """Let `dt_s` pass and return the load in N, 0 without contact.

        `indentation_m` is how far the bone is beyond where the skin first touched; negative in the
        air. `attraction_n` and `friction_n` are those of the touch.
        """
        settings = self.settings
        self.time_s += dt_s
        deep_m = indentation_m + self._tremor_m() - settings.drawn_m_per_n * attraction_n
        elastic_n = self._elastic(deep_m) if deep_m > 0.0 else 0.0
        lost_n = 0.0
        for i, (share, time_s) in enumerate(settings.relaxation):
            self._faded_n[i] -= (elastic_n - self._faded_n[i]) * math.expm1(-dt_s / time_s)
            lost_n += share * self._faded_n[i]
        pulse = 1.0 + settings.pulse_share * math.sin(
            2.0 * math.pi * settings.pulse_hz * self.time_s
        )
        tissue_n = max(elastic_n - lost_n, 0.0) * pulse
        touching = tissue_n > 0.0
        shear_n = settings.shear_share * friction_n if touching else 0.0
        self.load_n = max(tissue_n + shear_n, 0.0)
        return self.load_n

    def _tremor_m(self) -> float:
        amplitude_m = self.settings.tremor_m * math.sqrt(2.0 / self.TREMOR_PARTS)
        return amplitude_m * sum(
            math.sin(2.0 * math.pi * hz * self.time_s + phase) for hz, phase in self._tremor
        )
