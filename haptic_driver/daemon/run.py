"""The daemon from start to end: its place, its processes, its API, what systemd hears."""

from __future__ import annotations

import logging
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path

from haptic_driver.daemon.control_process import SWITCH_INTERVAL_S, Daemon
from haptic_driver.daemon.processes import Place, default_socket
from haptic_driver.daemon.server import serve
from haptic_driver.daemon.service import as_service
from haptic_driver.daemon.set_up import DaemonSettings, daemon_settings

PAGE_FOLDER = Path(__file__).with_name("dashboard")

_log = logging.getLogger(__name__)


def run_daemon(
    rig: str,
    socket: Path | None,
    model: str,
    allow_no_rt: bool,
    tcp_port: int | None,
    amplifier_record: Path | None = None,
    announce: Callable[[Path, str | None], None] = lambda socket, page: None,
) -> int:
    """Run a daemon until SIGTERM or SIGINT; exit status 0 when the output is known to be off at the end.

    `announce` is called once it can be used, with its socket and the address of its page, which holds the token.
    Raises HapticError when it does not get that far.
    """
    ended = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, frame: ended.set())
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    place = Place(socket or default_socket())
    try:
        settings = daemon_settings(rig, model, allow_no_rt=allow_no_rt, amplifier_record=amplifier_record)
        return 0 if _serve_until(ended, settings, place, tcp_port, announce) is False else 1
    finally:
        place.close()


def _serve_until(
    ended: threading.Event,
    settings: DaemonSettings,
    place: Place,
    tcp_port: int | None,
    announce: Callable[[Path, str | None], None],
) -> bool | None:
    """Whether the output is on at the end; None: unknown."""
    daemon = Daemon(settings)
    daemon.start()
    try:
        page_folder = PAGE_FOLDER if PAGE_FOLDER.is_dir() else None
        with serve(daemon, place, tcp_port, page=page_folder) as page, as_service(lambda: daemon.status().ticks):
            _log.info("ready at %s; processes %s", place.path, daemon.pids)
            announce(place.path, page)
            ended.wait()
            daemon.disarm()  # before anything that takes time
    finally:
        output_on = daemon.close()
        said = {False: "off", True: "ON", None: "UNKNOWN"}[output_on]
        _log.log(logging.ERROR if output_on is not False else logging.INFO, "ended; the output is %s", said)
    return output_on
