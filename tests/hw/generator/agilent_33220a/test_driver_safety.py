"""What must hold whatever the driver is asked, with the simulated generator and amplifier behind it."""

from __future__ import annotations

import math
import struct
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.amplifier.simulated import SimulatedAmplifier
from hw.errors import BadReply, InstrumentRejected, LimitExceeded
from hw.generator.agilent_33220a.driver import Agilent33220A, GeneratorSettings
from hw.generator.agilent_33220a.simulator import GeneratorLatency, Simulated33220A, TerminalOutput
from hw.serving.tcp import TcpServer
from hw.testing.memory import MemoryTransport
from hw.transport.contract import Transport
from hw.transport.tcp import TcpTransport
from tests.hw.instruments import IMMEDIATE

SETTINGS = GeneratorSettings(100.0, 300.0, 10.0, 10e3)
ROUNDING = 1.0 + 1e-9

NUMBER = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.floats(0.0, 400.0),
    st.floats(1.0, 300.0),
    st.sampled_from([300.0, math.nextafter(300.0, 400.0), 1.0, 0.0, -300.0]),
)
FREQUENCY = st.one_of(st.floats(10.0, 10e3), st.floats(allow_nan=True, allow_infinity=True))
LEFT_BEHIND = st.lists(
    st.sampled_from(
        [
            *(
                "OUTP:LOAD 50",
                "OUTP:LOAD INF",
                "OUTP:LOAD 1",
                "VOLT MAX",
                "VOLT 1E9",
                "VOLT:UNIT DBM",
                "VOLT:UNIT VRMS",
            ),
            *("VOLT:OFFS MAX", "FUNC SQU", "FUNC DC", "FREQ MAX", "APPL:PULS 1E3,5,1", "OUTP 1", "BURS:STAT 1", "NO"),
        ]
    ),
    max_size=8,
)


class Rig:
    """Driver, generator and an amplifier that would let everything through."""

    def __init__(self, latency: GeneratorLatency = IMMEDIATE) -> None:
        self.amplifier = SimulatedAmplifier(100.0, 1e6, enabled=True)
        self.seen: list[TerminalOutput] = []
        self.generator = Simulated33220A(latency, listener=self._listen)
        self.transport = MemoryTransport(self.generator)
        self.driver = Agilent33220A(self.transport, SETTINGS)

    def _listen(self, output: TerminalOutput) -> None:
        self.amplifier.drive(output)
        self.seen.append(output)

    def connect(self) -> None:
        self.driver.connect()
        self.amplifier.max_voltage_v = 0.0
        self.seen.clear()


@settings(max_examples=150)
@given(LEFT_BEHIND, st.lists(st.one_of(st.tuples(FREQUENCY, NUMBER), st.booleans()), max_size=20), st.booleans())
def test_the_electrode_never_exceeds_the_limit(
    left_behind: list[str], requests: list[tuple[float, float] | bool], slow: bool
) -> None:
    rig = Rig(GeneratorLatency() if slow else IMMEDIATE)
    for command in left_behind:
        rig.generator.handle(command.encode() + b"\n")
    rig.generator.advance(1.0)
    rig.connect()
    rig.generator.advance(1.0)
    for request in requests:
        if isinstance(request, bool):
            rig.driver.set_output(request)
        else:
            try:
                rig.driver.set_point(*request)
            except LimitExceeded:
                assert not (10.0 <= request[0] <= 10e3 and 1.0 <= request[1] <= 300.0)
        rig.generator.advance(0.02)
    assert rig.amplifier.max_voltage_v <= 300.0 * ROUNDING


@settings(max_examples=150)
@given(st.lists(st.tuples(st.floats(10.0, 10e3), st.floats(1.0, 300.0)), min_size=2, max_size=20))
def test_nothing_in_between_exceeds_what_was_asked(points: list[tuple[float, float]]) -> None:
    rig = Rig()
    rig.connect()
    rig.driver.set_output(True)
    rig.driver.set_point(*points[0])
    for (old_hz, old_v), (new_hz, new_v) in pairwise(points):
        rig.seen.clear()
        rig.driver.set_point(new_hz, new_v)
        for output in rig.seen:
            assert 100.0 * output.amplitude_v <= max(old_v, new_v) * ROUNDING
            product = 100.0 * output.amplitude_v * output.frequency_hz
            assert product <= max(old_v * old_hz, new_v * new_hz) * ROUNDING


@settings(max_examples=100)
@given(st.tuples(FREQUENCY, NUMBER).filter(lambda p: not (10.0 <= p[0] <= 10e3 and 1.0 <= p[1] <= 300.0)))
def test_a_refused_set_point_changes_nothing(point: tuple[float, float]) -> None:
    rig = Rig()
    rig.connect()
    rig.driver.set_output(True)
    before = rig.generator.output()
    with pytest.raises(LimitExceeded):
        rig.driver.set_point(*point)
    assert rig.generator.output() == before


