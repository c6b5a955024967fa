"""A scene whose 200 objects all move 60 times a second, by a client over HTTP: whether ticks keep
their time, and what a tick and a change take.

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
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.claim import Claim
from haptic_driver.client import HapticClient
from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.place import Place
from haptic_driver.daemon.set_up import PERIOD_S, daemon_settings
from haptic_driver.daemon.verbs import Verbs
from haptic_driver.daemon.web.server import serve
from haptic_driver.processes.real_time import SWITCH_INTERVAL_S

OBJECTS, RATE_HZ, SECONDS = 200, 60.0, 20.0
LEAST_SHARE = 0.98  # of the changes: the first comes when the client is there
TEXTURES = ("linen", "grating", "fine_grating", "brushed_metal")


def run() -> Iterator[Claim]:
    switch_interval_s = sys.getswitchinterval()
    with (
        tempfile.TemporaryDirectory() as folder,
        closing(Place(Path(folder, "daemon.sock"))) as place,
    ):
        settings = daemon_settings("simulated-envelope", "reference")
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        try:
            with Daemon(settings) as daemon, serve(daemon, place):
                token = daemon.arm(60.0).token
                with HapticClient(place.path) as client:
                    client.ask(Verbs.change_scene, {"changes": [*_objects()]}, token)
                yield from _moved(daemon, place.path, token, Path(folder, "empty.npy"))
                daemon.off()
        finally:
            sys.setswitchinterval(switch_interval_s)


def _moved(daemon: Daemon, socket: Path, token: str, empty: Path) -> Iterator[Claim]:
    time.sleep(1.0)
    loop_words = [str(round(SECONDS / PERIOD_S)), str(PERIOD_S), str(empty)]
    client_words = [str(socket), token]
    client = [sys.executable, "-m", "benchmarks.scene", *client_words]
    before, last = daemon.status(), daemon.shared.output.read().tick
    parts = []
    with (
        subprocess.Popen(client, stdout=subprocess.PIPE, text=True) as mover,
        subprocess.Popen([sys.executable, "-m", "benchmarks.empty_loop", *loop_words]),
    ):
        while mover.poll() is None:
            time.sleep(1.0)
            parts.append(daemon.samples(last, 1 << 14))
            last = int(parts[-1]["tick"][-1])
        assert mover.stdout is not None
        said = json.loads(mover.stdout.read())
    samples, after = np.concatenate(parts), daemon.status()
    missed = after.overruns - before.overruns
    late_s, _ = np.load(empty).T
    by_machine = int(np.sum(late_s // PERIOD_S))
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


def _objects() -> Iterator[dict[str, Any]]:
    yield {"do": "background", "cof": 0.6}
    for k in range(OBJECTS):
        shape = {"kind": "rectangle", "width_mm": 6.0, "height_mm": 4.0, "radius_mm": 1.0}
        if k % 2:
            shape = {"kind": "polygon", "corners_mm": [[0, -3], [3, 2], [-3, 2]]}
        made = {"texture": TEXTURES[k % 4]} if k % 3 else {"cof": 0.7}
        x_mm, y_mm = _place(k, 0.0)
        said = {"shape": shape, "origin_mm": [x_mm, y_mm], "soft_edge_mm": 0.5}
        yield {"do": "add", "id": f"object {k}", **said, **made}


def _place(k: int, time_s: float) -> tuple[float, float]:
    """Each on a circle of its own."""
    turn = 0.5 * time_s + k
    return 6.0 + 4.5 * (k % 20) + 4.0 * math.cos(turn), 6.0 + 5.0 * (k // 20) + 4.0 * math.sin(turn)


def main(socket: str, token: str) -> None:
    """Move all of them at the rate; what came of it on standard output, as JSON."""
    took_s: list[float] = []
    with HapticClient(socket) as client:
        start_s = time.monotonic()
        while (now_s := time.monotonic()) < start_s + SECONDS:
            places = ((k, *_place(k, now_s)) for k in range(OBJECTS))
            changes = [
                {"do": "move", "id": f"object {k}", "x_mm": x_mm, "y_mm": y_mm}
                for k, x_mm, y_mm in places
            ]
            client.ask(Verbs.change_scene, {"changes": changes}, token)
            took_s.append(time.monotonic() - now_s)
            time.sleep(max(start_s + len(took_s) / RATE_HZ - time.monotonic(), 0.0))
        seconds = time.monotonic() - start_s
    said = {"sent": len(took_s), "seconds": seconds, "median_s": float(np.median(took_s))}
    print(json.dumps(said))


if __name__ == "__main__":
    main(*sys.argv[1:])
