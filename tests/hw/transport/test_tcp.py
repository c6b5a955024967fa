from __future__ import annotations

import socket
import threading

import pytest

from hw.errors import DeviceDisconnected, DeviceTimeout
from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.serving.tcp import TcpServer
from hw.transport.contract import Bounds, Transport
from hw.transport.tcp import TcpTransport
from hw.transport.visa import VisaTransport
from tests.hw.instruments import IMMEDIATE
from tests.hw.testing.faulty_instrument import Fault, FaultyInstrument


@pytest.mark.parametrize("host", ["two..dots", "x" * 70])
def test_a_name_that_no_host_can_have_is_a_disconnect_at_open(host):
    with pytest.raises(DeviceDisconnected, match="cannot be reached"):
        TcpTransport(host, 5025).open()


@pytest.mark.parametrize("port", ["0", "65536", "70000"])
def test_a_port_that_does_not_exist_is_refused_and_not_taken_modulo_65536(port):
    with pytest.raises(ValueError, match=r"must be 1\.\.65535"):
        TcpTransport.from_resource(f"TCPIP::127.0.0.1::{port}::SOCKET")


@pytest.fixture
def silent(monkeypatch):
    """Makes the name server silent for whoever asks from now on, and says who did."""
    asked: list[str] = []
    over = threading.Event()

    def hang(host: str, *_: object, **__: object) -> None:
        asked.append(host)
        over.wait()
        raise socket.gaierror("too late")

    monkeypatch.setattr(socket, "getaddrinfo", hang)
    yield asked
    over.set()


def test_a_name_server_that_is_silent_is_a_timeout_at_open(silent):
    bounds = Bounds(open_timeout_s=0.05)
    for transport in (
        TcpTransport("generator.lab", 5025, bounds=bounds),
        VisaTransport("TCPIP::generator.lab::inst0::INSTR", bounds=bounds),
    ):
        with pytest.raises(DeviceTimeout):
            transport.open()
    assert silent == ["generator.lab", "generator.lab"]


def test_a_name_is_resolved_once_however_often_the_connection_is_lost(request):
    """OFF once waited 12 s for a name server that was silent, with 80 V on the electrode."""
    core = FaultyInstrument(Simulated33220A(IMMEDIATE))

    def asks(transport: Transport) -> bool:
        return b"33220A" in transport.query(b"*IDN?\n", 5.0)

    with TcpServer(core) as server:
        transport = TcpTransport("localhost", server.port)
        transport.open()
        assert asks(transport)
        asked = request.getfixturevalue("silent")
        core.inject(Fault.DISCONNECT, count=1)
        with pytest.raises(DeviceDisconnected):
            asks(transport)
        assert asks(transport)
        transport.close()
        transport.open()
        assert asks(transport)
        transport.close()
    assert asked == []


def test_a_visa_resource_gets_the_address_of_its_host(monkeypatch):
    found = [(socket.AF_INET, socket.SOCK_STREAM, 6, "", ("192.0.2.7", 0))]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_: found)
    for name, address in (
        ("TCPIP::generator.lab::inst0::INSTR", "TCPIP::192.0.2.7::inst0::INSTR"),
        ("TCPIP0::generator.lab,5000::INSTR", "TCPIP0::192.0.2.7,5000::INSTR"),
        ("GPIB0::10::INSTR", "GPIB0::10::INSTR"),
    ):
        assert VisaTransport(name)._resolved(float("inf")) == address
