from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.generator.keysight.scpi import ScpiEngine, ScpiError, only, parse_choice, parse_number


class Lamp:
    """A made-up instrument: two lamps with colours."""

    def __init__(self) -> None:
        self.colour = {"A": "RED", "B": "RED"}
        self.engine = ScpiEngine("Maker,Lamp,1,1.0", reset=lambda: None, executed=lambda: None)
        for lamp in "AB":
            self.engine.command(
                f"LAMP:{lamp}:COLour",
                lambda a, lamp=lamp: self.colour.update(
                    {lamp: parse_choice(only(a), ("RED", "GREen"))}
                ),
                lambda _, lamp=lamp: self.colour[lamp],
            )
            self.engine.command(f"LAMP:{lamp}:POWer", query=lambda _, lamp=lamp: f"power {lamp}")

    def __call__(self, message: str) -> str:
        return self.engine.handle(message.encode("latin-1") + b"\n").decode("latin-1")


@pytest.fixture
def lamp():
    return Lamp()


def test_a_compound_message_answers_in_one_line(lamp):
    assert lamp("LAMP:A:COL?;:LAMP:B:POW?;*IDN?") == "RED;power B;Maker,Lamp,1,1.0\n"


def test_a_header_without_colon_continues_in_the_last_subsystem(lamp):
    assert lamp("LAMP:B:COL GRE;POW?;COL?") == "power B;GRE\n"
    assert lamp("LAMP:B:COL?;A:COL?") == "GRE\n"  # no A below LAMP:B
    assert lamp("SYST:ERR?") == '-113,"Undefined header"\n'


def test_a_command_error_ends_the_message_an_execution_error_does_not(lamp):
    assert lamp("LAMP:A:COL BLUE;:LAMP:A:COL?") == "RED\n"
    assert lamp("LAMP:A:COL? ;:NONSENSE 1;:LAMP:A:COL?") == "RED\n"
    assert (
        lamp("SYST:ERR?;:SYST:ERR?;:SYST:ERR?")
        == '-224,"Illegal parameter value";-113,"Undefined header";+0,"No error"\n'
    )


@pytest.mark.parametrize(
    ("message", "code"),
    [
        ("LAMP:A:POW 3", -113),
        ("*FOO", -113),
        ("\xff\x00", -102),
        ("LAMP:A:COL", -109),
        ("LAMP:A:COL RED,RED", -108),
    ],
)
def test_errors_by_code(lamp, message, code):
    lamp(message)
    assert lamp("SYST:ERR?").startswith(f"{code},")


def test_the_error_queue_holds_twenty(lamp):
    for _ in range(25):
        lamp("NONSENSE")
    codes = [lamp("SYST:ERR?").partition(",")[0] for _ in range(21)]
    assert codes == ["-113"] * 19 + ["-350", "+0"]


def test_event_status_by_class_of_error(lamp):
    assert lamp("*ESR?") == "128\n"  # power on
    lamp("NONSENSE")
    assert lamp("*ESR?") == "32\n"
    lamp("LAMP:A:COL BLUE")
    assert lamp("*ESR?") == "16\n"
    lamp("*OPC")
    assert lamp("*ESR?;*ESR?") == "1;0\n"
    lamp.engine.post(-410)
    lamp.engine.post(720)
    assert lamp("*ESR?") == "12\n"


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("5 kHz", "HZ", 5e3),
        ("5MHZ", "HZ", 5e6),
        ("20 mV", "V", 0.02),
        ("-1.5e-3", "V", -1.5e-3),
        (".5", "", 0.5),
        ("MAX", "V", 7.0),
    ],
)
def test_numbers(text, unit, value):
    assert parse_number(text, unit, {"MAXimum": 7.0}) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "code"), [("5 V", -131), ("nan", -104), ("", -104), ("1E999", -123)]
)
def test_bad_numbers(text, code):
    with pytest.raises(ScpiError) as caught:
        parse_number(text, "HZ")
    assert caught.value.code == code


class Box:
    """A made-up instrument that keeps what it is sent under optional nodes."""

    def __init__(self) -> None:
        self.got: list[list[str]] = []
        self.engine = ScpiEngine("M,B,1,1", reset=lambda: None, executed=lambda: None)
        self.engine.command(
            "[SOURce:]VOLTage[:LEVel][:IMMediate][:AMPLitude]", self.got.append, lambda _: "level"
        )
        self.engine.command(
            "[SOURce:]VOLTage[:LEVel][:IMMediate]:OFFSet", self.got.append, lambda _: "offset"
        )

    def __call__(self, message: bytes) -> bytes:
        return self.engine.handle(message)


@st.composite
def spelling(draw: st.DrawFn, keywords: tuple[tuple[str, bool], ...]) -> str:
    """Any way to write a header whose second items say which keywords may be left out."""
    chosen = [word for word, optional in keywords if not (optional and draw(st.booleans()))]
    forms = [
        draw(st.sampled_from([word, "".join(c for c in word if not c.islower())]))
        for word in chosen
    ]
    cased = [
        (
            "".join(c.upper() if draw(st.booleans()) else c.lower() for c in form)
            if draw(st.booleans())
            else form
        )
        for form in forms
    ]
    return draw(st.sampled_from(["", ":"])) + ":".join(cased)


PATH = (("SOURce", True), ("VOLTage", False), ("LEVel", True), ("IMMediate", True))


@given(spelling((*PATH, ("AMPLitude", True))), spelling((*PATH, ("OFFSet", False))))
def test_every_spelling_of_a_header_means_the_same(level, offset):
    box = Box()
    assert box(f"{level}?\n{offset}?\n".encode()) == b"level\noffset\n"
    assert box(f"{level} 1.5;:{offset.lstrip(':')} 2\n".encode()) == b""
    assert box.got == [["1.5"], ["2"]]


@pytest.mark.parametrize("header", ["VOLTA", "SOU:VOLT", "VOLT:OFF", "VOLT:AMPL:LEV"])
def test_any_other_spelling_is_unknown(header):
    box = Box()
    assert box(f"{header} 1\n".encode()) == b""
    assert box(b"SYST:ERR?\n").startswith(b"-113,")
    assert box.got == []
