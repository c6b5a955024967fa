"""A stateful Agilent 33220A: its dialogue, its couplings and traps, and what is at its terminals.

Limits and couplings are the instrument's own (User's Guide, and the command-compatible Picotest G5100A manual
p. 37, 166, 167 where the former is silent), written down here independently of the driver's. Not simulated:
AM, FM and sweep, arbitrary data, and the gating of the output by bursts (burst settings are only stored).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

from hw.simulated.scpi import (
    INFINITY,
    ScpiEngine,
    ScpiError,
    format_number,
    only,
    parse_boolean,
    parse_choice,
    parse_named,
    parse_number,
)

_SOURCE_OHM = 50.0
# Levels into an open circuit: twice those into 50 ohm.
_EMF_LOW_VPP, _EMF_HIGH_VPP, _EMF_PEAK_V = 0.02, 20.0, 10.0
_LOAD_LOW_OHM, _LOAD_HIGH_OHM = 1.0, 10e3

_FUNCTIONS = ("SINusoid", "SQUare", "RAMP", "PULSe", "NOISe", "DC", "USER")
_FREQUENCY_RANGE_HZ = {
    "SIN": (1e-6, 20e6),
    "SQU": (1e-6, 20e6),
    "RAMP": (1e-6, 200e3),
    "PULS": (500e-6, 5e6),
    "NOIS": (1e-6, 20e6),
    "DC": (1e-6, 20e6),
    "USER": (1e-6, 6e6),
}
# Volts peak to peak per volt rms; noise and arbitrary waveforms are counted as a sine.
_VPP_PER_VRMS = {"SQU": 2.0, "PULS": 2.0, "RAMP": 2.0 * math.sqrt(3.0)}
_FAST_SQUARE_HZ = 10e6
_PULSE_WIDTH_LOW_S = 20e-9
_PULSE_PERIOD_S = (200e-9, 2000.0)

_BOOLEANS = {"BURSt:STATe": False, "OUTPut:TRIGger": False, "OUTPut:SYNC": True, "SYSTem:BEEPer:STATe": True}
_CHOICES = {
    "BURSt:MODE": ("TRIGgered", "GATed"),
    "BURSt:GATE:POLarity": ("NORMal", "INVerted"),
    "TRIGger:SOURce": ("IMMediate", "EXTernal", "BUS"),
    "TRIGger:SLOPe": ("POSitive", "NEGative"),
    "OUTPut:POLarity": ("NORMal", "INVerted"),
    "OUTPut:TRIGger:SLOPe": ("POSitive", "NEGative"),
    "FUNCtion:PULSe:HOLD": ("WIDTh", "DCYCle"),
    "SYSTem:COMMunicate:RLSTate": ("LOCal", "REMote", "RWLock"),
}
_NUMBERS = {  # pattern: low, high, default, unit
    "BURSt:NCYCles": (1.0, 50e3, 1.0, ""),
    "BURSt:PHASe": (-360.0, 360.0, 0.0, ""),
    "BURSt:INTernal:PERiod": (1e-6, 500.0, 10e-3, "S"),
    "FUNCtion:RAMP:SYMMetry": (0.0, 100.0, 100.0, ""),
    "FUNCtion:PULSe:TRANsition": (5e-9, 100e-9, 5e-9, "S"),
}


@dataclass(frozen=True)
class GeneratorLatency:
    """Simulated time from a command to its effect at the terminals, by what the command changes.

    The defaults are of the size in the 33220A's data sheet (5988-8544EN, from memory: low confidence).
    """

    amplitude_s: float = 0.030
    frequency_s: float = 0.003
    function_s: float = 0.111
    output_s: float = 0.0


class TerminalOutput(NamedTuple):
    """What is at the open terminals: peak of the alternating part and offset, both 0 while the output is off."""

    frequency_hz: float
    amplitude_v: float
    offset_v: float
    on: bool


@dataclass(frozen=True)
class _Signal:
    """What reaches the terminals; levels are the source's electromotive force, whatever load is programmed."""

    function: str = "SIN"
    frequency_hz: float = 1e3
    emf_vpp: float = 0.2
    emf_offset_v: float = 0.0
    on: bool = False

    def at_terminals(self) -> TerminalOutput:
        if not self.on:
            return TerminalOutput(self.frequency_hz, 0.0, 0.0, False)
        amplitude_v = 0.0 if self.function == "DC" else 0.5 * self.emf_vpp
        return TerminalOutput(self.frequency_hz, amplitude_v, self.emf_offset_v, True)


