"""Status asked 50 times a second by a second program, through random faults of a daemon.

`HAPTIC_SOAK_SAID`: how many faults (200). How often "off" was said beside more than 5 V is printed.
"""

from __future__ import annotations

import json
import os
import random
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import pytest

from haptic_driver.client import HapticClient
from haptic_driver.errors import HapticError
from tests.haptic_driver.daemon.electrode import history

FAULTS = int(os.environ.get("HAPTIC_SOAK_SAID", "200"))
SERVED, ASKING = (Path(__file__).with_name(name) for name in ("served_daemon.py", "asking.py"))
QUIET_V = 5.0
READY_S = 60.0  # until a daemon renders, on a busy machine; else the fault comes as it is
MODULES = {
    "render": "daemon.render_process",
    "watchdog": "safety.watchdog",
    "instruments": "simulation.process",
}


class Daemon:
    """It, its instruments, and whoever asks it."""

    def __init__(self, folder: Path) -> None:
        self.socket, self.record = folder / "d.sock", folder / "amplifier.txt"
        self.process = subprocess.Popen(
            [sys.executable, str(SERVED), str(self.socket), str(self.record)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        self.process.stdout.readline()
        said = json.loads(self.process.stdout.readline())
        _, host, port, _ = said["waveform_generator"].split("::")
        self.generator = host, int(port)
        self._answers = folder / "answers.txt"
        with self._answers.open("w") as answers:
            self.asking = subprocess.Popen(
                [sys.executable, str(ASKING), str(self.socket)],
                stdin=subprocess.PIPE,
                stdout=answers,
            )
        self._read = 0
        self.client = HapticClient(self.socket)

    def pid(self, name: str) -> int | None:
        """Of one of its processes, as it is now."""
        for folder in Path("/proc").glob("[0-9]*"):
            with suppress(OSError, IndexError):
                parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
                is_it = MODULES[name].encode() in (folder / "cmdline").read_bytes()
                if is_it and parent == self.process.pid:
                    return int(folder.name)
        return None

    def send(self, name: str, number: int) -> None:
        pid = self.pid(name)
        if pid is not None:
            with suppress(ProcessLookupError):
                os.kill(pid, number)

    def by_hand(self) -> None:
        """80 V at the amplifier, were it enabled, over a connection of somebody else's."""
        with suppress(OSError), socket.create_connection(self.generator, 1.0) as line:
            line.sendall(b"OUTP:LOAD INF;:APPL:SIN 1000,1.6,0\n")
            time.sleep(0.1)

    def render(self) -> None:
        """As soon as that is possible."""
        until_s = time.monotonic() + READY_S
        while time.monotonic() < until_s:
            with suppress(HapticError):
                state = self.client.status().state
                if state == "fault":
                    self.client.reset()
                if state == "rendering":
                    return
                self.client.disarm()
                self.client.set(self.client.arm(30.0).token, 0.65)
                time.sleep(0.5)

    def answers(self) -> list[tuple[float, float, str]]:
        """Those since the last call."""
        lines = self._answers.read_text().splitlines()
        lines, self._read = lines[self._read : -1], max(len(lines) - 1, self._read)
        words = map(str.split, lines)
        return [(float(asked_s), float(came_s), said) for asked_s, came_s, said in words]

    def close(self) -> None:
        for process in (self.asking, self.process):
            assert process.stdin is not None
            process.stdin.close()
            process.wait(60.0)
        assert self.process.stdout is not None
        self.process.stdout.close()
        self.client.close()


def least_v(changes: list[tuple[float, float]], from_s: float, to_s: float) -> float:
    """The lowest voltage at the electrode between two times."""
    before = [v for t, v in changes if t <= from_s]
    return min([*before[-1:], *(v for t, v in changes if from_s < t <= to_s)], default=0.0)


def pause(chance: random.Random) -> None:
    time.sleep(chance.uniform(0.1, 1.5))


def silent(daemon: Daemon, chance: random.Random) -> None:
    """All instruments, the amplifier's lines and monitor among them; what is on stays on."""
    daemon.send("instruments", signal.SIGSTOP)
    time.sleep(chance.uniform(0.3, 3.0))
    daemon.send("instruments", signal.SIGCONT)


def off_beside_silence(daemon: Daemon, chance: random.Random) -> None:
    daemon.send("instruments", signal.SIGSTOP)
    with suppress(HapticError):
        daemon.client.off()
    time.sleep(chance.uniform(0.3, 1.0))
    daemon.send("instruments", signal.SIGCONT)


def by_hand_then_silent(daemon: Daemon, chance: random.Random) -> None:
    daemon.by_hand()
    silent(daemon, chance)


def off(daemon: Daemon, chance: random.Random) -> None:
    with suppress(HapticError):
        daemon.client.off()


KINDS = {
    "instruments silent": silent,
    "off beside silence": off_beside_silence,
    "switched on by hand": lambda daemon, chance: daemon.by_hand(),
    "by hand, then silent": by_hand_then_silent,
    "render killed": lambda daemon, chance: daemon.send("render", signal.SIGKILL),
    "render stopped": lambda daemon, chance: daemon.send("render", signal.SIGSTOP),
    "watchdog killed": lambda daemon, chance: daemon.send("watchdog", signal.SIGKILL),
    "off": off,
}


@pytest.mark.process
@pytest.mark.soak
@pytest.mark.timeout(FAULTS * 70 + 300)
def test_off_is_never_said_beside_a_voltage(tmp_path):
    chance, daemon = random.Random(7), Daemon(tmp_path)
    said, wrong, highest_v = Counter[str](), [], 0.0
    changes: list[tuple[float, float]] = []
    try:
        for number in range(FAULTS):
            kind = chance.choice(list(KINDS))
            if chance.random() < 0.7:
                daemon.render()
            KINDS[kind](daemon, chance)
            pause(chance)
            answers = daemon.answers()
            changes = [*changes[-1:], *history(daemon.record)]
            highest_v = max([highest_v, *(v for _, v in changes)])
            said.update(word for _, _, word in answers)
            wrong += [
                (number, kind, asked_s)
                for asked_s, came_s, word in answers
                if word == "off" and least_v(changes, asked_s, came_s) > QUIET_V
            ]
            if changes and changes[-1][1] == 0.0:
                os.truncate(daemon.record, 0)
    finally:
        daemon.close()
    print(f"{FAULTS} faults, answers {dict(said)}; off beside more than {QUIET_V} V: {len(wrong)}")
    assert wrong == []
    assert highest_v > 30.0
    assert said["off"] > 10 * FAULTS
