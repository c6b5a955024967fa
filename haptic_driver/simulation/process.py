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
import socket
import sys
import threading
import time
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from haptic_driver.lookup.build import build_surface
from haptic_driver.lookup.models import load_model
from haptic_driver.processes import parent
from haptic_driver.processes.compilation import compilation_said
from haptic_driver.processes.real_time import Metronome, settle_memory
from haptic_driver.processes.started import start_thread
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.parts.load_stages import SimulatedLoadStageConfig
from haptic_driver.rig.slide import TICK_S, Slide, read_slide, synthetic_slide
from haptic_driver.simulation.electrode import SimulatedElectrode
from haptic_driver.simulation.finger_function import load_finger
from haptic_driver.simulation.finger_model import (
    ElectrodeLaw,
    FrictionLaw,
    electrode_of,
    surface_friction,
    with_hidden,
)
from haptic_driver.simulation.instruments import SimulatedInstruments
from haptic_driver.simulation.lines import LinesServer
from haptic_driver.simulation.world import World
from hw.analog.simulated_output import CardMemory
from hw.finger.simulated_touch_screen import PANEL, SimulatedTouchScreen
from hw.monitor.simulated import ElectrodeState
from hw.serving.responder import Responder
from hw.serving.serial import SerialServer
from hw.serving.tcp import TcpServer
from hw.transport.running import RunningTogether
from model.touch_model import TouchModel

STEP_S = 0.001
PARTS = 2  # of a step: what an envelope does within it is felt at its end
ROUNDING = 1e-3  # of a step
MOST_STEPS = 50  # at once; a machine that is slower than the simulation would never catch up
LINGER_S = 5.0  # for another watcher to switch off, and to lift the finger
FINGER_Y_M = 0.030
TOUCH_N = 0.02  # from this force on the screen feels the finger


class SlidingFinger(RunningTogether):
    """The simulated instruments, served, and a finger that repeats `slide` for ever; a touch screen
    reports its place.

    The load is the slide's. Where the rig has a load stage, it is that of the finger's body from
    when the stage moves for the first time on.

    Serves inside a `with` block; `step` lets time pass.
    """

    def __init__(
        self,
        config: RigConfig,
        friction: FrictionLaw,
        slide: Slide | None = None,
        record: Path | None = None,
        electrode: ElectrodeLaw | None = None,
    ) -> None:
        recording = None if record is None else _Record(record)
        on_drive = recording.note if recording else lambda frequency_hz, voltage_v: None
        card, self._card = CardMemory.create()
        self._stepping = threading.RLock()
        self._began_s = time.monotonic()
        self.instruments = SimulatedInstruments(
            config, friction, wrap=self._up_to_date, on_drive=on_drive, card=card
        )
        self.instruments.time_s = self._began_s
        self._slide = slide or synthetic_slide()
        self._speed_m_s = self._slide.speed_m_s
        self._screen = SimulatedTouchScreen(PANEL, clock=lambda: self.instruments.time_s)
        self._electrode = SimulatedElectrode(config, self.instruments, _there(electrode))
        self._by_samples = config.generator_kind().by_samples
        section = config.load_stage
        pressing = section if isinstance(section, SimulatedLoadStageConfig) else None
        self.world = World(self.instruments, pressing, step=self._pass)
        pressed = self.world.pressed
        self._stage_server: SerialServer | None = None
        if pressed is not None:
            pressed.stage.know_place()
            self._stage_server = SerialServer(self._up_to_date(pressed.stage), framed=False)
        lines = LinesServer(self.instruments, self._electrode.read, pressed)
        self._lines_server = TcpServer(self._up_to_date(lines))
        self._touch_server = _TouchServer(self._screen)
        super().__init__(
            *([closing(recording)] if recording else []),
            self.instruments,
            self._lines_server,
            closing(self._touch_server),
            *([self._stage_server] if self._stage_server else []),
        )

    @property
    def endpoints(self) -> dict[str, str]:
        force_box = self.instruments.force_box
        always = {
            "waveform_generator": self.instruments.generator_server.resource,
            "amplifier_lines": self._lines_server.resource,
            "force_sensor": f"{force_box.host}:{force_box.port}",
            "finger_tracker": f"127.0.0.1:{self._touch_server.port}",
        }
        if self._stage_server is not None:
            always["load_stage"] = self._stage_server.resource
        here = f"/proc/{os.getpid()}/fd/{self._card}"
        if self._by_samples:
            return always | {"waveform_generator": f"card:simulated:{here}"}
        return always if self.instruments.card is None else always | {"analog_output": here}

    def catch_up(self) -> None:
        """Let the time pass that has passed: the finger moves on, the outputs act on it, the
        sensors tell.

        What a busy machine missed has happened all the same, in steps as short as ever up to a
        limit. Whoever asks an instrument is answered for the present, and not for when this process
        last had its turn.
        """
        with self._stepping:
            missed = int((time.monotonic() - self.instruments.time_s) / STEP_S + ROUNDING)
            steps = min(missed, MOST_STEPS)
            for _ in range(steps):
                self._move(missed * STEP_S / steps)
            if steps:
                self._touch_server.pump()
                self.instruments.force_box.emit(1)

    def _up_to_date(self, generator: Responder) -> Responder:
        return _UpToDate(generator, self.catch_up)

    def _move(self, dt_s: float) -> None:
        slide = self._slide
        place = round((self.instruments.time_s + dt_s - self._began_s) / TICK_S) % slide.time_s.size
        force_n, x_m = float(slide.normal_force_n[place]), float(slide.position_m[place])
        self.world.advance(dt_s, force_n, float(self._speed_m_s[place]))
        if self.world.load_n >= TOUCH_N:
            self._screen.put(x_m, FINGER_Y_M)
        else:
            self._screen.lift()

    def _pass(self, dt_s: float, normal_force_n: float, speed_m_s: float) -> None:
        for _ in range(PARTS):
            self.instruments.step(dt_s / PARTS, normal_force_n, speed_m_s)


