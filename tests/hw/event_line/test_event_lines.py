"""Event lines, byte for byte and pin for pin; a trigger box over a pseudo-terminal."""

from __future__ import annotations

import fcntl
from itertools import pairwise
from pathlib import Path

import pytest

from hw.errors import DeviceDisconnected, DeviceError
from hw.event_line.contract import EventLine
from hw.event_line.modem_line import ModemEventLine
from hw.event_line.parallel_port import PPCLAIM, PPEXCL, PPRELEASE, PPWDATA, ParallelPort
from hw.event_line.simulated import SimulatedEventLine, SimulatedTriggerBox
from hw.event_line.trigger_box import TriggerBox
from hw.serving.memory import MemoryTransport
from hw.serving.serial import SerialServer
from hw.transport.serial import SerialTransport
from tests.waiting import HANG_S, until

pytestmark = pytest.mark.timeout(2 * HANG_S)


class Wire:
    """Keeps every byte."""

    def __init__(self) -> None:
        self.heard = b""

    def handle(self, data: bytes) -> bytes:
        self.heard += data
        return b""


def test_a_trigger_box_gets_one_byte_per_code_and_0_at_either_end() -> None:
    wire = Wire()
    box = TriggerBox(MemoryTransport(wire))
    box.open()
    assert wire.heard == b"\x00"
    for code in (1, 255, 0, 10):
        box.put(code)
    assert wire.heard == b"\x00\x01\xff\x00\x0a"
    box.close()
    assert wire.heard == b"\x00\x01\xff\x00\x0a\x00"
    with pytest.raises(DeviceError):
        box.put(1)


@pytest.mark.parametrize("code", [-1, 256])
def test_what_is_no_byte_is_not_sent(code: int) -> None:
    wire = Wire()
    box = TriggerBox(MemoryTransport(wire))
    box.open()
    with pytest.raises(ValueError, match="range"):
        box.put(code)
    assert wire.heard == b"\x00"


def test_over_a_serial_port_edges_come_in_order_with_times_that_rise() -> None:
    simulated = SimulatedTriggerBox()
    with SerialServer(simulated, framed=False) as server:
        box = TriggerBox(SerialTransport(server.path))
        box.open()
        for code in (21, 0, 31, 0):
            box.put(code)
        until(lambda: len(simulated.edges) == 4)
        box.close()
    assert [edge.code for edge in simulated.edges] == [21, 0, 31, 0]
    assert all(before.time_s <= after.time_s for before, after in pairwise(simulated.edges))


def test_a_simulated_line_can_be_taken_again() -> None:
    line: EventLine = SimulatedEventLine(box := SimulatedTriggerBox())
    for code in (7, 9):
        line.open()
        line.put(code)
        until(lambda code=code: box.edges and box.edges[-1].code == code)
        line.close()
    assert [edge.code for edge in box.edges if edge.code] == [7, 9]


def test_a_port_that_is_gone_says_so() -> None:
    for line in (
        TriggerBox(SerialTransport("/dev/no-such-port")),
        ModemEventLine("/dev/no-such-port", "rts"),
        ParallelPort("/dev/no-such-port"),
    ):
        with pytest.raises(DeviceDisconnected) as caught:
            line.open()
        assert caught.value.hint
        line.close()


def test_what_is_no_parallel_port_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(DeviceDisconnected, match="cannot be used"):
        ParallelPort(str(tmp_path / "file")).open()


def test_a_parallel_port_is_claimed_alone_written_and_released(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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

    def open(self) -> None:
        self.is_open = True

    def close(self) -> None:
        self.is_open = False


def test_one_wire_of_a_serial_port_is_high_for_any_code(monkeypatch: pytest.MonkeyPatch) -> None:
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
