"""Serves a simulated instrument on a loopback TCP port, as a LAN instrument's socket does."""

from __future__ import annotations

import socket
import socketserver
import threading
from contextlib import suppress
from typing import Any

from hw.serving.framing import MessageFramer
from hw.serving.responder import Disconnect, Responder
from hw.transport.running import Running

_CHUNK_BYTES = 1 << 16
_POLL_S = 0.05


class TcpServer(Running):
    r"""One instrument on 127.0.0.1, any number of connections, a thread each; messages end with
    `\n`.

    The port is bound when the object is made (`port` 0: a free one); it answers between `start` and
    `close`, or inside a `with` block.
    """

    def __init__(self, core: Responder, port: int = 0) -> None:
        self._server = _Server(core, port)
        self.host, self.port = "127.0.0.1", int(self._server.server_address[1])
        self.resource = f"TCPIP::{self.host}::{self.port}::SOCKET"
        self._thread = threading.Thread(
            target=self._server.serve_forever,
            args=(_POLL_S,),
            name=f"serve {self.resource}",
            daemon=True,
        )

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """Hang up on everyone and free the port; returns when all threads have ended."""
        if self._thread.is_alive():
            self._server.shutdown()
            self._thread.join()
        self._server.hang_up()
        self._server.server_close()


class _Server(socketserver.ThreadingTCPServer):
    allow_reuse_address = True

    def __init__(self, core: Responder, port: int) -> None:
        self.core = core
        self._connections: dict[Any, threading.Thread] = {}
        self._lock = threading.Lock()
        super().__init__(("127.0.0.1", port), _Connection)

    def process_request(self, request: Any, client_address: Any) -> None:
        # A daemon, so that a server left open never keeps the interpreter alive; `hang_up` waits
        # for it.
        thread = threading.Thread(
            target=self.process_request_thread, args=(request, client_address), daemon=True
        )
        with self._lock:
            self._connections[request] = thread
        thread.start()

    def shutdown_request(self, request: Any) -> None:
        with self._lock:
            self._connections.pop(request, None)
            super().shutdown_request(request)

    def hang_up(self) -> None:
        with self._lock:
            connections = dict(self._connections)
            for connection in connections:
                with suppress(OSError):
                    connection.shutdown(socket.SHUT_RDWR)
        for thread in connections.values():
            thread.join()


class _Connection(socketserver.BaseRequestHandler):
    server: _Server

    def setup(self) -> None:
        self.request.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, True)

    def handle(self) -> None:
        framer = MessageFramer()
        with suppress(OSError):  # the client is gone or sends no message, or close() was called
            while data := self.request.recv(_CHUNK_BYTES):
                for message in framer.feed(data):
                    try:
                        self.request.sendall(self.server.core.handle(message))
                    except Disconnect as goodbye:
                        self.request.sendall(goodbye.sent)
                        return
