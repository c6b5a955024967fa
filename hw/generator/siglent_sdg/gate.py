"""The last gate in Siglent's dialect."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

from hw.generator.gate import Bound, OutputGate

LEAST_VPP = 0.004  # what the driver asks for; with a load of 50 ohm programmed it is twice that
_LOW_VPP = 0.02
_CALMING: dict[str, dict[str, Any]] = {
    f"C1:BSWV AMP,{LEAST_VPP:g}": {"vpp": _LOW_VPP},
    "C1:BSWV OFST,0": {"offset_v": 0.0},
    "C1:OUTP OFF": {},
    "C1:OUTP LOAD,HZ": {"load_open": True},
    "C1:OUTP PLRT,NOR": {},
    "C1:SYNC ON": {},
}
_OTHER: dict[str, dict[str, Any]] = {"C1:BSWV WVTP,SINE": {"share": 0.5}, "C1:OUTP ON": {}}
_FREQUENCY = re.compile(r"C1:BSWV FRQ,[-+.0-9eE]+")
_LEVEL = re.compile(r"C1:BSWV (?P<what>AMP|OFST),(?P<value>\S+)")
_QUERY = re.compile(r"\*IDN\?|C1:(OUTP|BSWV|MDWV|SYNC)\?")


class SiglentGate(OutputGate):
    """Accepts one setting per message, of channel 1 alone, and only what the driver sends.

    Levels are refused until the load is known to be open and a reset has been sent. The reset ends
    modulation, sweeps, bursts and the combining of channels.
    """

    speaker = "SiglentSdg"

    def _after(self, bound: Bound, message: str) -> Bound:
        command = message.removesuffix("\n")
        if _QUERY.fullmatch(command) or _FREQUENCY.fullmatch(command):
            return bound
        if command == "*RST":
            return Bound(unit_vpp=True, modulated=False)
        if command in _CALMING:
            return replace(bound, **_CALMING[command])
        if command in _OTHER:
            return self._checked(replace(bound, **_OTHER[command]), command)
        level = _LEVEL.fullmatch(command)
        if level is None:
            raise self._refusal(command)
        value = self._level(bound, level["value"], command)
        if level["what"] == "OFST":
            return self._checked(replace(bound, offset_v=value), command)
        return self._checked(replace(bound, vpp=max(value, _LOW_VPP)), command)
