"""A daemon with its API on a socket and a port, as a process of its own; not a test.

    python served_daemon.py SOCKET AMPLIFIER_RECORD

prints the page's address once it serves, then where its simulated instruments are, and ends with
its standard input.
"""

from __future__ import annotations

import json
import sys
from contextlib import closing
from pathlib import Path

from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.place import Place
from haptic_driver.daemon.run import PAGE_FOLDER
from haptic_driver.daemon.set_up import daemon_settings
from haptic_driver.daemon.web.server import serve
from haptic_driver.processes.real_time import take_precedence


def main() -> None:
    path, record = Path(sys.argv[1]), Path(sys.argv[2])
    take_precedence()  # as `haptic daemon run` does
    settings = daemon_settings("simulated", "reference", amplifier_record=record)
    with (
        closing(Place(path)) as place,
        Daemon(settings) as daemon,
        serve(daemon, place, 0, page=PAGE_FOLDER) as page,
    ):
        print(page, flush=True)
        print(json.dumps(daemon.supervisor.endpoints), flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main()
