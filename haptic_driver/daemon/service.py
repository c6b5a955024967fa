"""Messages to systemd: ready, alive while ticks advance, stopping; nothing where it did not start
us.
"""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from haptic_driver.processes.started import start_thread


def notify(message: str) -> None:
    """Send one message such as `READY=1` to who started us (sd_notify(3)); does nothing when nobody
    listens.
    """
    address = os.environ.get("NOTIFY_SOCKET", "")
    if address[:1] not in ("/", "@"):
        return
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender, suppress(OSError):
        sender.connect("\0" + address[1:] if address.startswith("@") else address)
        sender.sendall(message.encode())


@contextmanager
def as_service(ticks: Callable[[], int]) -> Iterator[None]:
    """Ready inside, stopping afterwards; pats systemd's watchdog, if it asked for that, while
    `ticks()` advances.
    """
    ending = threading.Event()
    period_s = watchdog_period_s()
    notify("READY=1")
    patting = [start_thread("pat", _pat, ticks, period_s, ending)] if period_s is not None else []
    try:
        yield
    finally:
        notify("STOPPING=1")
        ending.set()
        for thread in patting:
            thread.join()


def watchdog_period_s() -> float | None:
    """Time between pats, half of what systemd waits for (sd_watchdog_enabled(3)); None when it does
    not wait for us.
    """
    microseconds, pid = (
        os.environ.get("WATCHDOG_USEC", ""),
        os.environ.get("WATCHDOG_PID", str(os.getpid())),
    )
    if not microseconds.isdecimal() or int(microseconds) == 0 or pid != str(os.getpid()):
        return None
    return int(microseconds) / 2e6


def _pat(ticks: Callable[[], int], period_s: float | None, ending: threading.Event) -> None:
    before = ticks()
    while not ending.wait(period_s):
        now = ticks()
        if now != before:
            notify("WATCHDOG=1")
        before = now
