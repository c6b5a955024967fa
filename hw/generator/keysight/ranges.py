"""What the simulated instruments can make: tables of their own, written down independently of the
drivers'.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass

SOURCE_OHM = 50.0
LOAD_LOW_OHM, LOAD_HIGH_OHM = 1.0, 10e3
RESET_EMF_VPP, RESET_FREQUENCY_HZ, RESET_LOAD_OHM = 0.2, 1e3, 50.0
# Levels of the source's electromotive force, i.e. into an open circuit: twice those into 50 ohm.
EMF_PEAK_V = 10.0
# Volts peak to peak per volt rms; noise is counted as a sine.
VPP_PER_VRMS = {"SQU": 2.0, "PULS": 2.0, "RAMP": 2.0 * math.sqrt(3.0), "TRI": 2.0 * math.sqrt(3.0)}
FAST_SQUARE_HZ = 10e6
UNMODULATED = (
    "DC",
    "NOIS",
    "PULS",
    "PRBS",
)  # functions without AM (assumed from the front panel's menus)
# Full scale of each attenuator setting, Vpp open. Where the older E1441A switches (its manual, p.
# 99); where newer ones do is assumed to be the same.
_RANGE_TOPS_VPP = (0.634, 1.264, 2.52, 5.04, 10.04, 2.0 * EMF_PEAK_V)


@dataclass(frozen=True)
class Ranges:
    """One model; `functions` in manual notation, frequencies by the short form. `own_limit`: it has
    VOLT:LIM.
    """

    identity: str
    emf_low_vpp: float
    functions: tuple[str, ...]
    frequency_hz: Mapping[str, tuple[float, float]]
    channel: str = ""  # number that headers may carry: SOUR1:, OUTP1
    own_limit: bool = False


def range_top_vpp(peak_v: float) -> float:
    """Return the full scale of the lowest attenuator setting that holds `peak_v` (open circuit)."""
    place = bisect_left(_RANGE_TOPS_VPP, 2.0 * peak_v * (1.0 - 1e-9))
    return _RANGE_TOPS_VPP[min(place, len(_RANGE_TOPS_VPP) - 1)]
