from __future__ import annotations

import os
import time

import pytest

from hw.errors import BadReply, DeviceDisconnected, DeviceTimeout
from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.serving.serial import SerialServer
from hw.transport.contract import Bounds
from hw.transport.marker import scpi_marker
from hw.transport.serial import SerialTransport
from tests.hw.instruments import IMMEDIATE

pytestmark = pytest.mark.timeout(30)


class Box:
    """Answers at once, or `late` seconds late."""

    def handle(self, data: bytes) -> bytes:
        if data == b"late?\n":
            time.sleep(0.1)
        return data if b"?" in data else b""


@pytest.fixture
def server():
    with SerialServer(Box()) as server:
        yield server


def test_the_port_is_held_exclusively(server):
    first, second = SerialTransport(server.path), SerialTransport(server.path)
    first.open()
    with pytest.raises(DeviceDisconnected, match="exclusively lock"):
        second.open()
    first.close()
    second.open()
    assert second.query(b"mine?\n", 5.0) == b"mine?"
    second.close()


@pytest.mark.parametrize("baud_rate", [9600, 115200])
def test_baud_rate_and_hardware_handshake_reach_the_port(server, baud_rate):
    import termios

    transport = SerialTransport(server.path, baud_rate, rtscts=True)
    transport.open()
    descriptor = os.open(server.terminal, os.O_RDWR | os.O_NOCTTY)
    _, _, cflag, _, input_speed, output_speed, _ = termios.tcgetattr(descriptor)
    os.close(descriptor)
    assert input_speed == output_speed == getattr(termios, f"B{baud_rate}")
    assert cflag & termios.CRTSCTS
    assert cflag & termios.CSIZE == termios.CS8
    assert not cflag & (termios.PARENB | termios.CSTOPB)
    transport.close()


def test_a_line_that_does_not_exist_is_said_to_be_missing(server):
    transport = SerialTransport(server.path)
    with pytest.raises(DeviceDisconnected, match="not open"):
        transport.set_rts(True)
    transport.open()
    assert transport.set_rts(True) is False
    assert transport.query(b"alive?\n", 5.0) == b"alive?"
    transport.close()


def test_a_wrong_baud_rate_is_refused_at_open(server):
    with pytest.raises(DeviceDisconnected, match="cannot be opened"):
        SerialTransport(server.path, -1).open()


def test_without_a_marker_a_late_answer_is_waited_out(server):
    transport = SerialTransport(server.path, settle_s=0.4)
    transport.open()
    with pytest.raises(DeviceTimeout):
        transport.query(b"late?\n", 0.02)
    assert transport.query(b"mine?\n", 5.0) == b"mine?"
    transport.close()


def test_questions_with_less_time_than_the_line_needs_to_settle_come_through_in_the_end(server):
    """As an interlock box is asked: each try settled from the beginning, and after one late answer
    all failed.
    """
    transport = SerialTransport(server.path, settle_s=0.25)
    transport.open()
    with pytest.raises(DeviceTimeout):
        transport.query(b"late?\n", 0.02)
    answers = []
    for _ in range(100):
        try:
            answers.append(transport.query(b"mine?\n", 0.1))
            break
        except DeviceTimeout:
            assert transport.dirty
    assert answers == [b"mine?"]
    transport.close()


def test_the_scpi_marker_finds_the_place_again_without_an_error_in_the_queue():
    with SerialServer(Simulated33220A(IMMEDIATE)) as server:
        transport = SerialTransport(server.path, marker=scpi_marker)
        transport.open()
        transport.write(b"FREQ 250\n")
        transport.write(b"FREQ?;VOLT?\n")
        transport.mark_dirty()
        for _ in range(20):
            assert transport.query(b"FREQ?\n", 5.0) == b"+2.5000000000000E+02"
            transport.mark_dirty()
        assert transport.query(b"SYST:ERR?\n", 5.0) == b'+0,"No error"'
        transport.close()


def test_a_marker_that_is_not_answered_is_reported(server):
    transport = SerialTransport(
        server.path,
        marker=lambda number: (b"a?\n" * 600, b"b"),
        bounds=Bounds(max_reply_bytes=1000),
    )
    transport.open()
    with pytest.raises(BadReply, match="does not answer"):
        transport.clear()
    assert transport.dirty
    transport.close()


def test_an_adapter_that_was_pulled_and_put_back_is_found_again(server, tmp_path):
    adapter = tmp_path / "adapter"
    controller, terminal = os.openpty()
    adapter.symlink_to(os.ttyname(terminal))
    transport = SerialTransport(str(adapter))
    transport.open()
    os.close(controller)
    os.close(terminal)
    adapter.unlink()
    with pytest.raises(DeviceDisconnected):
        transport.query(b"x?\n", 1.0)
    with pytest.raises(DeviceDisconnected, match="cannot be opened"):
        transport.query(b"x?\n", 1.0)
    adapter.symlink_to(server.terminal)
    assert transport.query(b"y?\n", 5.0) == b"y?"
    transport.close()


def test_a_device_that_takes_nothing_is_a_timeout():
    controller, terminal = os.openpty()  # nobody reads the controller's side
    transport = SerialTransport(os.ttyname(terminal), bounds=Bounds(write_timeout_s=0.1))
    transport.open()
    with pytest.raises(DeviceTimeout, match="did not take the command"):
        transport.write(bytes(1_000_000))
    transport.close()
    os.close(controller)
    os.close(terminal)
