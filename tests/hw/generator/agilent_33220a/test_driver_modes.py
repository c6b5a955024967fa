"""The 33220A driver on the simulated generator: shapes, modulation and range."""

from __future__ import annotations

import math
import warnings
from contextlib import closing
from typing import Any

import pytest

from hw.errors import BadReply
from hw.generator.agilent_33220a.driver import Agilent33220A
from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.generator.contract import GeneratorLatency, TerminalOutput
from hw.generator.settings import (
    ExternalModulation,
    GeneratorSettings,
    ModulationInput,
    RangePolicy,
    Shape,
)
from hw.serving.memory import MemoryTransport
from hw.serving.tcp import TcpServer
from hw.transport.tcp import TcpTransport
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


@pytest.mark.parametrize(
    ("shape", "offset_v", "low_v", "high_v"),
    [
        (Shape.SINE, 0.0, -120.0, 120.0),
        (Shape.SQUARE, 30.0, -90.0, 150.0),
        (Shape.DC, 0.0, 120.0, 120.0),
        (Shape.DC, -200.0, -80.0, -80.0),
    ],
)
def test_extremes_at_the_electrode(shape, offset_v, low_v, high_v):
    bench = Bench()
    bench.driver.set_point(250.0, 120.0, offset_v, shape=shape)
    bench.driver.set_output(True)
    frequency_hz, *extremes = bench.electrode()
    assert extremes == [pytest.approx(low_v, abs=0.02), pytest.approx(high_v, abs=0.02)]
    assert shape is Shape.DC or frequency_hz == 250.0


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_the_envelope_of_modulation_in(factor):
    bench = Bench(factor=factor)
    bench.driver.set_point(250.0, 300.0, modulation=ExternalModulation())
    bench.driver.set_output(True)
    for input_v, voltage_v in ((-5.0, 0.0), (-2.5, 75.0), (0.0, 150.0), (5.0, 300.0)):
        bench.generator.set_modulation_input(input_v)
        assert bench.electrode()[2] == pytest.approx(voltage_v)
    assert bench.peak_v == pytest.approx(300.0)


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


@pytest.mark.timeout(60)
def test_pymeasure_sees_what_the_driver_set():
    """An independent client on its own connection reads every property that both know."""
    generator = Simulated33220A(IMMEDIATE)
    with TcpServer(generator) as server, warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # pymeasure's own, at class construction
        from pymeasure.instruments.agilent import Agilent33220A as IndependentClient

        driver = Agilent33220A(
            TcpTransport(server.host, server.port),
            GeneratorSettings(GAIN, LIMIT_V, 10.0, 10e3, reply_timeout_s=3.0),
        )
        driver.connect()
        client = IndependentClient(
            server.resource,
            visa_library="@py",
            read_termination="\n",
            write_termination="\n",
            timeout=3000,
        )
        with closing(client.adapter):
            driver.set_point(2500.0, 120.0, 50.0, shape=Shape.SQUARE)
            driver.set_output(True)
            seen = [
                client.shape,
                client.frequency,
                client.amplitude,
                client.amplitude_unit,
                client.offset,
            ]
            assert seen == ["SQU", 2500.0, pytest.approx(2.4), "VPP", pytest.approx(0.5)]
            assert [client.voltage_high, client.voltage_low] == [
                pytest.approx(1.7),
                pytest.approx(-0.7),
            ]
            assert [client.output, client.burst_state] == [True, False]
            assert client.square_dutycycle == pytest.approx(50.0)
            client.output = False
            assert client.complete == "1"
            assert read_output(driver) is False
            client.amplitude = 1.0  # behind the driver's back
            assert client.complete == "1"
            with pytest.raises(BadReply, match="VOLT"):
                driver.set_point(2600.0, 120.0, 50.0, shape=Shape.SQUARE)
            driver.set_point(1000.0, 60.0, shape=Shape.DC)
            assert [client.shape, client.offset] == ["DC", pytest.approx(0.6)]
            assert client.check_errors() == []
            assert driver.close() is True
