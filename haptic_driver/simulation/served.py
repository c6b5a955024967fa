"""A simulated rig on loopback, every instrument by its own dialogue, in real time: for real drivers
and for other people's software.

    waveform_generator         TCP, as the LAN socket of a 33220A
    waveform_generator_serial  the same instrument on a pseudo-terminal
    interlock, interlock_tcp   the heartbeat interlock box of `hw.safety.interlock`, in series with
                               the amplifier's enable where the rig has one
    amplifier_lines            that enable and the monitors, by `hw.amplifier.served_lines`; GAIN x
                               multiplies the finger's friction, THRUST x lets it come to meet the
                               load stage by x m
    stage                      an LTS150 on a pseudo-terminal; it carries the finger
    load_stage                 another, which presses the finger
    force_sensor               a Net F/T box, `host:port` for UDP; 1e6 counts per N, pressing along
                               -z, sliding along x
    finger_tracker             a touch screen, `host:port` for its `struct input_event`
    analog_output              memory of a simulated card, wired to Modulation In
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from contextlib import closing
from functools import partial
from typing import Any

from haptic_driver.lookup.build import build_surface
from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.parts.interlocks import InterlockBox, SimulatedInterlockConfig
from haptic_driver.rig.parts.load_stages import SimulatedLoadStageConfig
from haptic_driver.rig.slide import Slide
from haptic_driver.simulation.electrode import SimulatedElectrode
from haptic_driver.simulation.finger_model import (
    ElectrodeLaw,
    FingerLaws,
    between_loads,
    electrode_of,
    finger_of,
    surface_friction,
)
from haptic_driver.simulation.hand import Hand
from haptic_driver.simulation.instruments import SimulatedInstruments
from haptic_driver.simulation.touch_server import TouchServer
from haptic_driver.simulation.twin import pressing, reached
from haptic_driver.simulation.world import World
from hw.amplifier.served_lines import LinesServer
from hw.analog.simulated_output import CardMemory
from hw.finger.simulated_touch_screen import PANEL, TOUCH_N, SimulatedTouchScreen
from hw.generator.analog_carrier.simulator import SimulatedCarrier
from hw.monitor.simulated import ElectrodeState
from hw.safety.simulated_interlock import SimulatedInterlock
from hw.serving.responder import Responder
from hw.serving.serial import SerialServer
from hw.serving.tcp import TcpServer
from hw.transport.running import RunningTogether
from model.touch_model import TouchModel

FORCE_RATE_HZ = 1000.0
START_MM = 5.0  # of the stage: homing takes a second
STEP_S = 0.001
PARTS = 2  # of a step: what an envelope does within it is felt at its end
ROUNDING = 1e-3  # of a step
MOST_STEPS = 50  # at once; a machine that is slower than the simulation would never catch up
SINE = 5  # numbers of a condition without bias and waveform


class ServedRig(RunningTogether):
    """The simulated instruments of a rig, served between entering and leaving a `with` block.

    Call `catch_up` as often as may be, or `advance` with the time that has passed. A `finger` by
    its model is exact and slow, and lives from one call to the next. With laws that answer at once
    it lives by the clock: whoever asks an instrument is answered for the present. `Hand` says what
    it does with `slide`. The amplifier is enabled as the rig's file says: by the interlock box, by
    a simulated rig's own line, or always. `generator_port` 0 is any free port. `on_drive` is that
    of `SimulatedInstruments`.
    """

    def __init__(
        self,
        config: RigConfig,
        finger: TouchModel | FingerLaws,
        slide: Slide | None = None,
        *,
        generator_port: int = 0,
        on_drive: Callable[[float, float], object] = lambda frequency_hz, voltage_v: None,
    ) -> None:
        self._config = config
        self._by_clock = not isinstance(finger, TouchModel)
        laws = _exact(config, finger) if isinstance(finger, TouchModel) else finger
        self._stepping = threading.RLock()
        self.interlock = SimulatedInterlock()
        boxed = isinstance(config.interlock, InterlockBox)
        card, self._card = CardMemory.create()
        self.instruments = SimulatedInstruments(
            config,
            laws.friction,
            contact=lambda: self.interlock.closed or not boxed,
            wrap=self._up_to_date,
            on_drive=on_drive,
            force_rate_hz=None if self._by_clock else FORCE_RATE_HZ,
            generator_port=generator_port,
            card=card,
        )
        self.amplifier, self.generator = self.instruments.amplifier, self.instruments.generator
        self.amplifier.write(not isinstance(config.interlock, SimulatedInterlockConfig))
        self._began_s = self.instruments.time_s = time.monotonic()  # by which a card plays
        clock = None if self._by_clock else time.monotonic
        self.world = World(
            self.instruments, pressing(config), stage_mm=START_MM, clock=clock, step=self._pass
        )
        assert self.world.sliding is not None  # both were asked for
        assert self.world.pressed is not None
        self.stage, self.load_stage = self.world.sliding, self.world.pressed.stage
        if isinstance(config.load_stage, SimulatedLoadStageConfig):
            self.load_stage.know_place()
        self._hand = Hand(config, slide, self.stage, self.instruments.force_box)
        self._screen = SimulatedTouchScreen(PANEL, clock=lambda: self.instruments.time_s)
        self._touch = TouchServer(self._screen)
        electrode = SimulatedElectrode(config, self.instruments, _there(laws.electrode))
        lines = LinesServer(
            self.amplifier,
            lambda frequency_hz: electrode.read(frequency_hz, self.instruments.voltage_v),
            self.instruments.tell_drive,
            {
                b"GAIN": partial(setattr, self.instruments, "finger_gain"),
                b"THRUST": partial(setattr, self.world.pressed, "thrust_m"),
            },
        )
        self._lines = TcpServer(self._up_to_date(lines))
        self._interlock_tcp = TcpServer(self.interlock)
        self._serial = {
            "waveform_generator_serial": SerialServer(self._up_to_date(self.generator)),
            "interlock": SerialServer(self.interlock, framed=False),
            "stage": SerialServer(self._up_to_date(self.stage), framed=False),
            "load_stage": SerialServer(self._up_to_date(self.load_stage), framed=False),
        }
        servers = self._lines, self._interlock_tcp, *self._serial.values()
        super().__init__(self.instruments, *servers, closing(self._touch))

    @property
    def endpoints(self) -> dict[str, str]:
        """Where everything is, by the names above."""
        instruments, card = self.instruments, f"/proc/{os.getpid()}/fd/{self._card}"
        found = {"waveform_generator": instruments.generator_server.resource}
        found |= {name: server.resource for name, server in self._serial.items()}
        found |= {
            "interlock_tcp": self._interlock_tcp.resource,
            "amplifier_lines": self._lines.resource,
            "force_sensor": f"{instruments.force_box.host}:{instruments.force_box.port}",
            "finger_tracker": self._touch.address,
        }
        if isinstance(self.generator, SimulatedCarrier):
            del found["waveform_generator_serial"]
            return found | {"waveform_generator": f"card:simulated:{card}"}
        return found if instruments.card is None else found | {"analog_output": card}

    @property
    def config(self) -> RigConfig:
        """The rig as its drivers reach it here."""
        return reached(self._config, self.endpoints)

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` pass: settings reach the terminals, hand and stages have moved the finger,
        friction follows.
        """
        hand = self._hand.at(self.instruments.time_s + dt_s - self._began_s)
        self.world.advance(dt_s, hand.load_n, hand.speed_m_s)
        if self.world.load_n >= TOUCH_N:
            self._screen.put(hand.x_m, hand.y_m)
        else:
            self._screen.lift()
        self._touch.pump()

    def catch_up(self) -> None:
        """Let the time pass that has passed.

        What a busy machine missed has happened all the same. Where the finger answers at once, it
        has in steps as short as ever, up to a limit.
        """
        with self._stepping:
            missed = int((time.monotonic() - self.instruments.time_s) / STEP_S + ROUNDING)
            steps = min(missed, MOST_STEPS if self._by_clock else 1)
            for _ in range(steps):
                self.advance(missed * STEP_S / steps)
            if steps and self._by_clock:
                self.instruments.force_box.emit(1)

    def _pass(self, dt_s: float, normal_force_n: float, speed_m_s: float) -> None:
        for _ in range(PARTS):
            self.instruments.step(dt_s / PARTS, normal_force_n, speed_m_s)

    def _up_to_date(self, instrument: Responder) -> Responder:
        return _UpToDate(instrument, self.catch_up) if self._by_clock else instrument


