from __future__ import annotations

import pytest

from hw.errors import DeviceDisconnected
from hw.transport.tcp import TcpTransport
from tests.hw.instruments import closed_port


def test_a_refused_connection_is_a_disconnect_at_open() -> None:
    port = closed_port()
    with pytest.raises(
        DeviceDisconnected, match=f"TCPIP::127.0.0.1::{port}::SOCKET cannot be reached"
    ):
        TcpTransport("127.0.0.1", port).open()


def test_resource_strings_are_read_and_written_alike() -> None:
    assert (
        TcpTransport.from_resource("TCPIP0::192.0.2.7::5025::SOCKET").resource
        == "TCPIP::192.0.2.7::5025::SOCKET"
    )


@pytest.mark.parametrize("host", ["two..dots", "x" * 70])
def test_a_name_that_no_host_can_have_is_a_disconnect_at_open(host: str) -> None:
    with pytest.raises(DeviceDisconnected, match="cannot be reached"):
        TcpTransport(host, 5025).open()


@pytest.mark.parametrize("port", ["0", "65536", "70000"])
def test_a_port_that_does_not_exist_is_refused_and_not_taken_modulo_65536(port: str) -> None:
    with pytest.raises(ValueError, match=r"must be 1\.\.65535"):
        TcpTransport.from_resource(f"TCPIP::127.0.0.1::{port}::SOCKET")


@pytest.mark.parametrize(
    "resource", ["USB0::1::2::INSTR", "TCPIP::host::INSTR", "", "TCPIP::h::5025::SOCKET::x"]
)
def test_other_resources_are_refused(resource: str) -> None:
    with pytest.raises(ValueError, match="TCPIP::host::port::SOCKET"):
        TcpTransport.from_resource(resource)
