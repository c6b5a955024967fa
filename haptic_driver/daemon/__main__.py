"""`python -m haptic_driver.daemon --rig RIG [--socket S]`: the daemon in the foreground."""

from __future__ import annotations

import argparse
import logging
import sys
from pathlib import Path

from haptic_driver.daemon.run import run_daemon
from haptic_driver.errors import HapticError
from hw.errors import DeviceError


def main() -> int:
    """Run it; the exit status is 0 when the output is known to be off at the end, 2 for bad input."""
    parser = argparse.ArgumentParser(prog="python -m haptic_driver.daemon", description=__doc__)
    parser.add_argument("--rig", default="simulated", help="a name in configs/rigs, or a path")
    parser.add_argument("--socket", type=Path, help="where to listen; by default in a private folder")
    parser.add_argument("--model", default="reference", help="a name in configs/models, or a path")
    parser.add_argument("--allow-no-rt", action="store_true", help="arm real hardware without real-time scheduling")
    parser.add_argument("--tcp-port", type=int, help="serve the API on this loopback port too, behind a token")
    parser.add_argument("--amplifier-record", type=Path, help="where a simulated amplifier keeps its record")
    parser.add_argument("--lsl", action="store_true", help="offer samples and events to the Lab Streaming Layer")
    parser.add_argument("--osc", metavar="HOST:PORT", help="send samples and events there, as OSC over UDP")
    given = parser.parse_args()
    logging.basicConfig(format="%(asctime)s %(name)s: %(message)s", level=logging.INFO)
    try:
        return run_daemon(
            given.rig, given.socket, given.model, given.allow_no_rt, given.tcp_port, given.amplifier_record,
            given.lsl, given.osc,
        )  # fmt: skip
    except (HapticError, DeviceError) as error:
        print(f"{error.message}\n{error.hint}", file=sys.stderr)
        return error.exit_status if isinstance(error, HapticError) else 1


if __name__ == "__main__":
    sys.exit(main())
