"""How long a tick takes in the daemon and how late it comes, also while clients load it; how soon a
new target acts.

An empty loop of the same scheduling runs beside it, meets the same load and does reference work.
What ticks take and how late they are is claimed against that loop; what a new target takes, against
the latency that the daemon itself says.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks import api_load
from benchmarks.claim import Claim
from benchmarks.reference import RECORDS
from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.place import Place
from haptic_driver.daemon.run import PAGE_FOLDER
from haptic_driver.daemon.set_up import daemon_settings
from haptic_driver.daemon.web.server import serve
from haptic_driver.processes.real_time import SWITCH_INTERVAL_S
from haptic_driver.signals import TICK_S, Array
from haptic_driver.simulation.served import STEP_S

UNLOADED_S, LOADED_S = 10.0, 45.0
MARGIN_S = 5.0  # by which the load outlasts what is measured
ROUNDS = 100
STARTS = 5  # of a rig whose electrode is looked at in step with its ticks: phases differ
TARGETS = (0.68, 0.60)  # in turns
SEEN = 0.1  # of the voltage: such a change is the new target's
TURNS, TURN_S = (False, True, False, True), 12.0  # of refits
LATE = 1 / 5  # of a period: what counts as late while a model is refit

# Times the reference work, which hands on as many records as a tick: what the stages compute in
# Python costs about as much again, compiled code and shared memory as much once more; and a tick of
# many functions needs more of the caches than a loop.
TAKES = 4.0
# One in a hundred finds its code and data gone from the caches, which the loop's few lines never
# are: a tick with all to fetch from memory takes twice as long (FIRST_REHEARSAL_S, REHEARSAL_S).
TAKES_COLD = 2.0 * TAKES
# Times the empty loop, which the same kernel wakes under the same load: 1, but for chance. In the
# tail 45 samples count, and stalls that differ by much.
LATE_RATIO, LATE_RATIO_TAIL = 1.2, 2.0
# Render looks for orders at each tick: the next one finds it.
PERIODS_TO_TICK = 1.0
# Times the latency that the daemon says, which is a mean: what 100 phases of set points, or a lead
# that changes by steps of a tick, leave of chance is less than a quarter of it.
LATENCY_RATIO = 1.25


def run() -> Iterator[Claim]:
    switch_interval_s = sys.getswitchinterval()
    with (
        tempfile.TemporaryDirectory() as folder,
        closing(Place(Path(folder, "daemon.sock"))) as place,
    ):
        record = Path(folder, "amplifier.txt")
        settings = daemon_settings("simulated", "reference", amplifier_record=record)
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        try:
            with Daemon(settings) as daemon, serve(daemon, place, 0, page=PAGE_FOLDER) as page:
                assert page is not None
                lease = daemon.arm(60.0)
                daemon.targets.set(lease.token, 0.65)
                samples, empty = _watched_beside(daemon, lease.token, UNLOADED_S)
                yield from _compute("a whole tick in the daemon", samples, empty)
                yield from _lateness(daemon, lease.token, place.path, page)
                acted = _acted_in(ROUNDS, daemon, lease.token, record)
                yield from _set_to_output("over SCPI", acted)
                daemon.off()
            yield from _set_to_envelope()
            yield from _refits()
        finally:
            sys.setswitchinterval(switch_interval_s)


class Beside(NamedTuple):
    """The empty loop's lateness and what its reference work took, s [n]."""

    late_s: Array
    took_s: Array


