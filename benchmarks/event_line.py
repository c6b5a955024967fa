"""From an event to its edge on the simulated event line, while the daemon renders: distributions.

A trigger box is simulated behind a pseudo-terminal: driver, queue and threads are those of a rig.
What a real box, its USB and its recorder add is not in it; measure that by a loop back.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.claim import Claim
from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.set_up import daemon_settings
from haptic_driver.rig.parts.event_lines import SimulatedEventLineConfig
from haptic_driver.signals import Array
from hw.event_line.simulated import SimulatedEventLine

MARKERS = 400
APART_S = 0.025  # more than a pulse and its pause
CODES = range(60, 250)  # the simulated finger's own are below
LEASE_S = 60.0  # more than all of it
WANTED_S = 0.002  # half of them; the rest is the machine's, which may have other things to do
QUANTILES = (0.5, 0.95, 0.99, 1.0)


def run() -> Iterator[Claim]:
    settings = daemon_settings("simulated", "reference")
    section = SimulatedEventLineConfig(kind="simulated")
    config = settings.config.model_copy(update={"event_line": section})
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
        rises_s = [edge.time_s for edge in line.box.edges if edge.code in CODES]
        told = [event for event in daemon.events(0) if event.kind == "edge"]
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
    yield Claim("ticks that were missed meanwhile", str(overruns))


def quantiles_said() -> str:
    return ", ".join(f"{q:.0%}" for q in QUANTILES)


def said(late_s: Array) -> str:
    return ", ".join(f"{1e3 * q:.2f}" for q in np.quantile(late_s, QUANTILES).tolist()) + " ms"
