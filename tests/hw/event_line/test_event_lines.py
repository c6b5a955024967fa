"""Event lines and lines in, byte for byte and pin for pin; a trigger box over a pseudo-terminal."""

from __future__ import annotations

import fcntl
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.errors import DeviceDisconnected, DeviceError
from hw.event_line.contract import LineIn
from hw.event_line.modem_line import ModemEventLine, ModemLineIn
from hw.event_line.parallel_port import (
    PPCLAIM,
    PPEXCL,
    PPRELEASE,
    PPRSTATUS,
    PPWDATA,
    ParallelPort,
    ParallelPortIn,
)
from hw.event_line.simulated import SimulatedLineIn, SimulatedTriggerBox
from hw.event_line.trigger_box import TriggerBox, TriggerBoxIn
from hw.serving.memory import MemoryTransport
from hw.serving.serial import SerialServer
from hw.transport.serial import SerialTransport
from tests.clock import ManualClock
from tests.waiting import HANG_S, until

pytestmark = pytest.mark.timeout(2 * HANG_S)


class Wire:
    """Keeps every byte."""

    def __init__(self) -> None:
        self.heard = b""

    def handle(self, data: bytes) -> bytes:
        self.heard += data
        return b""


class Arduino:
    """Begins anew when its port is opened: what comes meanwhile is lost, then it says so."""

    def __init__(self, clock: ManualClock, begins_s: float) -> None:
        self._clock, self._ready_s = clock, clock() + begins_s
        self.came_out = b""
        self.says = b"Ready\r\n"

    def handle(self, data: bytes) -> bytes:
        if self._clock() >= self._ready_s:
            self.came_out += data
        return b""


class ArduinoTransport(MemoryTransport):
    """The port of one."""

    def __init__(self, clock: ManualClock) -> None:
        self.arduinos: list[Arduino] = []
        self._now = clock
        super().__init__(self)

    def handle(self, data: bytes) -> bytes:
        return self.arduinos[-1].handle(data)

    def _connect(self, deadline_s: float) -> None:
        super()._connect(deadline_s)
        self.arduinos.append(Arduino(self._now, 1.6))
        self._answers += self.arduinos[-1].says

    def _reset(self, deadline_s: float) -> None:
        """A line has no connection to drop."""
        self._discard_input()


def test_a_box_that_begins_anew_when_it_is_opened_swallows_no_code():
    clock = ManualClock(0.0)
    port = ArduinoTransport(clock)
    box = TriggerBox(port, settle_s=2.0, sleep=clock.sleep)
    for _ in range(2):  # reopened after a loss too
        box.open()
        for code in (1, 0, 2, 0):
            box.put(code)
        box.close()
    assert [each.came_out for each in port.arduinos] == [b"\x00\x01\x00\x02\x00\x00"] * 2


@settings(deadline=None)
@given(codes=st.lists(st.integers(0, 255), max_size=30), edge=st.integers(0, 255))
def test_any_codes_come_out_and_any_bytes_are_edges_where_they_are_the_one(codes, edge):
    """Sent to a box that begins anew when it is opened, and heard from one."""
    clock = ManualClock(0.0)
    port = ArduinoTransport(clock)
    box = TriggerBox(port, settle_s=2.0, sleep=clock.sleep)
    box.open()
    for code in codes:
        box.put(code)
    box.close()
    assert port.arduinos[-1].came_out == bytes([0, *codes, 0])
    with pytest.raises(DeviceError):
        box.put(1)
    line = TriggerBoxIn(port, edge, settle_s=2.0, sleep=clock.sleep)
    line.open()
    port._answers += bytes(codes)
    edges = sum(code == edge if edge else code > 0 for code in codes)
    assert list(line.levels()) == [True, False] * edges
    line.close()


@pytest.mark.parametrize("code", [-1, 256])
def test_what_is_no_byte_is_not_sent(code):
    wire = Wire()
    box = TriggerBox(MemoryTransport(wire), settle_s=0.0)
    box.open()
    with pytest.raises(ValueError, match="range"):
        box.put(code)
    assert wire.heard == b"\x00"


def test_over_a_serial_port_edges_come_in_order_with_times_that_rise():
    simulated = SimulatedTriggerBox()
    with SerialServer(simulated, framed=False) as server:
        box = TriggerBox(SerialTransport(server.path), settle_s=0.0)
        box.open()
        for code in (21, 0, 31, 0):
            box.put(code)
        until(lambda: len(simulated.edges) == 4)
        box.close()
    assert [edge.code for edge in simulated.edges] == [21, 0, 31, 0]
    assert all(before.time_s <= after.time_s for before, after in pairwise(simulated.edges))


