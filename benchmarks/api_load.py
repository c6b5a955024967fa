"""What a daemon's clients ask of it, from a process of its own: requests at a steady rate, and its
page open.

    python -m benchmarks.api_load SOCKET PAGE LEASE SECONDS

says on standard output when the load is on, and in the end what it was.
"""

from __future__ import annotations

import http.client
import json
import shutil
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from websockets.sync.client import unix_connect

from haptic_driver.daemon.messages import LEASE_HEADER

RATE_HZ, CONNECTIONS = 200.0, 4
MIX = [  # of a client that watches, one that records by itself, and the holder of the lease
    ("GET", "/status"),
    ("GET", "/samples?most=50"),
    ("POST", "/renew"),
    ("GET", "/status"),
    ("GET", "/events"),
]
TIMEOUT_S = 20.0
CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)


class UnixConnection(http.client.HTTPConnection):
    def __init__(self, path: str) -> None:
        super().__init__("haptic", timeout=TIMEOUT_S)
        self._path = path

    def connect(self) -> None:
        self.sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.sock.settimeout(TIMEOUT_S)
        self.sock.connect(self._path)


class Requests(threading.Thread):
    """One connection's share of the requests, at instants that do not wait for the answers."""

    def __init__(self, path: str, lease: str, first_s: float, end_s: float) -> None:
        super().__init__()
        self._path, self._lease, self._first_s, self._end_s = path, lease, first_s, end_s
        self.answered = self.refused = 0

    def run(self) -> None:
        connection, k = UnixConnection(self._path), 0
        while (at_s := self._first_s + k * CONNECTIONS / RATE_HZ) < self._end_s:
            time.sleep(max(at_s - time.monotonic(), 0.0))
            method, path = MIX[k % len(MIX)]
            connection.request(method, path, headers={LEASE_HEADER: self._lease})
            answer = connection.getresponse()
            answer.read()
            self.answered += 1
            self.refused += answer.status != 200
            k += 1
        connection.close()


@contextmanager
def page_open(path: str, page: str) -> Iterator[tuple[str, list[int]]]:
    """Who looks at the page, and how many messages have come so far, in a list of one."""
    received = [0]

    def count(_: object = None) -> None:
        received[0] += 1

    if CHROMIUM is None or find_spec("playwright") is None:
        with unix_connect(path, "ws://haptic/state") as state:
            listener = threading.Thread(target=lambda: [count() for _ in state])
            listener.start()
            yield "a WebSocket client in place of a browser", received
            state.close()
            listener.join()
        return
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - only where it is installed

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        tab = browser.new_page()
        tab.on("websocket", lambda opened: opened.on("framereceived", count))
        tab.goto(page)
        tab.wait_for_timeout(2000)
        yield "headless Chromium", received
        tab.wait_for_timeout(1)  # hands over what came meanwhile
        browser.close()


def main() -> None:
    path, page, lease, seconds = sys.argv[1], sys.argv[2], sys.argv[3], float(sys.argv[4])
    with page_open(path, page) as (viewer, received):
        began_s = time.monotonic()
        workers = [
            Requests(path, lease, began_s + i / RATE_HZ, began_s + seconds)
            for i in range(CONNECTIONS)
        ]
        for worker in workers:
            worker.start()
        print("on", flush=True)
        for worker in workers:
            worker.join()
        elapsed_s = time.monotonic() - began_s
    answered, refused = (sum(getattr(w, what) for w in workers) for what in ("answered", "refused"))
    report = {
        "viewer": viewer,
        "requests_hz": answered / elapsed_s,
        "refused": refused,
        "messages": received[0],
    }
    print(json.dumps(report), flush=True)


if __name__ == "__main__":
    main()