def _watched_beside(daemon: Daemon, token: str, seconds: float) -> tuple[np.ndarray, Beside]:
    """The samples of so long, and an empty loop at the same time."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "empty.npy")
        words = [str(round(seconds / TICK_S)), str(TICK_S), str(path)]
        with subprocess.Popen([sys.executable, "-m", "benchmarks.empty_loop", *words]) as loop:
            samples = _watched(daemon, token, seconds)
            loop.wait()
        return samples, Beside(*np.load(path).T)


def _watched(daemon: Daemon, token: str, seconds: float) -> np.ndarray:
    """The samples of so long."""
    last, parts = daemon.status().ticks, []
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        time.sleep(1.0)
        if fault := daemon.status().fault:
            raise RuntimeError(f"the daemon is in fault: {fault}")
        daemon.renew(token)
        parts.append(daemon.samples(last, 1 << 14))
        last = int(parts[-1]["tick"][-1])
    return np.concatenate(parts)


def _compute(what: str, samples: np.ndarray, empty: Beside) -> Iterator[Claim]:
    """From the instant when a tick began until its sample was written, of the ticks that put
    voltage out.

    What takes so many times as long is interrupted so many times as often: its 99 % belongs to a
    rarer turn of the loop.
    """
    took_s = samples["compute_s"][samples["voltage_v"] > 0.0]
    for q, reference_q, most in ((50.0, 50.0, TAKES), (99.0, 100.0 - 1.0 / TAKES, TAKES_COLD)):
        ours_s, reference_s = np.percentile(took_s, q), np.percentile(empty.took_s, reference_q)
        ratio = float(ours_s / reference_s)
        told = f"{ratio:.1f} x ({1e6 * ours_s:.3g} us against {1e6 * reference_s:.3g} us)"
        name = "median" if q == 50.0 else f"{q:g} %"
        yield Claim(
            f"{what} against {RECORDS} records handed on in an empty loop beside it, {name}",
            told,
            f"at most {most:g} x",
            ratio <= most,
        )


@contextmanager
def _load(socket: Path, page: str, token: str, seconds: float) -> Iterator[dict[str, float | str]]:
    """Clients at work; afterwards what they say of it is in the answer."""
    words = [str(socket), page, token, str(seconds)]
    said: dict[str, float | str] = {}
    command = [sys.executable, "-m", "benchmarks.api_load", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as load:
        assert load.stdout is not None
        if not load.stdout.readline():
            raise RuntimeError("the load did not begin")
        yield said
        said.update(json.loads(load.stdout.read()))


def _lateness(daemon: Daemon, token: str, socket: Path, page: str) -> Iterator[Claim]:
    """Ticks and an empty loop, both under load."""
    with _load(socket, page, token, LOADED_S + MARGIN_S) as said:
        samples, empty = _watched_beside(daemon, token, LOADED_S)
    yield from _compute("the same under load", samples, empty)
    there = not said["refused"] and float(said["messages"]) > 0
    lesser = "" if there else ", no load"  # then nothing is shown
    for q in (50.0, 99.9):
        claim = _lateness_against("under load", samples["lateness_s"], empty.late_s, q)
        yield claim._replace(measured=claim.measured + lesser, holds=there and claim.holds)
    asked = (
        f"{float(said['requests_hz']):.0f} of {api_load.RATE_HZ:.0f} requests/s, {said['refused']}"
        " refused"
    )
    yield Claim(
        f"that load, page open in {said['viewer']}",
        f"{asked}, {said['messages']} messages to the page",
    )
    granted = "granted" if daemon.status().real_time else "NOT granted"
    yield Claim("real-time scheduling", f"{granted}, {os.cpu_count()} cores")


class Acted(NamedTuple):
    """A new target: the call, from its return to the tick that decides by it, and from there to the
    electrode, s.

    `expected_s`: the last, by the daemon's own budget.
    """

    call_s: float
    waited_s: float
    acted_s: float
    expected_s: float


def _acted_in(rounds: int, daemon: Daemon, token: str, record: Path) -> list[Acted]:
    """So many new targets, without those at which the finger lifted."""
    tried = (_acted(daemon, token, record, k) for k in range(rounds))
    return [each for each in tried if each is not None]


def _set_to_output(how: str, seen: list[Acted]) -> Iterator[Claim]:
    """From the call to the first tick that renders the new target, and to the change at the
    simulated electrode.
    """
    median = Acted(*map(statistics.median, zip(*seen, strict=True)))
    periods = median.waited_s / TICK_S
    yield Claim(
        f"{how}: from a new target to the tick that decides by it, median of {len(seen)}",
        f"{periods:.2f} periods",
        f"at most {PERIODS_TO_TICK:g}",
        periods <= PERIODS_TO_TICK,
    )
    ratio = median.acted_s / median.expected_s
    yield Claim(
        f"{how}: from that tick to the electrode, median, against the latency that the daemon says",
        f"{ratio:.2f} x ({1e3 * median.acted_s:.1f} ms against {1e3 * median.expected_s:.1f} ms)",
        f"at most {LATENCY_RATIO:g} x",
        ratio <= LATENCY_RATIO,
    )
    yield Claim(f"{how}: the call that sets a target, median", f"{1e3 * median.call_s:.2f} ms")


def _acted(daemon: Daemon, token: str, record: Path, k: int) -> Acted | None:
    """One new target; None where the finger lifted meanwhile."""
    while not daemon.shared.output.read().voltage_v > 0.0:
        time.sleep(0.01)
        daemon.renew(token)
    time.sleep(0.05 + 0.0037 * (k % 10))
    cof = TARGETS[k % 2]
    before = daemon.shared.output.read()
    began_s = time.monotonic()
    daemon.targets.set(token, cof)
    returned_s = time.monotonic()
    budget_s = daemon.status().latency_budget_s
    expected_s = budget_s["total"] - budget_s["sensor"] - budget_s["tick"]
    if cof == max(TARGETS):  # the voltage rises at a bounded rate
        expected_s += (
            SEEN * before.voltage_v / daemon.basis.settings.config.output.voltage_rise_v_per_s
        )
    time.sleep(expected_s + 0.04)
    samples = daemon.samples(before.tick, 1000)
    new = samples[samples["asked_cof"] == cof]
    if not new.size or not new["output_on"].all() or not before.voltage_v > 0.0:
        return None
    tick_s = float(new["time_s"][0] + new["lateness_s"][0])
    later = [tuple(map(float, line.split())) for line in record.read_text().splitlines()[-400:]]
    changed = [abs(v / before.voltage_v - 1.0) > SEEN and t > began_s for t, _, v in later]
    if True not in changed:
        return None
    first = changed.index(True)
    # The simulated electrode is looked at each step: it changed within the last one.
    electrode_s = later[first][0] - 0.5 * STEP_S
    return Acted(returned_s - began_s, tick_s - returned_s, electrode_s - tick_s, expected_s)


@contextmanager
def _by_envelope() -> Iterator[tuple[Daemon, str, Path]]:
    """A daemon of the rig with an analog output, armed and rendering; its lease and its record."""
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder, "amplifier.txt")
        settings = daemon_settings("simulated-envelope", "reference", amplifier_record=record)
        with Daemon(settings) as daemon:
            lease = daemon.arm(60.0)
            daemon.targets.set(lease.token, 0.65)
            yield daemon, lease.token, record
            daemon.off()


def _set_to_envelope() -> Iterator[Claim]:
    """The same on the rig with an analog output, whose lead follows how late the machine is."""
    seen: list[Acted] = []
    for _ in range(STARTS):
        with _by_envelope() as (daemon, token, record):
            seen += _acted_in(ROUNDS // STARTS, daemon, token, record)
    yield from _set_to_output("by an envelope", seen)
    with _by_envelope() as (daemon, token, _):
        daemon.targets.play(token, "linen")
        samples = _watched(daemon, token, UNLOADED_S)
    took_us = 1e6 * samples["compute_s"][samples["voltage_v"] > 0.0]
    told = " and ".join(f"{x:.3g} us" for x in np.percentile(took_us, [50.0, 99.0]))
    yield Claim("by an envelope: a whole tick on linen, median and 99 %", told)


def _refits() -> Iterator[Claim]:
    """Ticks while the model of a finger that is not the model's is refit, and without, in
    turns.
    """
    late: dict[bool, list[float]] = {on: [] for on in TURNS}
    ours_s, theirs_s = [], []
    with Daemon(daemon_settings("hidden_humidity", "reference")) as daemon:
        lease = daemon.arm(60.0)
        daemon.targets.set(lease.token, 0.65)
        for on in TURNS:
            daemon.adapt(on)
            samples, empty = _watched_beside(daemon, lease.token, TURN_S)
            late[on].append(float(np.mean(samples["lateness_s"] > LATE * TICK_S)))
            if on:
                ours_s.append(samples["lateness_s"])
                theirs_s.append(empty.late_s)
        refits = sum(event.message.startswith("refitted") for event in daemon.events(0))
        daemon.off()
    yield _lateness_against(
        "while a model is refit", np.concatenate(ours_s), np.concatenate(theirs_s), 99.9
    )
    shares = {on: " and ".join(f"{100.0 * share:.2g} %" for share in late[on]) for on in late}
    yield Claim(
        "ticks late by 1/5 of a period while a model is refit, and without, in turns",
        f"{shares[True]}, {refits} refits; {shares[False]}",
    )


def _lateness_against(when: str, ours_s: Array, theirs_s: Array, q: float) -> Claim:
    most = LATE_RATIO if q == 50.0 else LATE_RATIO_TAIL
    late_s, empty_s = np.percentile(ours_s, q), np.percentile(theirs_s, q)
    ratio = float(late_s / empty_s)
    return Claim(
        f"tick lateness {when} against an empty loop beside it, {q:g} %",
        f"{ratio:.2f} x ({1e6 * late_s:.3g} us against {1e6 * empty_s:.3g} us)",
        f"at most {most:g} x",
        ratio <= most,
    )
