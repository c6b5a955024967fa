"""A rig on simulated instruments whose time passes in steps: what every demo and measurement in
simulation runs on.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from math import ceil
from typing import Self

from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.devices import Devices, build_rig, carrier_output
from haptic_driver.rig.evidence import Clock
from haptic_driver.rig.load_loop import LoadSensor
from haptic_driver.rig.part import Wiring
from haptic_driver.rig.parts.analog_outputs import SimulatedAnalogOutputConfig
from haptic_driver.rig.parts.cameras import SimulatedCameraConfig
from haptic_driver.rig.parts.load_stages import SimulatedLoadStageConfig, lts150_settings
from haptic_driver.rig.parts.stages import Lts150StageConfig
from haptic_driver.simulation.electrode import SimulatedElectrode
from haptic_driver.simulation.finger_model import (
    ElectrodeLaw,
    FrictionLaw,
    between_loads,
    electrode_of,
    finger_of,
    friction_of,
)
from haptic_driver.simulation.instruments import SimulatedInstruments
from haptic_driver.simulation.twin import copy_of
from haptic_driver.simulation.world import World
from hw.analog.output import AnalogOutput, AnalogOutputSettings
from hw.analog.simulated_output import SimulatedAnalogOutput
from hw.camera.fingerprint import Optics
from hw.camera.simulated import Burst, Finger, SimulatedCamera
from hw.errors import DeviceTimeout
from hw.force.net_ft import NetFt, NetFtSettings
from hw.force.net_ft_server import SCALE
from hw.force.sensor import ForceAxes, ForceReading, NoForceSensor
from hw.generator.analog_carrier.driver import AnalogCarrier
from hw.health import FORCE, with_health
from hw.serving.memory import MemoryTransport
from hw.serving.responder import Responder
from hw.stage.lts150 import Lts150, StageSettings
from hw.stage.simulated import SimulatedLts150
from hw.transport.tcp import TcpTransport
from model.touch_model import TouchModel

STEP_S = 1e-3  # in which a pressed finger lives
FREE_STEP_S = 5e-3  # and one in the air
INSTANT_S = 1e-12
NEAR_M = 0.5e-3  # as near as this it may touch within a step
BYTE_S = 10.0 / 115_200.0
REPLY_S = 2e-3  # which a USB interface with the shortest latency adds to an answer
STAGE_MM = 40.0  # of the stage that carries the finger, as it begins
RESEND_S = 0.05
PUMPED_S = 0.002  # of simulated time, between two looks at a carrier's samples
# of instruments that are there: simulated time stands still meanwhile, whatever the machine does
TIMEOUT_S = 60.0


class SimulatedRig:
    """A rig and its instruments, connected over loopback inside a `with` block. Of a real rig it is
    a copy, without what is `left_out`.

    `rig` is what a driver sees, `instruments` what lies behind; `instruments.amplifier` keeps the
    record of what really was at the electrode. `friction` and `electrode` are any functions, in
    place of the model's with the effects that the rig's configuration hides. Friction without the
    other leaves nothing to read at the electrode. `wrap`: see `SimulatedInstruments`.
    `reply_timeout_s`: how long the driver waits for the generator, in place of the configuration's,
    which is meant for real time. With `envelope` the generator's amplitude follows the analog
    output of a rig that has one; `analog_output` is its driver's end.

    Stages are LTS150s behind their own drivers. Time passes as their wires answer, and as whoever
    waits sleeps. Until one has moved, the finger presses with `asked_n`, as a person does who is
    asked to. `varies` is told of each step before it is made.
    """

    def __init__(
        self,
        config: RigConfig,
        model: TouchModel,
        wrap: Callable[[Responder], Responder] = lambda generator: generator,
        friction: FrictionLaw | None = None,
        electrode: ElectrodeLaw | None = None,
        reply_timeout_s: float = TIMEOUT_S,
        envelope: bool = False,
    ) -> None:
        config, self.left_out = copy_of(config)
        generator = config.waveform_generator.model_copy(
            update={"reply_timeout_s": reply_timeout_s}
        )
        config = config.model_copy(update={"waveform_generator": generator})
        finger, stray_f = (
            finger_of(model, config.simulation),
            config.simulation.stray_capacitance_f,
        )
        varied = config.load_stage.kind != "none"  # then the load is another in every step
        law = friction or (between_loads if varied else friction_of)(finger)
        self.instruments = SimulatedInstruments(config, law, wrap=wrap)
        self.amplifier = self.instruments.amplifier
        self._finger = finger
        own_f = stray_f + finger.description.values.stray_capacitance_f
        self.electrode = SimulatedElectrode(
            config,
            self.instruments,
            electrode if friction else electrode_of(finger, stray_f),
            None if friction else own_f,
        )
        self.config = config
        self.analog_output = self._analog_output() if envelope else None
        resource = self.instruments.generator_server.resource
        port = self._carrier_output() or TcpTransport.from_resource(resource)
        self._force = _SteppedForceSensor(self.instruments)
        given = config.without_force
        sensor = self._force if given is None else NoForceSensor(given.load_n, self.clock)
        self._sensor: LoadSensor = with_health(sensor, "force_sensor", FORCE, self.clock)
        lines = Wiring(enable=self.amplifier, voltage_monitor=self.amplifier)
        self.rig = build_rig(
            config,
            port,
            self._sensor,
            lines,
            modulated=self.analog_output is not None,
            clock=Clock(self.clock),
        )
        self.asked_n = 0.0
        self.varies: Callable[[float], object] = lambda dt_s: None
        pressing, sliding = config.load_stage, config.stage
        section = pressing if isinstance(pressing, SimulatedLoadStageConfig) else None
        stage_mm = STAGE_MM if isinstance(sliding, Lts150StageConfig) else None
        self.world = World(self.instruments, section, stage_mm=stage_mm, step=self._pass)
        self.camera = self._camera()
        self.stage = self.load_stage = None
        if isinstance(sliding, Lts150StageConfig) and self.world.sliding is not None:
            self.stage = self._driver(self.world.sliding, sliding.settings())
        if section is not None and self.world.pressed is not None:
            self.load_stage = self._driver(self.world.pressed.stage, lts150_settings(section))

    @property
    def devices(self) -> Devices:
        """Its drivers as those of a real rig, closed."""
        drivers = [driver for driver in (self.stage, self.load_stage) if driver is not None]
        return Devices(
            rig=self.rig,
            force_sensor=self._sensor,
            stage=self.stage,
            load_stage=self.load_stage,
            camera=self.camera,
            opening=[self.__enter__, self.rig.connect, *(driver.connect for driver in drivers)],
            closing=[*(driver.close for driver in drivers), self.__exit__],
        )

    def step(self, dt_s: float, normal_force_n: float, speed_m_s: float) -> None:
        """Let `dt_s` pass with the finger pressing and sliding so, where no stage has moved it; the
        rig's outputs act on it.
        """
        self.world.advance(dt_s, normal_force_n, speed_m_s)

    def sleep(self, duration_s: float) -> None:
        """Let time pass: the finger slides and is pressed as the stages move."""
        end_s, pressed = self.time_s + duration_s, self.world.pressed
        while (left_s := end_s - self.time_s) > INSTANT_S:
            may_touch = self.asked_n > 0.0 if pressed is None else pressed.depth_m > -NEAR_M
            hand_n = self.asked_n if pressed is None else 0.0
            self.step(min(STEP_S if may_touch else FREE_STEP_S, left_s), hand_n, 0.0)

    def _pass(self, dt_s: float, normal_force_n: float, speed_m_s: float) -> None:
        self.varies(dt_s)
        generator = self.rig.generator
        parts = ceil(dt_s / PUMPED_S) if isinstance(generator, AnalogCarrier) else 1
        for _ in range(parts):
            self.instruments.step(dt_s / parts, normal_force_n, speed_m_s)
            if isinstance(generator, AnalogCarrier):
                generator.pump()

    def _driver(self, instrument: SimulatedLts150, settings: StageSettings) -> Lts150:
        wire = MemoryTransport(_Wire(instrument, self.sleep), clock=self.clock)
        return Lts150(wire, settings, clock=self.clock, sleep=self.sleep)

    @property
    def force_sensor(self) -> LoadSensor:
        """Its driver's end; open inside the `with` block."""
        return self._sensor

    @property
    def time_s(self) -> float:
        """Simulated time, by which forces are stamped."""
        return self.instruments.time_s

    def clock(self) -> float:
        """The same, for whoever calls a clock."""
        return self.time_s

    def read_force(self) -> ForceReading:
        """What the force sensor says now."""
        return self._sensor.read()

    def _camera(self) -> SimulatedCamera | None:
        section = self.config.camera
        if not isinstance(section, SimulatedCameraConfig):
            return None
        optics = Optics(
            section.width,
            section.height,
            section.scale_m_per_pixel,
            section.blur_m,
            noise=section.noise,
        )
        burst = Burst(section.frames, section.interval_s)
        return SimulatedCamera(self._touch, optics, burst, seed=self.config.simulation.seed)

    def _touch(self) -> Finger:
        """What there is to see: the model's area under the present load, whatever friction is."""
        load_n = self.instruments.plant.normal_force_n
        area_m2 = self._finger.contact_area_m2(load_n) if load_n > 0.0 else 0.0
        area_m2 *= self.electrode.touch_gain
        return Finger(self.time_s, area_m2, self.instruments.speed_m_s)

    def _analog_output(self) -> AnalogOutput | None:
        section = self.config.analog_output
        if not isinstance(section, SimulatedAnalogOutputConfig):
            return None
        return self._on_card(section.settings())

    def _carrier_output(self) -> AnalogOutput | None:
        """What stands in for a generator, if anything does."""
        carrier = self.config.waveform_generator.carrier
        return None if carrier is None else self._on_card(carrier_output(carrier))

    def _on_card(self, settings: AnalogOutputSettings) -> AnalogOutput:
        card = self.instruments.card
        assert card is not None  # of a rig with such an output
        return SimulatedAnalogOutput(lambda: card, settings, clock=self.clock, watch=False)

    def __enter__(self) -> Self:
        with ExitStack() as started:  # nothing is left serving where the next one does not start
            started.enter_context(self.instruments)
            started.callback(self._force.box.close)
            started.callback(self.rig.close)
            if self.analog_output is not None:
                started.callback(self.analog_output.close)
                self.analog_output.open()
            self._force.box.open()
            self._started = started.pop_all()
        return self

    def __exit__(self, *reason: object) -> None:
        """Switch off and stop serving."""
        self._started.close()


