"""What a query through our TCP transport costs over the same bytes on a bare socket, interleaved in
one run.
"""

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

# In a process of its own, as an instrument is; it sends back what it gets. One thread serves both
# connections: with a thread each, the system may run them on different cores, and which of the two
# then sits on the client's own core or on one that is awake is luck, and weighs more than the
# query. So the server's share, wherever its thread is at the time, is the same for both. Pinning
# both ends to one core gives the same ratio, where a system can do that at all.
ECHO_SERVER = """
import selectors, socket
ready = selectors.DefaultSelector()
server = socket.create_server(("127.0.0.1", 0))
ready.register(server, selectors.EVENT_READ)
print(server.getsockname()[1], flush=True)
while True:
    for key, _ in ready.select():
        if key.fileobj is server:
            connection = server.accept()[0]
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            ready.register(connection, selectors.EVENT_READ)
        elif data := key.fileobj.recv(65536):
            key.fileobj.sendall(data)
        else:
            ready.unregister(key.fileobj)
            key.fileobj.close()
"""


@contextmanager
def echo_server() -> Iterator[int]:
    with subprocess.Popen(
        [sys.executable, "-c", ECHO_SERVER], stdout=subprocess.PIPE, text=True
    ) as process:
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

        # In turns, one query each; the lower quartile is the cost when nothing else had the
        # processor.
        times_s = [
            (once_s(on_bare_socket), once_s(lambda: transport.query(LINE, 1.0)))
            for _ in range(QUERIES)
        ]
        transport.close()
    bare_s, ours_s = (statistics.quantiles(times, n=4)[0] for times in zip(*times_s, strict=True))
    yield Claim(
        "query over TCP against a bare socket round trip",
        f"{ours_s / bare_s:.2f} x ({1e6 * ours_s:.1f} us against {1e6 * bare_s:.1f} us)",
        "at most 1.5 x",
        ours_s <= 1.5 * bare_s,
    )
