"""The simulated Agilent 33220A."""

from __future__ import annotations

from hw.generator.keysight.ranges import Ranges
from hw.generator.keysight.simulator import SimulatedKeysight


class Simulated33220A(SimulatedKeysight):
    """What it can make is from the 33220A User's Guide."""

    model = Ranges(
        identity="Agilent Technologies,33220A,{serial_number},2.02-2.02-22-2",
        emf_low_vpp=0.02,
        functions=("SINusoid", "SQUare", "RAMP", "PULSe", "NOISe", "DC"),
        frequency_hz={
            "SIN": (1e-6, 20e6),
            "SQU": (1e-6, 20e6),
            "RAMP": (1e-6, 200e3),
            "PULS": (500e-6, 5e6),
            "NOIS": (1e-6, 20e6),
            "DC": (1e-6, 20e6),
        },
    )
