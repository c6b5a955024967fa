"""From an event to its edge on the simulated event line, and from an edge on the simulated line in
to the recording that it begins, while the daemon renders: distributions.

Trigger boxes are simulated behind pseudo-terminals: drivers, queue and threads are those of a rig.
What a real box, its USB and its recorder add is not in it; measure that by a loop back.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.claim import Claim
from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.set_up import daemon_settings
from haptic_driver.recording.read import read_run
from haptic_driver.rig.parts.event_lines import SimulatedEventLineConfig
from haptic_driver.rig.parts.lines_in import SimulatedLineInConfig
from haptic_driver.signals import Array
from hw.event_line.simulated import SimulatedEventLine, SimulatedLineIn

MARKERS = 400
APART_S = 0.025  # more than a pulse and its pause
CODES = range(60, 250)  # the simulated finger's own are below
LEASE_S = 60.0  # more than all of it
WANTED_S = 0.002  # half of them; the rest is the machine's, which may have other things to do
QUANTILES = (0.5, 0.95, 0.99, 1.0)
RECORDINGS = 20
HANG_S = 60.0


def run() -> Iterator[Claim]:
    with TemporaryDirectory(prefix="haptic-bench-") as folder:
        yield from _run(folder)


def _run(folder: str) -> Iterator[Claim]:
    settings = daemon_settings("simulated", "reference")
    config = settings.config.model_copy(
        update={
            "event_line": SimulatedEventLineConfig(kind="simulated"),
            "line_in": SimulatedLineInConfig(kind="simulated", folder=folder),
        }
    )
    with Daemon(replace(settings, config=config)) as daemon:
        lease = daemon.arm(LEASE_S)
        daemon.targets.play(lease.token, "linen", nearest=True)
        marked_s = []
        for i in range(MARKERS):
            marked_s.append(daemon.mark("bench", {"code": CODES[i % len(CODES)]}).time_s)
            time.sleep(APART_S)
        assert daemon.event_line is not None
        line = daemon.event_line.line
        assert isinstance(line, SimulatedEventLine)
        rises_s = _rises_s(line)
        told = [event for event in daemon.events(0) if event.kind == "edge"]
        began_s, first_s = _recordings(daemon, lease.token)
        overruns = daemon.status().overruns
    late_s = np.array(rises_s) - np.array(marked_s)
    yield Claim(
        f"marker to edge at the simulated box: {quantiles_said()}",
        said(late_s),
        f"half within {1e3 * WANTED_S:g} ms",
        float(np.median(late_s)) <= WANTED_S,
    )
    own_s = [event.data["late_s"] for event in told if event.message == "bench"]
    yield Claim("the same until the driver has handed it over, as recorded", said(np.array(own_s)))
    contact = [event.data["late_s"] for event in told if event.message in ("touch", "lift")]
    yield Claim(f"tick to edge of {len(contact)} touches and lifts", said(np.array(contact)))
    heard = [event for event in daemon.events(0) if "begins a recording" in event.message]
    seen_s = np.array([event.time_s for event in heard]) - began_s
    yield Claim(f"edge in until the driver has seen it, {RECORDINGS} recordings", said(seen_s))
    yield Claim("edge in to the first recorded tick", said(first_s - began_s))
    yield Claim("ticks that were missed meanwhile", str(overruns))


def _rises_s(line: SimulatedEventLine) -> list[float]:
    """When the box had each marker's code; on a busy machine the last are late."""
    until_s = time.monotonic() + HANG_S
    while True:
        rises_s = [edge.time_s for edge in line.box.edges if edge.code in CODES]
        if len(rises_s) == MARKERS or time.monotonic() > until_s:
            return rises_s
        time.sleep(APART_S)


def _recordings(daemon: Daemon, token: str) -> tuple[Array, Array]:
    """When edges came that began recordings, and the first tick of each recording."""
    assert daemon.line_in is not None
    line = daemon.line_in.line
    assert isinstance(line, SimulatedLineIn)
    began_s, first_s = [], []
    for _ in range(RECORDINGS):
        daemon.renew(token)
        before = daemon.events(0)[-1].number
        began_s.append(line.pulse())
        path = _told(daemon, before, "into ")
        time.sleep(APART_S)  # or the next would be bouncing
        line.pulse()
        _told(daemon, before, "ended: ")
        first_s.append(float(read_run(Path(path)).samples["time_s"][0]))
    return np.array(began_s), np.array(first_s)


def _told(daemon: Daemon, since: int, begins: str) -> str:
    """What an event about a recording says after these words, once it is there and done."""
    until_s = time.monotonic() + HANG_S
    while time.monotonic() < until_s:
        for event in daemon.events(since):
            if event.kind == "recording" and event.message.startswith(begins):
                return event.message.removeprefix(begins)
        time.sleep(APART_S)
    raise RuntimeError(f"no recording {begins.strip()}")


def quantiles_said() -> str:
    return ", ".join(f"{q:.0%}" for q in QUANTILES)


def said(late_s: Array) -> str:
    return ", ".join(f"{1e3 * q:.2f}" for q in np.quantile(late_s, QUANTILES).tolist()) + " ms"
