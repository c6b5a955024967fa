"""What systemd sends to the processes of the unit that is shipped, by systemd.kill(5) and
systemd.service(5); no systemd runs here.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterable
from pathlib import Path

UNIT = Path(__file__).parents[1] / "haptic_driver" / "daemon" / "haptic@.service"


def settings() -> dict[str, list[str]]:
    """Each key of the unit with its values, in their order; a key may be there several times."""
    found: dict[str, list[str]] = {}
    for line in UNIT.read_text().splitlines():
        key, equals, value = line.partition("=")
        if equals and not line.startswith("#"):
            found.setdefault(key, []).append(value)
    return found


def send_when_main_is_dead(others: Iterable[int], *, hung: bool = False) -> None:
    """At once, to what is left of the unit. `hung`: WatchdogSec had run out before that.

    With `control-group` all are asked, and killed only after `TimeoutStopSec`. With `mixed` only
    the main process is asked: once it is dead, all others are killed.
    """
    mode = settings().get("KillMode", ["control-group"])[0]
    asked = [signal.SIGABRT] if hung else []
    sent = {
        "control-group": [*asked, signal.SIGTERM, signal.SIGCONT],
        "mixed": [signal.SIGKILL],
        "process": [],
    }[mode]
    for pid in others:
        for number in sent:
            os.kill(pid, number)
