"""The 33220A driver on the simulated generator: shapes, modulation, range; changes by others."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from hw.errors import BadReply
from hw.generator.agilent_33220a.driver import Agilent33220A
from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.generator.contract import GeneratorLatency, TerminalOutput
from hw.generator.settings import GeneratorSettings, ModulationInput, RangePolicy
from hw.serving.memory import MemoryTransport
from tests.hw.generator.asking import read_output
from tests.hw.instruments import IMMEDIATE

GAIN, LIMIT_V = 100.0, 300.0


class Bench:
    """Driver and generator, and the highest peak times gain that ever was at the terminals."""

    def __init__(
        self, *, factor: float = 1.0, latency: GeneratorLatency = IMMEDIATE, **settings: Any
    ) -> None:
        self.peak_v = 0.0
        self.generator = Simulated33220A(latency, listener=self._listen, am_full_scale=factor)
        self.driver = Agilent33220A(
            MemoryTransport(self.generator),
            GeneratorSettings(
                GAIN, LIMIT_V, 10.0, 10e3, modulation_input=ModulationInput(5.0, factor), **settings
            ),
        )
        self.driver.connect()

    def _listen(self, output: TerminalOutput) -> None:
        self.peak_v = max(self.peak_v, GAIN * (output.amplitude_v + abs(output.offset_v)))

    def electrode(self) -> tuple[float, float, float]:
        """Frequency, and lowest and highest voltage at the electrode."""
        output = self.generator.output()
        low_v, high_v = (
            GAIN * (output.offset_v + sign * output.amplitude_v) for sign in (-1.0, 1.0)
        )
        return output.frequency_hz, low_v, high_v


@pytest.mark.parametrize("policy", list(RangePolicy))
def test_only_autoranging_switches_relays_while_amplitudes_change(policy):
    bench = Bench(range_policy=policy)
    bench.driver.set_point(250.0, 2.0)
    bench.driver.set_output(True)
    before = bench.generator.range_switches
    for voltage_v in (300.0, 50.0, 150.0, 2.0, 300.0):
        bench.driver.set_point(250.0, voltage_v)
        assert bench.electrode()[2] == pytest.approx(voltage_v)
    assert (bench.generator.range_switches == before) is (policy is RangePolicy.FIXED)


def test_a_range_is_never_visited_with_the_output_on():
    """Somebody connects to a generator that puts out something; the highest amplitude is tried with
    it off.
    """
    bench = Bench()
    bench.driver.set_point(250.0, 20.0)
    bench.driver.set_output(True)
    bench.peak_v = 0.0
    bench.generator.handle(b"VOLT:RANG:AUTO ON;:VOLT:UNIT VRMS\n")
    with pytest.raises(BadReply):
        bench.driver.set_point(250.0, 30.0)
    bench.generator.handle(b"OUTP 1\n")
    with pytest.raises(BadReply, match="changes its range"):
        bench.driver.set_point(250.0, 30.0)
    bench.driver.set_point(250.0, 30.0)
    bench.driver.set_output(True)
    assert bench.peak_v <= 30.0 * 2.0 * math.sqrt(2.0)


def test_a_load_changed_behind_the_driver_is_noticed_before_switching_on():
    bench = Bench()
    bench.driver.set_point(250.0, 120.0)
    bench.generator.handle(b"OUTP:LOAD 50;:VOLT 2.4\n")
    with pytest.raises(BadReply):
        bench.driver.set_output(True)
    assert bench.peak_v == 0.0


@pytest.mark.timeout(60)
def test_two_threads_on_one_driver_never_cross_replies():
    """Every set point is read back: a crossed reply, or a belief about what another thread changed,
    is a BadReply.

    One thread changes voltages at one frequency, the other frequencies at one of these voltages.
    """
    generator = Simulated33220A(IMMEDIATE)
    driver = Agilent33220A(MemoryTransport(generator), GeneratorSettings(GAIN, LIMIT_V, 10.0, 10e3))
    driver.connect()

    def hammer(points: list[tuple[float, float]]) -> list[bool | None]:
        states = []
        for _ in range(100):
            for point in points:
                driver.set_point(*point)
                states.append(read_output(driver))
        return states

    with ThreadPoolExecutor(2) as pool:
        states = list(
            pool.map(hammer, ([(100.0, 20.0), (100.0, 30.0)], [(200.0, 20.0), (300.0, 20.0)]))
        )
    assert states == [[False] * 200] * 2
    assert driver.close() is True
