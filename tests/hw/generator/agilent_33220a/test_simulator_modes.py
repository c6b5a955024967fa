"""Modulation, bursts, ranges, arbitrary waveforms and saved states of the simulated generator."""

from __future__ import annotations

import math
import struct

import pytest

from hw.generator.agilent_33220a.simulator import Simulated33220A, TerminalOutput
from tests.hw.instruments import IMMEDIATE


class Bench:
    def __init__(self, am_full_scale: float = 1.0) -> None:
        self.seen: list[TerminalOutput] = []
        self.generator = Simulated33220A(IMMEDIATE, listener=self.seen.append, am_full_scale=am_full_scale)
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
def bench() -> Bench:
    return Bench()


@pytest.mark.parametrize(("full_scale", "input_v", "peak_v"), [(1.0, 5.0, 2.0), (1.0, 0.0, 1.0), (1.0, -5.0, 0.0)])
@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_external_modulation(full_scale: float, input_v: float, peak_v: float, factor: float) -> None:
    bench = Bench(am_full_scale=factor)
    bench("VOLT 4;:AM:SOUR EXT;:AM:DEPT 100;:AM:STAT ON;:OUTP ON")
    bench.generator.set_modulation_input(input_v)
    assert bench.peak_v() == pytest.approx(factor * peak_v)


def test_an_envelope_reaches_the_listener_at_once(bench: Bench) -> None:
    bench("VOLT 4;:AM:SOUR EXT;:AM:STAT 1;:OUTP 1")
    bench.seen.clear()
    for input_v in (5.0, 5.0, -5.0):
        bench.generator.set_modulation_input(input_v)
    assert [output.amplitude_v for output in bench.seen] == [pytest.approx(2.0), pytest.approx(0.0)]


def test_one_kind_of_modulation_at_a_time(bench: Bench) -> None:
    for kind in ("AM", "FM", "PM", "FSK", "SWE", "BURS"):
        bench(f"{kind}:STAT 1")
    codes = [bench.error_code() for _ in range(6)]
    assert codes == [-221] * 5 + [0]
    assert bench("AM:STAT?;:FM:STAT?;:PM:STAT?;:FSK:STAT?;:SWE:STAT?;:BURS:STAT?") == "0;0;0;0;0;1"
    bench("FUNC PULS;:PWM:STAT 1")
    assert bench("BURS:STAT?;:PWM:STAT?") == "0;1"


@pytest.mark.parametrize(("function", "kind"), [("DC", "AM"), ("DC", "BURS"), ("SIN", "PWM"), ("PULS", "AM")])
def test_modulation_that_a_function_cannot_have(bench: Bench, function: str, kind: str) -> None:
    bench(f"FUNC {function};:{kind}:STAT 1")
    assert bench.error_code() == -221
    assert bench(f"{kind}:STAT?") == "0"


def test_a_function_without_modulation_ends_it(bench: Bench) -> None:
    bench("AM:STAT 1;:FUNC DC")
    assert bench.error_code() == -221
    assert bench("AM:STAT?") == "0"


def test_a_burst_lasts_its_cycles(bench: Bench) -> None:
    bench("FREQ 100;:VOLT 4;:BURS:NCYC 5;:TRIG:SOUR BUS;:BURS:STAT 1;:OUTP 1")
    assert bench.peak_v() == 0.0
    bench("*TRG")
    bench.generator.advance(0.0499)
    assert bench.peak_v() == pytest.approx(2.0)
    bench.generator.advance(0.0002)
    assert bench.peak_v() == 0.0
    assert bench("OUTP?") == "1"


def test_an_external_trigger_needs_its_source(bench: Bench) -> None:
    bench("VOLT 4;:BURS:NCYC INF;:TRIG:SOUR BUS;:BURS:STAT 1;:OUTP 1")
    bench.generator.external_trigger()
    assert bench.peak_v() == 0.0
    bench("TRIG:SOUR EXT;*TRG")
    assert bench.error_code() == -211
    bench.generator.external_trigger()
    bench.generator.advance(1e6)
    assert bench.peak_v() == pytest.approx(2.0)
    bench("BURS:STAT 0")
    assert bench.peak_v() == pytest.approx(2.0)


