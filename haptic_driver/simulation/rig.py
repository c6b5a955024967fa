"""A rig on simulated instruments whose time passes in steps: what every demo and measurement in simulation runs on."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Self

from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.devices import build_rig
from haptic_driver.rig.part import Wiring
from haptic_driver.simulation.friction import FrictionLaw, friction_of, with_hidden
from haptic_driver.simulation.instruments import SCALE, SimulatedInstruments
from hw.errors import DeviceTimeout
from hw.force.net_ft import NetFt, NetFtSettings
from hw.force.sensor import ForceAxes, ForceReading
from hw.serving.responder import Responder
from hw.transport.contract import Transport
from hw.transport.tcp import TcpTransport
from model.touch_model import TouchModel

FORCE_TIMEOUT_S = 60.0  # simulated time stands still while the model is asked


class SimulatedRig:
    """A rig and its instruments, connected over loopback inside a `with` block.

    `rig` is what a driver sees, `instruments` what lies behind; `instruments.amplifier` keeps the record of what really
    was at the electrode. `friction`: any function instead of the model's with the effects that the rig's configuration
    hides. `wrap`: see `SimulatedInstruments`. `through` may put something around the driver's transport, such as a wire
    log.
    """

    def __init__(
        self,
        config: RigConfig,
        model: TouchModel,
        wrap: Callable[[Responder], Responder] = lambda generator: generator,
        friction: FrictionLaw | None = None,
        through: Callable[[Transport], Transport] = lambda transport: transport,
    ) -> None:
        law = friction or friction_of(with_hidden(model, config.simulation.hide))
        self.instruments = SimulatedInstruments(config, law, wrap=wrap)
        self.amplifier = self.instruments.amplifier
        transport = TcpTransport.from_resource(self.instruments.generator_server.resource)
        self._force = _SteppedForceSensor(self.instruments)
        lines = Wiring(enable=self.amplifier, voltage_monitor=self.amplifier)
        self.rig = build_rig(config, through(transport), self._force, lines)

    def step(self, dt_s: float, normal_force_n: float, speed_m_s: float) -> None:
        """Let `dt_s` pass with the finger pressing and sliding so; the rig's outputs act on it."""
        self.instruments.step(dt_s, normal_force_n, speed_m_s)

    def __enter__(self) -> Self:
        """Serve the instruments."""
        with ExitStack() as started:  # nothing is left serving where the next one does not start
            started.enter_context(self.instruments)
            started.callback(self._force.box.close)
            started.callback(self.rig.close)
            self._force.box.open()
            self._started = started.pop_all()
        return self

    def __exit__(self, *reason: object) -> None:
        """Switch off and stop serving."""
        self._started.close()


class _SteppedForceSensor:
    """The Net F/T box, which is made to send whenever it is read; times are those of the simulation."""

    def __init__(self, instruments: SimulatedInstruments) -> None:
        self._instruments = instruments
        server = instruments.force_box
        settings = NetFtSettings(server.host, SCALE, ForceAxes("-z", "x"), port=server.port, timeout_s=FORCE_TIMEOUT_S)
        self.box = NetFt(settings)

    def read(self) -> ForceReading:
        """The forces now."""
        heard, until_s = self.box.counters.accepted, time.monotonic() + FORCE_TIMEOUT_S
        self._instruments.force_box.emit(1)
        reading = self.box.read()
        while self.box.counters.accepted == heard:  # it is still on its way
            if time.monotonic() > until_s:
                raise DeviceTimeout(f"{self.box.resource} sent nothing", "a fault of the simulation")
            reading = self.box.read()
        return reading._replace(time_s=self._instruments.plant.time_s)
