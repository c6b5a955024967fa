"""The last gate in the dialect of Agilent's and Keysight's generators."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

from hw.generator.gate import Bound, OutputGate

_LOW_VPP = 0.02  # VOLT MIN at any load is no more than this into an open circuit
_RESET_VPP = 0.2  # 100 mVpp for a load of 50 ohm

_COMMAND = re.compile(r"(?P<colon>:?)(?P<header>[A-Z*][A-Z:]*)(?: (?P<argument>\S+))?")
_QUERY = re.compile(r":?[A-Z*][A-Z:]*\?( \w+)?")

# Nothing of these changes the voltage; any argument may pass. A limit that the instrument keeps
# only takes away.
_HARMLESS = frozenset(
    {"*CLS", "FREQ", "AM:SOUR", "BURS:STAT", "VOLT:RANG:AUTO", "VOLT:LIM:HIGH", "VOLT:LIM:LOW"}
)
# What the rest of the dialect says about the instrument; the first group never raises the voltage.
_CALMING: dict[str, dict[str, Any]] = {
    "VOLT MIN": {"vpp": _LOW_VPP},
    "VOLT:OFFS 0": {"offset_v": 0.0},
    "VOLT:LIM:STAT 1": {},
    "OUTP 0": {},
    "OUTP:POL NORM": {},
    "OUTP:SYNC 1": {},
    "AM:STAT 0": {"modulated": False},
    "OUTP:LOAD INF": {"load_open": True},
    "VOLT:UNIT VPP": {"unit_vpp": True},
}
_OTHER: dict[str, dict[str, Any]] = {
    "OUTP 1": {},
    "AM:DEPT 100": {"full_depth": True},
    "AM:STAT 1": {"modulated": True},
    "FUNC SIN": {"share": 0.5},
    "FUNC SQU": {"share": 0.5},
    "FUNC DC": {"share": 0.0},
}


class KeysightGate(OutputGate):
    """Accepts short headers in upper case, each after the first of a message with a leading colon
    (or `*`).

    Whatever it does not know, such as APPLy or `*RCL`, it refuses. An amplitude is refused until
    the load is known to be open and the unit volts peak to peak.
    """

    speaker = "KeysightGenerator"

    def _after(self, bound: Bound, message: str) -> Bound:
        for place, command in enumerate(message.strip().split(";")):
            match = _COMMAND.fullmatch(command)
            if _QUERY.fullmatch(command):
                continue
            if match is None or (
                place > 0 and not match["colon"] and not match["header"].startswith("*")
            ):
                raise self._refusal(command, "is not a command that it knows how to read")
            bound = self._after_one(bound, match["header"], match["argument"] or "")
        return bound

    def _after_one(self, bound: Bound, header: str, argument: str) -> Bound:
        command = f"{header} {argument}".strip()
        if header in _HARMLESS:
            return bound
        if command == "*RST":
            return Bound(
                _RESET_VPP, 0.0, share=0.5, unit_vpp=True, modulated=False, full_depth=True
            )
        if command in _CALMING:
            return replace(bound, **_CALMING[command])
        if command in _OTHER:
            return self._checked(replace(bound, **_OTHER[command]), command)
        if header == "VOLT":
            return self._checked(
                replace(bound, vpp=max(self._level(bound, argument, command), _LOW_VPP)), command
            )
        if header == "VOLT:OFFS":
            return self._checked(
                replace(bound, offset_v=self._level(bound, argument, command)), command
            )
        raise self._refusal(command)
