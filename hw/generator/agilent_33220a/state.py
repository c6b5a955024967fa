"""What a simulated 33220A holds, and how one setting moves another.

Couplings are the User's Guide's and, where that is silent, the command-compatible Picotest G5100A manual's
(p. 37, 166, 167). Settings that conflict are moved and -221 is posted; values out of range are clipped and -222
is posted.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from hw.generator.agilent_33220a import limits
from hw.generator.agilent_33220a.memory import ArbitraryMemory
from hw.generator.scpi import (
    INFINITY,
    ScpiError,
    format_number,
    parse_boolean,
    parse_choice,
    parse_named,
    parse_number,
    short_form,
)


@dataclass(frozen=True)
class Signal:
    """What reaches the terminals; levels are the source's electromotive force, whatever load is programmed.

    `low` and `high` are the waveform's extremes as shares of its peak-to-peak value; `gated` is true while a
    burst waits for its trigger.
    """

    function: str = "SIN"
    frequency_hz: float = limits.RESET_FREQUENCY_HZ
    emf_vpp: float = limits.RESET_EMF_VPP
    emf_offset_v: float = 0.0
    low: float = -0.5
    high: float = 0.5
    modulation: str = ""
    depth: float = 1.0
    gated: bool = False
    on: bool = False


@dataclass
class _Settings:
    """All that `*RST` resets and `*SAV` saves."""

    signal: Signal = field(default_factory=Signal)
    load_ohm: float = limits.RESET_LOAD_OHM
    unit: str = "VPP"
    square_duty: float = 50.0
    pulse_width_s: float = 100e-6
    autorange: bool = True
    range_top_vpp: float = limits.range_top_vpp(0.5 * limits.RESET_EMF_VPP)
    kind: str = ""  # of modulation: one at a time
    user: str = "EXP_RISE"
    stored: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.stored |= {pattern: f"{default:d}" for pattern, default in limits.BOOLEANS.items()}
        self.stored |= {pattern: short_form(options[0]) for pattern, options in limits.CHOICES.items()}
        self.stored |= {pattern: format_number(number.default) for pattern, number in limits.NUMBERS.items()}


class GeneratorState:
    """The settings and their couplings. `post` takes the codes of errors that do not refuse a command.

    Setters take the text of one argument and raise ScpiError to refuse it.
    """

    def __init__(self, post: Callable[[int], None]) -> None:
        self._post = post
        self.settings = _Settings()
        self.memory = ArbitraryMemory()
        self._saved: dict[int, _Settings] = {}

    @property
    def signal(self) -> Signal:
        """What is on its way to the terminals."""
        return self.settings.signal

    def reset(self) -> None:
        """`*RST`; arbitrary waveforms and saved states stay."""
        self.settings = _Settings()

    def save(self, slot: int) -> None:
        """`*SAV`."""
        self._saved[slot] = copy.deepcopy(self.settings)

    def recall(self, slot: int) -> None:
        """`*RCL`: everything comes back, an output that was on too."""
        if slot not in self._saved:
            raise ScpiError(810)
        self.settings = copy.deepcopy(self._saved[slot])

    # --- settings without couplings ------------------------------------------------------------------------

    def store(self, pattern: str, text: str) -> None:
        """Keep a setting that is one of the table's booleans, choices or numbers."""
        stored = self.settings.stored
        if pattern in limits.BOOLEANS:
            stored[pattern] = f"{parse_boolean(text):d}"
        elif pattern in limits.CHOICES:
            stored[pattern] = parse_choice(text, limits.CHOICES[pattern])
        elif pattern == "BURSt:NCYCles" and text.upper() in ("INF", "INFINITY"):
            stored[pattern] = format_number(INFINITY)
        else:
            number = limits.NUMBERS[pattern]
            value = parse_number(text, number.unit, named_values(number.low, number.high, number.default))
            stored[pattern] = format_number(self._clipped(value, number.low, number.high))
        self._restrict_modulation()

    def number(self, pattern: str) -> float:
        """The value of one of the table's numbers."""
        return float(self.settings.stored[pattern])

    # --- function and frequency ----------------------------------------------------------------------------

    def set_function(self, text: str) -> None:
        """A frequency, amplitude, duty or modulation that the new function cannot have is moved (-221)."""
        function = parse_choice(text, limits.FUNCTIONS)
        low_hz, high_hz = limits.FREQUENCY_RANGE_HZ[function]
        frequency_hz = min(max(self.signal.frequency_hz, low_hz), high_hz)
        if frequency_hz != self.signal.frequency_hz:
            self._post(-221)
        self._change(function=function, frequency_hz=frequency_hz)
        self.reload_waveform()
        if self.settings.kind not in ("", *limits.KINDS[function]):
            self.settings.kind = ""
            self._post(-221)
        self._restrict_modulation()
        self._restrict_duty()

    def select_user(self, text: str) -> None:
        """`FUNC:USER <name>`: what `FUNC USER` puts out, or puts out now."""
        self.memory.points(text)
        self.settings.user = text.upper()
        self.reload_waveform()

    def reload_waveform(self) -> None:
        """Take over the extremes of the selected waveform; levels that do not fit it are moved."""
        is_user = self.signal.function == "USER"
        low, high = self.memory.extremes(self.settings.user) if is_user else (-0.5, 0.5)
        self._change(low=low, high=high)
        if self.signal.emf_vpp > self.emf_high_vpp() * (1.0 + 1e-12):
            self._change(emf_vpp=self.emf_high_vpp())
            self._post(-221)
        self._restrict_offset()

    def frequency_names(self) -> dict[str, float]:
        """MIN, MAX and DEF of the frequency for the present function."""
        return named_values(*limits.FREQUENCY_RANGE_HZ[self.signal.function], limits.RESET_FREQUENCY_HZ)

    def set_frequency(self, text: str) -> None:
        """Pulse width and square duty follow where they must."""
        self._set_frequency(parse_number(text, "HZ", self.frequency_names()))

    def set_period(self, text: str) -> None:
        """`PULS:PER`, the other side of the frequency."""
        low_s, high_s = limits.PULSE_PERIOD_S
        period_s = parse_number(text, "S", named_values(low_s, high_s, 1.0 / limits.RESET_FREQUENCY_HZ))
        self._set_frequency(1.0 / self._clipped(period_s, low_s, high_s))

    def _set_frequency(self, frequency_hz: float) -> None:
        pulse_duty = self.pulse_duty()
        self._change(frequency_hz=self._clipped(frequency_hz, *limits.FREQUENCY_RANGE_HZ[self.signal.function]))
        period_s = 1.0 / self.signal.frequency_hz
        settings = self.settings
        if settings.stored["FUNCtion:PULSe:HOLD"] == "DCYC":
            settings.pulse_width_s = 0.01 * pulse_duty * period_s
        low_s = limits.PULSE_WIDTH_LOW_S
        settings.pulse_width_s = max(min(settings.pulse_width_s, period_s - low_s), low_s)
        self._restrict_duty()

    def duty_names(self) -> dict[str, float]:
        """MIN, MAX and DEF of the square's duty cycle."""
        return named_values(*self._duty_range(), 50.0)

    def set_square_duty(self, text: str) -> None:
        """`FUNC:SQU:DCYC`, percent."""
        self.settings.square_duty = self._clipped(parse_number(text, named=self.duty_names()), *self._duty_range())

    def pulse_width_names(self) -> dict[str, float]:
        """MIN, MAX and DEF of the pulse width."""
        return named_values(limits.PULSE_WIDTH_LOW_S, 1.0 / self.signal.frequency_hz - limits.PULSE_WIDTH_LOW_S, 100e-6)

    def set_pulse_width(self, text: str) -> None:
        """`FUNC:PULS:WIDT`, s."""
        names = self.pulse_width_names()
        width_s = parse_number(text, "S", names)
        self.settings.pulse_width_s = self._clipped(width_s, names["MINimum"], names["MAXimum"])

    def pulse_duty(self) -> float:
        """Pulse width as percent of the period."""
        return 100.0 * self.settings.pulse_width_s * self.signal.frequency_hz

    def set_pulse_duty(self, text: str) -> None:
        """`FUNC:PULS:DCYC`, percent."""
        duty = self._clipped(parse_number(text), 0.0, 100.0)
        self.set_pulse_width(repr(0.01 * duty / self.signal.frequency_hz))

    def _duty_range(self) -> tuple[float, float]:
        return (20.0, 80.0) if self.signal.frequency_hz <= limits.FAST_SQUARE_HZ else (40.0, 60.0)

    def _restrict_duty(self) -> None:
        low, high = self._duty_range()
        if self.signal.function == "SQU" and not low <= self.settings.square_duty <= high:
            self.settings.square_duty = min(max(self.settings.square_duty, low), high)
            self._post(-221)

    # --- levels: programmed and queried values are scaled by the programmed load, the real output is not -------

    @property
    def scale(self) -> float:
        """Volts shown per volt of electromotive force."""
        load_ohm = self.settings.load_ohm
        return 1.0 if math.isinf(load_ohm) else load_ohm / (load_ohm + limits.SOURCE_OHM)

    def set_load(self, text: str) -> None:
        """`OUTP:LOAD`; dBm is impossible into an open circuit and falls to VPP."""
        low_ohm, high_ohm = limits.LOAD_LOW_OHM, limits.LOAD_HIGH_OHM
        names = named_values(low_ohm, high_ohm, limits.RESET_LOAD_OHM) | {"INFinity": math.inf}
        load_ohm = parse_number(text, "OHM", names)
        infinite = load_ohm >= INFINITY
        self.settings.load_ohm = math.inf if infinite else self._clipped(load_ohm, low_ohm, high_ohm)
        if infinite and self.settings.unit == "DBM":
            self.settings.unit = "VPP"

    def set_unit(self, text: str) -> None:
        """`VOLT:UNIT`."""
        unit = parse_choice(text, ("VPP", "VRMS", "DBM", "DEFault"))
        self._refuse_dbm_if_open(unit)
        self.settings.unit = "VPP" if unit == "DEF" else unit

    def _refuse_dbm_if_open(self, unit: str) -> None:
        if unit == "DBM" and math.isinf(self.settings.load_ohm):
            raise ScpiError(-221)

    def _to_emf_vpp(self, value: float, unit: str) -> float:
        if unit == "DBM":
            value = math.sqrt(1e-3 * 10.0 ** (0.1 * min(value, 1e3)) * self.settings.load_ohm)
        per_vrms = limits.VPP_PER_VRMS.get(self.signal.function, 2.0 * math.sqrt(2.0))
        return value * (1.0 if unit == "VPP" else per_vrms) / self.scale

    def shown_amplitude(self, emf_vpp: float) -> float:
        """An amplitude in the unit and for the load that are programmed."""
        vpp = emf_vpp * self.scale
        if self.settings.unit == "VPP":
            return vpp
        vrms = vpp / limits.VPP_PER_VRMS.get(self.signal.function, 2.0 * math.sqrt(2.0))
        return vrms if self.settings.unit == "VRMS" else 10.0 * math.log10(vrms**2 / self.settings.load_ohm / 1e-3)

    def _peak_share(self) -> float:
        return max(abs(self.signal.low), abs(self.signal.high))

    def emf_peak_v(self) -> float:
        """The highest voltage of either sign; held down by a fixed range."""
        return limits.EMF_PEAK_V if self.settings.autorange else 0.5 * self.settings.range_top_vpp

    def emf_high_vpp(self) -> float:
        """The highest amplitude; lower for a waveform that does not reach both ends of the DAC, or is one-sided."""
        return max(self.emf_peak_v() / self._peak_share(), limits.EMF_LOW_VPP)

    def amplitude_names(self) -> dict[str, float]:
        """MIN, MAX and DEF of the amplitude, as electromotive force."""
        return named_values(limits.EMF_LOW_VPP, self.emf_high_vpp(), limits.RESET_EMF_VPP)

    def set_amplitude(self, text: str) -> None:
        """A new amplitude is clipped to the range and wins over the offset, which is reduced (-221)."""
        unit = next((unit for unit in ("VPP", "VRMS", "DBM") if text.upper().endswith(unit)), None)
        self._refuse_dbm_if_open(unit or "")
        emf_vpp = parse_named(text, self.amplitude_names())
        if emf_vpp is None:
            emf_vpp = self._to_emf_vpp(parse_number(text, unit or "V"), unit or self.settings.unit)
        self._change(emf_vpp=self._clipped(emf_vpp, limits.EMF_LOW_VPP, self.emf_high_vpp()))
        self._restrict_offset()

    def offset_names(self) -> dict[str, float]:
        """MIN, MAX and DEF of the offset, as electromotive force."""
        room_v = self._offset_room_v()
        return named_values(-room_v, room_v, 0.0)

    def set_offset(self, text: str) -> None:
        """An offset beyond what the amplitude leaves is clipped (-222)."""
        room_v = self._offset_room_v()
        emf_v = parse_named(text, self.offset_names())
        if emf_v is None:
            emf_v = parse_number(text, "V") / self.scale
        self._change(emf_offset_v=self._clipped(emf_v, -room_v, room_v))

    def _offset_room_v(self) -> float:
        amplitude_v = 0.0 if self.signal.function == "DC" else self.signal.emf_vpp * self._peak_share()
        return max(self.emf_peak_v() - amplitude_v, 0.0)

    def _restrict_offset(self) -> None:
        room_v, offset_v = self._offset_room_v(), self.signal.emf_offset_v
        if abs(offset_v) > room_v:
            self._change(emf_offset_v=math.copysign(room_v, offset_v))
            self._post(-221)

    def level_v(self, half: float) -> float:
        """The high (`half` 0.5) or low (-0.5) level, as shown."""
        return (self.signal.emf_offset_v + half * self.signal.emf_vpp) * self.scale

    def set_level(self, text: str, *, high: bool) -> None:
        """Set the high or low level; the other one stays, unless it is in the way: then it moves (-221)."""
        sign, peak_v = (1.0 if high else -1.0), self.emf_peak_v()
        emf_v = parse_named(text, {"MINimum": -peak_v, "MAXimum": peak_v})
        if emf_v is None:
            emf_v = parse_number(text, "V") / self.scale
        # Seen along `sign`, the level set must be above the other one by at least the lowest amplitude.
        level = self._clipped(sign * emf_v, -peak_v + limits.EMF_LOW_VPP, peak_v)
        other = max(sign * self.signal.emf_offset_v - 0.5 * self.signal.emf_vpp, -peak_v)
        if level - other < limits.EMF_LOW_VPP * (1.0 - 1e-9):
            other = level - limits.EMF_LOW_VPP
            self._post(-221)
        emf_vpp = min(max(level - other, limits.EMF_LOW_VPP), self.emf_high_vpp())
        self._change(emf_vpp=emf_vpp, emf_offset_v=sign * 0.5 * (level + other))
        self._restrict_offset()

    # --- output, range, modulation -------------------------------------------------------------------------

    def set_output(self, on: bool) -> None:
        """`OUTP`."""
        self._change(on=on)

    def set_autorange(self, text: str) -> None:
        """`OFF` keeps the attenuator where the present level needs it, `ONCE` looks again and then keeps it."""
        choice = parse_choice(text, ("0", "1", "OFF", "ON", "ONCE"))
        self.settings.autorange = choice in ("1", "ON", "ONCE")
        self.follow_range()
        self.settings.autorange = choice in ("1", "ON")

    def follow_range(self) -> bool:
        """Let the attenuator follow the level, if it may; return whether it switched."""
        if not self.settings.autorange:
            return False
        amplitude_v = 0.0 if self.signal.function == "DC" else self.signal.emf_vpp * self._peak_share()
        before = self.settings.range_top_vpp
        self.settings.range_top_vpp = limits.range_top_vpp(amplitude_v + abs(self.signal.emf_offset_v))
        return self.settings.range_top_vpp != before

    def set_modulation(self, kind: str, text: str) -> None:
        """Only one kind at a time: switching one on switches another off (-221)."""
        on = parse_boolean(text)
        settings = self.settings
        if on and kind not in limits.KINDS[self.signal.function]:
            raise ScpiError(-221)
        if on and settings.kind not in ("", kind):
            self._post(-221)
        if on or settings.kind == kind:
            settings.kind = kind if on else ""
        self._restrict_modulation()

    def start_burst(self) -> float:
        """Let a waiting burst out; return how long it lasts, s."""
        self._change(gated=False)
        cycles = self.number("BURSt:NCYCles")
        return math.inf if cycles >= INFINITY else cycles / self.signal.frequency_hz

    def end_burst(self) -> None:
        """Wait for the next trigger."""
        self._restrict_modulation()

    def awaits_trigger(self) -> bool:
        """Whether a burst is armed and waits for a trigger."""
        stored = self.settings.stored
        return self.settings.kind == "BURS" and stored["BURSt:MODE"] == "TRIG" and stored["TRIGger:SOURce"] != "IMM"

    def _restrict_modulation(self) -> None:
        """Let modulation and gating follow from the settings; an open gate input counts as low."""
        stored, kind = self.settings.stored, self.settings.kind
        closed_gate = kind == "BURS" and stored["BURSt:MODE"] == "GAT" and stored["BURSt:GATE:POLarity"] == "NORM"
        modulation = f"AM {stored['AM:SOURce']}" if kind == "AM" else kind
        depth = 0.01 * self.number("AM:DEPTh")
        self._change(modulation=modulation, depth=depth, gated=closed_gate or self.awaits_trigger())

    # --- helpers -------------------------------------------------------------------------------------------

    def _change(self, **values: Any) -> None:
        self.settings.signal = replace(self.settings.signal, **values)

    def _clipped(self, value: float, low: float, high: float) -> float:
        """Clip to the range; posts -222 unless the excess is rounding."""
        clipped = min(max(value, low), high)
        if not math.isclose(clipped, value, rel_tol=1e-9, abs_tol=1e-15):
            self._post(-222)
        return clipped


def named_values(low: float, high: float, default: float) -> dict[str, float]:
    """Return the values that MIN, MAX and DEF stand for."""
    return {"MINimum": low, "MAXimum": high, "DEFault": default}
