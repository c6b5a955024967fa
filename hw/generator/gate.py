"""The last gate before the generator's wire: reads what is about to be sent and refuses too much voltage.

It knows nothing of the driver's own reckoning and does not trust it: it parses the outgoing bytes and keeps, from
them alone, an upper bound of the voltage at the electrode.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hw.errors import LimitExceeded

_ROUNDING = 1.0 + 1e-9  # numbers go out with 12 digits
_LOW_VPP = 0.02  # VOLT MIN at any load is no more than this into an open circuit
_RESET_VPP = 0.2  # 100 mVpp for a load of 50 ohm
_DAC_HIGH = 8191
_NOT_THE_DRIVERS = "only what `Agilent33220A` sends may pass; a new command is first made known to `hw.generator.gate`"
# Amplitude at + full scale of Modulation In over the amplitude programmed, where nobody has measured it.
_WORST_MODULATION = 2.0

_COMMAND = re.compile(r"(?P<colon>:?)(?P<header>[A-Z*][A-Z:]*)(?: (?P<argument>\S+))?")
_QUERY = re.compile(r":?[A-Z*][A-Z:]*\?( \w+)?")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_UPLOAD = re.compile(rb"DATA:DAC VOLATILE,")
_BINARY = re.compile(rb" ?#([1-9])(\d+)", re.DOTALL)

# Nothing of these changes the voltage; any argument may pass.
_HARMLESS = frozenset(
    {"*CLS", "*ESE", "*SRE", "*OPC", "*WAI", "*TRG", "FREQ", "AM:SOUR", "AM:INT:FREQ", "AM:INT:FUNC", "BURS:STAT"}
    | {"BURS:MODE", "BURS:NCYC", "BURS:PHAS", "TRIG:SOUR", "TRIG:SLOP", "VOLT:RANG:AUTO", "OUTP:SYNC"}
)
_LEVELS = ("VOLT", "VOLT:OFFS", "VOLT:HIGH", "VOLT:LOW")
# What the rest of the dialect says about the instrument; the first group never raises the voltage.
_CALMING: dict[str, dict[str, Any]] = {
    "VOLT MIN": {"vpp": _LOW_VPP},
    "VOLT:OFFS 0": {"offset_v": 0.0},
    "OUTP 0": {},
    "AM:STAT 0": {"modulated": False},
    "OUTP:LOAD INF": {"load_open": True},
    "VOLT:UNIT VPP": {"unit_vpp": True},
    "FORM:BORD NORM": {"big_endian": True},
    "FUNC:USER VOLATILE": {"volatile_selected": True},
}
_OTHER: dict[str, dict[str, Any]] = {
    "OUTP 1": {},
    "AM:STAT 1": {"modulated": True},
    **{f"FUNC {function}": {"function": function} for function in ("SIN", "SQU", "DC", "USER")},
}


@dataclass(frozen=True)
class _Bound:
    """What the instrument holds at most; everything is unknown until a command says it."""

    vpp: float = math.inf
    offset_v: float = math.inf
    load_open: bool = False
    unit_vpp: bool = False
    function: str = ""
    modulated: bool = True
    depth: float = 1.0
    big_endian: bool = False
    volatile_selected: bool = False
    arbitrary_share: float = math.inf  # peak of the volatile waveform over its amplitude

    def peak_v(self, modulation: float) -> float:
        """Highest voltage at the open terminals if the output is on; `modulation` is the highest at full depth."""
        if self.function == "DC":
            return abs(self.offset_v)
        user = self.arbitrary_share if self.volatile_selected else math.inf
        share = {"SIN": 0.5, "SQU": 0.5, "USER": user}.get(self.function, math.inf)
        envelope = 0.5 * modulation * (1.0 + self.depth) if self.modulated else 1.0
        return abs(self.offset_v) + self.vpp * share * envelope


class OutputGate:
    """Lets messages pass that keep the peak at the electrode within `limit_v`, whether the output is on or not.

    It accepts only the dialect that the driver speaks: short headers in upper case, each after the first of a
    message with a leading colon (or `*`). Whatever it does not know, such as APPLy or `*RCL`, it refuses. An
    amplitude is refused until the load is known to be open and the unit volts peak to peak. Not thread-safe: the
    caller holds the transport.
    """

    def __init__(self, volts_per_volt: float, limit_v: float, *, modulation: float | None = None) -> None:
        self._volts_per_volt = volts_per_volt
        self._limit_v = limit_v
        self._modulation = _WORST_MODULATION if modulation is None else modulation
        self._bound = _Bound()

    def forget(self) -> None:
        """What was sent last may or may not have arrived."""
        self._bound = _Bound()

    def check(self, message: bytes) -> None:
        """Take note of a message that is to be sent next; raises LimitExceeded for one that must not be sent."""
        bound = self._bound
        if (upload := _UPLOAD.match(message)) is not None:
            share = _peak_share(message[upload.end() :], bound.big_endian)
            self._bound = self._checked(replace(bound, arbitrary_share=share), "DATA:DAC VOLATILE")
            return
        for place, command in enumerate(message.decode("latin-1").strip().split(";")):
            match = _COMMAND.fullmatch(command)
            if _QUERY.fullmatch(command):
                continue
            if match is None or (place > 0 and not match["colon"] and not match["header"].startswith("*")):
                raise _refusal(command, "is not a command that it knows how to read")
            bound = self._after(bound, match["header"], match["argument"] or "")
        self._bound = bound

    def _after(self, bound: _Bound, header: str, argument: str) -> _Bound:
        command = f"{header} {argument}".strip()
        if header in _HARMLESS:
            return bound
        if command == "*RST":
            return _Bound(vpp=_RESET_VPP, offset_v=0.0, unit_vpp=True, function="SIN", modulated=False)
        if command in _CALMING:
            return replace(bound, **_CALMING[command])
        if command in _OTHER:
            return self._checked(replace(bound, **_OTHER[command]), command)
        if header == "AM:DEPT" and 0.0 <= (depth := 0.01 * _number(argument, command)) <= 1.0:
            return self._checked(replace(bound, depth=depth), command)
        if header in _LEVELS:
            return self._checked(_with_level(bound, header, _number(argument, command), command), command)
        raise _refusal(command, "is not a command that it lets pass")

    def _checked(self, bound: _Bound, command: str) -> _Bound:
        peak_v = bound.peak_v(self._modulation) * self._volts_per_volt
        if not peak_v <= self._limit_v * _ROUNDING:
            raise _refusal(
                command,
                f"would allow {peak_v:.6g} V at the electrode, over the limit of {self._limit_v:g} V",
                "lower the voltage",
            )
        return bound


def _with_level(bound: _Bound, header: str, value: float, command: str) -> _Bound:
    if not (bound.load_open and bound.unit_vpp):
        raise _refusal(command, "sets a level while the programmed load and unit are not known to be INF and VPP")
    if header == "VOLT":
        return replace(bound, vpp=max(value, _LOW_VPP))
    if header == "VOLT:OFFS":
        return replace(bound, offset_v=value)
    sign = 1.0 if header == "VOLT:HIGH" else -1.0
    other = sign * bound.offset_v - 0.5 * bound.vpp  # the other level, seen along `sign`
    other = min(other, sign * value - _LOW_VPP)  # it gives way
    return replace(bound, vpp=sign * value - other, offset_v=sign * 0.5 * (sign * value + other))


def _peak_share(payload: bytes, big_endian: bool) -> float:
    """Return the peak over the amplitude of uploaded codes; raises LimitExceeded for what cannot be read."""
    codes = _binary_codes(payload, big_endian) if b"#" in payload[:2] else _decimal_codes(payload)
    if codes.size == 0 or np.ptp(codes) == 0 or np.abs(codes).max() > _DAC_HIGH:
        raise _refusal("DATA:DAC VOLATILE", f"does not hold DAC codes of -{_DAC_HIGH} to {_DAC_HIGH} that differ")
    return max(0.5, float(np.abs(codes).max()) / float(np.ptp(codes)))


def _binary_codes(payload: bytes, big_endian: bool) -> NDArray[np.int64]:
    match = _BINARY.match(payload)
    start = match.start(2) + int(match[1]) if match else 0
    data = payload[start:-1]
    if match is None or payload[match.start(2) : start] != b"%0*d" % (int(match[1]), len(data)) or len(data) % 2:
        raise _refusal("DATA:DAC VOLATILE", "holds a block whose length is wrong")
    if not big_endian:
        raise _refusal("DATA:DAC VOLATILE", "sends a block while the byte order is not known to be big-endian")
    return np.frombuffer(data, ">i2").astype(np.int64)


def _decimal_codes(payload: bytes) -> NDArray[np.int64]:
    try:
        return np.array([int(code) for code in payload.split(b",")], dtype=np.int64)
    except (ValueError, OverflowError):
        raise _refusal("DATA:DAC VOLATILE", "holds something that is not a whole number") from None


def _number(argument: str, command: str) -> float:
    if not _NUMBER.fullmatch(argument):
        raise _refusal(command, "has no plain number")
    return float(argument)


def _refusal(command: str, why: str, hint: str = _NOT_THE_DRIVERS) -> LimitExceeded:
    return LimitExceeded(f"the last gate holds back {command[:60]!r}: it {why}; nothing was sent", hint)
