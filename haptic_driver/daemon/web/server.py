"""Where the API is served: a Unix socket for this user, and loopback TCP behind a token for the
page.
"""

from __future__ import annotations

import asyncio
import secrets
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import uvicorn
from starlette.middleware.cors import CORSMiddleware

from haptic_driver.daemon.address import LOOPBACK, listen
from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.messages import LEASE_HEADER
from haptic_driver.daemon.place import Place
from haptic_driver.daemon.private_file import LEAST_TOKEN, write_private
from haptic_driver.daemon.web.api import PAGE, create_app
from haptic_driver.daemon.web.door import Door, Handed
from haptic_driver.daemon.web.off import OffThreads
from haptic_driver.daemon.web.security import AtMost, OneRequest, TokenGate
from haptic_driver.errors import HapticError
from haptic_driver.processes.patience import join_within
from haptic_driver.processes.started import start_thread

MOST_AT_ONCE = 64  # requests and streams
START_TIMEOUT_S = 20.0
STARTED_POLL_S = 0.005
GRACE_S = 1  # for requests under way when the server ends
END_S = 5.0  # at most for a web server that hangs
MOST_MESSAGE_BYTES = 256 * 1024  # of a WebSocket client: hundreds of objects of a scene at once


class _Served(NamedTuple):
    """One address: its door, and the web server behind."""

    listener: socket.socket
    door: Door
    handed: Handed
    server: uvicorn.Server

    def answer(self) -> None:
        asyncio.run(self._answer())

    async def _answer(self) -> None:
        cutting = asyncio.create_task(self.handed.cut_unread())
        await self.server.serve(sockets=[self.handed])
        cutting.cancel()

    def close(self) -> None:
        self.handed.close()
        self.listener.close()


@contextmanager
def serve(
    daemon: Daemon,
    place: Place,
    tcp_port: int | None = None,
    page: Path | None = None,
    origins: frozenset[str] = frozenset(),
    token: str | None = None,
) -> Iterator[str | None]:
    """Serve in threads inside the `with` block; gives the page's address with its token, None
    without TCP.

    At `place` whoever may open the socket may use the API. With `tcp_port` (0: any that is free) it
    is on loopback too, for those who know the token, and for pages of `origins` that do. The token,
    a new one by default, is also in a file of mode 0600 beside the socket. Raises HapticError when
    a port cannot be had.
    """
    listener = None if tcp_port is None else listen(tcp_port)
    off = OffThreads(daemon)
    app = AtMost(create_app(daemon, page, off), MOST_AT_ONCE)
    served, url, token_file = [_served(place.listener, app, off)], None, None
    if listener is not None:
        token = secrets.token_urlsafe(LEAST_TOKEN) if token is None else token
        port = listener.getsockname()[1]
        token_file = place.path.with_name(place.path.name + ".token")
        hosts = frozenset({f"{LOOPBACK}:{port}", f"localhost:{port}"})
        app = AtMost(create_app(daemon, page, off), MOST_AT_ONCE)
        served.append(_served(listener, TokenGate(app, token, hosts, PAGE + "/", origins), off))
        url = f"http://{LOOPBACK}:{port}{PAGE}/?token={token}"
        write_private(token_file, token + "\n")
    try:
        with _running(served):
            yield url
    finally:
        if token_file is not None:
            token_file.unlink(missing_ok=True)
        off.close()


def _served(listener: socket.socket, app: TokenGate | AtMost, off: OffThreads) -> _Served:
    handed = Handed()
    gate = app if isinstance(app, TokenGate) else None
    door = Door(listener, gate, off, handed)
    config = uvicorn.Config(
        OneRequest(app if gate is None or not gate.origins else _with_cors(gate)),
        http="h11",
        log_config=None,
        log_level="warning",
        access_log=False,  # addresses hold tokens
        lifespan="off",
        loop="asyncio",  # it accepts by calling `Handed.accept`
        ws="websockets-sansio",
        ws_max_size=MOST_MESSAGE_BYTES,
        ws_per_message_deflate=False,  # it would cost time, and no byte leaves this machine
        proxy_headers=False,
        server_header=False,
        timeout_graceful_shutdown=GRACE_S,
    )
    return _Served(listener, door, handed, uvicorn.Server(config))


def _with_cors(gate: TokenGate) -> CORSMiddleware:
    """A browser asks first whether a page of another origin may send a token, and read answers."""
    return CORSMiddleware(
        gate,
        allow_origins=sorted(gate.origins),
        allow_methods=["GET", "POST"],
        allow_headers=["Authorization", "Content-Type", LEASE_HEADER],
    )


@contextmanager
def _running(served: list[_Served]) -> Iterator[None]:
    """Each door and each server in a thread of its own.

    A crowd at the port keeps no lease from being renewed over the socket. The doors end last.
    """
    doors = [start_thread("door", one.door.run) for one in served]
    servers = [start_thread("api", one.answer) for one in served]
    try:
        until_s = time.monotonic() + START_TIMEOUT_S
        while not all(one.server.started for one in served):
            if not all(thread.is_alive() for thread in servers) or time.monotonic() > until_s:
                raise HapticError("no_api", "the API could not be started", "look at the log")
            time.sleep(STARTED_POLL_S)
        yield
    finally:
        for one in served:
            one.server.should_exit = True
        join_within(END_S, servers)
        for one in served:
            one.door.close()
        join_within(END_S, doors)
        for one in served:
            one.close()
