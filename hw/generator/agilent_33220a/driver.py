"""The Agilent 33220A."""

from __future__ import annotations

import re

from hw.generator.keysight.driver import KeysightGenerator


class Agilent33220A(KeysightGenerator):
    """Driver of one 33220A. It is not known to have a voltage limit of its own."""

    model = re.compile("33220A")
    amplitude_low_vpp = 0.02  # data sheet: 10 mVpp to 10 Vpp into 50 ohm, doubled open
    amplitude_high_vpp = 20.0