def test_a_set_point_is_volts_at_the_electrode() -> None:
    rig = Rig()
    rig.connect()
    rig.driver.set_output(True)
    rig.driver.set_point(250.0, 120.0)
    assert rig.generator.output() == (250.0, pytest.approx(1.2), 0.0, True)
    assert rig.amplifier.voltage_v == pytest.approx(120.0)


@pytest.mark.parametrize("load", ["50", "1", "10E3"])
def test_a_load_left_behind_is_corrected_and_read_back(load: str) -> None:
    rig = Rig()
    rig.generator.handle(f"OUTP:LOAD {load}\n".encode())
    rig.connect()
    assert rig.generator.handle(b"OUTP:LOAD?\n") == b"+9.9000000000000E+37\n"
    rig.driver.set_output(True)
    rig.driver.set_point(250.0, 120.0)
    assert rig.amplifier.max_voltage_v == pytest.approx(120.0)


def test_connecting_leaves_the_output_off() -> None:
    rig = Rig()
    rig.generator.handle(b"APPL:SIN 1E3,10,0\n")
    rig.connect()
    assert not rig.generator.output().on
    assert rig.driver.read_output() is False


@pytest.mark.parametrize("change", ["OUTP:LOAD 50", "VOLT:UNIT VRMS", "VOLT:OFFS 3", "*RST;:OUTP 1"])
def test_levels_changed_behind_the_driver_are_noticed_switched_off_and_set_up_again(change: str) -> None:
    """At LOAD 50 the amplitude alone reads back as it was set, while the electrode gets twice that."""
    rig = Rig()
    rig.connect()
    rig.driver.set_output(True)
    rig.driver.set_point(250.0, 120.0)
    rig.generator.handle(change.encode() + b"\n")
    with pytest.raises(BadReply, match="offset 0 V and an open load were set"):
        rig.driver.set_point(260.0, 120.0)
    assert rig.amplifier.voltage_v == 0.0
    rig.driver.set_point(250.0, 60.0)
    rig.driver.set_output(True)
    assert rig.amplifier.voltage_v == pytest.approx(60.0)


def test_a_clipped_value_is_an_error_and_off_never_accepted() -> None:
    """The fixed range ends at 5.02 V: 5 V of offset are clipped to 3.82 V, and the error waits for whoever asks."""
    rig = Rig()
    rig.connect()
    rig.driver.set_output(True)
    rig.driver.set_point(250.0, 120.0)
    rig.generator.handle(b"VOLT:OFFS 5\n")
    with pytest.raises(InstrumentRejected, match="-222"):
        rig.driver.set_point(260.0, 120.0)
    assert rig.amplifier.voltage_v == 0.0
    rig.driver.set_point(250.0, 60.0)
    rig.driver.set_output(True)
    assert rig.amplifier.voltage_v == pytest.approx(60.0)


def test_a_load_changed_behind_the_driver_is_noticed_before_switching_on() -> None:
    rig = Rig()
    rig.connect()
    rig.driver.set_point(250.0, 120.0)
    rig.generator.handle(b"OUTP:LOAD 50;:VOLT 2.4\n")
    with pytest.raises(BadReply):
        rig.driver.set_output(True)
    assert rig.amplifier.max_voltage_v == 0.0


def transport_to(generator: Simulated33220A, server: TcpServer | None) -> Transport:
    return MemoryTransport(generator) if server is None else TcpTransport(server.host, server.port)


@pytest.mark.timeout(60)
@pytest.mark.parametrize("over_tcp", [False, True])
def test_two_threads_on_one_driver_never_cross_replies(over_tcp: bool) -> None:
    """Every set point is read back: a crossed reply, or a belief about what another thread changed, is a BadReply.

    One thread changes voltages at one frequency, the other frequencies at one of these voltages.
    """
    generator = Simulated33220A(IMMEDIATE)
    server = TcpServer(generator) if over_tcp else None
    if server is not None:
        server.start()
    driver = Agilent33220A(transport_to(generator, server), SETTINGS)
    driver.connect()

    def hammer(points: list[tuple[float, float]]) -> list[bool | None]:
        states = []
        for _ in range(100):
            for point in points:
                driver.set_point(*point)
                states.append(driver.read_output())
        return states

    with ThreadPoolExecutor(2) as pool:
        states = list(pool.map(hammer, ([(100.0, 20.0), (100.0, 30.0)], [(200.0, 20.0), (300.0, 20.0)])))
    assert states == [[False] * 200] * 2
    assert driver.close() is True
    if server is not None:
        server.close()


def test_wild_bit_patterns_are_either_refused_or_within_limits() -> None:
    """Floats from every exponent, e.g. 5e-324 or 1e308."""
    rig = Rig()
    rig.connect()
    rig.driver.set_output(True)
    for exponent in range(0, 2048, 3):
        (value,) = struct.unpack(">d", (exponent << 52 | 0xABCDEF).to_bytes(8))
        for point in ((250.0, value), (value, 100.0)):
            try:
                rig.driver.set_point(*point)
            except LimitExceeded:
                continue
    assert rig.amplifier.max_voltage_v <= 300.0 * ROUNDING
