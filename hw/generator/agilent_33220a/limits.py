"""What the simulated 33220A can make: its own table, written down independently of the driver's.

From the 33220A User's Guide where it is known; what is assumed says so.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from typing import NamedTuple

SOURCE_OHM = 50.0
# Levels of the source's electromotive force, i.e. into an open circuit: twice those into 50 ohm.
EMF_LOW_VPP, EMF_HIGH_VPP, EMF_PEAK_V = 0.02, 20.0, 10.0
LOAD_LOW_OHM, LOAD_HIGH_OHM = 1.0, 10e3
RESET_EMF_VPP, RESET_FREQUENCY_HZ, RESET_LOAD_OHM = 0.2, 1e3, 50.0

FUNCTIONS = ("SINusoid", "SQUare", "RAMP", "PULSe", "NOISe", "DC", "USER")
FREQUENCY_RANGE_HZ = {
    "SIN": (1e-6, 20e6),
    "SQU": (1e-6, 20e6),
    "RAMP": (1e-6, 200e3),
    "PULS": (500e-6, 5e6),
    "NOIS": (1e-6, 20e6),
    "DC": (1e-6, 20e6),
    "USER": (1e-6, 6e6),
}
# Volts peak to peak per volt rms; noise and arbitrary waveforms are counted as a sine.
VPP_PER_VRMS = {"SQU": 2.0, "PULS": 2.0, "RAMP": 2.0 * math.sqrt(3.0)}
FAST_SQUARE_HZ = 10e6
PULSE_WIDTH_LOW_S = 20e-9
PULSE_PERIOD_S = (200e-9, 2000.0)

# Full scale of each attenuator setting, Vpp open. Where the older E1441A switches (its manual, p. 99); where the
# 33220A does is assumed to be the same.
RANGE_TOPS_VPP = (0.634, 1.264, 2.52, 5.04, 10.04, EMF_HIGH_VPP)

DAC_HIGH = 8191
ARBITRARY_POINTS_HIGH = 65_536
NON_VOLATILE_SLOTS = 4  # assumed

# Which kinds of modulation each function takes (assumed from the front panel's menus); DC takes none.
_PLAIN = frozenset({"AM", "FM", "PM", "FSK", "SWE", "BURS"})
KINDS = {
    "SIN": _PLAIN,
    "SQU": _PLAIN,
    "RAMP": _PLAIN,
    "USER": _PLAIN,
    "PULS": frozenset({"PWM", "BURS"}),
    "NOIS": frozenset({"BURS"}),
    "DC": frozenset[str](),
}

_SHAPES = ("SINusoid", "SQUare", "RAMP", "NRAMp", "TRIangle", "NOISe", "USER")

BOOLEANS = {"OUTPut:TRIGger": False, "OUTPut:SYNC": True, "SYSTem:BEEPer:STATe": True}
BOOLEANS |= {"SYSTem:KLOCk": False, "DISPlay": True}
CHOICES = {
    "BURSt:MODE": ("TRIGgered", "GATed"),
    "BURSt:GATE:POLarity": ("NORMal", "INVerted"),
    "TRIGger:SOURce": ("IMMediate", "EXTernal", "BUS"),
    "TRIGger:SLOPe": ("POSitive", "NEGative"),
    "OUTPut:POLarity": ("NORMal", "INVerted"),
    "OUTPut:TRIGger:SLOPe": ("POSitive", "NEGative"),
    "FUNCtion:PULSe:HOLD": ("WIDTh", "DCYCle"),
    "SYSTem:COMMunicate:RLSTate": ("LOCal", "REMote", "RWLock"),
    "FORMat:BORDer": ("NORMal", "SWAPped"),
    "SWEep:SPACing": ("LINear", "LOGarithmic"),
    "UNIT:ANGLe": ("DEGree", "RADian"),
    **{f"{kind}:SOURce": ("INTernal", "EXTernal") for kind in ("AM", "FM", "PM", "FSKey", "PWM")},
    **{f"{kind}:INTernal:FUNCtion": _SHAPES for kind in ("AM", "FM", "PM", "PWM")},
}


class NumberRange(NamedTuple):
    """A setting that is a number and depends on no other setting; `unit` is its SCPI suffix."""

    low: float
    high: float
    default: float
    unit: str


NUMBERS = {
    "BURSt:NCYCles": NumberRange(1.0, 50e3, 1.0, ""),
    "BURSt:PHASe": NumberRange(-360.0, 360.0, 0.0, ""),
    "BURSt:INTernal:PERiod": NumberRange(1e-6, 500.0, 10e-3, "S"),
    "FUNCtion:RAMP:SYMMetry": NumberRange(0.0, 100.0, 100.0, ""),
    "FUNCtion:PULSe:TRANsition": NumberRange(5e-9, 100e-9, 5e-9, "S"),
    "AM:DEPTh": NumberRange(0.0, 120.0, 100.0, ""),
    **{f"{kind}:INTernal:FREQuency": NumberRange(2e-3, 20e3, 100.0, "HZ") for kind in ("AM", "FM", "PM", "PWM")},
    "FM:DEViation": NumberRange(1e-6, 10e6, 100.0, "HZ"),
    "PM:DEViation": NumberRange(0.0, 360.0, 180.0, ""),
    "PWM:DEViation": NumberRange(0.0, 1000.0, 10e-6, "S"),
    "FSKey:FREQuency": NumberRange(1e-6, 20e6, 100.0, "HZ"),
    "FSKey:INTernal:RATE": NumberRange(2e-3, 100e3, 10.0, "HZ"),
    "SWEep:TIME": NumberRange(1e-3, 500.0, 1.0, "S"),
    "FREQuency:STARt": NumberRange(1e-6, 20e6, 100.0, "HZ"),
    "FREQuency:STOP": NumberRange(1e-6, 20e6, 1e3, "HZ"),
}


def range_top_vpp(peak_v: float) -> float:
    """Return the full scale of the lowest attenuator setting that holds `peak_v` (open circuit)."""
    return RANGE_TOPS_VPP[min(bisect_left(RANGE_TOPS_VPP, 2.0 * peak_v * (1.0 - 1e-9)), len(RANGE_TOPS_VPP) - 1)]
