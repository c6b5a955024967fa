"""The simulated instruments of a rig in a process of their own: real bytes on loopback, the model's physics behind.

    python -m haptic_driver.simulation.process RIG MODEL [--record FILE]

says its endpoints on standard output, as one JSON line, once it serves. It ends on SIGTERM, or a while after its
standard input closes: instruments outlive a driver that dies, so that whoever else watches can switch them off.
`--record` keeps what really was at the electrode: a line `time_s frequency_hz voltage_v` for every change, on
CLOCK_MONOTONIC.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import socket
import sys
import threading
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from haptic_driver.processes.real_time import Metronome
from haptic_driver.render.compiled import compilation_said
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.parts.analog_outputs import SimulatedAnalogOutputConfig
from haptic_driver.rig.slide import Slide, synthetic_slide
from haptic_driver.simulation.lines import PANEL, SCALE, LinesServer
from haptic_driver.simulation.rig import simulated_amplifier, simulated_generator, surface_friction, with_hidden
from haptic_driver.surface.build import build_surface
from haptic_driver.surface.models import load_model
from hw.analog.served_output import AnalogOutputServer
from hw.analog.simulated_output import SimulatedCard
from hw.finger.plant import FingerPlant
from hw.finger.simulated_touch_screen import SimulatedTouchScreen
from hw.force.net_ft_server import NetFtServer
from hw.generator.contract import TerminalOutput
from hw.serving.tcp import TcpServer
from model.description import ModelDescription
from model.touch_model import TouchModel

STEP_S = 0.001
LINGER_S = 2.0
FINGER_Y_M = 0.030
TOUCH_N = 0.02  # from this force on the screen feels the finger


class SimulatedInstruments:
    """Generator, amplifier with its lines, force sensor and touch screen of a simulated rig, and a finger sliding.

    With an analog output in the rig's file there is a card too, wired to the generator's Modulation In. The finger
    repeats `slide` for ever. Serves inside a `with` block; `step` lets time pass.
    """

    def __init__(
        self, config: RigConfig, model: ModelDescription, slide: Slide | None = None, record: Path | None = None
    ) -> None:
        simulation = config.simulation
        slide = slide or synthetic_slide()
        self._slide = slide
        self._speed_m_s = slide.speed_m_s
        self._duration_s = float(slide.time_s[-1] - slide.time_s[0])
        self._began_s = time.monotonic()
        self._gain = 1.0
        self._frequency_hz = 0.0
        self._noise = random.Random(simulation.seed)
        self._noise_n = simulation.force_noise_n
        self._range_n = simulation.force_range_n
        self._record = None if record is None else os.open(record, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        self._recorded: tuple[float, float] | None = None
        self._recording = threading.Lock()
        self.amplifier = simulated_amplifier(config)
        self._generator = simulated_generator(config, self.amplifier, self._drive)
        output = config.analog_output
        self._card = SimulatedCard(output.zero_level_v) if isinstance(output, SimulatedAnalogOutputConfig) else None
        file = build_surface(with_hidden(TouchModel(model), simulation.hide).description, config.operating_limits())
        law = surface_friction(file, config.operating_limits())
        self._plant = FingerPlant(
            lambda f, v, n, speed: self._gain * law(f, v, n, speed, self._plant.time_s),
            cutoff_hz_per_mm_s=simulation.friction_cutoff_hz_per_mm_s,
        )
        self._screen = SimulatedTouchScreen(PANEL, slots=0, clock=time.monotonic)
        self._generator_server = TcpServer(self._generator)
        self._lines_server = TcpServer(LinesServer(self.amplifier, self._note, self._set_gain))
        self._force_server = NetFtServer(self._wrench, **SCALE._asdict(), rate_hz=None)
        self._touch_server = _TouchServer(self._screen)
        self._card_server = None if self._card is None else TcpServer(AnalogOutputServer(self._card))

    @property
    def endpoints(self) -> dict[str, str]:
        """Where everything is."""
        always = {
            "waveform_generator": self._generator_server.resource,
            "amplifier_lines": self._lines_server.resource,
            "force_sensor": f"{self._force_server.host}:{self._force_server.port}",
            "touch_screen": f"127.0.0.1:{self._touch_server.port}",
        }
        return always if self._card_server is None else always | {"analog_output": self._card_server.resource}

    def step(self, dt_s: float) -> None:
        """Let `dt_s` pass: the finger moves on, the outputs act on it, the sensors tell."""
        if self._card is not None:
            self._card.advance(dt_s)
            self._generator.set_modulation_input(self._card.terminal_v)
        self._generator.advance(dt_s)
        output = self._generator.output()
        voltage_v = self.amplifier.step(dt_s, output)
        self._note()
        place = int(
            ((time.monotonic() - self._began_s) % self._duration_s) / self._duration_s * self._slide.time_s.size
        )
        force_n, x_m = float(self._slide.normal_force_n[place]), float(self._slide.position_m[place])
        self._plant.step(dt_s, output.frequency_hz, voltage_v, force_n, float(self._speed_m_s[place]))
        if force_n >= TOUCH_N:
            self._screen.put(x_m, FINGER_Y_M)
        else:
            self._screen.lift()
        self._touch_server.pump()
        self._force_server.emit(1)

    def __enter__(self) -> Self:
        """Serve."""
        self._serving = ExitStack()
        for server in (self._generator_server, self._lines_server, self._force_server, self._touch_server):
            self._serving.enter_context(server)
        if self._card_server is not None:
            self._serving.enter_context(self._card_server)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop serving."""
        self._serving.close()
        if self._record is not None:
            os.close(self._record)

    def _drive(self, output: TerminalOutput) -> None:
        self.amplifier.drive(output)
        self._frequency_hz = output.frequency_hz
        self._note()

    def _note(self) -> None:
        """Write down what is at the electrode, if that is news; at once, so that no kill loses it."""
        if self._record is None:
            return
        with self._recording:
            now = (self._frequency_hz, self.amplifier.voltage_v)
            if now != self._recorded:
                self._recorded = now
                os.write(self._record, b"%.6f %.6g %.6g\n" % (time.monotonic(), *now))

    def _set_gain(self, gain: float) -> None:
        self._gain = gain

    def _wrench(self) -> tuple[float, float, float, float, float, float]:
        """What the transducer feels, noise and the end of its range included: pressing along -z, sliding along x."""
        lateral_n, normal_n = (
            max(-self._range_n, min(force_n + self._noise.gauss(0.0, self._noise_n), self._range_n))
            for force_n in (self._plant.lateral_force_n, self._plant.normal_force_n)
        )
        return lateral_n, 0.0, -normal_n, 0.0, 0.0, 0.0


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
            self._screen.repeat()  # it missed where the finger is, and only changes are told
        try:
            events = os.read(self._screen.descriptor, 1 << 16)
            if self._client is not None:
                self._client.sendall(events)
        except BlockingIOError:
            pass
        except OSError:
            self._client = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._listener.close()
        if self._client is not None:
            self._client.close()


def main() -> None:
    """Run the process."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rig")
    parser.add_argument("model")
    parser.add_argument("--record", type=Path)
    given = parser.parse_args()
    config = load_rig(given.rig)
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda number, frame: ended.set())
    signal.signal(signal.SIGINT, lambda number, frame: ended.set())
    model = load_model(config.simulation.model or given.model)
    with compilation_said("simulated instruments"), SimulatedInstruments(config, model, record=given.record) as served:
        print(json.dumps({"endpoints": served.endpoints}), flush=True)
        threading.Thread(target=_linger, args=(ended,), daemon=True).start()
        metronome = Metronome(STEP_S)
        while not ended.is_set():
            served.step((metronome.wait().missed + 1) * STEP_S)


def _linger(ended: threading.Event) -> None:
    """End some time after whoever started us has gone."""
    while os.read(sys.stdin.fileno(), 64):
        pass
    time.sleep(LINGER_S)
    ended.set()


if __name__ == "__main__":
    main()