def test_a_port_that_is_gone_says_so():
    for line in (
        TriggerBox(SerialTransport("/dev/no-such-port")),
        ModemEventLine("/dev/no-such-port", "rts"),
        ParallelPort("/dev/no-such-port"),
        TriggerBoxIn(SerialTransport("/dev/no-such-port")),
        ModemLineIn("/dev/no-such-port", "cts"),
        ParallelPortIn("/dev/no-such-port", 10),
    ):
        with pytest.raises(DeviceDisconnected) as caught:
            line.open()
        assert caught.value.hint
        line.close()


def test_what_is_no_parallel_port_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(DeviceDisconnected, match="cannot be used"):
        ParallelPort(str(tmp_path / "file")).open()


def test_a_parallel_port_is_claimed_alone_written_and_released(tmp_path, monkeypatch):
    """By the requests of linux/ppdev.h, in the order of its documentation."""
    (tmp_path / "port").touch()
    asked: list[tuple[int, bytes]] = []
    monkeypatch.setattr(fcntl, "ioctl", lambda file, number, data=b"": asked.append((number, data)))
    port = ParallelPort(str(tmp_path / "port"))
    port.open()
    port.put(37)
    port.close()
    assert asked == [
        (PPEXCL, b""),
        (PPCLAIM, b""),
        (PPWDATA, b"\x00"),
        (PPWDATA, b"\x25"),
        (PPWDATA, b"\x00"),
        (PPRELEASE, b""),
    ]


class Port:
    """What pyserial's Serial is to a line."""

    def __init__(self) -> None:
        self.port, self.rts, self.dtr, self.is_open = "", True, True, False
        self.cts = self.dsr = False

    def open(self) -> None:
        self.is_open = True

    def close(self) -> None:
        self.is_open = False


def test_one_wire_of_a_serial_port_is_high_for_any_code(monkeypatch):
    port = Port()
    monkeypatch.setattr("serial.Serial", lambda: port)
    line = ModemEventLine("/dev/ttyUSB0", "dtr")
    line.open()
    levels = [port.dtr]
    for code in (1, 0, 200):
        line.put(code)
        levels.append(port.dtr)
    line.close()
    assert [*levels, port.dtr, port.rts, port.is_open] == [
        *(False, True, False, True),
        *(False, False, False),
    ]


def levels_of(line: LineIn, count: int) -> list[bool]:
    """The next so many."""
    seen: list[bool] = []
    until(lambda: seen.extend(line.levels()) or len(seen) >= count)
    return seen


def test_an_input_of_a_serial_port_is_what_it_reads(monkeypatch):
    port = Port()
    monkeypatch.setattr("serial.Serial", lambda: port)
    line = ModemLineIn("/dev/ttyUSB0", "dsr")
    with pytest.raises(DeviceDisconnected):
        line.levels()
    line.open()
    assert (port.rts, port.dtr, line.levels()) == (True, True, (False,))
    port.cts = True
    assert line.levels() == (False,)
    port.dsr = True
    assert line.levels() == (True,)
    line.close()
    assert not port.is_open


@pytest.mark.parametrize(
    ("pin", "low", "high"),
    [(10, 0xBF, 0x40), (11, 0x80, 0x7F), (12, 0xDF, 0x20), (13, 0xEF, 0x10), (15, 0xF7, 0x08)],
)
def test_a_status_pin_is_its_bit_and_busy_is_inverted(pin, low, high, tmp_path, monkeypatch):
    """IEEE 1284, table of the status register: nAck 6, Busy 7 inverted, PError 5, Select 4,
    nFault 3.
    """
    (tmp_path / "port").touch()
    asked: list[int] = []
    status = [low]

    def answer(file: int, number: int, data: bytes = b"") -> bytes:
        asked.append(number)
        return bytes(status)

    monkeypatch.setattr(fcntl, "ioctl", answer)
    line = ParallelPortIn(str(tmp_path / "port"), pin)
    line.open()
    assert line.levels() == (False,)
    status[0] = high
    assert line.levels() == (True,)
    line.close()
    assert asked == [PPEXCL, PPCLAIM, PPRSTATUS, PPRSTATUS, PPRELEASE]


def test_a_simulated_line_in_has_its_pulses_and_can_be_lost_and_taken_again():
    line = SimulatedLineIn(code=5)
    for _ in range(2):
        line.open()
        line.pulse()
        assert levels_of(line, 2) == [True, False]
        line.unplug()
        with pytest.raises(DeviceDisconnected):
            levels_of(line, 1)
        line.close()


def test_a_simulated_line_in_pulses_by_itself_where_it_is_told_to():
    line = SimulatedLineIn(every_s=1e-3)
    line.open()
    assert levels_of(line, 6)[:2] == [True, False]
    line.close()
