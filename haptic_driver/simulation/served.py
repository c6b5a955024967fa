"""A whole simulated rig on loopback for other people's software: every instrument by its own
dialogue, in real time.

    waveform_generator         TCP, as the LAN socket of a 33220A
    waveform_generator_serial  the same instrument on a pseudo-terminal
    interlock, interlock_tcp   the heartbeat interlock box of `hw.safety.interlock`, in series with
                               the amplifier's enable
    stage                      an LTS150 on a pseudo-terminal; it carries the finger
    load_stage                 another, which presses the finger as LOAD_STAGE says
    force_sensor               a Net F/T box, `host:port` for UDP; 1e6 counts per N, pressing along
                               -z, sliding along x
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping

from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.part import NoPart
from haptic_driver.rig.parts.finger_trackers import StageFingerConfig
from haptic_driver.rig.parts.force_sensors import NetFtForceSensorConfig
from haptic_driver.rig.parts.generators import WatchdogConfig
from haptic_driver.rig.parts.interlocks import InterlockBox
from haptic_driver.rig.parts.load_stages import SimulatedLoadStageConfig
from haptic_driver.rig.parts.stages import Lts150StageConfig
from haptic_driver.rig.roles import APART, ROLES
from haptic_driver.simulation.finger_model import between_loads, with_hidden
from haptic_driver.simulation.instruments import SimulatedInstruments
from haptic_driver.simulation.world import World
from hw.analog.simulated_output import CardMemory
from hw.force.net_ft_server import SCALE
from hw.generator.analog_carrier.simulator import SimulatedCarrier
from hw.safety.simulated_interlock import SimulatedInterlock
from hw.serving.serial import SerialServer
from hw.serving.tcp import TcpServer
from hw.transport.running import RunningTogether
from model.touch_model import TouchModel

NORMAL_FORCE_N = 0.5  # of the finger on the screen
FORCE_RATE_HZ = 1000.0
START_MM = 5.0  # of the stage: homing takes a second
LOAD_STAGE = SimulatedLoadStageConfig(kind="simulated")
# a simulated generator that is gone will not come back at the same address
WATCHDOG_GIVE_UP_S = 1.0
REPLY_S = 0.1  # of the interlock box, which shares its processor with everything else here


class ServedRig(RunningTogether):
    """The simulated instruments of a rig, served between entering and leaving a `with` block.

    Nothing but the stage moves by itself: call `advance` with the time that has passed.
    `generator_port` 0 is any free port. The enable line is the interlock's contact: without beats
    the amplifier is off. The finger is lifted, so that the force sensor can take its bias, until
    the stage moves for the first time; then it presses.
    """

    def __init__(self, config: RigConfig, model: TouchModel, *, generator_port: int = 0) -> None:
        self.interlock = SimulatedInterlock()
        card, self._card = CardMemory.create()
        self.instruments = SimulatedInstruments(
            config,
            between_loads(with_hidden(model, config.simulation.hide)),
            contact=lambda: self.interlock.closed,
            force_rate_hz=FORCE_RATE_HZ,
            generator_port=generator_port,
            card=card,
        )
        self.instruments.time_s = time.monotonic()  # by which a card plays
        self.amplifier, self.generator = self.instruments.amplifier, self.instruments.generator
        self.amplifier.write(True)
        self.world = World(self.instruments, LOAD_STAGE, stage_mm=START_MM, clock=time.monotonic)
        assert self.world.sliding is not None  # both were asked for
        assert self.world.pressed is not None
        self.stage, self.load_stage = self.world.sliding, self.world.pressed.stage
        self._load_serial = SerialServer(self.load_stage, framed=False)
        self._generator_serial = SerialServer(self.generator)
        self._interlock_tcp = TcpServer(self.interlock)
        self._interlock_serial = SerialServer(self.interlock, framed=False)
        self._stage_serial = SerialServer(self.stage, framed=False)
        super().__init__(
            self.instruments,
            self._generator_serial,
            self._interlock_tcp,
            self._interlock_serial,
            self._stage_serial,
            self._load_serial,
        )

    @property
    def endpoints(self) -> dict[str, str]:
        """Where everything is, by the names above."""
        generator = {
            "waveform_generator": self.instruments.generator_server.resource,
            "waveform_generator_serial": self._generator_serial.resource,
        }
        if isinstance(self.generator, SimulatedCarrier):
            here = f"/proc/{os.getpid()}/fd/{self._card}"
            generator = {"waveform_generator": f"card:simulated:{here}"}
        return generator | {
            "interlock": self._interlock_serial.resource,
            "interlock_tcp": self._interlock_tcp.resource,
            "stage": self._stage_serial.resource,
            "load_stage": self._load_serial.resource,
            "force_sensor": f"{self.instruments.force_box.host}:{self.instruments.force_box.port}",
        }

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` pass: settings reach the terminals, the stage has moved the finger, friction
        follows.
        """
        self.world.advance(dt_s, NORMAL_FORCE_N if self.stage.has_moved else 0.0)


def reached(config: RigConfig, endpoints: Mapping[str, str]) -> RigConfig:
    """A simulated rig as its drivers reach it: what is served of it at `endpoints`, by
    `haptic_driver.simulation.process`.
    """
    generator, lines = endpoints["waveform_generator"], endpoints["amplifier_lines"]
    watchdog = WatchdogConfig(generator=generator, give_up_s=WATCHDOG_GIVE_UP_S)
    where = {"interlock": lines, "electrode_monitors": lines, **endpoints}
    changed: dict[str, object] = {"watchdog": watchdog}
    for key, role in ROLES.items():
        simulated = [one for one in config.sections_of(key) if one.is_simulated]
        if simulated and role.opens is not APART:
            absent = RigConfig.model_fields[key].default
            served = [one.served_at(where[key]) for one in simulated if key in where]
            changed[key] = served if isinstance(absent, list) else next(iter(served), absent)
    return config.model_copy(update=changed)


def as_real(config: RigConfig, endpoints: Mapping[str, str]) -> RigConfig:
    """`config` as the file of a real rig would say it whose devices are those served at
    `endpoints`.
    """
    host, port = endpoints["force_sensor"].split(":")
    generator = endpoints["waveform_generator"]
    none = config.without_force
    if none is not None:
        none = none.model_copy(update={"stray_capacitance_f": config.stray_capacitance_f})
    box = NetFtForceSensorConfig(
        kind="net_ft",
        host=host,
        port=int(port),
        **SCALE._asdict(),
        normal_axis="-z",
        lateral_axis="x",
    )
    return config.model_copy(
        update={
            "simulated": False,
            "electrode_monitors": [] if none is None else config.electrode_monitors,
            "camera": NoPart(),
            "load_stage": NoPart(),
            "waveform_generator": config.waveform_generator.served_at(generator),
            "interlock": InterlockBox(
                kind="box", resource=endpoints["interlock"], reply_timeout_s=REPLY_S
            ),
            "watchdog": WatchdogConfig(generator=generator, interlock=endpoints["interlock_tcp"]),
            "force_sensor": none or box,
            "stage": Lts150StageConfig(
                resource=endpoints["stage"],
                travel_m=[0.0, 0.15],
                velocity_m_s=0.02,
                acceleration_m_s2=0.02,
                velocity_limit_m_s=0.05,
                acceleration_limit_m_s2=0.05,
            ),
            "finger_tracker": StageFingerConfig(kind="stage", origin_m=[0.0, 0.03]),
        }
    )
