"""The 33220A driver by exact bytes on the wire."""

from __future__ import annotations

from dataclasses import replace

import pytest

from hw.errors import BadReply, InstrumentRejected, LimitExceeded
from hw.generator.agilent_33220a.driver import Agilent33220A
from hw.generator.settings import (
    ExternalModulation,
    GeneratorSettings,
    ModulationInput,
    RangePolicy,
    Shape,
)
from hw.serving.memory import MemoryTransport
from tests.hw.generator.asking import read_output

# 100 V at the electrode per volt at the generator: 1 Vpp is 50 V peak.
SETTINGS = GeneratorSettings(
    volts_per_volt=100.0,
    voltage_limit_v=300.0,
    frequency_low_hz=10.0,
    frequency_high_hz=10e3,
    reply_timeout_s=1.0,
)
IDENTIFY = (b"*IDN?\n", b"Agilent Technologies,33220A,MY1,2.02-2.02-22-2\n")
SWITCH_OFF = (b"OUTP 0;*RST;*CLS;:OUTP?\n", b"0\n")
STATE_QUERIES = (
    b"FUNC?;:FREQ?;:VOLT?;:VOLT:OFFS?;:VOLT:UNIT?;:OUTP:LOAD?;:AM:STAT?;:OUTP:POL?;:BURS:STAT?;"
    b":SYST:ERR?\n"
)
SET_UP_LINE = (
    b"VOLT MIN;:VOLT:OFFS 0;:AM:STAT 0;:BURS:STAT 0;:OUTP:LOAD INF;:VOLT:UNIT VPP;:FUNC SIN;:VOLT"
    b" MIN;:VOLT:OFFS 0;:FREQ 10;:OUTP:POL NORM;:OUTP:SYNC 1;:VOLT:RANG:AUTO?;:OUTP?;:OUTP:SYNC?;:"
    + STATE_QUERIES
)
MINIMUM = b'SIN;+1.0E+01;+2.0E-02;+0.0E+00;VPP;+9.9E+37;0;NORM;0;+0,"No error"\n'
SET_UP = (SET_UP_LINE, b"1;0;1;" + MINIMUM)
FIX_RANGE = (
    b"OUTP 0;:VOLT 6;:VOLT:RANG:AUTO OFF;:VOLT MIN;:VOLT:RANG:AUTO?;:OUTP?;:" + STATE_QUERIES,
    b"0;0;" + MINIMUM,
)
SET_UP_AGAIN = (SET_UP_LINE, b"0;0;1;" + MINIMUM)
BASE = (
    b"OUTP 0;:VOLT MIN;:VOLT:OFFS 0;:AM:STAT 0;:BURS:STAT 0;:FUNC SIN;:VOLT MIN;:VOLT:OFFS 0;:FREQ"
    b" 10;:OUTP?;:" + STATE_QUERIES,
    b"0;" + MINIMUM,
)


def levels(
    commands: bytes,
    frequency: bytes,
    amplitude: bytes,
    error: bytes = b'+0,"No error"',
    *,
    offset: bytes = b"0",
    function: bytes = b"SIN",
    modulated: bytes = b"0",
) -> tuple[bytes, bytes]:
    """Commands with all state asked in the same line, and an answer of these values with all else
    in order.
    """
    asked = commands + b";:" + STATE_QUERIES if commands else STATE_QUERIES
    values = (
        function,
        frequency,
        amplitude,
        offset,
        b"VPP",
        b"+9.9E+37",
        modulated,
        b"NORM",
        b"0",
        error,
    )
    return asked, b";".join(values) + b"\n"


OFF = (b"VOLT MIN;:VOLT:OFFS 0;:OUTP 0;:OUTP?\n", b"0\n")
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


def connected(
    *pairs: tuple[bytes, bytes], settings: GeneratorSettings = SETTINGS
) -> tuple[Agilent33220A, Script]:
    script = Script(IDENTIFY, SWITCH_OFF, SET_UP, FIX_RANGE, *pairs)
    driver = Agilent33220A(MemoryTransport(script, resource="GEN"), settings)
    driver.connect()
    return driver, script


def test_connect_switches_off_and_sets_up_and_reads_all_of_it_back():
    _, script = connected()
    assert not script.pairs


def test_a_set_point_is_one_round_trip_and_sends_only_what_changed():
    driver, script = connected(
        levels(b"FREQ 250;:VOLT 1.2", b"+2.5E+02", b"+1.2000000000000E+00"),
        levels(b"FREQ 300", b"+3.0E+02", b"+1.2000000000000E+00"),
        levels(b"VOLT 2", b"300", b"2.0E0"),
    )
    driver.set_point(250.0, 60.0)
    driver.set_point(300.0, 60.0)
    driver.set_point(300.0, 100.0)
    driver.set_point(300.0, 100.0)
    assert not script.pairs


