"""What a simulated Agilent or Keysight generator holds, and how one setting moves another.

Couplings are the 33220A User's Guide's and, where that is silent, the command-compatible Picotest
G5100A manual's (p. 37, 166, 167). Settings that conflict are moved and -221 is posted; values out
of range are clipped and -222 is posted. Those of VOLT:LIM are from memory of the 33500's manual:
unverified.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from hw.generator.keysight import ranges
from hw.generator.keysight.ranges import Ranges
from hw.generator.keysight.scpi import (
    INFINITY,
    ScpiError,
    parse_boolean,
    parse_choice,
    parse_named,
    parse_number,
)
from hw.generator.terminals import Signal


@dataclass
class _Settings:
    """All that `*RST` resets."""

    signal: Signal = field(
        default_factory=lambda: Signal("SIN", ranges.RESET_FREQUENCY_HZ, ranges.RESET_EMF_VPP)
    )
    load_ohm: float = ranges.RESET_LOAD_OHM
    unit: str = "VPP"
    square_duty: float = 50.0
    autorange: bool = True
    range_top_vpp: float = ranges.range_top_vpp(0.5 * ranges.RESET_EMF_VPP)
    modulating: bool = False
    external: bool = False
    depth: float = 100.0
    burst: bool = False
    inverted: bool = False
    sync: bool = True
    limited: bool = False
    limits_v: tuple[float, float] = (-ranges.EMF_PEAK_V, ranges.EMF_PEAK_V)

    @property
    def scale(self) -> float:
        """Volts shown per volt of electromotive force."""
        load_ohm = self.load_ohm
        return 1.0 if math.isinf(load_ohm) else load_ohm / (load_ohm + ranges.SOURCE_OHM)

    def to_emf_vpp(self, value: float, unit: str) -> float:
        """The amplitude as electromotive force."""
        if unit == "DBM":
            value = math.sqrt(1e-3 * 10.0 ** (0.1 * min(value, 1e3)) * self.load_ohm)
        per_vrms = ranges.VPP_PER_VRMS.get(self.signal.function, 2.0 * math.sqrt(2.0))
        return value * (1.0 if unit == "VPP" else per_vrms) / self.scale

    def shown_amplitude(self, emf_vpp: float) -> float:
        """An amplitude in the unit and for the load that are programmed."""
        vpp = emf_vpp * self.scale
        if self.unit == "VPP":
            return vpp
        vrms = vpp / ranges.VPP_PER_VRMS.get(self.signal.function, 2.0 * math.sqrt(2.0))
        return vrms if self.unit == "VRMS" else 10.0 * math.log10(vrms**2 / self.load_ohm / 1e-3)

    def emf_peak_v(self) -> float:
        """The highest voltage of either sign; held down by a fixed range."""
        return ranges.EMF_PEAK_V if self.autorange else 0.5 * self.range_top_vpp

    def amplitude_v(self) -> float:
        """From the offset to the highest level."""
        return 0.0 if self.signal.function == "DC" else 0.5 * self.signal.emf_vpp

    def duty_range(self) -> tuple[float, float]:
        """Lowest and highest duty cycle of the square at this frequency, percent."""
        return (20.0, 80.0) if self.signal.frequency_hz <= ranges.FAST_SQUARE_HZ else (40.0, 60.0)

    def level_v(self, sign: float) -> float:
        """The highest (`sign` 1) or lowest (-1) level at the terminals, as shown."""
        return (self.signal.emf_offset_v + sign * self.amplitude_v()) * self.scale


class GeneratorState:
    """The settings and their couplings. `post` takes the codes of errors that do not refuse a
    command.

    Setters take the text of one argument and raise ScpiError to refuse it.
    """

    def __init__(self, model: Ranges, post: Callable[[int], None]) -> None:
        self._model = model
        self._post = post
        self.settings = _Settings()

    @property
    def signal(self) -> Signal:
        """What is on its way to the terminals."""
        return self.settings.signal

    def reset(self) -> None:
        """`*RST`."""
        self.settings = _Settings()

    # --- function and frequency

    def set_function(self, text: str) -> None:
        """A frequency, amplitude, duty or modulation that the new function cannot have is moved
        (-221).
        """
        function = parse_choice(text, self._model.functions)
        low_hz, high_hz = self._model.frequency_hz[function]
        frequency_hz = min(max(self.signal.frequency_hz, low_hz), high_hz)
        if frequency_hz != self.signal.frequency_hz:
            self._post(-221)
        self._change(function=function, frequency_hz=frequency_hz)
        if self.settings.modulating and function in ranges.UNMODULATED:
            self.settings.modulating = False
            self._post(-221)
        self._follow_modulation()
        self._restrict_offset()
        self._restrict_duty()

    def frequency_names(self) -> dict[str, float]:
        """MIN, MAX and DEF of the frequency for the present function."""
        return named_values(
            *self._model.frequency_hz[self.signal.function], ranges.RESET_FREQUENCY_HZ
        )

    def set_frequency(self, text: str) -> None:
        """Square duty follows where it must."""
        frequency_hz = parse_number(text, "HZ", self.frequency_names())
        self._change(
            frequency_hz=self._clipped(
                frequency_hz, *self._model.frequency_hz[self.signal.function]
            )
        )
        self._restrict_duty()

    def duty_names(self) -> dict[str, float]:
        """MIN, MAX and DEF of the square's duty cycle."""
        return named_values(*self.settings.duty_range(), 50.0)

    def set_square_duty(self, text: str) -> None:
        """`FUNC:SQU:DCYC`, percent."""
        self.settings.square_duty = self._clipped(
            parse_number(text, named=self.duty_names()), *self.settings.duty_range()
        )

    def _restrict_duty(self) -> None:
        low, high = self.settings.duty_range()
        if self.signal.function == "SQU" and not low <= self.settings.square_duty <= high:
            self.settings.square_duty = min(max(self.settings.square_duty, low), high)
            self._post(-221)

    # --- levels: programmed and queried values are scaled by the programmed load, the real output
    # is not -------

    def set_load(self, text: str) -> None:
        """`OUTP:LOAD`; dBm is impossible into an open circuit and falls to VPP."""
        low_ohm, high_ohm = ranges.LOAD_LOW_OHM, ranges.LOAD_HIGH_OHM
        names = named_values(low_ohm, high_ohm, ranges.RESET_LOAD_OHM) | {"INFinity": math.inf}
        load_ohm = parse_number(text, "OHM", names)
        infinite = load_ohm >= INFINITY
        self.settings.load_ohm = (
            math.inf if infinite else self._clipped(load_ohm, low_ohm, high_ohm)
        )
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

    def _level_range_v(self) -> tuple[float, float]:
        """Lowest and highest level; VOLT:LIM counts as shown for the programmed load."""
        peak_v = self.settings.emf_peak_v()
        if not self.settings.limited:
            return -peak_v, peak_v
        low_v, high_v = (v / self.settings.scale for v in self.settings.limits_v)
        return max(-peak_v, low_v), min(peak_v, high_v)

    def _emf_high_vpp(self) -> float:
        low_v, high_v = self._level_range_v()
        return max(2.0 * min(-low_v, high_v), self._model.emf_low_vpp)

    def amplitude_names(self) -> dict[str, float]:
        """MIN, MAX and DEF of the amplitude, as electromotive force."""
        return named_values(self._model.emf_low_vpp, self._emf_high_vpp(), ranges.RESET_EMF_VPP)

    def set_amplitude(self, text: str) -> None:
        """A new amplitude is clipped to the range and wins over the offset, which is reduced
        (-221).
        """
        unit = next((unit for unit in ("VPP", "VRMS", "DBM") if text.upper().endswith(unit)), None)
        self._refuse_dbm_if_open(unit or "")
        emf_vpp = parse_named(text, self.amplitude_names())
        if emf_vpp is None:
            emf_vpp = self.settings.to_emf_vpp(
                parse_number(text, unit or "V"), unit or self.settings.unit
            )
        self._change(emf_vpp=self._clipped(emf_vpp, self._model.emf_low_vpp, self._emf_high_vpp()))
        self._restrict_offset()

    def offset_names(self) -> dict[str, float]:
        """MIN, MAX and DEF of the offset, as electromotive force."""
        return named_values(*self._offset_range_v(), 0.0)

    def set_offset(self, text: str) -> None:
        """An offset beyond what the amplitude leaves is clipped (-222)."""
        emf_v = parse_named(text, self.offset_names())
        if emf_v is None:
            emf_v = parse_number(text, "V") / self.settings.scale
        self._change(emf_offset_v=self._clipped(emf_v, *self._offset_range_v()))

    def _offset_range_v(self) -> tuple[float, float]:
        low_v, high_v = self._level_range_v()
        return min(low_v + self.settings.amplitude_v(), 0.0), max(
            high_v - self.settings.amplitude_v(), 0.0
        )

    def _restrict_offset(self) -> None:
        low_v, high_v = self._offset_range_v()
        offset_v = min(max(self.signal.emf_offset_v, low_v), high_v)
        if offset_v != self.signal.emf_offset_v:
            self._change(emf_offset_v=offset_v)
            self._post(-221)

    def level_v(self, half: float) -> float:
        """The high (`half` 0.5) or low (-0.5) level, as shown."""
        return (self.signal.emf_offset_v + half * self.signal.emf_vpp) * self.settings.scale

    def set_level(self, text: str, *, high: bool) -> None:
        """Set the high or low level; the other one stays, unless it is in the way: then it moves
        (-221).
        """
        sign, least_vpp = (1.0 if high else -1.0), self._model.emf_low_vpp
        low_v, high_v = self._level_range_v()
        emf_v = parse_named(text, {"MINimum": low_v, "MAXimum": high_v})
        if emf_v is None:
            emf_v = parse_number(text, "V") / self.settings.scale
        # Seen along `sign`, the level set must be above the other one by at least the lowest
        # amplitude.
        bottom, top = (low_v, high_v) if high else (-high_v, -low_v)
        level = self._clipped(sign * emf_v, bottom + least_vpp, top)
        other = max(sign * self.signal.emf_offset_v - 0.5 * self.signal.emf_vpp, bottom)
        if level - other < least_vpp * (1.0 - 1e-9):
            other = level - least_vpp
            self._post(-221)
        self._change(
            emf_vpp=max(level - other, least_vpp), emf_offset_v=sign * 0.5 * (level + other)
        )
        self._restrict_offset()

    def set_limit(self, text: str, *, high: bool) -> None:
        """`VOLT:LIM:HIGH|LOW`; not inside the levels that are there now (-221)."""
        value_v = parse_number(
            text, "V", {"MINimum": -ranges.EMF_PEAK_V, "MAXimum": ranges.EMF_PEAK_V}
        )
        value_v = self._clipped(value_v, -ranges.EMF_PEAK_V, ranges.EMF_PEAK_V)
        there_v = self.settings.level_v(1.0 if high else -1.0)
        if value_v < there_v if high else value_v > there_v:
            value_v = there_v
            self._post(-221)
        low_v, high_v = self.settings.limits_v
        self.settings.limits_v = (low_v, value_v) if high else (value_v, high_v)

    def set_limited(self, text: str) -> None:
        """`VOLT:LIM:STAT`; not while the levels are outside (-221)."""
        on = parse_boolean(text)
        levels_v = [self.settings.level_v(sign) for sign in (-1.0, 1.0)]
        low_v, high_v = self.settings.limits_v
        if on and not (low_v <= levels_v[0] and levels_v[1] <= high_v):
            raise ScpiError(-221)
        self.settings.limited = on

    # --- output, range, modulation

    def set_output(self, on: bool) -> None:
        """`OUTP`."""
        self._change(on=on)

    def set_polarity(self, text: str) -> None:
        """`OUTP:POL`: the waveform around its offset; Sync and offset stay as they are."""
        self.settings.inverted = parse_choice(text, ("NORMal", "INVerted")) == "INV"

    def set_sync(self, text: str) -> None:
        """`OUTP:SYNC`."""
        self.settings.sync = parse_boolean(text)

    def set_autorange(self, text: str) -> None:
        """`OFF` keeps the attenuator where the present level needs it, `ONCE` looks again and then
        keeps it.
        """
        choice = parse_choice(text, ("0", "1", "OFF", "ON", "ONCE"))
        self.settings.autorange = choice in ("1", "ON", "ONCE")
        self.follow_range()
        self.settings.autorange = choice in ("1", "ON")

    def follow_range(self) -> bool:
        """Let the attenuator follow the level, if it may; return whether it switched."""
        if not self.settings.autorange:
            return False
        before = self.settings.range_top_vpp
        self.settings.range_top_vpp = ranges.range_top_vpp(
            self.settings.amplitude_v() + abs(self.signal.emf_offset_v)
        )
        return self.settings.range_top_vpp != before

    def set_modulating(self, text: str) -> None:
        """`AM:STAT`; ends a burst (-221)."""
        on = parse_boolean(text)
        if on and self.signal.function in ranges.UNMODULATED:
            raise ScpiError(-221)
        if on and self.settings.burst:
            self.settings.burst = False
            self._post(-221)
        self.settings.modulating = on
        self._follow_modulation()

    def set_source(self, text: str) -> None:
        """`AM:SOUR`."""
        self.settings.external = parse_choice(text, ("INTernal", "EXTernal")) == "EXT"
        self._follow_modulation()

    def set_depth(self, text: str) -> None:
        """`AM:DEPT`, percent."""
        self.settings.depth = self._clipped(
            parse_number(text, named=named_values(0.0, 120.0, 100.0)), 0.0, 120.0
        )
        self._follow_modulation()

    def set_burst(self, text: str) -> None:
        """`BURS:STAT`; nothing triggers it, so nothing but the offset goes out. Ends modulation
        (-221).
        """
        on = parse_boolean(text)
        if on and self.signal.function == "DC":
            raise ScpiError(-221)
        if on and self.settings.modulating:
            self.settings.modulating = False
            self._post(-221)
        self.settings.burst = on
        self._follow_modulation()

    def _follow_modulation(self) -> None:
        """Internal modulation at its loudest is the amplitude programmed; it is not followed in
        time.
        """
        settings = self.settings
        self._change(
            modulated=settings.modulating and settings.external,
            depth=0.01 * settings.depth,
            silent=settings.burst or self.signal.function == "DC",
        )

    # --- helpers

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
