"""A carrier on a simulated card, with simulated time."""

from __future__ import annotations

from hw.analog.output import AnalogOutputSettings
from hw.analog.simulated_output import CardMemory, SimulatedAnalogOutput
from hw.generator.analog_carrier.driver import AnalogCarrier, CarrierSettings
from hw.generator.analog_carrier.simulator import SimulatedCarrier
from hw.generator.contract import GeneratorLatency
from hw.generator.settings import GeneratorSettings
from tests.clock import ManualClock

SETTINGS = GeneratorSettings(100.0, 150.0, 100.0, 2.5e3)  # 1.5 V at the terminal
OUTPUT = AnalogOutputSettings(-10.0, 10.0, 0.0, 50e3, buffer_s=0.04, gap_s=0.01)


class Bench:
    """Time passes in steps; the carrier is written ahead between them."""

    def __init__(self, settings: GeneratorSettings = SETTINGS, rate_hz: float = 50e3) -> None:
        self.clock = ManualClock(0.0)
        self.memory = memoryview(bytearray(CardMemory.SIZE))
        self.card = CardMemory(self.memory)
        self.output = SimulatedAnalogOutput(
            lambda: self.card, OUTPUT, clock=self.clock, watch=False
        )
        self.driver = AnalogCarrier(self.output, settings, CarrierSettings(rate_hz))
        self.terminal = SimulatedCarrier(GeneratorLatency())

    def pass_s(self, dt_s: float, *, pumped: bool = True) -> None:
        for _ in range(round(dt_s / 0.001)):
            self.clock.sleep(0.001)
            if pumped:
                self.driver.pump()
            self.terminal.look(self.card, self.clock())
