"""A rig on simulated instruments whose time passes in steps: what every demo and measurement in
simulation runs on.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from math import ceil, pi
from typing import Self

from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.devices import build_rig, carrier_output
from haptic_driver.rig.part import Wiring
from haptic_driver.rig.parts.analog_outputs import SimulatedAnalogOutputConfig
from haptic_driver.rig.parts.electrode_monitors import SimulatedElectrodeMonitorConfig
from haptic_driver.simulation.finger_model import (
    ElectrodeLaw,
    FrictionLaw,
    between_loads,
    electrode_of,
    friction_of,
    with_hidden,
)
from haptic_driver.simulation.instruments import SINE_WITHOUT_BIAS, SimulatedInstruments
from hw.analog.output import AnalogOutput
from hw.analog.simulated_output import SimulatedAnalogOutput
from hw.errors import DeviceTimeout
from hw.force.net_ft import NetFt, NetFtSettings
from hw.force.net_ft_server import SCALE
from hw.force.sensor import ForceAxes, ForceReading, ForceSensor, NoForceSensor
from hw.generator.analog_carrier.driver import AnalogCarrier
from hw.monitor.contract import ElectrodeMonitor, ElectrodeReading
from hw.monitor.lines import SampledMonitor
from hw.monitor.simulated import ElectrodeState, SimulatedInputs, SimulatedLines
from hw.serving.responder import Responder
from hw.transport.contract import Transport
from hw.transport.tcp import TcpTransport
from model.touch_model import TouchModel

RESEND_S = 0.05
PUMPED_S = 0.002  # of simulated time, between two looks at a carrier's samples
# of instruments that are there: simulated time stands still meanwhile, whatever the machine does
TIMEOUT_S = 60.0


class SimulatedRig:
    """A rig and its instruments, connected over loopback inside a `with` block.

    `rig` is what a driver sees, `instruments` what lies behind; `instruments.amplifier` keeps the
    record of what really was at the electrode. `friction` and `electrode` are any functions, in
    place of the model's with the effects that the rig's configuration hides. Friction without the
    other leaves nothing to read at the electrode. `wrap`: see `SimulatedInstruments`. `through` may
    put something around the driver's transport, such as a wire log. `reply_timeout_s`: how long the
    driver waits for the generator, in place of the configuration's, which is meant for real time.
    `touch_gain` multiplies the current of the model's touch, beside the stray one. With `envelope`
    the generator's amplitude follows the analog output of a rig that has one; `analog_output` is
    its driver's end.
    """

    def __init__(
        self,
        config: RigConfig,
        model: TouchModel,
        wrap: Callable[[Responder], Responder] = lambda generator: generator,
        friction: FrictionLaw | None = None,
        electrode: ElectrodeLaw | None = None,
        through: Callable[[Transport], Transport] = lambda transport: transport,
        reply_timeout_s: float = TIMEOUT_S,
        envelope: bool = False,
    ) -> None:
        generator = config.waveform_generator.model_copy(
            update={"reply_timeout_s": reply_timeout_s}
        )
        config = config.model_copy(update={"waveform_generator": generator})
        finger, stray_f = (
            with_hidden(model, config.simulation.hide),
            config.simulation.stray_capacitance_f,
        )
        varied = config.load_stage.kind != "none"  # then the load is another in every step
        law = friction or (between_loads if varied else friction_of)(finger)
        self.instruments = SimulatedInstruments(config, law, wrap=wrap)
        self.amplifier = self.instruments.amplifier
        self._finger = finger
        self._electrode = electrode if friction else electrode_of(finger, stray_f)
        self._stray_f = (
            None if friction else stray_f + finger.description.values.stray_capacitance_f
        )
        self.touch_gain = 1.0
        self._seen: ElectrodeState | None = None  # what the monitors look at
        self.config, self._monitors = config, electrode_monitors(config, lambda: self._seen)
        self.analog_output = self._analog_output() if envelope else None
        port = self._carrier_output() or through(
            TcpTransport.from_resource(self.instruments.generator_server.resource)
        )
        self._force = _SteppedForceSensor(self.instruments)
        given = config.without_force
        self._sensor: ForceSensor = (
            self._force if given is None else NoForceSensor(given.load_n, lambda: self.time_s)
        )
        lines = Wiring(enable=self.amplifier, voltage_monitor=self.amplifier)
        self.rig = build_rig(
            config, port, self._sensor, lines, modulated=self.analog_output is not None
        )

    def step(self, dt_s: float, normal_force_n: float, speed_m_s: float) -> None:
        """Let `dt_s` pass with the finger pressing and sliding so; the rig's outputs act on it."""
        generator = self.rig.generator
        parts = ceil(dt_s / PUMPED_S) if isinstance(generator, AnalogCarrier) else 1
        for _ in range(parts):
            self.instruments.step(dt_s / parts, normal_force_n, speed_m_s)
            if isinstance(generator, AnalogCarrier):
                generator.pump()

    def read_electrode(self, frequency_hz: float, voltage_v: float) -> ElectrodeReading | None:
        """The present reading of the first monitor that measures this carrier; None without one, or
        where nothing is known.
        """
        i = self.config.electrode_monitor(frequency_hz)
        self._seen = None if i is None else self._electrode_state()
        if i is None or self._seen is None:
            return None
        return self._monitors[i].read(frequency_hz, voltage_v)

    @property
    def force_sensor(self) -> ForceSensor:
        """Its driver's end; open inside the `with` block."""
        return self._sensor

    @property
    def time_s(self) -> float:
        """Simulated time, by which forces are stamped."""
        return self.instruments.plant.time_s

    def read_force(self) -> ForceReading:
        """What the force sensor says now."""
        return self._sensor.read()

    def touch_area_m2(self) -> float:
        """Apparent contact area of the model's finger under the present load; 0 where it is
        lifted.
        """
        load_n = self.instruments.plant.normal_force_n
        return self._finger.contact_area_m2(load_n) if load_n > 0.0 else 0.0

    def _analog_output(self) -> AnalogOutput | None:
        section, card = self.config.analog_output, self.instruments.card
        if not isinstance(section, SimulatedAnalogOutputConfig) or card is None:
            return None
        return SimulatedAnalogOutput(
            lambda: card, section.settings(), clock=lambda: self.instruments.time_s, watch=False
        )

    def _carrier_output(self) -> AnalogOutput | None:
        """What stands in for a generator, if anything does."""
        carrier, card = self.config.waveform_generator.carrier, self.instruments.card
        if carrier is None or card is None:
            return None
        return SimulatedAnalogOutput(
            lambda: card,
            carrier_output(carrier),
            clock=lambda: self.instruments.time_s,
            watch=False,
        )

    def _electrode_state(self) -> ElectrodeState | None:
        if self._electrode is None:
            return None
        instruments, plant = self.instruments, self.instruments.plant
        frequency_hz, voltage_v, *bias = instruments.stimulus()
        told = () if tuple(bias) == SINE_WITHOUT_BIAS else bias
        condition = (
            frequency_hz,
            voltage_v,
            plant.normal_force_n,
            instruments.speed_m_s,
            plant.time_s,
        )
        state = self._electrode(*condition, *told)
        if state is None or self._stray_f is None:
            return state
        stray_a = 2j * pi * frequency_hz * self._stray_f * state.voltage_v
        return state._replace(current_a=stray_a + self.touch_gain * (state.current_a - stray_a))

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


def electrode_monitors(
    config: RigConfig, state: Callable[[], ElectrodeState | None]
) -> list[ElectrodeMonitor]:
    """The drivers of what reads the electrode, on the simulated amplifier's monitor lines."""
    amplifier = config.amplifier
    lines, noise_v = (
        amplifier.monitor_lines(),
        (amplifier.voltage_monitor_noise_v, amplifier.current_monitor_noise_v),
    )
    simulated = SimulatedLines(state, lines, noise_v, config.simulation.seed)
    monitors: list[ElectrodeMonitor] = []
    for section in config.electrode_monitors:
        assert isinstance(
            section, SimulatedElectrodeMonitorConfig
        )  # or the file would have been refused
        inputs = SimulatedInputs(
            simulated,
            section.sample_rate_hz,
            section.range_v,
            section.resolution_v,
            section.buffer_s,
        )
        monitors.append(SampledMonitor(inputs, lines, section.sampling()))
    return monitors


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
            with suppress(
                DeviceTimeout
            ):  # nothing yet, or stale by the machine's clock, not the simulation's
                newest = self.box.read()
                reading = newest if self.box.counters.accepted > heard else None
        return reading._replace(time_s=self._instruments.plant.time_s)
