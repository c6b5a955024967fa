"""The simulated instruments of a rig in a process of their own: real bytes on loopback, the model's
physics behind.

    python -m haptic_driver.simulation.process RIG MODEL [--record FILE] [--finger module:function]
    [--slide FILE]

says its endpoints on standard output, as one JSON line, once it serves. It ends on SIGTERM, or a
while after its standard input closes. Instruments outlive a driver that dies, so that another
watcher can switch them off. `--finger` is a finger of your own, as `haptic measure` takes one;
`--slide` is what it does, again and again, as `haptic demo --trace` takes it. `--record` keeps what
really was at the electrode: a line `time_s frequency_hz voltage_v` for every change, on
CLOCK_MONOTONIC.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
import time
from contextlib import closing
from pathlib import Path

from haptic_driver.processes import parent
from haptic_driver.processes.compilation import compilation_said
from haptic_driver.processes.real_time import Metronome, go_first, settle_memory
from haptic_driver.processes.started import start_thread
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.slide import read_slide, synthetic_slide
from haptic_driver.simulation.finger_function import load_finger
from haptic_driver.simulation.finger_model import FingerLaws
from haptic_driver.simulation.served import STEP_S, ServedRig, finger_at_once

LINGER_S = 5.0  # for another watcher to switch off, and to lift the finger


class _Record:
    """What really was at the electrode: every change, written at once, so that no kill loses it."""

    def __init__(self, path: Path | str) -> None:
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        self._last: tuple[float, float] | None = None
        self._writing = threading.Lock()

    def note(self, frequency_hz: float, voltage_v: float) -> None:
        """Write it down, if that is news."""
        with self._writing:
            now = (frequency_hz, voltage_v)
            if now != self._last:
                self._last = now
                os.write(self._file, b"%.6f %.6g %.6g\n" % (time.monotonic(), *now))

    def close(self) -> None:
        """No more of it."""
        os.close(self._file)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rig")
    parser.add_argument("model")
    parser.add_argument("--record", type=Path, default=os.devnull)
    parser.add_argument("--finger")
    parser.add_argument("--slide", type=Path)
    given = parser.parse_args()
    config = load_rig(given.rig)
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda number, frame: ended.set())
    signal.signal(signal.SIGINT, lambda number, frame: ended.set())
    with compilation_said("simulated instruments", parent.still):
        finger = _finger(config, given.model, given.finger)
    slide = synthetic_slide() if given.slide is None else read_slide(given.slide)
    go_first(with_its_own=True)  # real instruments answer however busy the machine is
    with (
        closing(_Record(given.record)) as record,
        ServedRig(config, finger, slide, on_drive=record.note) as served,
    ):
        parent.tell({"endpoints": served.endpoints})
        start_thread("linger", _linger, ended)
        settle_memory()
        metronome = Metronome(STEP_S, began_s=served.instruments.time_s)
        while not ended.is_set():
            metronome.wait()
            served.catch_up()


def _finger(config: RigConfig, model: str, finger: str | None) -> FingerLaws:
    """A function's laws, or those of the finger's model with what the rig hides."""
    if finger is None:
        return finger_at_once(config, model)
    own = load_finger(finger)
    own.friction(1e3, 50.0, 0.5, 0.02, 0.0)  # made ready before time passes
    return FingerLaws(own.friction, own.electrode)


def _linger(ended: threading.Event) -> None:
    """End some time after whoever started us has gone."""
    while os.read(sys.stdin.fileno(), 64):
        pass
    time.sleep(LINGER_S)
    ended.set()


if __name__ == "__main__":
    main()