def test_a_closed_gate_keeps_only_the_offset(bench: Bench) -> None:
    bench("VOLT 4;:VOLT:OFFS 1;:BURS:MODE GAT;:BURS:STAT 1;:OUTP 1")
    assert bench.generator.output()[1:] == (0.0, pytest.approx(1.0), True)
    bench("BURS:GATE:POL INV")
    assert bench.peak_v() == pytest.approx(3.0)


def test_apply_ends_modulation_and_turns_on(bench: Bench) -> None:
    bench("AM:STAT 1;:APPL:SIN 1E3,4,0")
    assert bench("AM:STAT?;:OUTP?") == "0;1"


def test_a_fixed_range_keeps_its_relay_and_its_highest_voltage(bench: Bench) -> None:
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


def block(values: list[int], order: str = ">") -> bytes:
    data = struct.pack(f"{order}{len(values)}h", *values)
    length = str(len(data)).encode()
    return b"DATA:DAC VOLATILE, #%d%s%s" % (len(length), length, data)


CODES = [-8191, 10, 0, 8191, -300]  # 10 is 0x000A: its second byte is a line end


def attributes(bench: Bench) -> list[float]:
    answers = bench("DATA:ATTR:POIN? VOLATILE;PTP? VOLATILE;AVER? VOLATILE;CFAC? VOLATILE")
    return [float(answer) for answer in answers.split(";")]


def test_blocks_text_and_shares_make_the_same_waveform() -> None:
    messages = [
        block(CODES),
        b"FORM:BORD SWAP;:" + block(CODES, "<"),
        b"DATA:DAC VOLATILE," + ",".join(map(str, CODES)).encode(),
        b"DATA VOLATILE," + ",".join(repr(code / 8191) for code in CODES).encode(),
    ]
    answers = []
    for message in messages:
        bench = Bench()
        bench(message)
        assert bench.error_code() == 0
        answers.append(attributes(bench))
    rms = math.sqrt(sum(code**2 for code in CODES) / 5.0)
    assert answers == [pytest.approx([5.0, 1.0, sum(CODES) / 5.0 / 8191, 8191 / rms], abs=1e-12)] * 4


def test_the_byte_order_trap(bench: Bench) -> None:
    """Native bytes under FORM:BORD NORM: most swapped codes are out of range, some are silently another waveform."""
    bench(block(CODES, "<"))
    assert bench.error_code() == -222
    bench(block([0, 1, 2, 3], "<"))
    assert bench.error_code() == 0
    assert attributes(bench)[1] == pytest.approx(0.5 * 3 * 256 / 8191)


@pytest.mark.parametrize(
    ("message", "code"),
    [
        (b"DATA:DAC VOLATILE, #13abc", -161),
        (b"DATA:DAC VOLATILE,1,x", -104),
        (b"DATA:DAC VOLATILE,1,9000", -222),
        (b"DATA VOLATILE,0,1.1", -222),
        (b"DATA:DAC VOLATILE", -109),
        (b"DATA:DAC OTHER,1,2", -224),
        (b"DATA:DAC VOLATILE," + b",".join([b"0"] * 65_537), -222),
        (b"FUNC:USER NOTHING", 780),
        (b"DATA:ATTR:POIN? NOTHING", 780),
        (b"DATA:DEL SINC", 781),
        (b"DATA:COPY SINC,VOLATILE", 782),
        (b"DATA:COPY MINE,VOLATILE", 780),
    ],
)
def test_errors_of_arbitrary_waveforms(bench: Bench, message: bytes, code: int) -> None:
    bench(message)
    assert bench.error_code() == code


def test_waveforms_are_copied_listed_selected_and_deleted(bench: Bench) -> None:
    bench("DATA VOLATILE,-1,1")
    for name in ("A1", "A2", "A3", "A4"):
        assert float(bench("DATA:NVOL:FREE?")) > 0
        bench(f"DATA:COPY {name}, VOLATILE")
    bench("DATA:COPY A5, VOLATILE")
    assert bench.error_code() == 785
    assert bench("DATA:NVOL:CAT?") == '"A1","A2","A3","A4"'
    bench("FUNC:USER A1;:FUNC USER;:DATA:DEL A1")
    assert bench.error_code() == 781
    bench("DATA:DEL:ALL")
    assert bench("DATA:CAT?") == '"A1","EXP_RISE","EXP_FALL","NEG_RAMP","SINC","CARDIAC"'