class _UpToDate:
    """An instrument to which commands come at the time at which they were sent."""

    def __init__(self, instrument: Responder, catch_up: Callable[[], object]) -> None:
        self._instrument = instrument
        self._catch_up = catch_up

    def handle(self, data: bytes) -> bytes:
        """As the instrument itself, now."""
        self._catch_up()
        return self._instrument.handle(data)


def finger_at_once(config: RigConfig, model: str) -> FingerLaws:
    """The finger of a rig that `model` drives, answering in microseconds: by a surface, where the
    voltage is a sine without bias.
    """
    finger = TouchModel(load_model(config.simulation.model or model))
    exact, limits = _exact(config, finger), config.operating_limits()
    hidden = finger_of(finger, config.simulation).description
    by_surface = surface_friction(build_surface(hidden, limits), limits)

    def friction_n(*condition: Any) -> float:
        return (by_surface if len(condition) == SINE else exact.friction)(*condition)

    friction_n(1e3, 50.0, 0.5, 0.02, 0.0)  # made ready before time passes
    return FingerLaws(friction_n, exact.electrode)


def _exact(config: RigConfig, model: TouchModel) -> FingerLaws:
    finger = finger_of(model, config.simulation)
    return FingerLaws(
        between_loads(finger), electrode_of(finger, config.simulation.stray_capacitance_f)
    )


def _there(law: ElectrodeLaw) -> ElectrodeLaw:
    """A law by which a monitor reads its own noise where nothing else is known."""

    def seen(*condition: Any) -> ElectrodeState:
        return law(*condition) or ElectrodeState(0.0, 0.0, 0.0)

    return seen