def _there(law: ElectrodeLaw | None) -> ElectrodeLaw:
    """A law by which a monitor reads its own noise where nothing else is known."""

    def seen(*condition: Any) -> ElectrodeState:
        state = None if law is None else law(*condition)
        return state or ElectrodeState(0.0, 0.0, 0.0)

    return seen


class _UpToDate:
    """An instrument to which commands come at the time at which they were sent."""

    def __init__(self, instrument: Responder, catch_up: Callable[[], object]) -> None:
        self._instrument = instrument
        self._catch_up = catch_up

    def handle(self, data: bytes) -> bytes:
        """As the instrument itself, now."""
        self._catch_up()
        return self._instrument.handle(data)


class _Record:
    """What really was at the electrode: every change, written at once, so that no kill loses it."""

    def __init__(self, path: Path) -> None:
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


class _TouchServer:
    """Hands the touch screen's events, as bytes of `struct input_event`, to the latest client."""

    def __init__(self, screen: SimulatedTouchScreen) -> None:
        self._screen = screen
        os.set_blocking(screen.descriptor, False)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)
        self.port = int(self._listener.getsockname()[1])
        self._client: socket.socket | None = None

    def pump(self) -> None:
        """Pass on what there is; without a client it is thrown away."""
        with suppress(BlockingIOError):
            self._client, _ = self._listener.accept()
            self._client.setblocking(False)
            self._screen.repeat()  # it missed where the finger is, and only changes are reported
        try:
            events = os.read(self._screen.descriptor, 1 << 16)
            if self._client is not None:
                self._client.sendall(events)
        except BlockingIOError:
            pass
        except OSError:
            self._client = None

    def close(self) -> None:
        self._listener.close()
        if self._client is not None:
            self._client.close()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rig")
    parser.add_argument("model")
    parser.add_argument("--record", type=Path)
    parser.add_argument("--finger")
    parser.add_argument("--slide", type=Path)
    given = parser.parse_args()
    config = load_rig(given.rig)
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda number, frame: ended.set())
    signal.signal(signal.SIGINT, lambda number, frame: ended.set())
    with compilation_said("simulated instruments", parent.still):
        friction, electrode = _finger(config, given.model, given.finger)
        friction(1e3, 50.0, 0.5, 0.02, 0.0)  # made ready before time passes
    slide = None if given.slide is None else read_slide(given.slide)
    with SlidingFinger(config, friction, slide, given.record, electrode) as served:
        parent.tell({"endpoints": served.endpoints})
        start_thread("linger", _linger, ended)
        settle_memory()
        metronome = Metronome(STEP_S, began_s=served.instruments.time_s)
        while not ended.is_set():
            metronome.wait()
            served.catch_up()


def _finger(config: RigConfig, model: str, finger: str | None) -> tuple[FrictionLaw, ElectrodeLaw]:
    """Those of a function, or of the finger's model with what the rig hides."""
    if finger is not None:
        own = load_finger(finger)
        return own.friction, own.electrode
    limits, description = config.operating_limits(), load_model(config.simulation.model or model)
    model_of_finger = with_hidden(TouchModel(description), config.simulation.hide)
    electrode = electrode_of(model_of_finger, config.simulation.stray_capacitance_f)
    return surface_friction(build_surface(model_of_finger.description, limits), limits), electrode


def _linger(ended: threading.Event) -> None:
    """End some time after whoever started us has gone."""
    while os.read(sys.stdin.fileno(), 64):
        pass
    time.sleep(LINGER_S)
    ended.set()


if __name__ == "__main__":
    main()
