"""What must hold whatever the driver is asked, with the simulated generator and amplifier behind
it.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import pytest

from hw.amplifier.simulated import SimulatedAmplifier
from hw.errors import BadReply, InstrumentRejected
from hw.generator.agilent_33220a.driver import Agilent33220A
from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.generator.contract import GeneratorLatency, TerminalOutput
from hw.generator.settings import GeneratorSettings
from hw.serving.memory import MemoryTransport
from hw.serving.tcp import TcpServer
from hw.transport.contract import Transport
from hw.transport.tcp import TcpTransport
from tests.hw.generator.asking import read_output
from tests.hw.instruments import IMMEDIATE

SETTINGS = GeneratorSettings(100.0, 300.0, 10.0, 10e3)
ROUNDING = 1.0 + 1e-9


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


@pytest.mark.parametrize("load", ["50", "1", "10E3"])
def test_a_load_left_behind_is_corrected_and_read_back(load):
    rig = Rig()
    rig.generator.handle(f"OUTP:LOAD {load}\n".encode())
    rig.connect()
    assert rig.generator.handle(b"OUTP:LOAD?\n") == b"+9.9000000000000E+37\n"
    rig.driver.set_output(True)
    rig.driver.set_point(250.0, 120.0)
    assert rig.amplifier.max_voltage_v == pytest.approx(120.0)


def test_connecting_leaves_the_output_off():
    rig = Rig()
    rig.generator.handle(b"APPL:SIN 1E3,10,0\n")
    rig.connect()
    assert not rig.generator.output().on
    assert read_output(rig.driver) is False


@pytest.mark.parametrize(
    "change", ["OUTP:LOAD 50", "VOLT:UNIT VRMS", "VOLT:OFFS 3", "*RST;:OUTP 1"]
)
def test_levels_changed_behind_the_driver_are_noticed_switched_off_and_set_up_again(
    change,
):
    """At LOAD 50 the amplitude alone reads back as it was set, while the electrode gets twice
    that.
    """
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


def test_a_clipped_value_is_an_error_and_off_never_accepted():
    """The fixed range ends at 5.02 V: 5 V of offset are clipped to 3.82 V, and the error waits for
    whoever asks.
    """
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


def test_a_load_changed_behind_the_driver_is_noticed_before_switching_on():
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
def test_two_threads_on_one_driver_never_cross_replies(over_tcp):
    """Every set point is read back: a crossed reply, or a belief about what another thread changed,
    is a BadReply.

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
                states.append(read_output(driver))
        return states

    with ThreadPoolExecutor(2) as pool:
        states = list(
            pool.map(hammer, ([(100.0, 20.0), (100.0, 30.0)], [(200.0, 20.0), (300.0, 20.0)]))
        )
    assert states == [[False] * 200] * 2
    assert driver.close() is True
    if server is not None:
        server.close()