def test_output_is_switched_and_read_back():
    driver, script = connected(
        levels(b"", b"10", b"+2.0E-02"),
        (b"OUTP 1;:OUTP?;:SYST:ERR?\n", b'1;+0,"No error"\n'),
        (b"OUTP?\n", b"1\n"),
        (b"OUTP 0;:OUTP?;:SYST:ERR?\n", b'0;+0,"No error"\n'),
        (b"OUTP?\n", b"0\n"),
    )
    driver.set_output(True)
    assert read_output(driver) is True
    driver.set_output(False)
    assert read_output(driver) is False
    assert not script.pairs


def test_an_output_that_does_not_follow_is_an_error():
    driver, _ = connected(
        levels(b"", b"10", b"+2.0E-02"), (b"OUTP 1;:OUTP?;:SYST:ERR?\n", b'0;+0,"No error"\n')
    )
    with pytest.raises(BadReply, match="GEN has its output off"):
        driver.set_output(True)


def test_off_is_amplitude_down_then_output_off_then_evidence():
    driver, script = connected(OFF)
    assert driver.off() is True
    assert not script.pairs


def test_off_tries_twice_and_says_so_when_the_output_stays_on():
    driver, script = connected((OFF[0], b"1\n"), (b"OUTP 0;:OUTP?\n", b"1\n"))
    assert driver.off() is False
    assert not script.pairs


def test_the_generator_has_a_limit_too():
    small_gain = GeneratorSettings(2.0, 300.0, 10.0, 10e3)
    driver = Agilent33220A(MemoryTransport(Script()), small_gain)
    with pytest.raises(LimitExceeded):
        driver.set_point(250.0, 21.0)  # more than 10 V peak from the generator


def test_an_instrument_error_is_raised_the_output_off_and_everything_sent_again():
    driver, script = connected(
        levels(
            b"FREQ 250;:VOLT 1.2",
            b"250",
            b"+1.2E+00",
            b'-222,"Data out of range; value clipped to upper limit"',
        ),
        (b"SYST:ERR?\n", b'-221,"Settings conflict"\n'),
        NO_ERROR,
        OFF,
        SET_UP_AGAIN,
        levels(b"FREQ 250;:VOLT 1.2", b"250", b"+1.2E+00"),
    )
    with pytest.raises(InstrumentRejected, match=r"GEN .*-222.*-221"):
        driver.set_point(250.0, 60.0)
    driver.set_point(250.0, 60.0)
    assert not script.pairs


@pytest.mark.parametrize(
    ("shown", "accepted"),
    [
        (b"+1.2000000000000E+00", True),
        (b"+1.20100E0", True),  # within 0.1 %
        (b"+1.2020E+00", False),
        (b"+6.0000000000000E-01", False),  # someone set LOAD 50
        (b"NAN", False),
        (b"", False),
    ],
)
def test_the_amplitude_read_back_must_agree(shown, accepted):
    driver, script = connected(levels(b"FREQ 250;:VOLT 1.2", b"250", shown))
    if accepted:
        driver.set_point(250.0, 60.0)
    else:
        script.pairs.append(OFF)
        with pytest.raises(BadReply, match="GEN"):
            driver.set_point(250.0, 60.0)


def test_a_small_amplitude_may_be_off_by_its_last_digit():
    driver, _ = connected(levels(b"FREQ 250;:VOLT 0.03", b"250", b"+3.01E-02"))
    driver.set_point(250.0, 1.5)


@pytest.mark.parametrize(
    ("answer", "switched_off"),
    [
        (b'1;1;1;SIN;10;+2.0E-02;+0.0E+00;VPP;+9.9E+37;0;NORM;0;+0,"No error"\n', 2),
        (b'1;0;1;SIN;10;+2.0E-02;+0.0E+00;VPP;0;NORM;0;+0,"No error"\n', 1),
    ],
)
def test_a_set_up_that_did_not_take_is_refused_and_switched_off(answer, switched_off):
    """Each other setting: tests/hw/test_asked_and_got.py."""
    script = Script(IDENTIFY, SWITCH_OFF, (SET_UP_LINE, answer), *[OFF] * switched_off)
    with pytest.raises(BadReply):
        Agilent33220A(MemoryTransport(script), SETTINGS).connect()
    assert not script.pairs


def test_switching_on_before_anything_is_known_sets_up_the_minimum_first():
    driver, script = connected(
        (b"OUTP?\n", b"maybe\n"),
        SET_UP_AGAIN,
        levels(b"", b"10", b"0.02"),
        (b"OUTP 1;:OUTP?;:SYST:ERR?\n", b'1;+0,"No error"\n'),
    )
    assert read_output(driver) is None
    driver.set_output(True)
    assert not script.pairs


