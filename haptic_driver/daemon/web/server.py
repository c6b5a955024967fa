"""Where the API is served: a Unix socket for this user, and loopback TCP behind a token for the
page.
"""

from __future__ import annotations

import asyncio
import secrets
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import uvicorn
from starlette.types import ASGIApp

from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.place import Place
from haptic_driver.daemon.private_file import write_private
from haptic_driver.daemon.web import connections
from haptic_driver.daemon.web.api import PAGE, create_app
from haptic_driver.daemon.web.connections import MOST_CONNECTIONS, Connection, OffLane, Streamed
from haptic_driver.daemon.web.door import Door
from haptic_driver.daemon.web.security import AtMost, TokenGate
from haptic_driver.errors import HapticError

LOOPBACK = "127.0.0.1"
START_TIMEOUT_S = 20.0
STARTED_POLL_S = 0.005
GRACE_S = 1  # for requests under way when the server ends
MOST_MESSAGE_BYTES = 4096  # of a WebSocket client, which has little to say


@contextmanager
def serve(
    daemon: Daemon, place: Place, tcp_port: int | None = None, page: Path | None = None
) -> Iterator[str | None]:
    """Serve in a thread inside the `with` block; gives the page's address with its token, None
    without TCP.

    At `place` whoever may open the socket may use the API. With `tcp_port` (0: any that is free) it
    is on loopback too, for those who know the token, which is also in a file of mode 0600 beside
    the socket. Raises HapticError when a port cannot be had.
    """
    lane = OffLane(daemon)
    servers, url, token_file = (
        [(_server(create_app(daemon, page), lane), place.listener)],
        None,
        None,
    )
    if tcp_port is not None:
        listener = listen(tcp_port)
        token, port = secrets.token_urlsafe(24), listener.getsockname()[1]
        token_file = place.path.with_name(place.path.name + ".token")
        hosts = frozenset({f"{LOOPBACK}:{port}", f"localhost:{port}"})
        gate = TokenGate(
            AtMost(create_app(daemon, page), MOST_CONNECTIONS), token, hosts, PAGE + "/"
        )
        servers.append((_server(gate, gate=gate), listener))
        url = f"http://{LOOPBACK}:{port}{PAGE}/?token={token}"
        write_private(token_file, token + "\n")
    try:
        with _running(servers):
            yield url
    finally:
        if token_file is not None:
            token_file.unlink(missing_ok=True)
        lane.close()


@contextmanager
def _running(servers: list[tuple[uvicorn.Server, socket.socket]]) -> Iterator[None]:
    """Each in a thread and an event loop of its own: what crowds one keeps nobody waiting at the
    other.
    """

    def run(server: uvicorn.Server, listener: socket.socket) -> None:
        asyncio.run(server.serve(sockets=[listener]))

    threads = [threading.Thread(target=run, args=one, name="api", daemon=True) for one in servers]
    for thread in threads:
        thread.start()
    try:
        until_s = time.monotonic() + START_TIMEOUT_S
        while not all(server.started for server, _ in servers):
            if not all(thread.is_alive() for thread in threads) or time.monotonic() > until_s:
                raise HapticError("no_api", "the API could not be started", "look at the log")
            time.sleep(STARTED_POLL_S)
        yield
    finally:
        for server, _ in servers:
            server.should_exit = True
        for thread in threads:
            thread.join()
        for _, listener in servers:
            listener.close()


class BehindDoor(uvicorn.Server):
    """A server to whom connections come through a `Door`."""

    token: str
    _door: Door

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        assert sockets is not None
        await super().startup([])
        self._door = Door(sockets[0], self.token, self._made, lambda: connections.HEADERS_TIMEOUT_S)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._door.close()
        await super().shutdown(sockets)

    def _made(self, begun: bytes) -> Connection:
        made: Any = self.config.http_protocol_class
        connection: Connection = made(self.config, self.server_state, self.lifespan.state)
        connection.begun = begun
        return connection


def _server(
    app: ASGIApp, lane: OffLane | None = None, gate: TokenGate | None = None
) -> uvicorn.Server:
    said: dict[str, Any] = {"lane": lane, "gate": gate, "strangers": {}}
    server: type[uvicorn.Server] = uvicorn.Server
    if gate is not None:
        server = type("BehindIts", (BehindDoor,), {"token": gate.token})
    return server(
        uvicorn.Config(
            app,
            http=type("Listened", (Connection,), said),
            backlog=MOST_CONNECTIONS,  # so many are accepted in one go
            log_config=None,
            log_level="warning",
            access_log=False,  # addresses hold tokens
            lifespan="off",
            loop="asyncio",
            ws=Streamed,
            ws_max_size=MOST_MESSAGE_BYTES,
            ws_per_message_deflate=False,  # it would cost time, and no byte leaves this machine
            proxy_headers=False,
            server_header=False,
            timeout_graceful_shutdown=GRACE_S,
        )
    )


def listen(port: int) -> socket.socket:
    """A loopback socket at a port, 0: any that is free. Raises HapticError when it cannot be
    had.
    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((LOOPBACK, port))
    except OSError as error:
        listener.close()
        raise HapticError(
            "no_port", f"{LOOPBACK} port {port}: {error.strerror}", "choose another --port"
        ) from error
    return listener
