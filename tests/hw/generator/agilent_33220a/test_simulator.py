from __future__ import annotations

import pytest

from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.generator.contract import GeneratorLatency, TerminalOutput
from tests.hw.instruments import IMMEDIATE


class Bench:
    """A simulated generator and everything that ever was at its terminals."""

    def __init__(
        self, latency: GeneratorLatency = IMMEDIATE, *, am_full_scale: float = 1.0
    ) -> None:
        self.seen: list[TerminalOutput] = []
        self.generator = Simulated33220A(
            latency, listener=self.seen.append, am_full_scale=am_full_scale
        )

    def __call__(self, message: str) -> str:
        return self.generator.handle(message.encode() + b"\n").decode().strip()

    def error_code(self) -> int:
        return int(self("SYST:ERR?").partition(",")[0])


@pytest.fixture
def bench():
    return Bench()


@pytest.fixture
def open_bench(bench):
    bench("OUTP:LOAD INF")
    return bench


def test_after_reset(bench):
    bench("FUNC SQU;:FREQ 5;:OUTP 1;:OUTP:LOAD INF;:BURS:STAT 1;*RST")
    maker, model, serial_number, firmware = bench("*IDN?").split(",")
    assert (maker, model, firmware) == ("Agilent Technologies", "33220A", "2.02-2.02-22-2")
    assert serial_number.startswith("SIM")
    assert (
        bench("FUNC?;:FREQ?;:VOLT?;:VOLT:OFFS?;:OUTP:LOAD?;:OUTP?;:BURS:STAT?;:VOLT:UNIT?")
        == "SIN;+1.0000000000000E+03;+1.0000000000000E-01;+0.0000000000000E+00;"
        "+5.0000000000000E+01;0;0;VPP"
    )
    assert bench("SYST:ERR?") == '+0,"No error"'


def test_fifty_ohm_trap_the_open_terminal_has_twice_the_programmed_voltage(bench):
    bench("OUTP:LOAD 50;:VOLT 3;:OUTP 1")
    assert bench.generator.output().amplitude_v == pytest.approx(
        3.0
    )  # 3 Vpp programmed, 6 Vpp there
    bench("OUTP:LOAD INF;:VOLT 3")
    assert bench.generator.output().amplitude_v == pytest.approx(1.5)


def test_nothing_is_at_the_terminals_while_the_output_is_off(bench):
    bench("VOLT 5;:VOLT:OFFS 1")
    assert bench.generator.output()[:4] == (1e3, 0.0, 0.0, False)


def test_apply_turns_the_output_on(bench):
    assert bench("OUTP?") == "0"
    bench("APPL:SIN 5 KHZ, 3.0, -2.5")
    assert bench("OUTP?") == "1"
    assert bench("APPL?") == '"SIN +5.0000000000000E+03,+3.0000000000000E+00,-2.5000000000000E+00"'
    bench("*RST;:APPL:SQU")
    assert (
        bench("OUTP?;:APPL?")
        == '1;"SQU +1.0000000000000E+03,+1.0000000000000E-01,+0.0000000000000E+00"'
    )


@pytest.mark.parametrize(
    ("setup", "command", "code", "query", "value"),
    [
        ("OUTP:LOAD INF", "VOLT 21", -222, "VOLT?", 20.0),
        ("FREQ 1E6", "FUNC RAMP", -221, "FREQ?", 200e3),
        ("VOLT 2;:VOLT:OFFS 4", "VOLT 6", -221, "VOLT:OFFS?", 2.0),
        ("VOLT 2", "VOLT:OFFS 5", -222, "VOLT:OFFS?", 4.0),
        ("VOLT:HIGH 2;LOW 1", "VOLT:LOW 3", -221, "VOLT:HIGH?", 3.01),
        ("VOLT 2", "VOLT:UNIT VRMS", 0, "VOLT?", 0.70710678),
        ("VOLT 2;:FUNC SQU", "VOLT:UNIT VRMS", 0, "VOLT?", 1.0),
        ("VOLT:UNIT DBM;:VOLT 10", "VOLT:UNIT VPP", 0, "VOLT?", 2.0),
        ("OUTP:LOAD INF", "VOLT:UNIT DBM", -221, "VOLT?", 0.2),
        ("FUNC SQU;:FREQ 15E6", "FUNC:SQU:DCYC 70", -222, "FUNC:SQU:DCYC?", 60.0),
        ("FUNC SQU;:FUNC:SQU:DCYC 70", "FREQ 15E6", -221, "FUNC:SQU:DCYC?", 60.0),
    ],
)
def test_limits_and_couplings(bench, setup, command, code, query, value):
    bench(setup)
    assert bench.error_code() == 0
    bench(command)
    assert bench.error_code() == code
    assert float(bench(query)) == pytest.approx(value, rel=1e-7)


def test_dbm_falls_to_vpp_at_an_open_load(bench):
    bench("VOLT:UNIT DBM;:OUTP:LOAD INF")
    assert bench("VOLT:UNIT?") == "VPP"


def test_errors_keep_the_output_as_it_was(bench):
    bench("OUTP 1;:VOLT 2")
    before = bench.generator.output()
    for nonsense in ("VOLT TWO", "FREQ", "OUTP MAYBE", "FUNC SINE", "VOLT 1,2", "VOLT:OFFS NAN"):
        bench(nonsense)
        assert bench.error_code() < 0
    assert bench.generator.output() == before


