"""The 33220A driver by exact bytes on the wire."""

from __future__ import annotations

import math

import pytest

from hw.errors import BadReply, InstrumentRejected, LimitExceeded
from hw.transport.memory import MemoryTransport
from hw.waveform_generator import Agilent33220A, GeneratorSettings

# 100 V at the electrode per volt at the generator: 1 Vpp is 50 V peak.
SETTINGS = GeneratorSettings(
    volts_per_volt=100.0, voltage_limit_v=300.0, frequency_low_hz=10.0, frequency_high_hz=10e3, reply_timeout_s=1.0
)
IDENTIFY = (b"*IDN?\n", b"Agilent Technologies,33220A,MY1,2.02-2.02-22-2\n")
SWITCH_OFF = (b"OUTP 0;*RST;*CLS;:OUTP?\n", b"0\n")
LEVEL_QUERIES = b"VOLT?;:VOLT:OFFS?;:VOLT:UNIT?;:OUTP:LOAD?;:SYST:ERR?\n"
SET_UP_LINE = b"VOLT MIN;:OUTP:LOAD INF;:VOLT:UNIT VPP;:FUNC SIN;:VOLT MIN;:VOLT:OFFS 0;:FUNC?;:" + LEVEL_QUERIES
SET_UP = (
    SET_UP_LINE,
    b'SIN;+2.0000000000000E-02;+0.0000000000000E+00;VPP;+9.9000000000000E+37;+0,"No error"\n',
)


def levels(commands: bytes, amplitude: bytes, error: bytes = b'+0,"No error"') -> tuple[bytes, bytes]:
    """Commands with all levels asked in the same line, and an answer of this amplitude with all else in order."""
    asked = commands + b";:" + LEVEL_QUERIES if commands else LEVEL_QUERIES
    return asked, amplitude + b";+0.0E+00;VPP;+9.9E+37;" + error + b"\n"


OFF = (b"VOLT MIN;:OUTP 0;:OUTP?\n", b"0\n")
NO_ERROR = (b"SYST:ERR?\n", b'+0,"No error"\n')


class Script:
    """An instrument that expects exactly these messages."""

    def __init__(self, *pairs: tuple[bytes, bytes]) -> None:
        self.pairs = list(pairs)

    def handle(self, data: bytes) -> bytes:
        assert self.pairs, f"unexpected {data!r}"
        expected, answer = self.pairs.pop(0)
        assert data == expected
        return answer


def connected(*pairs: tuple[bytes, bytes]) -> tuple[Agilent33220A, Script]:
    script = Script(IDENTIFY, SWITCH_OFF, SET_UP, *pairs)
    driver = Agilent33220A(MemoryTransport(script, resource="GEN"), SETTINGS)
    driver.connect()
    return driver, script


def test_connect_switches_off_and_sets_up_and_reads_all_of_it_back() -> None:
    _, script = connected()
    assert not script.pairs


def test_a_set_point_is_one_round_trip_and_sends_only_what_changed() -> None:
    driver, script = connected(
        levels(b"FREQ 250;:VOLT 1.2", b"+1.2000000000000E+00"),
        levels(b"FREQ 300", b"+1.2000000000000E+00"),
        levels(b"VOLT 2", b"2.0E0"),
    )
    driver.set_point(250.0, 60.0)
    driver.set_point(300.0, 60.0)
    driver.set_point(300.0, 100.0)
    driver.set_point(300.0, 100.0)
    assert not script.pairs


def test_a_rising_voltage_goes_last_and_a_falling_one_first() -> None:
    driver, script = connected(
        levels(b"FREQ 250;:VOLT 4", b"+4.0E+00"),
        levels(b"VOLT 1;:FREQ 5000", b"+1.0E+00"),
        levels(b"FREQ 250;:VOLT 4", b"+4.0E+00"),
    )
    driver.set_point(250.0, 200.0)
    driver.set_point(5000.0, 50.0)
    driver.set_point(250.0, 200.0)
    assert not script.pairs


def test_output_is_switched_and_read_back() -> None:
    driver, script = connected(
        levels(b"", b"+2.0E-02"),
        (b"OUTP 1;:OUTP?;:SYST:ERR?\n", b'1;+0,"No error"\n'),
        (b"OUTP?\n", b"1\n"),
        (b"OUTP 0;:OUTP?;:SYST:ERR?\n", b'0;+0,"No error"\n'),
        (b"OUTP?\n", b"0\n"),
    )
    driver.set_output(True)
    assert driver.read_output() is True
    driver.set_output(False)
    assert driver.read_output() is False
    assert not script.pairs


def test_an_output_that_does_not_follow_is_an_error() -> None:
    driver, _ = connected(levels(b"", b"+2.0E-02"), (b"OUTP 1;:OUTP?;:SYST:ERR?\n", b'0;+0,"No error"\n'))
    with pytest.raises(BadReply, match="GEN has its output off"):
        driver.set_output(True)


def test_off_is_amplitude_down_then_output_off_then_evidence() -> None:
    driver, script = connected(OFF)
    assert driver.off() is True
    assert not script.pairs


def test_off_tries_twice_and_says_so_when_the_output_stays_on() -> None:
    driver, script = connected((OFF[0], b"1\n"), (b"OUTP 0;:OUTP?\n", b"1\n"))
    assert driver.off() is False
    assert not script.pairs


def test_close_switches_off_first() -> None:
    driver, script = connected(OFF)
    assert driver.close() is True
    assert not script.pairs


