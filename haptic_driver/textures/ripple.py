"""The ripple that a carrier leaves in friction, and what it costs to be rid of it.

Attraction follows voltage squared. So under a sine it varies between nothing and twice its mean, at
twice the carrier. The ripple's peak equals the rise of friction that the carrier makes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from haptic_driver.render.controller import Controller, ControllerSettings
from haptic_driver.textures.bands import EDGES_HZ


class Ripple(NamedTuple):
    """The ripple of one carrier: where it lies among the bands of `bands.py`, and whether it is
    felt.

    `band_hz`: the edges of the band in which it lies, None below and above them.
    """

    frequency_hz: float
    place: Literal["below", "in", "above"]
    band_hz: tuple[float, float] | None
    felt: bool

    def __str__(self) -> str:
        where = f"{self.place} the bands"
        if self.band_hz is not None:
            where = f"in the band of {self.band_hz[0]:.3g} to {self.band_hz[1]:.3g} Hz"
        return f"{self.frequency_hz:.4g} Hz, {where}: {'felt' if self.felt else 'not felt'}"


class QuietReach(NamedTuple):
    """What carriers without a felt ripple reach, against what any carrier does.

    `share`: how much of the authority, highest less lowest friction, is left.
    """

    cof: tuple[float, float]
    any_cof: tuple[float, float]
    share: float


def ripple(carrier_hz: float, quiet_above_hz: float) -> Ripple:
    """The ripple of a carrier, felt below `quiet_above_hz`; see `docs/carrier.md`."""
    ripple_hz = 2.0 * carrier_hz
    # As many edges lie at or below it.
    passed = int(np.searchsorted(EDGES_HZ, ripple_hz * (1.0 + 1e-9), side="right"))
    place: Literal["below", "in", "above"] = "in"
    band_hz = None
    if passed == 0:
        place = "below"
    elif passed == EDGES_HZ.size:
        place = "above"
    else:
        band_hz = (float(EDGES_HZ[passed - 1]), float(EDGES_HZ[passed]))
    is_felt = ripple_hz < quiet_above_hz * (1.0 - 1e-9)
    return Ripple(ripple_hz, place, band_hz, is_felt)


def quiet_reach(settings: ControllerSettings, normal_force_n: float) -> QuietReach:
    """What is within reach under a load without a felt ripple."""
    strongest = replace(settings, policy="max_authority")
    low, high = Controller(strongest).reachable(normal_force_n)
    quiet_high = low
    lowest_hz = max(0.5 * settings.quiet_above_hz, settings.lowest_carrier_hz)
    if lowest_hz <= np.exp(settings.surface.log_frequency[-1]):
        loud_excluded = replace(strongest, lowest_carrier_hz=lowest_hz)
        _, quiet_high = Controller(loud_excluded).reachable(normal_force_n)
    share = (quiet_high - low) / (high - low) if high > low else 0.0
    return QuietReach((low, quiet_high), (low, high), share)
