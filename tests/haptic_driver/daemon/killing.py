"""A daemon that may be killed, as seen from outside."""

from __future__ import annotations

import json
import math
import os
import queue
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest

from tests.haptic_driver.daemon.electrode import history

KILLABLE = Path(__file__).with_name("killable.py")
HANG_S = 240.0
LEASE_S = 0.5
SCHEDULING_S = 0.2  # what a loaded machine may add to any reaction
WATCHED_S = 1.1  # after a signal
LONGEST_S = 5.0  # that is watched where there is no zero yet, though the amplifier lives


class KillableDaemon:
    """`killable.py` as seen from outside: its reports, and what was at the electrode."""

    def __init__(self, record: Path, rig: str, *load: str):
        self.record = record
        self.report = {"state": "starting"}
        self.process = subprocess.Popen(
            [sys.executable, str(KILLABLE), str(record), rig, *load],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        self._lines: queue.Queue[bytes] = queue.Queue()
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    def _listen(self):
        for line in self.process.stdout:
            self._lines.put(line)

    def await_fault(self):
        """Why the daemon is in fault, once it is."""
        while self._take(HANG_S)["state"] != "fault":
            pass
        return self.report["fault"]

    def _take(self, timeout_s):
        self.report = json.loads(self._lines.get(timeout=timeout_s))
        return self.report

    def go_on(self):
        self.process.stdin.write(b"again\n")
        self.process.stdin.flush()

    def await_output(self):
        """The process ids once there is rendered voltage; faults that a loaded machine causes are
        reset.
        """
        until_s = time.monotonic() + HANG_S
        while True:
            with suppress(queue.Empty):
                if self._take(0.005)["state"] == "fault":
                    self.go_on()
            changes = history(self.record)
            if self.report["state"] == "rendering" and changes and changes[-1][1] > 10.0:
                return self.report["pids"]
            assert time.monotonic() < until_s, f"no output: {self.report}"

    def time_to_zero_s(self, name, sent):
        """Send a process a signal; how long until zero at the electrode, for good. Infinite without
        a zero in time.
        """
        longest_s = WATCHED_S if name == "instruments" else LONGEST_S
        sent_s = time.monotonic()
        os.kill(self.report["pids"][name], sent)
        time.sleep(WATCHED_S)
        while math.isinf(zero_s := self._zero_s()) and time.monotonic() < sent_s + longest_s:
            time.sleep(0.1)
        os.truncate(self.record, 0)  # or reading it takes longer and longer
        return max(0.0, zero_s - sent_s)

    def _zero_s(self):
        """When the electrode came to zero for good; infinite where it has not."""
        zero_s = math.inf
        for time_s, voltage_v in history(self.record):
            zero_s = math.inf if voltage_v > 0.0 else min(zero_s, time_s)
        return zero_s

    def close(self):
        with suppress(BrokenPipeError):
            self.process.stdin.close()
        try:
            self.process.wait(HANG_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._listener.join()
        self.process.stdout.close()


@pytest.fixture
def killable_daemon(tmp_path):
    daemons = []

    def start(rig="simulated", *load):
        daemons.append(KillableDaemon(tmp_path / "amplifier.txt", rig, *load))
        return daemons[-1]

    yield start
    for daemon in daemons:
        daemon.close()