@pytest.mark.parametrize(
    ("frequency_hz", "voltage_v"),
    [
        (250.0, 300.001),
        (250.0, math.nan),
        (250.0, math.inf),
        (250.0, -10.0),
        (250.0, 0.0),
        (250.0, 0.999),  # below 10 mV peak at the generator
        (math.nan, 60.0),
        (math.inf, 60.0),
        (9.99, 60.0),
        (10001.0, 60.0),
        (-250.0, 60.0),
    ],
)
def test_limits_are_refused_before_any_byte_is_written(frequency_hz: float, voltage_v: float) -> None:
    driver, _ = connected()
    with pytest.raises(LimitExceeded, match=r"GEN: .* nothing was sent"):
        driver.set_point(frequency_hz, voltage_v)


def test_the_generator_has_a_limit_too() -> None:
    small_gain = GeneratorSettings(2.0, 300.0, 10.0, 10e3)
    driver = Agilent33220A(MemoryTransport(Script()), small_gain)
    with pytest.raises(LimitExceeded):
        driver.set_point(250.0, 21.0)  # more than 10 V peak from the generator


def test_the_minimum_voltage_can_be_set() -> None:
    driver, script = connected(levels(b"FREQ 250", b"+2.0E-02"))
    assert driver.minimum_voltage_v == pytest.approx(1.0)
    driver.set_point(250.0, driver.minimum_voltage_v)
    assert not script.pairs


def test_an_instrument_error_is_raised_the_queue_emptied_and_everything_sent_again() -> None:
    driver, script = connected(
        levels(b"FREQ 250;:VOLT 1.2", b"+1.2E+00", b'-222,"Data out of range; value clipped to upper limit"'),
        (b"SYST:ERR?\n", b'-221,"Settings conflict"\n'),
        NO_ERROR,
        SET_UP,
        levels(b"FREQ 250;:VOLT 1.2", b"+1.2E+00"),
    )
    with pytest.raises(InstrumentRejected, match=r"GEN .*-222.*-221"):
        driver.set_point(250.0, 60.0)
    driver.set_point(250.0, 60.0)
    assert not script.pairs


@pytest.mark.parametrize(
    ("shown", "accepted"),
    [
        (b"+1.2000000000000E+00", True),
        (b"1.2", True),
        (b"+1.20100E0", True),  # within 0.1 %
        (b"+1.2020E+00", False),
        (b"+6.0000000000000E-01", False),  # someone set LOAD 50
        (b"NAN", False),
        (b"", False),
        (b"1.2 V", False),
        (b"1_2", False),
    ],
)
def test_the_amplitude_read_back_must_agree(shown: bytes, accepted: bool) -> None:
    driver, script = connected(levels(b"FREQ 250;:VOLT 1.2", shown))
    if accepted:
        driver.set_point(250.0, 60.0)
    else:
        script.pairs.append(OFF)
        with pytest.raises(BadReply, match="GEN"):
            driver.set_point(250.0, 60.0)


def test_a_small_amplitude_may_be_off_by_its_last_digit() -> None:
    driver, _ = connected(levels(b"FREQ 250;:VOLT 0.03", b"+3.01E-02"))
    driver.set_point(250.0, 1.5)


@pytest.mark.parametrize("identity", [b"Agilent Technologies,33250A,MY1,1.0\n", b"133220A\n", b"?\n", b";\n", b"\n"])
def test_another_instrument_is_refused_and_left_alone(identity: bytes) -> None:
    script = Script((b"*IDN?\n", identity))
    with pytest.raises(BadReply, match="MEMORY::0"):
        Agilent33220A(MemoryTransport(script), SETTINGS).connect()


@pytest.mark.parametrize(
    ("answer", "switched_off"),
    [
        (b'SIN;+2.0E-02;+0.0E+00;VPP;+5.0000000000000E+01;+0,"No error"\n', 2),
        (b'SIN;+2.0E-02;+0.0E+00;VRMS;+9.9E+37;+0,"No error"\n', 2),
        (b'SIN;+2.0E-02;+1.0E+00;VPP;+9.9E+37;+0,"No error"\n', 2),
        (b'SIN;+1.0E-01;+0.0E+00;VPP;+9.9E+37;+0,"No error"\n', 2),
        (b'SQU;+2.0E-02;+0.0E+00;VPP;+9.9E+37;+0,"No error"\n', 1),
        (b'SIN;+2.0E-02;+0.0E+00;VPP;+0,"No error"\n', 1),
    ],
)
def test_a_set_up_that_did_not_take_is_refused_and_switched_off(answer: bytes, switched_off: int) -> None:
    script = Script(IDENTIFY, SWITCH_OFF, (SET_UP_LINE, answer), *[OFF] * switched_off)
    with pytest.raises(BadReply):
        Agilent33220A(MemoryTransport(script), SETTINGS).connect()
    assert not script.pairs


def test_switching_on_before_anything_is_known_sets_up_the_minimum_first() -> None:
    driver, script = connected(
        (b"OUTP?\n", b"maybe\n"), SET_UP, levels(b"", b"0.02"), (b"OUTP 1;:OUTP?;:SYST:ERR?\n", b'1;+0,"No error"\n')
    )
    assert driver.read_output() is None
    driver.set_output(True)
    assert not script.pairs


@pytest.mark.parametrize(
    "change",
    [
        {"volts_per_volt": 0.0},
        {"voltage_limit_v": -1.0},
        {"voltage_limit_v": math.nan},
        {"reply_timeout_s": math.inf},
        {"frequency_low_hz": 20e3},
        {"frequency_high_hz": 30e6},
    ],
)
def test_senseless_settings_are_refused(change: dict[str, float]) -> None:
    values = {"volts_per_volt": 100.0, "voltage_limit_v": 300.0, "frequency_low_hz": 10.0, "frequency_high_hz": 1e4}
    with pytest.raises(ValueError, match="generator"):
        GeneratorSettings(**(values | change))