class _SteppedForceSensor:
    """The Net F/T box, which is made to send whenever it is read; times are those of the
    simulation.
    """

    def __init__(self, instruments: SimulatedInstruments) -> None:
        self._instruments = instruments
        server = instruments.force_box
        settings = NetFtSettings(
            server.host, SCALE, ForceAxes("-z", "x"), port=server.port, timeout_s=TIMEOUT_S
        )
        self.box = NetFt(settings)

    def read(self) -> ForceReading:
        self.box.take_readings()  # nobody may have looked for long: the next record is believed
        heard, until_s, sent_s = self.box.counters.accepted, time.monotonic() + TIMEOUT_S, -math.inf
        reading: ForceReading | None = None
        while reading is None:
            now_s = time.monotonic()
            if now_s > until_s:
                raise DeviceTimeout(
                    f"{self.box.resource} took no record for {TIMEOUT_S:g} s",
                    "a fault of the simulation: no time has passed for the rig meanwhile",
                )
            if now_s - sent_s > RESEND_S:  # a busy machine loses datagrams, and is late with them
                self._instruments.force_box.emit(1)
                sent_s = now_s
            # nothing yet, or stale by the machine's clock, not the simulation's
            with suppress(DeviceTimeout):
                newest = self.box.read()
                reading = newest if self.box.counters.accepted > heard else None
        return reading._replace(time_s=self._instruments.time_s)


class _Wire:
    """An instrument whose answers take the time of their bytes and of the interface."""

    def __init__(self, instrument: SimulatedLts150, sleep: Callable[[float], None]) -> None:
        self._instrument, self._sleep = instrument, sleep

    def handle(self, data: bytes) -> bytes:
        answer = self._instrument.handle(data)
        self._sleep(BYTE_S * (len(data) + len(answer)) + (REPLY_S if answer else 0.0))
        return answer
