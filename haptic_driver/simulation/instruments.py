"""The simulated instruments of a rig, wired to one another and to the finger that feels them.

Driver, limits and safety are those of a real rig: what is simulated lies beyond the wires. Time
passes in steps.
"""

from __future__ import annotations

import random
from collections.abc import Callable

from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.parts.analog_outputs import SimulatedAnalogOutputConfig
from haptic_driver.simulation.finger_model import FrictionLaw
from hw.amplifier.simulated import SimulatedAmplifier
from hw.analog.simulated_output import CardMemory
from hw.finger.plant import FingerPlant
from hw.force.net_ft_server import NetFtServer
from hw.generator.analog_carrier.simulator import SimulatedCarrier
from hw.generator.contract import GeneratorLatency, Listener, SimulatedGenerator, TerminalOutput
from hw.generator.settings import Shape
from hw.serving.responder import Responder
from hw.serving.tcp import TcpServer
from hw.transport.running import RunningTogether

SINE_WITHOUT_BIAS = (0.0, Shape.SINE.value)


class SimulatedInstruments(RunningTogether):
    """Generator, amplifier, force sensor and finger; a card too, wired to Modulation In, or in the
    generator's place, where the rig's file has one.

    Generator and force sensor answer over their own wires inside a `with` block; the amplifier's
    lines are its own methods. `friction` is the finger's, `finger_gain` multiplies it. `contact` is
    in series with the amplifier's enable line. `wrap` may put something between the generator and
    its socket, such as faults. `on_drive` hears (frequency_hz, voltage_v) whenever what is at the
    electrode may have changed. Without `force_rate_hz` the force sensor sends by `force_box.emit`
    alone, pressing along -z and sliding along x. `card` stands in for one of this process alone.
    `time_s` is what a card plays by; it may be set to that of a clock before time passes. The
    finger's law has the time since the touch, or that of the plant without `ages_from_touch`.
    """

    def __init__(
        self,
        config: RigConfig,
        friction: FrictionLaw,
        *,
        contact: Callable[[], bool] = lambda: True,
        wrap: Callable[[Responder], Responder] = lambda generator: generator,
        on_drive: Callable[[float, float], object] = lambda frequency_hz, voltage_v: None,
        force_rate_hz: float | None = None,
        generator_port: int = 0,
        card: CardMemory | None = None,
    ) -> None:
        simulation, output = config.simulation, config.analog_output
        self.amplifier = simulated_amplifier(config, contact)
        self.generator = simulated_generator(config, self._drive)
        has_card = isinstance(output, SimulatedAnalogOutputConfig)
        has_card |= isinstance(self.generator, SimulatedCarrier)
        self.card = (card or CardMemory()) if has_card else None
        self.time_s = 0.0
        self.finger_gain = 1.0
        self.ages_from_touch = True
        self._friction = friction
        self.speed_m_s = 0.0
        self.plant = FingerPlant(
            self._lateral_n, cutoff_hz_per_mm_s=simulation.friction_cutoff_hz_per_mm_s
        )
        self.generator_server = TcpServer(wrap(self.generator), generator_port)
        self.force_box = NetFtServer(
            self._wrench, rate_hz=force_rate_hz, range_n=simulation.force_range_n
        )
        self._on_drive = on_drive
        self._noise = random.Random(simulation.seed)
        self._noise_n = simulation.force_noise_n
        super().__init__(self.generator_server, self.force_box)

    def step(self, dt_s: float, normal_force_n: float, speed_m_s: float) -> None:
        """Let `dt_s` pass with the finger pressing and sliding so; the outputs act on it."""
        before_s, self.time_s = self.time_s, self.time_s + dt_s
        if isinstance(self.generator, SimulatedCarrier) and self.card is not None:
            self.generator.look(self.card, self.time_s)
        elif self.card is not None:
            self.generator.set_modulation_input(self.card.terminal_v(before_s, self.time_s))
        self.generator.advance(dt_s)
        output = self.generator.output()
        voltage_v = self.amplifier.step(dt_s, output)
        self._on_drive(output.frequency_hz, voltage_v)
        self.speed_m_s = speed_m_s
        self.plant.step(dt_s, output.frequency_hz, voltage_v, normal_force_n, speed_m_s)

    def tell_drive(self) -> None:
        """Say what is at the electrode."""
        self._on_drive(self.frequency_hz, self.voltage_v)

    @property
    def voltage_v(self) -> float:
        """Peak voltage at the electrode now."""
        return self.amplifier.voltage_v

    @property
    def frequency_hz(self) -> float:
        """Frequency at the generator's terminals now."""
        return self.generator.output().frequency_hz

    def stimulus(self) -> tuple[float, float, float, str]:
        """What is at the electrode now: frequency_hz, voltage_v, voltage_offset_v, waveform."""
        output = self.amplifier.output
        if output.shape is Shape.DC:
            return 0.0, output.offset_v, 0.0, output.shape.value
        return output.frequency_hz, output.amplitude_v, output.offset_v, output.shape.value

    def attraction_n(self) -> float:
        """Force of the voltage between skin and screen, from the rise of friction over that without
        voltage. It is 0 for a finger that rests or is lifted.
        """
        plant, load_n = self.plant, self.plant.normal_force_n
        if load_n <= 0.0 or self.speed_m_s == 0.0 or self.voltage_v == 0.0:
            return 0.0
        bare_n = self._lateral_n(self.frequency_hz, 0.0, load_n, self.speed_m_s)
        return load_n * max(plant.lateral_force_n / bare_n - 1.0, 0.0) if bare_n > 0.0 else 0.0

    def _lateral_n(
        self, frequency_hz: float, voltage_v: float, normal_force_n: float, speed_m_s: float
    ) -> float:
        """The finger's friction; voltages without bias are described by their peak alone."""
        told: tuple[float | str, ...] = ()
        if voltage_v > 0.0:
            f, v, offset_v, waveform = self.stimulus()
            if (offset_v, waveform) != SINE_WITHOUT_BIAS:
                frequency_hz, voltage_v, told = f, v, (offset_v, waveform)
        law, time_s = self._friction, self.plant.time_s
        if self.ages_from_touch:
            time_s -= self.plant.touched_s
        return self.finger_gain * law(
            frequency_hz, voltage_v, normal_force_n, speed_m_s, time_s, *told
        )

    def _drive(self, output: TerminalOutput) -> None:
        """What the generator does between steps."""
        self.amplifier.drive(output)
        self._on_drive(output.frequency_hz, self.amplifier.voltage_v)

    def _wrench(self) -> tuple[float, float, float, float, float, float]:
        normal_n, lateral_n = (
            force_n + self._noise.gauss(0.0, self._noise_n)
            for force_n in (self.plant.normal_force_n, self.plant.lateral_force_n)
        )
        return lateral_n, 0.0, -normal_n, 0.0, 0.0, 0.0


def simulated_amplifier(
    config: RigConfig, contact: Callable[[], bool] = lambda: True
) -> SimulatedAmplifier:
    """The amplifier as the rig's file describes it, with a contact in series with its enable
    line.
    """
    amplifier = config.amplifier
    return SimulatedAmplifier(
        amplifier.gain_v_per_v,
        amplifier.voltage_limit_v,
        voltage_monitor_v_per_v=amplifier.voltage_monitor_v_per_v,
        interlock=contact,
    )


def simulated_generator(config: RigConfig, listener: Listener) -> SimulatedGenerator:
    """The generator that drives it; `listener` hears also what it does between steps."""
    simulation, modulation = config.simulation, config.waveform_generator.modulation_input
    latency = GeneratorLatency(
        amplitude_s=simulation.amplitude_latency_s, frequency_s=simulation.frequency_latency_s
    )
    highest = 1.0 if modulation is None else modulation.amplitude_at_full_scale
    return config.generator_kind().simulator(latency, listener=listener, am_full_scale=highest)
