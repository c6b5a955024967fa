"""The simulated Keysight 33512B, channel 1."""

from __future__ import annotations

from hw.generator.keysight.ranges import Ranges
from hw.generator.keysight.simulator import SimulatedKeysight


class Simulated33500(SimulatedKeysight):
    """Takes headers with the channel's number too; frequencies from the data sheet, from memory:
    low confidence.
    """

    model = Ranges(
        identity="Agilent Technologies,33512B,{serial_number},3.05-1.19-2.00-52-00",
        emf_low_vpp=0.002,
        functions=("SINusoid", "SQUare", "TRIangle", "RAMP", "PULSe", "PRBS", "NOISe", "DC"),
        frequency_hz={
            "SIN": (1e-6, 20e6),
            "SQU": (1e-6, 20e6),
            "TRI": (1e-6, 200e3),
            "RAMP": (1e-6, 200e3),
            "PULS": (1e-6, 20e6),
            "PRBS": (1e-6, 20e6),
            "NOIS": (1e-6, 20e6),
            "DC": (1e-6, 20e6),
        },
        channel="1",
        own_limit=True,
    )
