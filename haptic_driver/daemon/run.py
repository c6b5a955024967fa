"""The daemon from start to end: its place, its processes, its API, what systemd hears."""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import NamedTuple

from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.inlets import LslMarkers, hearing
from haptic_driver.daemon.outlets import LslOutlet, OscOutlet, Outlet, feeding
from haptic_driver.daemon.place import Place
from haptic_driver.daemon.service import as_service
from haptic_driver.daemon.set_up import DaemonSettings, daemon_settings
from haptic_driver.daemon.web.server import serve
from haptic_driver.processes.compilation import compilation_said
from haptic_driver.processes.real_time import settle_memory, take_precedence
from haptic_driver.rig.evidence import KnownOutput

KEEP_PERIOD_S = 1.0  # between looks at the socket's name
PAGE_FOLDER = Path(__file__).parent / "web" / "dashboard"

_log = logging.getLogger(__name__)


class Links(NamedTuple):
    """To other programs: samples and events as streams of the Lab Streaming Layer, and the same by
    OSC to HOST:PORT. Markers come from the LSL stream of that name. Pages of `origins` may use the
    API, with its token, which is a new one where `token` is None.
    """

    lsl: bool = False
    osc: str | None = None
    lsl_markers: str | None = None
    origins: frozenset[str] = frozenset()
    token: str | None = None


def run_daemon(
    rig: str,
    socket: Path,
    model: str,
    allow_no_rt: bool,
    tcp_port: int | None,
    links: Links,
    announce: Callable[[Path, str | None], None],
    slide: Path | None = None,
) -> int:
    """Run a daemon until SIGTERM, SIGINT or SIGHUP; exit status 0 when the output is known to be
    off at the end.

    `announce` is called once it can be used, with its socket and the address of its page, which
    holds the token. `slide`: a file of what a simulated finger does. Raises HapticError when it
    does not get that far.
    """
    osc = [OscOutlet(links.osc)] if links.osc is not None else []  # a wrong address is told at once
    ended = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, lambda number, frame: ended.set())
    take_precedence()
    place = Place(socket)
    try:
        with compilation_said("daemon"):
            settings = daemon_settings(rig, model, allow_no_rt=allow_no_rt, slide=slide)
            partners = _partners(settings, links, osc)
            served = partial(serve, tcp_port=tcp_port, origins=links.origins, token=links.token)
            output = _serve_until(ended, settings, place, served, partners, announce)
            return 0 if output.on is False else 1
    finally:
        place.close()


def _serve_until(
    ended: threading.Event,
    settings: DaemonSettings,
    place: Place,
    served: Callable[..., AbstractContextManager[str | None]],
    partners: _Partners,
    announce: Callable[[Path, str | None], None],
) -> KnownOutput:
    """What was known of the output when the instruments were let go."""
    daemon = Daemon(settings, ended=ended)
    daemon.start()
    try:
        page_folder = PAGE_FOLDER if PAGE_FOLDER.is_dir() else None
        with ExitStack() as running:
            page = running.enter_context(served(daemon, place, page=page_folder))
            running.enter_context(as_service(lambda: daemon.status().ticks))
            failed = partial(daemon.event_log.tell, "outlet")
            if partners.outlets:
                running.enter_context(
                    feeding(partners.outlets, daemon.shared.ring, daemon.events, failed)
                )
            if partners.inlet is not None:
                running.enter_context(hearing(partners.inlet, daemon.event_log.add, failed))
            settle_memory()
            _log.info("ready at %s; processes %s", place.path, daemon.pids)
            announce(place.path, page)
            while not ended.wait(KEEP_PERIOD_S):
                with suppress(OSError):
                    place.keep()
            daemon.disarm()  # before anything that takes time
    finally:
        output = daemon.close()
        _log.log(
            logging.ERROR if output.on is not False else logging.INFO,
            "ended; when the instruments were let go the output was %s",
            output,
        )
    return output


class _Partners(NamedTuple):
    """Who is sent to, and who is heard."""

    outlets: Sequence[Outlet]
    inlet: LslMarkers | None


def _partners(settings: DaemonSettings, links: Links, osc: Sequence[OscOutlet]) -> _Partners:
    """All that are asked for, before anything is started. Raises HapticError without their
    packages.
    """
    lsl = [LslOutlet(1.0 / settings.render.period_s, settings.config.name)] if links.lsl else []
    inlet = None if links.lsl_markers is None else LslMarkers(links.lsl_markers)
    return _Partners([*lsl, *osc], inlet)
