"""A scene whose 200 objects all move 60 times a second, by a client over the command channel:
whether ticks keep their time, and what a tick and a change take.

The rig has an envelope, for which a tick looks up 21 places. An empty loop of the same scheduling
runs beside it and misses instants by the machine's doing alone.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.claim import Claim
from haptic_driver.client import HapticClient, new_samples
from haptic_driver.signals import TICK_S

OBJECTS, RATE_HZ, SECONDS = 200, 60.0, 20.0
SILENT_S = 10.0  # so long without a tick: the daemon has ended
LEAST_SHARE = 0.98  # of the changes: the first comes when the client is there
TEXTURES = ("linen", "grating", "fine_grating", "brushed_metal")


def run() -> Iterator[Claim]:
    with tempfile.TemporaryDirectory() as folder:
        socket, empty = Path(folder, "daemon.sock"), Path(folder, "empty.npy")
        haptic = str(Path(sys.executable).with_name("haptic"))
        words = ["daemon", "run", "--rig", "simulated-envelope", "--socket", str(socket), "--json"]
        with subprocess.Popen([haptic, *words], stdout=subprocess.PIPE) as running:
            assert running.stdout is not None
            running.stdout.readline()  # it can be used
            try:
                with HapticClient(socket) as client:
                    yield from _moved(client, socket, empty)
            finally:
                running.terminate()


def _moved(daemon: HapticClient, socket: Path, empty: Path) -> Iterator[Claim]:
    loop_words = [str(round(SECONDS / TICK_S)), str(TICK_S), str(empty)]
    client = [sys.executable, "-m", "benchmarks.scene", str(socket)]
    parts = []
    with (
        subprocess.Popen(client, stdout=subprocess.PIPE, text=True) as mover,
        subprocess.Popen([sys.executable, "-m", "benchmarks.empty_loop", *loop_words]),
    ):
        assert mover.stdout is not None
        mover.stdout.readline()  # it begins to move them
        before = daemon.status()
        for samples in new_samples(daemon.samples, SILENT_S):
            parts.append(samples)
            if mover.poll() is not None:
                break
        after, said = daemon.status(), json.loads(mover.stdout.read())
    samples, missed = np.concatenate(parts), after.overruns - before.overruns
    late_s, _ = np.load(empty).T
    by_machine = int(np.sum(late_s // TICK_S))
    share = said["sent"] / (RATE_HZ * said["seconds"])
    yield Claim(
        f"{OBJECTS} objects moved {RATE_HZ:.0f} times a second by a client: changes made",
        f"{said['sent'] / said['seconds']:.1f} /s, one in {1e3 * said['median_s']:.1f} ms",
        f"at least {LEAST_SHARE:.0%}",
        share >= LEAST_SHARE,
    )
    yield Claim(
        "overruns meanwhile, against instants that an empty loop beside it missed",
        f"{missed} against {by_machine} in {samples.size} ticks",
        "no more",
        missed <= by_machine,
    )
    took_us = 1e6 * samples["compute_s"][samples["voltage_v"] > 0.0]
    told = " and ".join(f"{x:.3g} us" for x in np.percentile(took_us, [50.0, 99.0, 100.0]))
    yield Claim("a whole tick by an envelope meanwhile, median, 99 % and longest", told)


def objects() -> Iterator[dict[str, Any]]:
    yield {"do": "background", "cof": 0.6}
    for k in range(OBJECTS):
        shape = {"kind": "rectangle", "width_mm": 6.0, "height_mm": 4.0, "radius_mm": 1.0}
        if k % 2:
            shape = {"kind": "polygon", "corners_mm": [[0, -3], [3, 2], [-3, 2]]}
        made = {"texture": TEXTURES[k % 4]} if k % 3 else {"cof": 0.7}
        x_mm, y_mm = _place(k, 0.0)
        said = {"shape": shape, "origin_mm": [x_mm, y_mm], "soft_edge_mm": 0.5}
        yield {"do": "add", "id": f"object {k}", **said, **made}


def moved(time_s: float) -> list[dict[str, Any]]:
    """The changes that bring all objects to where they are then."""
    places = ((k, *_place(k, time_s)) for k in range(OBJECTS))
    return [
        {"do": "move", "id": f"object {k}", "x_mm": x_mm, "y_mm": y_mm} for k, x_mm, y_mm in places
    ]


def _place(k: int, time_s: float) -> tuple[float, float]:
    """Each on a circle of its own."""
    turn = 0.5 * time_s + k
    return 6.0 + 4.5 * (k % 20) + 4.0 * math.cos(turn), 6.0 + 5.0 * (k // 20) + 4.0 * math.sin(turn)


def main(socket: str) -> None:
    """Move all of them at the rate; what came of it on standard output, as JSON."""
    took_s: list[float] = []
    with HapticClient(socket) as client, client.channel() as channel:
        channel.arm(60.0)
        channel.scene.change([*objects()])
        print("begun", flush=True)
        start_s = time.monotonic()
        while (now_s := time.monotonic()) < start_s + SECONDS:
            channel.scene.change(moved(now_s))
            took_s.append(time.monotonic() - now_s)
            time.sleep(max(start_s + len(took_s) / RATE_HZ - time.monotonic(), 0.0))
        seconds = time.monotonic() - start_s
    said = {"sent": len(took_s), "seconds": seconds, "median_s": float(np.median(took_s))}
    print(json.dumps(said))


if __name__ == "__main__":
    main(*sys.argv[1:])
