"""A stateful Agilent or Keysight generator: its dialogue, its couplings and traps, and what is at
its terminals.

Sine, square, constant voltage, levels, load, range, AM, the output and errors act as on the
instrument. Of other functions the name is taken and the peak is right. `APPLy` is there because it
is a trap: it turns the output on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import ClassVar

from hw.generator.contract import GeneratorLatency, Listener, TerminalOutput
from hw.generator.keysight import ranges
from hw.generator.keysight.scpi import (
    INFINITY,
    Query,
    ScpiEngine,
    ScpiError,
    format_number,
    only,
    parse_boolean,
    parse_choice,
    parse_named,
)
from hw.generator.keysight.state import GeneratorState, named_values
from hw.generator.terminals import Terminals, simulated_serial_number

_LEVEL = "VOLTage[:LEVel][:IMMediate]"
_OVERLOAD = 720  # the real code is not known; the class (device error) is

Names = Callable[[], Mapping[str, float]]


class SimulatedKeysight:
    """One channel as bytes in, bytes out, with its own clock; see `Terminals` for the arguments.
    Thread-safe.
    """

    model: ClassVar[ranges.Ranges]

    def __init__(
        self,
        latency: GeneratorLatency | None = None,
        *,
        listener: Listener | None = None,
        am_full_scale: float = 1.0,
    ) -> None:
        self.range_switches = 0
        identity = self.model.identity.format(serial_number=simulated_serial_number())
        self._scpi = ScpiEngine(identity, reset=self._reset, executed=self._executed)
        self._state = GeneratorState(self.model, self._scpi.post)
        self._terminals = Terminals(
            self._state.signal,
            latency or GeneratorLatency(),
            ranges.EMF_PEAK_V,
            listener=listener,
            am_full_scale=am_full_scale,
        )
        self._stored: dict[str, str] = {}
        self._add_function_and_levels()
        self._add_output()
        self._add_modulation()

    def handle(self, data: bytes) -> bytes:
        """Carry out complete SCPI messages and return their answers."""
        return self._scpi.handle(data)

    def advance(self, dt_s: float) -> None:
        """Let simulated time pass."""
        with self._scpi.lock:
            self._terminals.advance(dt_s)

    def output(self) -> TerminalOutput:
        """What is at the open terminals now."""
        with self._scpi.lock:
            return self._terminals.output()

    def set_modulation_input(self, voltage_v: float) -> None:
        """Put a voltage on the rear panel's Modulation In; it acts at once. Open, it is at 0 V."""
        with self._scpi.lock:
            self._terminals.set_modulation_input(voltage_v)

    @property
    def sync_on(self) -> bool:
        """Whether the Sync output at the back shows the sine's rise."""
        with self._scpi.lock:
            return self._state.settings.sync

    def overload(self) -> None:
        """A voltage from outside at the terminals: the output switches itself off and says so in
        the error queue.
        """
        with self._scpi.lock:
            self._state.set_output(False)
            self._scpi.post(_OVERLOAD)
            self._executed()

    def _reset(self) -> None:
        self._state.reset()

    def _executed(self) -> None:
        self.range_switches += self._state.follow_range()
        self._terminals.put(self._state.signal)

    # --- the command tree

    def _add_function_and_levels(self) -> None:
        state, source = self._state, self._source
        source("FUNCtion[:SHAPe]", state.set_function, lambda _: state.signal.function)
        source(
            "FREQuency",
            state.set_frequency,
            _number(lambda: state.signal.frequency_hz, state.frequency_names),
        )
        shown = lambda v: state.settings.shown_amplitude(v)  # noqa: E731, PLW0108 - `*RST` brings other settings
        amplitude = _number(lambda: state.signal.emf_vpp, state.amplitude_names, shown)
        source(f"{_LEVEL}[:AMPLitude]", state.set_amplitude, amplitude)
        offset = _number(
            lambda: state.signal.emf_offset_v,
            state.offset_names,
            lambda v: v * state.settings.scale,
        )
        source(f"{_LEVEL}:OFFSet", state.set_offset, offset)
        for keyword, high in (("HIGH", True), ("LOW", False)):
            half = 0.5 if high else -0.5
            level = _number(partial(state.level_v, half), partial(self._level_names, half))
            source(f"{_LEVEL}:{keyword}", partial(state.set_level, high=high), level)
            if self.model.own_limit:
                limit = _number(partial(self._limit_v, high), dict[str, float])
                source(f"VOLTage:LIMit:{keyword}", partial(state.set_limit, high=high), limit)
        if self.model.own_limit:
            source(
                "VOLTage:LIMit:STATe", state.set_limited, lambda _: f"{state.settings.limited:d}"
            )
        source("VOLTage:UNIT", state.set_unit, lambda _: state.settings.unit)
        source("VOLTage:RANGe:AUTO", state.set_autorange, lambda _: f"{state.settings.autorange:d}")
        source(
            "FUNCtion:SQUare:DCYCle",
            state.set_square_duty,
            _number(lambda: state.settings.square_duty, state.duty_names),
        )

    def _add_output(self) -> None:
        state, command = self._state, self._scpi.command
        self._output(
            "[:STATe]",
            lambda text: state.set_output(parse_boolean(text)),
            lambda _: f"{state.signal.on:d}",
        )
        load = named_values(ranges.LOAD_LOW_OHM, ranges.LOAD_HIGH_OHM, ranges.RESET_LOAD_OHM)
        shown = _number(lambda: min(state.settings.load_ohm, INFINITY), lambda: load)
        self._output(":LOAD", state.set_load, shown)
        self._output(
            ":POLarity", state.set_polarity, lambda _: "INV" if state.settings.inverted else "NORM"
        )
        self._output(":SYNC", state.set_sync, lambda _: f"{state.settings.sync:d}")
        command("APPLy", query=self._ask_apply)
        for function in self.model.functions:
            command(f"APPLy:{function}", partial(self._apply, function))
        command("SYSTem:BEEPer[:IMMediate]", lambda _: None)
        self._store("SYSTem:BEEPer:STATe", ("0", "1", "OFF", "ON"), "1")
        self._store("SYSTem:COMMunicate:RLSTate", ("LOCal", "REMote", "RWLock"), "LOC")

    def _add_modulation(self) -> None:
        state, source = self._state, self._source
        source("AM:STATe", state.set_modulating, lambda _: f"{state.settings.modulating:d}")
        source("AM:SOURce", state.set_source, lambda _: "EXT" if state.settings.external else "INT")
        depth = _number(lambda: state.settings.depth, lambda: named_values(0.0, 120.0, 100.0))
        source("AM:DEPTh", state.set_depth, depth)
        source("BURSt:STATe", state.set_burst, lambda _: f"{state.settings.burst:d}")

    # --- answers and arguments

    def _source(self, pattern: str, write: Callable[[str], None], query: Query) -> None:
        """Add a command below the optional SOURce node, with and without the channel's number."""
        for node in {"[SOURce:]", f"SOURce{self.model.channel}:"}:
            self._scpi.command(node + pattern, _one(write), query)

    def _output(self, pattern: str, write: Callable[[str], None], query: Query) -> None:
        for node in {"OUTPut", f"OUTPut{self.model.channel}"}:
            self._scpi.command(node + pattern, _one(write), query)

    def _store(self, pattern: str, words: tuple[str, ...], default: str) -> None:
        """Add a setting that acts on nothing."""
        stored = self._stored
        stored[pattern] = default

        def write(text: str) -> None:
            word = parse_choice(text, words)
            stored[pattern] = {"OFF": "0", "ON": "1"}.get(word, word)

        self._scpi.command(pattern, _one(write), lambda _: stored[pattern])

    def _limit_v(self, high: bool) -> float:
        return self._state.settings.limits_v[high]

    def _level_names(self, half: float) -> dict[str, float]:
        peak_v = self._state.settings.emf_peak_v() * self._state.settings.scale
        return named_values(-peak_v, peak_v, self._state.level_v(half))

    def _apply(self, function: str, arguments: list[str]) -> None:
        """`APPLy` also switches modulation off and the output ON."""
        state = self._state
        if len(arguments) > 3:
            raise ScpiError(-108)
        state.set_modulating("0")
        state.set_function(function)
        setters = (state.set_frequency, state.set_amplitude, state.set_offset)
        for setter, text in zip(setters, arguments, strict=False):
            setter(text)
        state.set_output(True)

    def _ask_apply(self, _: list[str]) -> str:
        state, signal = self._state, self._state.signal
        numbers = (
            signal.frequency_hz,
            state.settings.shown_amplitude(signal.emf_vpp),
            signal.emf_offset_v * state.settings.scale,
        )
        return f'"{signal.function} {",".join(map(format_number, numbers))}"'


def _one(write: Callable[[str], None]) -> Callable[[list[str]], None]:
    return lambda arguments: write(only(arguments))


def _number(
    value: Callable[[], float], names: Names, shown: Callable[[float], float] = lambda value: value
) -> Query:
    """Make a query that answers the present value, or what MIN, MAX or DEF would be."""

    def query(arguments: list[str]) -> str:
        answer = parse_named(only(arguments), names()) if arguments else value()
        if answer is None:
            raise ScpiError(-224)
        return format_number(shown(answer))

    return query
