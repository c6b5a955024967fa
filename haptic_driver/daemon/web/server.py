"""Where the API is served: a Unix socket for this user, and loopback TCP behind a token for the page."""

from __future__ import annotations

import asyncio
import secrets
import socket
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path

import uvicorn
from starlette.types import ASGIApp

from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.place import Place
from haptic_driver.daemon.private_file import write_private
from haptic_driver.daemon.web.api import PAGE, create_app
from haptic_driver.daemon.web.connections import MOST_CONNECTIONS, Connection, OffLane
from haptic_driver.daemon.web.security import TokenGate
from haptic_driver.errors import HapticError

LOOPBACK = "127.0.0.1"
START_TIMEOUT_S = 20.0
STARTED_POLL_S = 0.005
TICK_S = 0.1  # of uvicorn
LET_IN_S = 0.005  # for a connection that was just accepted to be known
GRACE_S = 1  # for requests under way when the server ends
MOST_MESSAGE_BYTES = 4096  # of a WebSocket client, which has nothing to say


@contextmanager
def serve(daemon: Daemon, place: Place, tcp_port: int | None = None, page: Path | None = None) -> Iterator[str | None]:
    """Serve in a thread inside the `with` block; gives the page's address with its token, None without TCP.

    At `place` whoever may open the socket may use the API. With `tcp_port` (0: any that is free) it is on loopback too,
    for those who know the token, which is also in a file of mode 0600 beside the socket. Raises HapticError when a port
    cannot be had.
    """
    lane = OffLane(daemon)
    servers, url, token_file = [(_server(create_app(daemon, page), lane), place.listener)], None, None
    if tcp_port is not None:
        listener = listen(tcp_port)
        token, port = secrets.token_urlsafe(24), listener.getsockname()[1]
        token_file = place.path.with_name(place.path.name + ".token")
        hosts = frozenset({f"{LOOPBACK}:{port}", f"localhost:{port}"})
        gate = TokenGate(create_app(daemon, page), token, hosts, PAGE + "/")
        servers.append((_server(gate), listener))
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
def _running(servers: list[tuple[_Server, socket.socket]]) -> Iterator[None]:
    """Each in a thread and an event loop of its own: what crowds one keeps nobody waiting at the other."""

    def run(server: _Server, listener: socket.socket) -> None:
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
            server.end()
        for thread in threads:
            thread.join()
        for _, listener in servers:
            listener.close()


class _Server(uvicorn.Server):
    """Ends as soon as it is told to; uvicorn looks every tenth of a second, and waits for one where nobody is left."""

    def __init__(self, config: uvicorn.Config) -> None:
        super().__init__(config)
        self._told: Future[None] = Future()

    def end(self) -> None:
        """From any thread."""
        self.should_exit = True
        self._told.set_result(None)

    async def main_loop(self) -> None:
        """Until it is told to end."""
        told, ticks = asyncio.wrap_future(self._told), 0
        while not await self.on_tick(ticks):  # every tenth renews what responses say of the time
            ticks += 1
            await asyncio.wait([told], timeout=TICK_S)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Let requests under way end, where there are any."""
        for server in self.servers:
            server.close()
        await asyncio.sleep(LET_IN_S)
        if self.server_state.connections or self.server_state.tasks:
            await super().shutdown(sockets)


def _server(app: ASGIApp, off_lane: OffLane | None = None) -> _Server:
    class Listened(Connection):
        lane = off_lane

    return _Server(
        uvicorn.Config(
            app,
            http=Listened,
            backlog=MOST_CONNECTIONS,  # so many are accepted in one go
            log_config=None,
            log_level="warning",
            access_log=False,  # addresses hold tokens
            lifespan="off",
            loop="asyncio",
            ws="websockets-sansio",
            ws_max_size=MOST_MESSAGE_BYTES,
            proxy_headers=False,
            server_header=False,
            timeout_graceful_shutdown=GRACE_S,
        )
    )


def listen(port: int) -> socket.socket:
    """A loopback socket at a port, 0: any that is free. Raises HapticError when it cannot be had."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((LOOPBACK, port))
    except OSError as error:
        listener.close()
        raise HapticError("no_port", f"{LOOPBACK} port {port}: {error.strerror}", "choose another --port") from error
    return listener
