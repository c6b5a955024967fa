"""The 33220A driver on a bad line: clear errors in time, honest evidence, recovery."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import closing

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.errors import BadReply, DeviceDisconnected, DeviceError, DeviceTimeout
from hw.generator.agilent_33220a.driver import Agilent33220A
from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.generator.settings import GeneratorSettings
from hw.serving.memory import MemoryTransport
from hw.serving.tcp import TcpServer
from hw.transport.contract import Transport
from hw.transport.tcp import TcpTransport
from tests.clock import ManualClock
from tests.hw.generator.asking import read_output
from tests.hw.instruments import IMMEDIATE
from tests.hw.testing.faulty_instrument import Fault, FaultyInstrument

pytestmark = pytest.mark.timeout(60)

TIMEOUT_S = 0.3
HANG_BOUND_S = 10.0  # generous: it tells a bounded wait from a hang, nothing more
SETTINGS = GeneratorSettings(100.0, 300.0, 10.0, 10e3, reply_timeout_s=TIMEOUT_S)
EXPECTED = {
    Fault.GARBAGE: BadReply,
    Fault.SILENCE: DeviceTimeout,
    Fault.HANG: DeviceTimeout,
    Fault.LATE: DeviceTimeout,
    Fault.TRUNCATED: DeviceTimeout,
    Fault.DISCONNECT: DeviceDisconnected,
}


class Bench:
    def __init__(self, sleep: Callable[[float], None] = time.sleep) -> None:
        self.generator = Simulated33220A(IMMEDIATE)
        self.line = FaultyInstrument(self.generator, sleep=sleep)

    def connect(self, transport: Transport) -> None:
        self.transport = transport
        self.driver = Agilent33220A(transport, SETTINGS)
        self.driver.connect()
        self.driver.set_point(250.0, 100.0)
        self.driver.set_output(True)

    def amplitude_v(self) -> float:
        return 100.0 * self.generator.output().amplitude_v


@pytest.fixture
def bench():
    bench = Bench()
    with (
        TcpServer(bench.line) as server,
        closing(TcpTransport(server.host, server.port)) as transport,
    ):
        bench.connect(transport)
        yield bench


@pytest.fixture
def stepped():
    """In memory, where waiting takes no time."""
    clock = ManualClock()
    bench = Bench(clock.sleep)
    bench.connect(MemoryTransport(bench.line, clock=clock))
    return bench


@pytest.mark.parametrize("fault", list(Fault))
def test_each_fault_is_its_own_error_and_the_next_set_point_recovers(bench, fault):
    bench.line.inject(fault, delay_s=2.0 * TIMEOUT_S)
    started_s = time.monotonic()
    with pytest.raises(EXPECTED[fault], match=bench.transport.resource) as caught:
        bench.driver.set_point(300.0, 200.0)
    assert time.monotonic() - started_s < HANG_BOUND_S
    assert caught.value.hint
    bench.driver.set_point(400.0, 150.0)
    assert bench.amplitude_v() == pytest.approx(150.0)
    assert bench.generator.output().frequency_hz == 400.0


def test_a_late_reply_is_never_taken_for_the_next_one(bench):
    for step in range(3):
        bench.line.inject(Fault.LATE, delay_s=1.5 * TIMEOUT_S)
        with pytest.raises(DeviceTimeout):
            bench.driver.set_point(300.0 + step, 200.0)
        assert read_output(bench.driver) is True
        bench.driver.set_point(400.0, 100.0 + step)
        assert bench.amplitude_v() == pytest.approx(100.0 + step)


@pytest.mark.parametrize("fault", list(Fault))
def test_off_recovers_from_one_fault_and_brings_evidence(stepped, fault):
    stepped.line.inject(fault, delay_s=2.0 * TIMEOUT_S)
    assert stepped.driver.off() is True
    assert not stepped.generator.output().on


@pytest.mark.parametrize("fault", list(Fault))
def test_off_and_read_output_say_unknown_when_nothing_comes_back(bench, fault):
    bench.line.inject(fault, count=math.inf, delay_s=1.5 * TIMEOUT_S)
    assert read_output(bench.driver) is None
    started_s = time.monotonic()
    assert bench.driver.off() is None
    assert time.monotonic() - started_s < HANG_BOUND_S
    # Only a hung instrument is still on; the others obeyed, but nobody can know.
    assert bench.generator.output().on is (fault is Fault.HANG)
    bench.line.heal()
    assert bench.driver.off() is True


@pytest.mark.parametrize("fault", list(Fault))
def test_connecting_over_a_dead_line_is_an_error_in_time(fault):
    bench = Bench()
    bench.line.inject(fault, count=math.inf, delay_s=1.5 * TIMEOUT_S)
    with TcpServer(bench.line) as server:
        transport = TcpTransport(server.host, server.port)
        started_s = time.monotonic()
        with pytest.raises(DeviceError):
            Agilent33220A(transport, SETTINGS).connect()
        assert time.monotonic() - started_s < HANG_BOUND_S
        transport.close()


def test_a_server_that_went_away_is_a_disconnect_and_its_return_is_found():
    bench = Bench()
    server = TcpServer(bench.line)
    server.start()
    bench.connect(TcpTransport(server.host, server.port))
    server.close()
    with pytest.raises(DeviceDisconnected):
        bench.driver.set_point(300.0, 200.0)
    assert read_output(bench.driver) is None
    assert bench.driver.off() is None
    with pytest.raises(DeviceDisconnected, match="cannot be reached"):
        bench.driver.set_point(300.0, 200.0)
    with TcpServer(bench.line, server.port):
        bench.generator.handle(b"*RST\n")  # it was switched off and on: LOAD 50, output off
        bench.driver.set_point(300.0, 200.0)
        bench.driver.set_output(True)
        assert bench.amplitude_v() == pytest.approx(200.0)
        assert bench.driver.close() is True


class Babble:
    """A generator whose answers are replaced once `answer` is set."""

    def __init__(self) -> None:
        self.generator = Simulated33220A()
        self.answer: bytes | None = None

    def handle(self, data: bytes) -> bytes:
        answer = self.generator.handle(data)
        return answer if self.answer is None else self.answer


ALMOST = st.sampled_from(
    [
        b'+2.4E+00;+0.0E+00;VPP;+9.9E+37;+1E400,"x"\n',
        b'+2.4E+400;+0.0E+00;VPP;+9.9E+37;+0,"No error"\n',
        b"1;1;1;1;1\n",
        b"1\n",
        b";;;;\n",
        b'"\n',
    ]
)


@settings(max_examples=200)
@given(
    st.one_of(
        ALMOST, st.binary(max_size=60), st.binary(max_size=60).map(lambda answer: answer + b"\n")
    )
)
def test_whatever_is_answered_only_device_errors_come_out(answer):
    babble = Babble()
    driver = Agilent33220A(MemoryTransport(babble), SETTINGS)
    driver.connect()
    babble.answer = answer
    for use in (
        lambda: driver.set_point(250.0, 120.0),
        lambda: driver.set_output(True),
        driver.connect,
    ):
        with pytest.raises(DeviceError):
            use()
    assert read_output(driver) in (True, False, None)
    assert driver.off() in (True, False, None)


def test_a_driver_never_connected_knows_nothing():
    driver = Agilent33220A(MemoryTransport(Simulated33220A()), SETTINGS)
    assert read_output(driver) is None
    assert driver.off() is None
    assert driver.close() is None
    with pytest.raises(DeviceDisconnected, match="not open"):
        driver.set_point(250.0, 100.0)
