"""What a daemon asks of its computer: each process's share of a core and its memory, while it
renders by each kind of output, and the status is asked ten times a second.

Simulated instruments are a process that a real rig does not have.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from benchmarks.claim import Claim
from haptic_driver.client import HapticClient

RIGS = {
    "simulated": "set points over SCPI",
    "simulated-envelope": "an analog envelope",
    "simulated-carrier": "carrier and envelope as samples",
}
SECONDS, WARM_S, ASK_S = 30.0, 10.0, 0.1
MODULES = {"haptic_driver.simulation.process": "instruments", "hw.safety.watchdog": "watchdog"}


def run() -> Iterator[Claim]:
    for rig, output in RIGS.items():
        with tempfile.TemporaryDirectory() as folder:
            socket = Path(folder, "daemon.sock")
            haptic = str(Path(sys.executable).with_name("haptic"))
            words = ["daemon", "run", "--rig", rig, "--socket", str(socket), "--json"]
            with subprocess.Popen([haptic, *words], stdout=subprocess.PIPE) as running:
                assert running.stdout is not None
                running.stdout.readline()  # it can be used
                try:
                    yield from _shares(running.pid, socket, output)
                finally:
                    running.terminate()


def _shares(daemon: int, socket: Path, output: str) -> Iterator[Claim]:
    with HapticClient(socket) as client, client.armed(5.0) as session:
        session.play("linen")
        _ask(client, WARM_S)
        before = used(daemon)
        _ask(client, SECONDS)
        after, budget_s = used(daemon), client.status().latency_budget_s
    for name, (cpu_s, memory) in after.items():
        share = (cpu_s - before[name][0]) / SECONDS if name in before else 0.0
        yield Claim(f"{output}: {name}", f"{share:.0%} of a core, {1e-6 * memory:.0f} MB")
    told = ", ".join(f"{part} {1e3 * took_s:.1f}" for part, took_s in budget_s.items())
    yield Claim(f"{output}: latency by the rig's file, ms", told)


def _ask(client: HapticClient, seconds: float) -> None:
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        client.status()
        time.sleep(ASK_S)


def used(daemon: int) -> dict[str, tuple[float, int]]:
    """Processor time of a daemon's processes, and memory in bytes: what several share is split
    among them.
    """
    found = {"control": _used(daemon)}
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError, IndexError):  # it has ended meanwhile
            if int((folder / "stat").read_text().rpartition(")")[2].split()[1]) == daemon:
                found[_name(folder)] = _used(int(folder.name))
    return found


def _name(folder: Path) -> str:
    words = (folder / "cmdline").read_text().split("\0")
    module = words[words.index("-m") + 1] if "-m" in words else Path(words[0]).name
    return MODULES.get(module, module.rpartition(".")[2].removesuffix("_process"))


def _used(pid: int) -> tuple[float, int]:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    rollup = Path(f"/proc/{pid}/smaps_rollup").read_text()
    kilobytes = int(rollup.partition("Pss:")[2].split()[0])
    ticks = int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK"), 1024 * kilobytes
