from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest
import serial

from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.serving.serial import SerialServer
from tests.hw.instruments import IMMEDIATE
from tests.hw.testing.faulty_instrument import Fault, FaultyInstrument
from tests.waiting import HANG_S, until

pytestmark = pytest.mark.timeout(2 * HANG_S)


def generator() -> Simulated33220A:
    return Simulated33220A(IMMEDIATE)


def test_unplugging_ends_the_port_and_the_path_leads_to_a_new_one():
    faulty = FaultyInstrument(generator())
    with SerialServer(faulty) as server:
        faulty.inject(Fault.DISCONNECT)
        with serial.Serial(server.path, timeout=5.0) as port:
            port.write(b"*IDN?\n")
            with pytest.raises(serial.SerialException):
                port.read(1000)  # half an answer, and then not even silence
        with serial.Serial(server.path, timeout=5.0) as port:
            port.write(b"*OPC?\n")
            assert port.readline() == b"1\n"


def test_closing_ends_the_thread_and_removes_the_path():
    before = threading.active_count(), len(os.listdir("/proc/self/fd"))
    server = SerialServer(generator())
    server.start()
    assert Path(server.path).exists()
    server.close()
    assert not Path(server.path).exists()
    assert (threading.active_count(), len(os.listdir("/proc/self/fd"))) == before


def test_closing_does_not_wait_for_a_client_who_does_not_read():
    class Babble:
        def handle(self, data: bytes) -> bytes:
            return bytes(10_000_000)

    server = SerialServer(Babble())
    server.start()
    with serial.Serial(server.path, timeout=5.0) as port:
        port.write(b"go\n")
        until(lambda: port.in_waiting)
        server.close()