class Simulated33220A:
    """A 33220A as bytes in, bytes out, with its own clock.

    Settings reach the terminals after `latency` of simulated time, in the order in which they were sent;
    switching off does not queue behind the others. `listener` is called, under the instrument's lock, at each
    change at the terminals. Thread-safe.
    """

    def __init__(
        self,
        latency: GeneratorLatency | None = None,
        *,
        listener: Callable[[TerminalOutput], object] | None = None,
    ) -> None:
        latency = latency or GeneratorLatency()
        self._latency_s = {
            "function": latency.function_s,
            "frequency_hz": latency.frequency_s,
            "emf_vpp": latency.amplitude_s,
            "emf_offset_v": latency.amplitude_s,
            "on": latency.output_s,
        }
        self._listener = listener
        self._clock_s = 0.0
        self._sent = self._terminal = _Signal()
        self._under_way: list[tuple[float, dict[str, Any]]] = []
        self._reset()
        self._scpi = ScpiEngine(
            "Agilent Technologies,33220A,SIM00001,2.02-2.02-22-2",
            reset=self._reset,
            trigger=self._trigger,
            executed=self._propagate,
        )
        self._add_commands()

    def handle(self, data: bytes) -> bytes:
        """Carry out complete SCPI messages and return their answers."""
        return self._scpi.handle(data)

    def advance(self, dt_s: float) -> None:
        """Let simulated time pass."""
        with self._scpi.lock:
            self._clock_s += dt_s
            self._arrive()

    def output(self) -> TerminalOutput:
        """What is at the open terminals now."""
        with self._scpi.lock:
            return self._terminal.at_terminals()

    # --- settings to terminals -----------------------------------------------------------------------------

    def _reset(self) -> None:
        self._signal = _Signal()
        self._load_ohm = 50.0
        self._unit = "VPP"
        self._square_duty = 50.0
        self._pulse_width_s = 100e-6
        self._stored: dict[str, str] = {"VOLTage:RANGe:AUTO": "1"}
        self._stored |= {pattern: f"{default:d}" for pattern, default in _BOOLEANS.items()}
        self._stored |= {pattern: parse_choice(options[0], options) for pattern, options in _CHOICES.items()}
        self._stored |= {pattern: format_number(number[2]) for pattern, number in _NUMBERS.items()}

    def _propagate(self) -> None:
        """Send on its way, as one change, what the last command changed."""
        changed = {
            name: getattr(self._signal, name)
            for name in self._latency_s
            if getattr(self._signal, name) != getattr(self._sent, name)
        }
        self._sent = self._signal
        if changed.get("on") is False:
            self._switch_off()
            del changed["on"]
        if changed:
            due_s = self._clock_s + max(self._latency_s[name] for name in changed)
            self._under_way.append((max([due_s, *(due for due, _ in self._under_way)]), changed))
        self._arrive()

    def _switch_off(self) -> None:
        for _, change in self._under_way:
            change.pop("on", None)
        self._under_way.append((self._clock_s + self._latency_s["on"], {"on": False}))
        self._under_way.sort(key=lambda change: change[0])

    def _arrive(self) -> None:
        while self._under_way and self._under_way[0][0] <= self._clock_s + 1e-9:
            _, change = self._under_way.pop(0)
            before = self._terminal.at_terminals()
            self._terminal = replace(self._terminal, **change)
            if self._listener is not None and self._terminal.at_terminals() != before:
                self._listener(self._terminal.at_terminals())

    # --- the command tree ----------------------------------------------------------------------------------

    def _add_commands(self) -> None:
        add = self._scpi.command
        add("FUNCtion", self._set_function, lambda _: self._signal.function)
        add("FREQuency", lambda a: self._set_frequency_text(only(a)), self._ask_frequency)
        add("PULSe:PERiod", self._set_period, lambda _: format_number(1.0 / self._signal.frequency_hz))
        add("VOLTage", lambda a: self._set_amplitude(only(a)), self._ask_amplitude)
        add("VOLTage:OFFSet", lambda a: self._set_offset(only(a)), self._ask_offset)
        add("VOLTage:HIGH", lambda a: self._set_level(only(a), high=True), lambda _: self._level(+0.5))
        add("VOLTage:LOW", lambda a: self._set_level(only(a), high=False), lambda _: self._level(-0.5))
        add("VOLTage:UNIT", self._set_unit, lambda _: self._unit)
        add("VOLTage:RANGe:AUTO", self._set_autorange, lambda _: self._stored["VOLTage:RANGe:AUTO"])
        add("OUTPut", self._set_output, lambda _: f"{self._signal.on:d}")
        add("OUTPut:LOAD", self._set_load, self._ask_load)
        add("FUNCtion:SQUare:DCYCle", self._set_square_duty, lambda _: format_number(self._square_duty))
        add("FUNCtion:PULSe:WIDTh", self._set_pulse_width, lambda _: format_number(self._pulse_width_s))
        add("FUNCtion:PULSe:DCYCle", self._set_pulse_duty, lambda _: format_number(self._pulse_duty()))
        add("APPLy", query=self._ask_apply)
        for function in _FUNCTIONS:
            add(f"APPLy:{function}", partial(self._apply, function))
        add("TRIGger", lambda _: self._trigger())
        add("SYSTem:BEEPer", lambda _: None)
        for pattern in _BOOLEANS:
            self._add_stored(pattern, lambda text: f"{parse_boolean(text):d}")
        for pattern, options in _CHOICES.items():
            self._add_stored(pattern, partial(parse_choice, options=options))
        for pattern in _NUMBERS:
            self._add_stored(pattern, partial(self._plain_number, pattern))

    def _add_stored(self, pattern: str, parse: Callable[[str], str]) -> None:
        def write(arguments: list[str]) -> None:
            self._stored[pattern] = parse(only(arguments))

        self._scpi.command(pattern, write, lambda _: self._stored[pattern])

    def _plain_number(self, pattern: str, text: str) -> str:
        low, high, default, unit = _NUMBERS[pattern]
        named = {"MINimum": low, "MAXimum": high, "DEFault": default}
        if pattern == "BURSt:NCYCles" and text.upper() in ("INF", "INFINITY"):
            return format_number(INFINITY)
        return format_number(self._clipped(parse_number(text, unit, named), low, high))

    def _set_output(self, arguments: list[str]) -> None:
        self._change(on=parse_boolean(only(arguments)))

    def _set_autorange(self, arguments: list[str]) -> None:
        choice = parse_choice(only(arguments), ("0", "1", "OFF", "ON", "ONCE"))
        self._stored["VOLTage:RANGe:AUTO"] = "1" if choice in ("1", "ON") else "0"

    def _trigger(self) -> None:
        if self._stored["TRIGger:SOURce"] != "BUS":
            raise ScpiError(-211)

    # --- function and frequency ----------------------------------------------------------------------------

    def _set_function(self, arguments: list[str]) -> None:
        function = parse_choice(only(arguments), _FUNCTIONS)
        low_hz, high_hz = _FREQUENCY_RANGE_HZ[function]
        frequency_hz = min(max(self._signal.frequency_hz, low_hz), high_hz)
        if frequency_hz != self._signal.frequency_hz:
            self._scpi.post(-221)
        self._change(function=function, frequency_hz=frequency_hz)
        self._restrict_duty()
        self._restrict_offset()

    def _frequency_argument(self, text: str) -> float:
        low_hz, high_hz = _FREQUENCY_RANGE_HZ[self._signal.function]
        return parse_number(text, "HZ", {"MINimum": low_hz, "MAXimum": high_hz, "DEFault": 1e3})

    def _set_frequency_text(self, text: str) -> None:
        self._set_frequency(self._frequency_argument(text))

    def _set_frequency(self, frequency_hz: float) -> None:
        pulse_duty = self._pulse_duty()
        self._change(frequency_hz=self._clipped(frequency_hz, *_FREQUENCY_RANGE_HZ[self._signal.function]))
        period_s = 1.0 / self._signal.frequency_hz
        if self._stored["FUNCtion:PULSe:HOLD"] == "DCYC":
            self._pulse_width_s = 0.01 * pulse_duty * period_s
        self._pulse_width_s = max(min(self._pulse_width_s, period_s - _PULSE_WIDTH_LOW_S), _PULSE_WIDTH_LOW_S)
        self._restrict_duty()

    def _ask_frequency(self, arguments: list[str]) -> str:
        return format_number(self._frequency_argument(arguments[0]) if arguments else self._signal.frequency_hz)

    def _set_period(self, arguments: list[str]) -> None:
        self._set_frequency(1.0 / self._clipped(parse_number(only(arguments), "S"), *_PULSE_PERIOD_S))

    def _duty_range(self) -> tuple[float, float]:
        return (20.0, 80.0) if self._signal.frequency_hz <= _FAST_SQUARE_HZ else (40.0, 60.0)

    def _set_square_duty(self, arguments: list[str]) -> None:
        low, high = self._duty_range()
        named = {"MINimum": low, "MAXimum": high, "DEFault": 50.0}
        self._square_duty = self._clipped(parse_number(only(arguments), named=named), low, high)

    def _restrict_duty(self) -> None:
        low, high = self._duty_range()
        if self._signal.function == "SQU" and not low <= self._square_duty <= high:
            self._square_duty = min(max(self._square_duty, low), high)
            self._scpi.post(-221)

    def _set_pulse_width(self, arguments: list[str]) -> None:
        high_s = 1.0 / self._signal.frequency_hz - _PULSE_WIDTH_LOW_S
        self._pulse_width_s = self._clipped(parse_number(only(arguments), "S"), _PULSE_WIDTH_LOW_S, high_s)

    def _pulse_duty(self) -> float:
        return 100.0 * self._pulse_width_s * self._signal.frequency_hz

    def _set_pulse_duty(self, arguments: list[str]) -> None:
        duty = self._clipped(parse_number(only(arguments)), 0.0, 100.0)
        self._set_pulse_width([repr(0.01 * duty / self._signal.frequency_hz)])

    # --- levels: programmed and queried values are scaled by the programmed load, the real output is not -------

    def _scale(self) -> float:
        """Volts shown per volt of electromotive force."""
        return 1.0 if math.isinf(self._load_ohm) else self._load_ohm / (self._load_ohm + _SOURCE_OHM)

    def _set_load(self, arguments: list[str]) -> None:
        named = {"MINimum": _LOAD_LOW_OHM, "MAXimum": _LOAD_HIGH_OHM, "INFinity": math.inf}
        load_ohm = parse_number(only(arguments), "OHM", named)
        infinite = load_ohm >= INFINITY
        self._load_ohm = math.inf if infinite else self._clipped(load_ohm, _LOAD_LOW_OHM, _LOAD_HIGH_OHM)
        if infinite and self._unit == "DBM":
            self._unit = "VPP"

    def _ask_load(self, arguments: list[str]) -> str:
        if arguments:
            return format_number(
                parse_number(only(arguments), named={"MINimum": _LOAD_LOW_OHM, "MAXimum": _LOAD_HIGH_OHM})
            )
        return format_number(min(self._load_ohm, INFINITY))

    def _set_unit(self, arguments: list[str]) -> None:
        unit = parse_choice(only(arguments), ("VPP", "VRMS", "DBM"))
        if unit == "DBM" and math.isinf(self._load_ohm):
            raise ScpiError(-221)
        self._unit = unit

    def _to_emf_vpp(self, value: float, unit: str) -> float:
        if unit == "DBM":
            value = math.sqrt(1e-3 * 10.0 ** (0.1 * min(value, 1e3)) * self._load_ohm)
        per_vrms = _VPP_PER_VRMS.get(self._signal.function, 2.0 * math.sqrt(2.0))
        return value * (1.0 if unit == "VPP" else per_vrms) / self._scale()

    def _from_emf_vpp(self, emf_vpp: float) -> float:
        vpp = emf_vpp * self._scale()
        if self._unit == "VPP":
            return vpp
        vrms = vpp / _VPP_PER_VRMS.get(self._signal.function, 2.0 * math.sqrt(2.0))
        return vrms if self._unit == "VRMS" else 10.0 * math.log10(vrms**2 / self._load_ohm / 1e-3)

    def _set_amplitude(self, text: str) -> None:
        """A new amplitude is clipped to the range and wins over the offset, which is reduced (-221)."""
        unit = next((unit for unit in ("VPP", "VRMS", "DBM") if text.upper().endswith(unit)), None)
        if unit == "DBM" and math.isinf(self._load_ohm):
            raise ScpiError(-221)
        named = {"MINimum": _EMF_LOW_VPP, "DEFault": 0.2, "MAXimum": _EMF_HIGH_VPP}
        emf_vpp = parse_named(text, named)
        if emf_vpp is None:
            emf_vpp = self._to_emf_vpp(parse_number(text, unit or "V"), unit or self._unit)
        emf_vpp = self._clipped(emf_vpp, _EMF_LOW_VPP, _EMF_HIGH_VPP)
        self._change(emf_vpp=emf_vpp)
        self._restrict_offset()

    def _ask_amplitude(self, arguments: list[str]) -> str:
        named = {"MINimum": _EMF_LOW_VPP, "DEFault": 0.2, "MAXimum": _EMF_HIGH_VPP}
        emf_vpp = parse_named(only(arguments), named) if arguments else self._signal.emf_vpp
        if emf_vpp is None:
            raise ScpiError(-224)
        return format_number(self._from_emf_vpp(emf_vpp))

    def _offset_room_v(self) -> float:
        return _EMF_PEAK_V if self._signal.function == "DC" else _EMF_PEAK_V - 0.5 * self._signal.emf_vpp

    def _restrict_offset(self) -> None:
        room_v, offset_v = self._offset_room_v(), self._signal.emf_offset_v
        if abs(offset_v) > room_v:
            self._change(emf_offset_v=math.copysign(room_v, offset_v))
            self._scpi.post(-221)

    def _set_offset(self, text: str) -> None:
        room_v = self._offset_room_v()
        emf_v = parse_named(text, {"MINimum": -room_v, "MAXimum": room_v, "DEFault": 0.0})
        if emf_v is None:
            emf_v = parse_number(text, "V") / self._scale()
        self._change(emf_offset_v=self._clipped(emf_v, -room_v, room_v))

    def _ask_offset(self, arguments: list[str]) -> str:
        room_v = self._offset_room_v()
        named = {"MINimum": -room_v, "MAXimum": room_v, "DEFault": 0.0}
        emf_v = parse_named(only(arguments), named) if arguments else self._signal.emf_offset_v
        if emf_v is None:
            raise ScpiError(-224)
        return format_number(emf_v * self._scale())

    def _level(self, half: float) -> str:
        return format_number((self._signal.emf_offset_v + half * self._signal.emf_vpp) * self._scale())

    def _set_level(self, text: str, *, high: bool) -> None:
        """Set the high or low level; the other one stays, unless it is in the way: then it moves (-221)."""
        sign = 1.0 if high else -1.0
        emf_v = parse_named(text, {"MINimum": -_EMF_PEAK_V, "MAXimum": _EMF_PEAK_V})
        if emf_v is None:
            emf_v = parse_number(text, "V") / self._scale()
        # Seen along `sign`, the level set must be above the other one by at least the lowest amplitude.
        level = self._clipped(sign * emf_v, -_EMF_PEAK_V + _EMF_LOW_VPP, _EMF_PEAK_V)
        other = max(sign * self._signal.emf_offset_v - 0.5 * self._signal.emf_vpp, -_EMF_PEAK_V)
        if level - other < _EMF_LOW_VPP * (1.0 - 1e-9):
            other = level - _EMF_LOW_VPP
            self._scpi.post(-221)
        self._change(emf_vpp=max(level - other, _EMF_LOW_VPP), emf_offset_v=sign * 0.5 * (level + other))

    # --- APPLy, which also switches the output on --------------------------------------------------------------

    def _apply(self, function: str, arguments: list[str]) -> None:
        if len(arguments) > 3:
            raise ScpiError(-108)
        self._set_function([function])
        setters: tuple[Callable[[str], None], ...] = (self._set_frequency_text, self._set_amplitude, self._set_offset)
        for setter, text in zip(setters, arguments, strict=False):
            setter(text)
        self._change(on=True)

    def _ask_apply(self, _: list[str]) -> str:
        numbers = ",".join(
            (
                format_number(self._signal.frequency_hz),
                format_number(self._from_emf_vpp(self._signal.emf_vpp)),
                format_number(self._signal.emf_offset_v * self._scale()),
            )
        )
        return f'"{self._signal.function} {numbers}"'

    # --- helpers -------------------------------------------------------------------------------------------

    def _change(self, **values: Any) -> None:
        self._signal = replace(self._signal, **values)

    def _clipped(self, value: float, low: float, high: float) -> float:
        """Clip to the range; posts -222 unless the excess is rounding."""
        clipped = min(max(value, low), high)
        if not math.isclose(clipped, value, rel_tol=1e-9, abs_tol=1e-15):
            self._scpi.post(-222)
        return clipped
