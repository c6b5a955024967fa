import socket
import threading

import pytest

from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.serving.tcp import TcpServer

pytestmark = pytest.mark.timeout(30)


def test_connections_share_one_instrument():
    with TcpServer(Simulated33220A()) as server:
        address = (server.host, server.port)
        with (
            socket.create_connection(address, 5.0) as one,
            socket.create_connection(address, 5.0) as two,
        ):
            one.sendall(b"FREQ 250;*OPC?\n")
            assert one.makefile("rb").readline() == b"1\n"
            two.sendall(b"FREQ?\n")
            assert two.makefile("rb").readline() == b"+2.5000000000000E+02\n"


def test_an_unfinished_line_is_not_carried_out():
    generator = Simulated33220A()
    with (
        TcpServer(generator) as server,
        socket.create_connection((server.host, server.port), 5.0) as client,
    ):
        client.sendall(b"FREQ 250")
        client.shutdown(socket.SHUT_WR)
        assert client.recv(1) == b""  # the server has seen the end
    assert generator.handle(b"FREQ?\n") == b"+1.0000000000000E+03\n"


def test_closing_hangs_up_ends_the_threads_and_frees_the_port():
    before = threading.active_count()
    server = TcpServer(Simulated33220A())
    server.start()
    with socket.create_connection((server.host, server.port), 5.0) as client:
        client.sendall(b"*IDN?\n")
        assert client.recv(100)
        server.close()
        assert client.recv(100) == b""
    assert threading.active_count() == before
    again = TcpServer(Simulated33220A(), server.port)
    again.close()