@pytest.mark.parametrize(
    "change", [{"volts_per_volt": 0.0}, {"frequency_low_hz": 20e3}, {"frequency_high_hz": 30e6}]
)
def test_senseless_settings_are_refused(change):
    values = {
        "volts_per_volt": 100.0,
        "voltage_limit_v": 300.0,
        "frequency_low_hz": 10.0,
        "frequency_high_hz": 1e4,
    }
    with pytest.raises(ValueError, match="generator"):
        GeneratorSettings(**(values | change))


OUTPUT_IS_OFF, OUTPUT_IS_ON = (b"OUTP?\n", b"0\n"), (b"OUTP?\n", b"1\n")
ERROR_FREE = b';+0,"No error"\n'
WITH_AM = replace(
    SETTINGS, modulation_input=ModulationInput(full_scale_v=5.0, amplitude_at_full_scale=2.0)
)


def exchange(commands: bytes, answers: bytes) -> tuple[bytes, bytes]:
    return commands + b";:SYST:ERR?\n", answers + ERROR_FREE


def test_a_square_is_set_up_with_the_output_off_which_comes_back_on():
    driver, script = connected(
        OUTPUT_IS_ON,
        BASE,
        exchange(b"FUNC SQU;:FUNC?", b"SQU"),
        levels(b"FREQ 250;:VOLT 1.2", b"250", b"1.2", function=b"SQU"),
        levels(b"", b"250", b"1.2", function=b"SQU"),
        exchange(b"OUTP 1;:OUTP?", b"1"),
    )
    driver.set_point(250.0, 60.0, shape=Shape.SQUARE)
    assert not script.pairs


def test_a_constant_voltage_is_an_offset_without_frequency():
    without_frequency = STATE_QUERIES.replace(b":FREQ?;", b"")
    driver, script = connected(
        OUTPUT_IS_OFF,
        BASE,
        exchange(b"FUNC DC;:FUNC?", b"DC"),
        (b"VOLT:OFFS -0.4;:" + without_frequency, b"DC;0.02;-0.4;VPP;9.9E37;0;NORM;0" + ERROR_FREE),
    )
    driver.set_point(0.0, 60.0, -100.0, shape=Shape.DC)
    assert not script.pairs


def modulated(source_and_depth: bytes) -> tuple[bytes, bytes]:
    asked, answer = levels(b"FREQ 250;:VOLT 3", b"250", b"3", modulated=b"1")
    return (
        asked.replace(b":SYST:ERR?", b":AM:SOUR?;:AM:DEPT?;:SYST:ERR?"),
        answer.replace(b"NORM;0;", b"NORM;0;" + source_and_depth + b";"),
    )


@pytest.mark.parametrize("held", [b"INT;+1.0E+02", b"EXT;+5.0E+01"])
def test_another_source_or_depth_of_modulation_than_was_set_is_switched_off(held):
    driver, script = connected(
        OUTPUT_IS_OFF,
        BASE,
        exchange(
            b"AM:SOUR EXT;:AM:DEPT 100;:AM:STAT 1;:AM:SOUR?;:AM:DEPT?;:AM:STAT?",
            b"EXT;+1.0000000000000E+02;1",
        ),
        modulated(held),
        OFF,
        settings=WITH_AM,
    )
    with pytest.raises(BadReply, match="AM:DEPT"):
        driver.set_point(250.0, 300.0, modulation=ExternalModulation())
    assert not script.pairs


def test_external_modulation_programs_what_full_scale_makes_of_it():
    driver, script = connected(
        OUTPUT_IS_OFF,
        BASE,
        exchange(
            b"AM:SOUR EXT;:AM:DEPT 100;:AM:STAT 1;:AM:SOUR?;:AM:DEPT?;:AM:STAT?",
            b"EXT;+1.0000000000000E+02;1",
        ),
        modulated(b"EXT;+1.0E+02"),
        settings=WITH_AM,
    )
    driver.set_point(
        250.0, 300.0, modulation=ExternalModulation()
    )  # 3 Vpp doubled at full scale, times 50
    assert not script.pairs


def test_modulation_is_refused_until_it_is_measured_and_for_a_constant_voltage():
    driver, _ = connected()
    with pytest.raises(LimitExceeded, match="what modulation does to the amplitude is not set"):
        driver.set_point(250.0, 60.0, modulation=ExternalModulation())
    driver, _ = connected(settings=WITH_AM)
    with pytest.raises(LimitExceeded, match="that swings"):
        driver.set_point(250.0, 60.0, shape=Shape.DC, modulation=ExternalModulation())


def test_autoranging_as_a_policy_leaves_the_range_alone():
    line = SET_UP_LINE.replace(b":VOLT:RANG:AUTO?", b":VOLT:RANG:AUTO ON;:VOLT:RANG:AUTO?")
    script = Script(IDENTIFY, SWITCH_OFF, (line, b"1;0;1;" + MINIMUM))
    settings = replace(SETTINGS, range_policy=RangePolicy.AUTO)
    Agilent33220A(MemoryTransport(script), settings).connect()
    assert not script.pairs
