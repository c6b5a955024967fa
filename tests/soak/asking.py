"""A second program that asks the daemon for its status 50 times a second; not a test.

    python asking.py SOCKET

prints a line per answer: when it was asked for, when it came, and the output (`on`, `off` or
`unknown`). It ends with its standard input.
"""

from __future__ import annotations

import select
import sys
import time

from haptic_driver.client import HapticClient
from haptic_driver.errors import HapticError

PERIOD_S = 0.02
WORDS = {True: "on", False: "off", None: "unknown"}


def main() -> None:
    with HapticClient(sys.argv[1]) as client:
        while not select.select([sys.stdin], [], [], PERIOD_S)[0]:
            asked_s = time.monotonic()
            try:
                said = WORDS[client.status().output_on]
            except HapticError:
                continue  # it said nothing
            print(asked_s, time.monotonic(), said, flush=True)


if __name__ == "__main__":
    main()
