"""A client that changes a scene as fast as answers come; not a test.

    python unpaced.py SOCKET TOKEN

prints how many changes were made, and what the median and the slowest of them took, when its
standard input ends or a change is refused.
"""

from __future__ import annotations

import select
import sys
import time
from contextlib import suppress

import numpy as np

from haptic_driver.client import HapticClient
from haptic_driver.daemon.messages import RefusedError


def main() -> None:
    took_s = []
    with HapticClient(sys.argv[1]) as client, suppress(RefusedError):
        while not select.select([sys.stdin], [], [], 0.0)[0]:
            began_s = time.monotonic()
            place = {"x_mm": 50.0 + 10.0 * np.sin(began_s), "y_mm": 30.0}
            client.change_scene(sys.argv[2], [{"do": "move", "id": "object 0"} | place], False)
            took_s.append(time.monotonic() - began_s)
    median_ms, most_s = 1e3 * np.median(took_s), max(took_s)
    print(f"{len(took_s)} by HTTP, one in {median_ms:.1f} ms, {most_s:.2g} s at most")


if __name__ == "__main__":
    main()
