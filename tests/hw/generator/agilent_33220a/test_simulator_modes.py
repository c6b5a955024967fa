"""Modulation, bursts and ranges of the simulated generator."""

from __future__ import annotations

import pytest

from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.generator.contract import TerminalOutput
from tests.hw.instruments import IMMEDIATE


class Bench:
    def __init__(self, am_full_scale: float = 1.0) -> None:
        self.seen: list[TerminalOutput] = []
        self.generator = Simulated33220A(
            IMMEDIATE, listener=self.seen.append, am_full_scale=am_full_scale
        )
        self("OUTP:LOAD INF")

    def __call__(self, message: str | bytes) -> str:
        data = message.encode() if isinstance(message, str) else message
        return self.generator.handle(data + b"\n").decode().strip()

    def error_code(self) -> int:
        return int(self("SYST:ERR?").partition(",")[0])

    def peak_v(self) -> float:
        output = self.generator.output()
        return output.amplitude_v + abs(output.offset_v)


@pytest.fixture
def bench():
    return Bench()


@pytest.mark.parametrize(
    ("full_scale", "input_v", "peak_v"), [(1.0, 5.0, 2.0), (1.0, 0.0, 1.0), (1.0, -5.0, 0.0)]
)
@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_external_modulation(full_scale, input_v, peak_v, factor):
    bench = Bench(am_full_scale=factor)
    bench("VOLT 4;:AM:SOUR EXT;:AM:DEPT 100;:AM:STAT ON;:OUTP ON")
    bench.generator.set_modulation_input(input_v)
    assert bench.peak_v() == pytest.approx(factor * peak_v)


def test_an_envelope_reaches_the_listener_at_once(bench):
    bench("VOLT 4;:AM:SOUR EXT;:AM:STAT 1;:OUTP 1")
    bench.seen.clear()
    for input_v in (5.0, 5.0, -5.0):
        bench.generator.set_modulation_input(input_v)
    assert [output.amplitude_v for output in bench.seen] == [pytest.approx(2.0), pytest.approx(0.0)]


@pytest.mark.parametrize(("function", "kind"), [("DC", "AM"), ("DC", "BURS"), ("PULS", "AM")])
def test_modulation_that_a_function_cannot_have(bench, function, kind):
    bench(f"FUNC {function};:{kind}:STAT 1")
    assert bench.error_code() == -221
    assert bench(f"{kind}:STAT?") == "0"


def test_a_burst_that_nothing_triggers_keeps_only_the_offset_and_ends_modulation(bench):
    bench("VOLT 4;:VOLT:OFFS 1;:AM:STAT 1;:OUTP 1;:BURS:STAT 1")
    assert bench.error_code() == -221
    assert bench("AM:STAT?;:BURS:STAT?") == "0;1"
    assert bench.generator.output()[1:4] == (0.0, pytest.approx(1.0), True)
    bench("AM:STAT 1")
    assert bench.error_code() == -221
    assert bench("AM:STAT?;:BURS:STAT?") == "1;0"


def test_a_fixed_range_keeps_its_relay_and_its_highest_voltage(bench):
    bench("VOLT 6;:VOLT:RANG:AUTO OFF")
    switches = bench.generator.range_switches
    bench("VOLT 0.02;:VOLT 1;:VOLT 6")
    assert bench.generator.range_switches == switches
    assert float(bench("VOLT? MAX")) == pytest.approx(10.04)
    bench("VOLT 12")
    assert bench.error_code() == -222
    bench("VOLT:RANG:AUTO ON;:VOLT 0.5")
    assert bench.generator.range_switches == switches + 1
    bench("VOLT:RANG:AUTO ONCE;:VOLT 2")
    assert bench("VOLT:RANG:AUTO?") == "0"
    assert float(bench("VOLT?")) == pytest.approx(0.634)


def test_an_overload_switches_off_and_says_so(bench):
    bench("*CLS;:VOLT 4;:OUTP 1")
    bench.generator.overload()
    assert bench.peak_v() == 0.0
    assert bench("OUTP?;*ESR?") == "0;8"
    assert bench.error_code() > 0


@pytest.mark.parametrize(
    ("header", "low", "high", "default"),
    [("FREQ", 1e-6, 20e6, 1e3), ("VOLT", 0.02, 20.0, 0.2), ("OUTP:LOAD", 1.0, 10e3, 50.0)],
)
def test_minimum_maximum_and_default_are_answered_and_set(bench, header, low, high, default):
    for name, value in (("MIN", low), ("MAXimum", high), ("def", default)):
        assert float(bench(f"{header}? {name}")) == pytest.approx(value)
    for name, value in (("MAX", high), ("MIN", low), ("DEF", default)):
        bench(f"OUTP:LOAD INF;:VOLT DEF;:{header} {name}")
        assert float(bench(f"{header}?")) == pytest.approx(value)
    assert bench.error_code() == 0
