"""The last gate: what may be on its way to the generator, judged by the bytes alone."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.errors import LimitExceeded
from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.generator.gate import OutputGate
from hw.generator.keysight.gate import KeysightGate
from hw.generator.settings import GeneratorSettings, ModulationInput
from tests.hw.instruments import IMMEDIATE

GAIN, LIMIT_V = 100.0, 300.0
READY = b"*RST;:OUTP:LOAD INF;:VOLT:UNIT VPP;:AM:STAT 0\n"


def gate(*messages: bytes, modulation: float | None = None) -> OutputGate:
    measured = None if modulation is None else ModulationInput(5.0, modulation)
    gate = KeysightGate(GeneratorSettings(GAIN, LIMIT_V, 10.0, 10e3, modulation_input=measured))
    for message in messages:
        gate.check(message)
    return gate


@pytest.mark.parametrize(
    "message",
    [
        b"VOLT 6\n",
        b"FUNC DC;:VOLT:OFFS 3\n",
        b"VOLT 4;:VOLT:OFFS -1\n",
        b"FREQ 250;:VOLT 1.2;:VOLT?;:SYST:ERR?\n",
        b"VOLT? MAX\n",
        b"OUTP 1;:OUTP?\n",
        b"VOLT:LIM:HIGH 3;:VOLT:LIM:LOW -3;:VOLT:LIM:STAT 1\n",
    ],
)
def test_what_keeps_the_limit_passes(message):
    gate(READY, message)


@pytest.mark.parametrize(
    "message",
    [
        b"VOLT 6.001\n",
        b"VOLT MAX\n",
        b"VOLT 1E9\n",
        b"VOLT 4;:VOLT:OFFS -1.01\n",
        b"VOLT:OFFS MAX\n",
        b"VOLT:HIGH 1\n",
        b"VOLT:LOW -1\n",
        b"VOLT:LIM:STAT 0\n",
        b"FREQ 250;:VOLT 7;:VOLT 1\n",  # in between counts
        b"VOLT 5 VRMS\n",
        b"VOLT nan\n",
        b"VOLT 20?\n",
        b"volt 20\n",
        b"VOLTAGE 20\n",
        b"APPL:SIN 1E3,1,0\n",
        b"*RCL 1\n",
        b"OUTP:LOAD 50\n",
        b"VOLT:UNIT DBM\n",
        b"FUNC USER\n",
        b"FUNC NOIS\n",
        b"FM:STAT 1\n",
        b"AM:DEPT 120\n",
        b"AM:STAT 1;:VOLT 3.1\n",  # twice that at full scale, as long as nobody has measured it
        b"VOLT:OFFS 1;OFFS 9\n",  # would be looked up below VOLT
        b"FREQ?\nVOLT 20\n",
        b"*RST\nVOLT?\n",
        b"\n",
    ],
)
def test_what_does_not_is_held_back(message):
    with pytest.raises(LimitExceeded, match="last gate"):
        gate(READY, message)


@pytest.mark.parametrize(
    "message", [b"VOLT 0.1\n", b"VOLT:OFFS 0.1\n", b"OUTP 1\n", b"FUNC SIN\n", b"AM:STAT 1\n"]
)
def test_while_nothing_is_known_only_what_calms_passes(message):
    gate(b"VOLT MIN;:VOLT:OFFS 0;:OUTP 0;:AM:STAT 0;:OUTP?\n")
    with pytest.raises(LimitExceeded):
        gate(message)
    known = gate(READY)
    known.forget()
    with pytest.raises(LimitExceeded):
        known.check(message)


def test_only_too_much_voltage_is_mended_by_less():
    for message, hint in (
        (b"VOLT 6.1\n", "lower the voltage"),
        (b"APPL:SIN 1E3\n", "only what `KeysightGenerator` sends"),
    ):
        with pytest.raises(LimitExceeded) as refused:
            gate(READY, message)
        assert refused.value.hint.startswith(hint)


def test_a_refused_message_leaves_no_trace():
    opened = gate(READY, b"VOLT 5\n")
    with pytest.raises(LimitExceeded):
        opened.check(b"VOLT 0.1;:VOLT:OFFS 2;:VOLT 5\n")
    with pytest.raises(LimitExceeded):
        opened.check(b"VOLT:OFFS 0.6\n")  # the 5 V still stand


def test_modulation_of_unknown_depth_is_no_bound():
    ready = gate(
        b"VOLT MIN;:VOLT:OFFS 0;:AM:STAT 0;:OUTP:LOAD INF;:VOLT:UNIT VPP\n", b"FUNC SIN;:VOLT 0.1\n"
    )
    with pytest.raises(LimitExceeded):
        ready.check(b"AM:STAT 1\n")
    ready.check(b"AM:DEPT 100;:AM:STAT 1\n")


def test_a_measured_modulation_is_reckoned_with():
    gate(READY, b"AM:STAT 1;:VOLT 6\n", modulation=1.0)
    with pytest.raises(LimitExceeded):
        gate(READY, b"AM:STAT 1;:VOLT 6.1\n", modulation=1.0)


VALUE = st.floats(-12.0, 12.0).map("{:.6g}".format)
COMMAND = st.one_of(
    st.sampled_from(["VOLT", "VOLT:OFFS", "VOLT:HIGH", "VOLT:LOW"]).flatmap(
        lambda h: VALUE.map(lambda v: f"{h} {v}")
    ),
    st.sampled_from(
        [
            *(
                "*RST",
                "OUTP:LOAD INF",
                "OUTP:LOAD 50",
                "VOLT:UNIT VPP",
                "VOLT:UNIT VRMS",
                "FUNC SIN",
                "FUNC SQU",
            ),
            *("FUNC DC", "FUNC USER", "AM:STAT 1", "AM:STAT 0", "AM:DEPT 50"),
            *(
                "AM:SOUR EXT",
                "OUTP 1",
                "OUTP 0",
                "VOLT MIN",
                "VOLT MAX",
                "VOLT:OFFS 0",
                "APPL:SIN 1E3,5,0",
            ),
            *("AM:DEPT 100", "BURS:STAT 1", "*SAV 1", "*RCL 1", "FREQ 100"),
        ]
    ),
)


@settings(max_examples=150)
@given(st.lists(COMMAND, max_size=25), st.booleans())
def test_whatever_is_sent_through_the_gate_the_terminals_keep_the_limit(commands, doubling):
    """With nobody above the gate: commands at random, after each everything that was at the
    simulated terminals.
    """
    seen: list[float] = []
    generator = Simulated33220A(
        IMMEDIATE,
        listener=lambda output: seen.append(output.amplitude_v + abs(output.offset_v)),
        am_full_scale=2.0 if doubling else 1.0,
    )
    generator.set_modulation_input(5.0)
    opened = gate()
    for command in ("*RST", "OUTP:LOAD INF", "VOLT:UNIT VPP", "AM:STAT 0", *commands):
        message = command.encode() + b"\n"
        try:
            opened.check(message)
        except LimitExceeded:
            continue
        generator.handle(message)
        if generator.handle(b"SYST:ERR?\n") != b'+0,"No error"\n':
            generator.handle(b"*CLS\n")
            opened.forget()
    assert GAIN * max(seen, default=0.0) <= LIMIT_V * (1.0 + 1e-6)


@pytest.mark.parametrize(
    "known", [b"*RST\n", b"VOLT:UNIT VPP\n", b"OUTP:LOAD INF\n", b"AM:STAT 0\n"]
)
@pytest.mark.parametrize("level", [b"VOLT 0.1\n", b"VOLT:OFFS 0.1\n"])
def test_no_level_passes_before_both_load_and_unit_are_known(known, level):
    """For a load of 50 ohms a level is half of what an open electrode gets."""
    with pytest.raises(
        LimitExceeded, match="programmed load and unit are not known to be open, Vpp"
    ):
        gate(known, level)
    gate(b"*RST;:OUTP:LOAD INF\n", level)
