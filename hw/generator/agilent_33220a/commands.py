"""The command tree of the simulated 33220A: which text sets and asks what."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from hw.generator.agilent_33220a import limits
from hw.generator.agilent_33220a.memory import ArbitraryMemory
from hw.generator.agilent_33220a.state import GeneratorState, named_values
from hw.generator.scpi import (
    INFINITY,
    ScpiEngine,
    ScpiError,
    format_number,
    only,
    parse_boolean,
    parse_named,
    parse_number,
)

_LEVEL = "VOLTage[:LEVel][:IMMediate]"
# Under the optional SOURce node, and other optional nodes, of settings that have no couplings.
_SPELLING = {
    "DISPlay": "DISPlay[:WINDow][:STATe]",
    "OUTPut:TRIGger": "OUTPut:TRIGger[:STATe]",
    "SYSTem:KLOCk": "SYSTem:KLOCk[:STATe]",
}
_NOT_SOURCE = ("OUTPut", "SYSTem", "TRIGger", "FORMat", "UNIT", "DISPlay")
_KINDS = {"AM": "AM", "FM": "FM", "PM": "PM", "FSKey": "FSK", "PWM": "PWM", "SWEep": "SWE", "BURSt": "BURS"}
_SLOTS = range(5)
# What `*LRN?` answers with, in an order in which no setting conflicts with one before.
_LEARNED = (
    *("OUTP:LOAD", "VOLT:UNIT", "FUNC:USER", "FUNC", "FREQ", "VOLT", "VOLT:OFFS", "VOLT:RANG:AUTO", "FUNC:SQU:DCYC"),
    *("FUNC:RAMP:SYMM", "FUNC:PULS:WIDT", "BURS:MODE", "BURS:NCYC", "BURS:PHAS", "TRIG:SOUR", "TRIG:SLOP"),
    *("AM:SOUR", "AM:DEPT", "AM:STAT", "BURS:STAT", "OUTP:POL", "OUTP:SYNC", "OUTP"),
)

Names = Callable[[], Mapping[str, float]]


class GeneratorCommands:
    """Adds the instrument's commands to `scpi`; `trigger` is what `TRIG` and `*TRG` do."""

    def __init__(self, scpi: ScpiEngine, state: GeneratorState, trigger: Callable[[], None]) -> None:
        self._scpi = scpi
        self._state = state
        self._text = ""
        self._add_function_and_levels()
        self._add_output(trigger)
        self._add_arbitrary(state.memory)
        self._add_modulation()
        self._add_states()
        for pattern in (*limits.BOOLEANS, *limits.CHOICES):
            scpi.command(_spelling(pattern), self._one(partial(state.store, pattern)), partial(self._stored, pattern))
        for pattern in limits.NUMBERS:
            query = partial(self._stored_number, pattern)
            scpi.command(_spelling(pattern), self._one(partial(state.store, pattern)), query)

    def _add_function_and_levels(self) -> None:
        state, source = self._state, self._source
        source("FUNCtion[:SHAPe]", state.set_function, lambda _: state.signal.function)
        source("FREQuency", state.set_frequency, self._number(lambda: state.signal.frequency_hz, state.frequency_names))
        period = named_values(*limits.PULSE_PERIOD_S, 1.0 / limits.RESET_FREQUENCY_HZ)
        source("PULSe:PERiod", state.set_period, self._number(lambda: 1.0 / state.signal.frequency_hz, lambda: period))
        emf_vpp = self._number(lambda: state.signal.emf_vpp, state.amplitude_names, state.shown_amplitude)
        source(f"{_LEVEL}[:AMPLitude]", state.set_amplitude, emf_vpp)
        emf_v = self._number(lambda: state.signal.emf_offset_v, state.offset_names, lambda v: v * state.scale)
        source(f"{_LEVEL}:OFFSet", state.set_offset, emf_v)
        for keyword, high in (("HIGH", True), ("LOW", False)):
            query = partial(self._ask_level, 0.5 if high else -0.5)
            source(f"{_LEVEL}:{keyword}", partial(state.set_level, high=high), query)
        source("VOLTage:UNIT", state.set_unit, lambda _: state.settings.unit)
        source("VOLTage:RANGe:AUTO", state.set_autorange, lambda _: f"{state.settings.autorange:d}")
        duty = self._number(lambda: state.settings.square_duty, state.duty_names)
        source("FUNCtion:SQUare:DCYCle", state.set_square_duty, duty)
        width = self._number(lambda: state.settings.pulse_width_s, state.pulse_width_names)
        for pattern in ("FUNCtion:PULSe:WIDTh", "PULSe:WIDTh"):
            source(pattern, state.set_pulse_width, width)
        source("FUNCtion:PULSe:DCYCle", state.set_pulse_duty, lambda _: format_number(state.pulse_duty()))

    def _add_output(self, trigger: Callable[[], None]) -> None:
        state, command = self._state, self._scpi.command
        command("OUTPut[:STATe]", lambda a: state.set_output(parse_boolean(only(a))), lambda _: f"{state.signal.on:d}")
        load = named_values(limits.LOAD_LOW_OHM, limits.LOAD_HIGH_OHM, limits.RESET_LOAD_OHM)
        shown = self._number(lambda: min(state.settings.load_ohm, INFINITY), lambda: load)
        command("OUTPut:LOAD", self._one(state.set_load), shown)
        command("APPLy", query=self._ask_apply)
        for function in limits.FUNCTIONS:
            command(f"APPLy:{function}", partial(self._apply, function))
        command("TRIGger[:IMMediate]", lambda _: trigger())
        command("SYSTem:BEEPer[:IMMediate]", lambda _: None)
        command("DISPlay[:WINDow]:TEXT", self._set_text, lambda _: f'"{self._text}"')
        command("DISPlay[:WINDow]:TEXT:CLEar", lambda _: self._set_text(['""']))

    def _add_arbitrary(self, memory: ArbitraryMemory) -> None:
        state, command = self._state, self._scpi.command

        def add(pattern: str, write: Callable[[list[str]], None]) -> None:
            def changed(arguments: list[str]) -> None:
                write(arguments)
                state.reload_waveform()

            command(f"[SOURce:]{pattern}", changed)

        add("DATA", memory.store_shares)
        add("DATA:DAC", lambda a: memory.store_codes(a, swapped=state.settings.stored["FORMat:BORDer"] == "SWAP"))
        add("DATA:COPY", memory.copy)
        add("DATA:DELete[:NAME]", lambda a: memory.delete(only(a), self._selected()))
        add("DATA:DELete:ALL", lambda _: memory.delete_all(self._selected()))
        command("[SOURce:]DATA:CATalog", query=lambda _: _quoted(memory.names()))
        command("[SOURce:]DATA:NVOLatile:CATalog", query=lambda _: _quoted(memory.non_volatile()))
        command("[SOURce:]DATA:NVOLatile:FREE", query=lambda _: format_number(memory.free()))
        self._source("FUNCtion:USER", state.select_user, lambda _: state.settings.user)
        attributes: dict[str, Callable[[np.ndarray[tuple[int], np.dtype[np.float64]]], float]] = {
            "POINts": len,
            "PTPeak": lambda points: 0.5 * float(np.ptp(points)),
            "AVERage": lambda points: float(points.mean()),
            "CFACtor": lambda points: float(np.abs(points).max() / np.sqrt(np.mean(points**2))),
        }
        for keyword, attribute in attributes.items():
            query = partial(self._ask_attribute, attribute)
            command(f"[SOURce:]DATA:ATTRibute:{keyword}", query=query)

    def _add_modulation(self) -> None:
        state = self._state
        for keyword, kind in _KINDS.items():
            self._source(
                f"{keyword}:STATe",
                partial(state.set_modulation, kind),
                partial(lambda kind, _: f"{state.settings.kind == kind:d}", kind),
            )

    def _add_states(self) -> None:
        self._scpi.common("*SAV", lambda a: self._state.save(_slot(a)))
        self._scpi.common("*RCL", lambda a: self._state.recall(_slot(a)))
        self._scpi.common("*LRN", query=lambda _: self._learned())

    # --- answers and arguments -----------------------------------------------------------------------------

    def _source(self, pattern: str, write: Callable[[str], None], query: Callable[[list[str]], str]) -> None:
        self._scpi.command(f"[SOURce:]{pattern}", self._one(write), query)

    @staticmethod
    def _one(write: Callable[[str], None]) -> Callable[[list[str]], None]:
        return lambda arguments: write(only(arguments))

    @staticmethod
    def _number(
        value: Callable[[], float], names: Names, shown: Callable[[float], float] = lambda value: value
    ) -> Callable[[list[str]], str]:
        """Make a query that answers the present value, or what MIN, MAX or DEF would be."""

        def query(arguments: list[str]) -> str:
            answer = parse_named(only(arguments), names()) if arguments else value()
            if answer is None:
                raise ScpiError(-224)
            return format_number(shown(answer))

        return query

    def _stored(self, pattern: str, _: list[str]) -> str:
        return self._state.settings.stored[pattern]

    def _stored_number(self, pattern: str, arguments: list[str]) -> str:
        low, high, default, _ = limits.NUMBERS[pattern]
        value = partial(self._state.number, pattern)
        return self._number(value, lambda: named_values(low, high, default))(arguments)

    def _ask_level(self, half: float, arguments: list[str]) -> str:
        peak_v = self._state.emf_peak_v() * self._state.scale
        names = named_values(-peak_v, peak_v, self._state.level_v(half))
        return self._number(lambda: self._state.level_v(half), lambda: names)(arguments)

    def _ask_attribute(
        self, attribute: Callable[[np.ndarray[tuple[int], np.dtype[np.float64]]], float], arguments: list[str]
    ) -> str:
        name = only(arguments) if arguments else self._state.settings.user
        return format_number(attribute(self._state.memory.points(name)))

    def _selected(self) -> str:
        return self._state.settings.user if self._state.signal.function == "USER" else ""

    def _set_text(self, arguments: list[str]) -> None:
        self._text = only(arguments).strip('"')

    def _apply(self, function: str, arguments: list[str]) -> None:
        """`APPLy` also switches modulation off and the output ON."""
        state = self._state
        if len(arguments) > 3:
            raise ScpiError(-108)
        if state.settings.kind:
            state.set_modulation(state.settings.kind, "0")
        state.set_function(function)
        setters = (state.set_frequency, state.set_amplitude, state.set_offset)
        for setter, text in zip(setters, arguments, strict=False):
            setter(text)
        state.set_output(True)

    def _ask_apply(self, _: list[str]) -> str:
        state, signal = self._state, self._state.signal
        numbers = (signal.frequency_hz, state.shown_amplitude(signal.emf_vpp), signal.emf_offset_v * state.scale)
        return f'"{signal.function} {",".join(map(format_number, numbers))}"'

    def _learned(self) -> str:
        answers = self._scpi.handle(";:".join(f"{header}?" for header in _LEARNED).encode()).decode().strip()
        return ";".join(f":{header} {answer}" for header, answer in zip(_LEARNED, answers.split(";"), strict=True))


def _spelling(pattern: str) -> str:
    pattern = _SPELLING.get(pattern, pattern)
    return pattern if pattern.startswith(_NOT_SOURCE) else f"[SOURce:]{pattern}"


def _slot(arguments: list[str]) -> int:
    slot = parse_number(only(arguments))
    if slot not in _SLOTS:
        raise ScpiError(-222)
    return int(slot)


def _quoted(names: list[str]) -> str:
    return ",".join(f'"{name}"' for name in names) or '""'
