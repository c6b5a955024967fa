"""The Keysight 33500 and 33600 series, channel 1 (also under Agilent's name)."""

from __future__ import annotations

import re

from hw.generator.keysight.driver import KeysightGenerator


class Keysight33500(KeysightGenerator):
    """Driver of channel 1; headers without a channel mean it.

    The instrument also holds the rig's limit as its own (VOLT:LIM) and refuses more by itself. Each
    set point reads that limit back. Unverified: what an instrument answers to a level beyond, and
    its least amplitude.
    """

    model = re.compile(r"33[56]\d\d[AB]")
    amplitude_low_vpp = 0.002  # 1 mVpp to 10 Vpp into 50 ohm, doubled open
    amplitude_high_vpp = 20.0
    limits_itself = True
