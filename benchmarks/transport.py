"""What a query through our TCP transport costs over the same bytes on a bare socket, interleaved in one run."""

from __future__ import annotations

import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from benchmarks.claim import Claim
from hw.transport.tcp import TcpTransport

LINE = b"FREQ +2.5000000000000E+02\n"
QUERIES = 20_000

# In a process of its own, as an instrument is; it sends back what it gets, so the server's share is the same for all.
ECHO_SERVER = """
import socket, threading
def echo(connection):
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    while data := connection.recv(65536):
        connection.sendall(data)
server = socket.create_server(("127.0.0.1", 0))
print(server.getsockname()[1], flush=True)
while True:
    threading.Thread(target=echo, args=(server.accept()[0],), daemon=True).start()
"""


@contextmanager
def echo_server() -> Iterator[int]:
    with subprocess.Popen([sys.executable, "-c", ECHO_SERVER], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield int(process.stdout.readline())
        finally:
            process.terminate()


def once_s(function: Callable[[], object]) -> float:
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


def run() -> Iterator[Claim]:
    with echo_server() as port, socket.create_connection(("127.0.0.1", port)) as bare:
        bare.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        transport = TcpTransport("127.0.0.1", port)
        transport.open()

        def on_bare_socket() -> bytes:
            bare.sendall(LINE)
            answer = b""
            while not answer.endswith(b"\n"):
                answer += bare.recv(65536)
            return answer

        # In turns, one query each; the lower quartile is the cost when nothing else had the processor.
        times_s = [(once_s(on_bare_socket), once_s(lambda: transport.query(LINE, 1.0))) for _ in range(QUERIES)]
        transport.close()
    bare_s, ours_s = (statistics.quantiles(times, n=4)[0] for times in zip(*times_s, strict=True))
    yield Claim(
        "query over TCP against a bare socket round trip",
        f"{ours_s / bare_s:.2f} x ({1e6 * ours_s:.1f} us against {1e6 * bare_s:.1f} us)",
        "at most 1.5 x",
        ours_s <= 1.5 * bare_s,
    )