def test_a_waveform_that_does_not_span_the_dac_has_a_lower_highest_amplitude(bench: Bench) -> None:
    """The User's Guide gives 6.087 Vpp into 50 ohm for SINC."""
    bench("OUTP:LOAD 50;:VOLT 10;:FUNC:USER SINC;:FUNC USER")
    assert bench.error_code() == -221
    assert float(bench("VOLT?;")) == pytest.approx(6.087, rel=1e-3)
    bench("OUTP 1")
    assert bench.peak_v() == pytest.approx(10.0)


def test_a_one_sided_waveform_counts_by_its_own_ends(bench: Bench) -> None:
    bench("DATA VOLATILE,0,1;:FUNC:USER VOLATILE;:FUNC USER;:VOLT 3;:OUTP 1")
    assert bench.generator.output()[1:] == (pytest.approx(1.5), pytest.approx(1.5), True)
    bench("DATA VOLATILE,-1,1")  # uploaded while it plays
    assert bench.generator.output()[1:] == (pytest.approx(1.5), pytest.approx(0.0), True)


def test_a_recalled_state_comes_back_with_its_output_on(bench: Bench) -> None:
    bench("VOLT 4;:OUTP 1;*SAV 2;*RST")
    assert bench.peak_v() == 0.0
    bench("*RCL 2")
    assert bench.peak_v() == pytest.approx(2.0)
    bench("*RCL 3")
    assert bench.error_code() == 810
    bench("*SAV 5")
    assert bench.error_code() == -222


def test_what_is_learned_makes_another_instrument_the_same(bench: Bench) -> None:
    bench("FUNC SQU;:FREQ 250;:VOLT 4;:VOLT:OFFS -1;:FUNC:SQU:DCYC 30;:BURS:NCYC 7;:TRIG:SOUR BUS;:BURS:STAT 1")
    bench("OUTP 1")
    learned = bench("*LRN?")
    other = Bench()
    other(learned)
    assert other.error_code() == 0
    assert other("*LRN?") == learned
    assert other.generator.output() == bench.generator.output()


def test_an_overload_switches_off_and_says_so(bench: Bench) -> None:
    bench("*CLS;:VOLT 4;:OUTP 1")
    bench.generator.overload()
    assert bench.peak_v() == 0.0
    assert bench("OUTP?;*ESR?") == "0;8"
    assert bench.error_code() > 0


@pytest.mark.parametrize(
    ("header", "low", "high", "default"),
    [
        ("FREQ", 1e-6, 20e6, 1e3),
        ("VOLT", 0.02, 20.0, 0.2),
        ("VOLT:OFFS", -9.9, 9.9, 0.0),
        ("OUTP:LOAD", 1.0, 10e3, 50.0),
        ("FUNC:SQU:DCYC", 20.0, 80.0, 50.0),
        ("FUNC:RAMP:SYMM", 0.0, 100.0, 100.0),
        ("PULS:PER", 200e-9, 2000.0, 1e-3),
        ("BURS:NCYC", 1.0, 50e3, 1.0),
        ("BURS:PHAS", -360.0, 360.0, 0.0),
        ("AM:DEPT", 0.0, 120.0, 100.0),
        ("AM:INT:FREQ", 2e-3, 20e3, 100.0),
        ("FSK:INT:RATE", 2e-3, 100e3, 10.0),
    ],
)
def test_minimum_maximum_and_default_are_answered_and_set(
    bench: Bench, header: str, low: float, high: float, default: float
) -> None:
    for name, value in (("MIN", low), ("MAXimum", high), ("def", default)):
        assert float(bench(f"{header}? {name}")) == pytest.approx(value)
    for name, value in (("MAX", high), ("MIN", low), ("DEF", default)):
        bench(f"OUTP:LOAD INF;:VOLT DEF;:{header} {name}")
        assert float(bench(f"{header}?")) == pytest.approx(value)
    assert bench.error_code() == 0