def test_settings_reach_the_terminals_after_their_latency():
    bench = Bench(
        GeneratorLatency(amplitude_s=0.030, frequency_s=0.003, function_s=0.1, output_s=0.0)
    )
    bench("OUTP:LOAD INF;:OUTP 1")
    assert bench.generator.output()[:4] == (1e3, pytest.approx(0.1), 0.0, True)
    bench("VOLT 2")
    bench.generator.advance(0.029)
    assert bench.generator.output().amplitude_v == pytest.approx(0.1)
    bench.generator.advance(0.001)
    assert bench.generator.output().amplitude_v == pytest.approx(1.0)
    bench("FREQ 250")
    assert bench("FREQ?") == "+2.5000000000000E+02"
    bench.generator.advance(0.002)
    assert bench.generator.output().frequency_hz == 1000.0
    bench.generator.advance(0.001)
    assert bench.generator.output().frequency_hz == 250.0


def test_settings_arrive_in_order_but_off_does_not_wait():
    bench = Bench(
        GeneratorLatency(amplitude_s=0.030, frequency_s=0.003, function_s=0.1, output_s=0.0)
    )
    bench("VOLT 2;:FREQ 250;:OUTP 1")
    bench.generator.advance(0.010)
    assert bench.generator.output()[:4] == (1e3, 0.0, 0.0, False)  # on comes after the amplitude
    bench("OUTP 0;:OUTP 1")
    bench("OUTP 0")
    bench.generator.advance(1.0)
    assert not bench.generator.output().on
    assert not any(seen.on for seen in bench.seen)


def test_any_bytes_are_survived():
    bench = Bench()
    bench.generator.handle(bytes(range(256)) * 4 + b"\n")
    assert bench("*CLS;*OPC?") == "1"


@pytest.mark.parametrize(
    ("full_scale", "input_v", "peak_v"), [(1.0, 5.0, 2.0), (1.0, 0.0, 1.0), (1.0, -5.0, 0.0)]
)
@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_external_modulation(full_scale, input_v, peak_v, factor):
    bench = Bench(am_full_scale=factor)
    bench("OUTP:LOAD INF;:VOLT 4;:AM:SOUR EXT;:AM:DEPT 100;:AM:STAT ON;:OUTP ON")
    bench.generator.set_modulation_input(input_v)
    assert bench.generator.output().amplitude_v == pytest.approx(factor * peak_v)


def test_an_envelope_reaches_the_listener_at_once(open_bench):
    open_bench("VOLT 4;:AM:SOUR EXT;:AM:STAT 1;:OUTP 1")
    open_bench.seen.clear()
    for input_v in (5.0, 5.0, -5.0):
        open_bench.generator.set_modulation_input(input_v)
    assert [output.amplitude_v for output in open_bench.seen] == [
        pytest.approx(2.0),
        pytest.approx(0.0),
    ]


@pytest.mark.parametrize(("function", "kind"), [("DC", "AM"), ("DC", "BURS"), ("PULS", "AM")])
def test_modulation_that_a_function_cannot_have(open_bench, function, kind):
    open_bench(f"FUNC {function};:{kind}:STAT 1")
    assert open_bench.error_code() == -221
    assert open_bench(f"{kind}:STAT?") == "0"


def test_a_burst_that_nothing_triggers_keeps_only_the_offset_and_ends_modulation(open_bench):
    open_bench("VOLT 4;:VOLT:OFFS 1;:AM:STAT 1;:OUTP 1;:BURS:STAT 1")
    assert open_bench.error_code() == -221
    assert open_bench("AM:STAT?;:BURS:STAT?") == "0;1"
    assert open_bench.generator.output()[1:4] == (0.0, pytest.approx(1.0), True)
    open_bench("AM:STAT 1")
    assert open_bench.error_code() == -221
    assert open_bench("AM:STAT?;:BURS:STAT?") == "1;0"


def test_a_fixed_range_keeps_its_relay_and_its_highest_voltage(open_bench):
    open_bench("VOLT 6;:VOLT:RANG:AUTO OFF")
    switches = open_bench.generator.range_switches
    open_bench("VOLT 0.02;:VOLT 1;:VOLT 6")
    assert open_bench.generator.range_switches == switches
    assert float(open_bench("VOLT? MAX")) == pytest.approx(10.04)
    open_bench("VOLT 12")
    assert open_bench.error_code() == -222
    open_bench("VOLT:RANG:AUTO ON;:VOLT 0.5")
    assert open_bench.generator.range_switches == switches + 1
    open_bench("VOLT:RANG:AUTO ONCE;:VOLT 2")
    assert open_bench("VOLT:RANG:AUTO?") == "0"
    assert float(open_bench("VOLT?")) == pytest.approx(0.634)


def test_an_overload_switches_off_and_says_so(open_bench):
    open_bench("*CLS;:VOLT 4;:OUTP 1")
    open_bench.generator.overload()
    assert open_bench.generator.output().amplitude_v == 0.0
    assert open_bench("OUTP?;*ESR?") == "0;8"
    assert open_bench.error_code() > 0
