"""The 33220A driver on the simulated generator: waveforms, modulation, uploads, bursts, and what they may never do."""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Callable
from contextlib import closing, suppress
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.errors import BadReply, InstrumentRejected, LimitExceeded
from hw.generator.agilent_33220a.driver import (
    Agilent33220A,
    ArbitraryWaveform,
    Burst,
    ExternalModulation,
    GeneratorSettings,
    InternalModulation,
    ModulationInput,
    RangePolicy,
    Shape,
    TriggerSource,
)
from hw.generator.agilent_33220a.simulator import GeneratorLatency, Simulated33220A, TerminalOutput
from hw.serving.tcp import TcpServer
from hw.testing.memory import MemoryTransport
from hw.transport.tcp import TcpTransport
from tests.hw.instruments import IMMEDIATE

GAIN, LIMIT_V = 100.0, 300.0


class Bench:
    """Driver and generator, and the highest peak times gain that ever was at the terminals."""

    def __init__(self, *, factor: float = 1.0, latency: GeneratorLatency = IMMEDIATE, **settings: Any) -> None:
        self.peak_v = 0.0
        self.generator = Simulated33220A(latency, listener=self._listen, am_full_scale=factor)
        self.driver = Agilent33220A(
            MemoryTransport(self.generator),
            GeneratorSettings(GAIN, LIMIT_V, 10.0, 10e3, modulation_input=ModulationInput(5.0, factor), **settings),
        )
        self.driver.connect()

    def _listen(self, output: TerminalOutput) -> None:
        self.peak_v = max(self.peak_v, GAIN * (output.amplitude_v + abs(output.offset_v)))

    def electrode(self) -> tuple[float, float, float]:
        """Frequency, and lowest and highest voltage at the electrode."""
        output = self.generator.output()
        low_v, high_v = (GAIN * (output.offset_v + sign * output.amplitude_v) for sign in (-1.0, 1.0))
        return output.frequency_hz, low_v, high_v


ONE_SIDED = ArbitraryWaveform.from_samples([0.0, 1.0, 0.5])
LOPSIDED = ArbitraryWaveform.from_samples(np.array([-3.0, 0.0, 1.0]))
EVEN = ArbitraryWaveform.from_samples([-1.0, 0.3, 1.0, 0.0])


@pytest.mark.parametrize(
    ("waveform", "offset_v", "low_v", "high_v"),
    [
        (Shape.SINE, 0.0, -120.0, 120.0),
        (Shape.SQUARE, 30.0, -90.0, 150.0),
        (Shape.DC, 0.0, 120.0, 120.0),
        (Shape.DC, -200.0, -80.0, -80.0),
        (ONE_SIDED, 0.0, 0.0, 120.0),
        (ONE_SIDED, -60.0, -60.0, 60.0),
        (LOPSIDED, 0.0, -120.0, 40.0),
        (EVEN, 0.0, -120.0, 120.0),
    ],
)
def test_extremes_at_the_electrode(waveform: Any, offset_v: float, low_v: float, high_v: float) -> None:
    bench = Bench()
    bench.driver.set_point(250.0, 120.0, offset_v, waveform=waveform)
    bench.driver.set_output(True)
    frequency_hz, *extremes = bench.electrode()
    assert extremes == [pytest.approx(low_v, abs=0.02), pytest.approx(high_v, abs=0.02)]
    assert waveform is Shape.DC or frequency_hz == 250.0


def test_limits_are_on_the_real_peak_of_a_one_sided_waveform() -> None:
    """Half its span is far below the limit; its peak is not."""
    bench = Bench()
    bench.driver.set_point(250.0, 300.0, waveform=ONE_SIDED)
    with pytest.raises(LimitExceeded):
        bench.driver.set_point(250.0, 300.0, 1.0, waveform=ONE_SIDED)
    with pytest.raises(LimitExceeded):
        bench.driver.set_point(250.0, 300.1, waveform=ONE_SIDED)


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_the_envelope_of_modulation_in(factor: float) -> None:
    bench = Bench(factor=factor)
    bench.driver.set_point(250.0, 300.0, modulation=ExternalModulation())
    bench.driver.set_output(True)
    measured = bench.driver.settings.modulation_input
    assert measured is not None
    for voltage_v in (0.0, 75.0, 150.0, 300.0):
        bench.generator.set_modulation_input(measured.input_v(voltage_v / 300.0))
        assert bench.electrode()[2] == pytest.approx(voltage_v)
    assert bench.peak_v == pytest.approx(300.0)


def test_internal_modulation_reaches_the_voltage_asked_for() -> None:
    bench = Bench()
    bench.driver.set_point(250.0, 200.0, modulation=InternalModulation(7.0, depth=0.5))
    bench.driver.set_output(True)
    assert bench.electrode()[2] == pytest.approx(200.0)


def test_modulation_that_leaves_little_cannot_ask_for_more_than_the_generator_makes() -> None:
    """At depth 0 half of the amplitude programmed is left: 600 V at a gain of 100 would take 24 Vpp."""
    generator = Simulated33220A(IMMEDIATE)
    settings = GeneratorSettings(
        GAIN, 900.0, 10.0, 10e3, range_policy=RangePolicy.AUTO, modulation_input=ModulationInput(5.0, 1.0)
    )
    driver = Agilent33220A(MemoryTransport(generator), settings)
    driver.connect()
    driver.set_point(250.0, 500.0, modulation=InternalModulation(7.0, depth=0.0))
    assert generator.handle(b"VOLT?\n") == b"+2.0000000000000E+01\n"
    with pytest.raises(LimitExceeded, match="before modulation"):
        driver.set_point(250.0, 600.0, modulation=InternalModulation(7.0, depth=0.0))
    with pytest.raises(LimitExceeded, match="before modulation"):
        driver.set_point(250.0, 480.0, 50.0, modulation=InternalModulation(7.0, depth=0.0))
    assert generator.handle(b"VOLT?;:SYST:ERR?\n") == b'+2.0000000000000E+01;+0,"No error"\n'


def test_a_waveform_is_uploaded_once_and_the_output_comes_back() -> None:
    bench = Bench()
    bench.driver.set_point(250.0, 100.0, waveform=ONE_SIDED)
    bench.driver.set_output(True)
    bench.driver.set_point(250.0, 100.0)
    bench.generator.handle(b"DATA VOLATILE,1,-1,-1\n")  # tells whether it is uploaded again
    bench.driver.set_point(250.0, 100.0, waveform=ONE_SIDED)
    assert bench.generator.handle(b"DATA:ATTR:AVER? VOLATILE\n").startswith(b"-3.33")
    bench.driver.set_point(250.0, 100.0, waveform=EVEN)
    assert bench.generator.handle(b"DATA:ATTR:POIN? VOLATILE\n") == b"+4.0000000000000E+00\n"
    assert bench.generator.output().on


def test_after_a_failure_a_waveform_is_uploaded_again() -> None:
    bench = Bench()
    bench.driver.set_point(250.0, 100.0, waveform=ONE_SIDED)
    bench.generator.handle(b"*RST;:DATA VOLATILE,1,-1\n")
    with pytest.raises(BadReply):
        bench.driver.set_point(260.0, 100.0, waveform=ONE_SIDED)
    bench.driver.set_point(260.0, 100.0, waveform=ONE_SIDED)
    bench.driver.set_output(True)
    assert bench.electrode() == (260.0, pytest.approx(0.0, abs=0.02), pytest.approx(100.0))


@pytest.mark.parametrize("binary", [True, False])
def test_uploads_over_tcp_whatever_bytes_they_hold(binary: bool) -> None:
    """65,536 points, line ends, semicolons and hashes among their bytes."""
    samples = np.sin(np.linspace(0.0, 40.0 * np.pi, 65_536)) * np.linspace(0.2, 1.0, 65_536)
    waveform = ArbitraryWaveform.from_samples(samples)
    data = waveform.upload_command(binary=True)
    assert all(byte in data for byte in b"\n;#,\r")
    generator = Simulated33220A(IMMEDIATE)
    with TcpServer(generator) as server:
        driver = Agilent33220A(
            TcpTransport(server.host, server.port), GeneratorSettings(GAIN, LIMIT_V, 10.0, 10e3, binary_upload=binary)
        )
        driver.connect()
        driver.upload(waveform)
        assert driver.read_output() is False
        answers = generator.handle(b"DATA:ATTR:POIN? VOLATILE;AVER? VOLATILE;CFAC? VOLATILE\n").decode().split(";")
        low, high = samples.min(), samples.max()
        codes = np.rint(8191 * (2.0 * samples - high - low) / (high - low))
        expected = [65_536.0, codes.mean() / 8191, 8191 / math.sqrt(np.mean(codes**2))]
        assert [float(answer) for answer in answers] == pytest.approx(expected, rel=1e-9)
        assert driver.close() is True


def test_a_swapped_byte_order_is_noticed() -> None:
    """A link that swaps bytes: out of range most times, another mean otherwise; never accepted."""

    class Swapping:
        def handle(self, data: bytes) -> bytes:
            if data.startswith(b"DATA:DAC VOLATILE, #18"):
                head, codes = data[:22], data[22:-1]
                data = head + np.frombuffer(codes, ">i2").astype("<i2").tobytes() + b"\n"
            return generator.handle(data)

    generator = Simulated33220A(IMMEDIATE)
    driver = Agilent33220A(MemoryTransport(Swapping()), GeneratorSettings(GAIN, LIMIT_V, 10.0, 10e3))
    driver.connect()
    with pytest.raises((BadReply, InstrumentRejected)):
        driver.upload(ArbitraryWaveform.from_samples([0.0, 0.5, 1.0, 0.0]))


def test_a_burst_ends_by_itself() -> None:
    bench = Bench()
    bench.driver.set_point(100.0, 120.0)
    bench.driver.set_burst(Burst(3))
    bench.driver.set_output(True)
    assert bench.peak_v == 0.0
    bench.driver.trigger()
    bench.generator.advance(0.02)
    assert bench.electrode()[2] == pytest.approx(120.0)
    bench.generator.advance(0.02)
    assert bench.electrode()[2] == 0.0
    bench.driver.set_burst(Burst(3, TriggerSource.EXTERNAL))
    with pytest.raises(InstrumentRejected, match="-211"):
        bench.driver.trigger()


def test_a_burst_that_reads_back_as_noise_is_switched_off() -> None:
    class Noisy:
        """Garbles the number of cycles, and nothing else."""

        def __init__(self) -> None:
            self.generator = Simulated33220A(IMMEDIATE)

        def handle(self, data: bytes) -> bytes:
            answer = self.generator.handle(data)
            return answer.replace(b"+3.0000000000000E+00", b"+3.0#00000000000E+00") if b"NCYC" in data else answer

    noisy = Noisy()
    driver = Agilent33220A(MemoryTransport(noisy), GeneratorSettings(GAIN, LIMIT_V, 10.0, 10e3))
    driver.connect()
    driver.set_point(100.0, 120.0)
    driver.set_output(True)
    with pytest.raises(BadReply, match="NCYC"):
        driver.set_burst(Burst(3))
    assert noisy.generator.output().on is False


def test_no_burst_of_a_constant_voltage_or_under_modulation() -> None:
    bench = Bench()
    for what in ({"waveform": Shape.DC}, {"modulation": ExternalModulation()}):
        bench.driver.set_point(100.0, 120.0, **what)
        with pytest.raises(LimitExceeded, match="burst"):
            bench.driver.set_burst(Burst(3))


@pytest.mark.parametrize("policy", list(RangePolicy))
def test_only_autoranging_switches_relays_while_amplitudes_change(policy: RangePolicy) -> None:
    bench = Bench(range_policy=policy)
    bench.driver.set_point(250.0, 2.0)
    bench.driver.set_output(True)
    before = bench.generator.range_switches
    for voltage_v in (300.0, 50.0, 150.0, 2.0, 300.0):
        bench.driver.set_point(250.0, voltage_v)
        assert bench.electrode()[2] == pytest.approx(voltage_v)
    assert (bench.generator.range_switches == before) is (policy is RangePolicy.FIXED)


def test_a_range_is_never_visited_with_the_output_on() -> None:
    """Somebody connects to a generator that puts out something; the highest amplitude is tried with it off."""
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


def test_status_tells_of_an_overload() -> None:
    bench = Bench()
    bench.driver.set_output(True)
    bench.generator.overload()
    status = bench.driver.read_status()
    assert status.events & 8
    assert status.status_byte & 4
    assert len(status.errors) == 1
    assert bench.driver.read_status().errors == ()
    assert bench.driver.read_output() is False


VOLTAGE = st.one_of(st.floats(0.0, 310.0), st.floats(1.0, 300.0), st.sampled_from([300.0, 1.0, 0.0, math.nan]))
OFFSET = st.one_of(st.just(0.0), st.floats(-310.0, 310.0), st.sampled_from([300.0, -300.0, math.inf]))
SET_POINT = st.builds(
    lambda f, v, o, w, m: lambda d: d.set_point(f, v, o, waveform=w, modulation=m),
    st.floats(10.0, 10e3),
    VOLTAGE,
    OFFSET,
    st.sampled_from([Shape.SINE, Shape.SINE, Shape.SQUARE, Shape.DC, ONE_SIDED, LOPSIDED, EVEN]),
    st.sampled_from([None, None, ExternalModulation(), InternalModulation(5.0), InternalModulation(5.0, 0.3)]),
)
OTHER: st.SearchStrategy[Callable[[Agilent33220A], object]] = st.sampled_from(
    [
        lambda d: d.set_output(True),
        lambda d: d.set_output(False),
        lambda d: d.set_burst(Burst(5)),
        lambda d: d.set_burst(None),
        lambda d: d.trigger(),
        lambda d: d.upload(LOPSIDED),
        lambda d: d.off(),
        lambda d: d.connect(),
    ]
)


@settings(max_examples=100)
@given(
    st.lists(st.one_of(SET_POINT, SET_POINT, OTHER), max_size=15),
    st.sampled_from([1.0, 2.0]),
    st.sampled_from(list(RangePolicy)),
    st.booleans(),
)
def test_no_sequence_of_calls_ever_brings_the_electrode_above_the_limit(
    calls: list[Callable[[Agilent33220A], object]], factor: float, policy: RangePolicy, slow: bool
) -> None:
    """At every change at the terminals, in the middle of a line too, with the envelope at its highest."""
    bench = Bench(factor=factor, latency=GeneratorLatency() if slow else IMMEDIATE, range_policy=policy)
    bench.generator.set_modulation_input(5.0)
    bench.driver.set_output(True)
    for call in calls:
        with suppress(LimitExceeded, InstrumentRejected):
            call(bench.driver)
        bench.generator.advance(0.05)
    bench.generator.advance(1.0)
    assert bench.peak_v <= LIMIT_V * (1.0 + 1e-6)
    assert bench.driver.off() is True
    bench.generator.advance(1.0)
    assert not bench.generator.output().on


@settings(max_examples=100)
@given(
    st.lists(st.tuples(st.floats(10.0, 10e3), st.floats(1.0, 150.0), st.floats(-150.0, 150.0)), min_size=2, max_size=10)
)
def test_no_step_between_two_set_points_is_above_both(points: list[tuple[float, float, float]]) -> None:
    bench = Bench()
    bench.driver.set_output(True)
    bench.driver.set_point(*points[0])
    for old, new in itertools.pairwise(points):
        bench.peak_v = 0.0
        bench.driver.set_point(*new)
        assert bench.peak_v <= max(old[1] + abs(old[2]), new[1] + abs(new[2])) * (1.0 + 1e-9)


@pytest.mark.timeout(60)
def test_pymeasure_sees_what_the_driver_set() -> None:
    """An independent client on its own connection reads every property that both know."""
    generator = Simulated33220A(IMMEDIATE)
    with TcpServer(generator) as server, warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # pymeasure's own, at class construction
        from pymeasure.instruments.agilent import Agilent33220A as IndependentClient

        driver = Agilent33220A(
            TcpTransport(server.host, server.port), GeneratorSettings(GAIN, LIMIT_V, 10.0, 10e3, reply_timeout_s=3.0)
        )
        driver.connect()
        client = IndependentClient(
            server.resource, visa_library="@py", read_termination="\n", write_termination="\n", timeout=3000
        )
        with closing(client.adapter):
            driver.set_point(2500.0, 120.0, 50.0, waveform=Shape.SQUARE)
            driver.set_burst(Burst(12, TriggerSource.EXTERNAL))
            driver.set_output(True)
            seen = [client.shape, client.frequency, client.amplitude, client.amplitude_unit, client.offset]
            assert seen == ["SQU", 2500.0, pytest.approx(2.4), "VPP", pytest.approx(0.5)]
            assert [client.voltage_high, client.voltage_low] == [pytest.approx(1.7), pytest.approx(-0.7)]
            assert [client.output, client.burst_state] == [True, True]
            assert [client.burst_mode, client.burst_ncycles, client.trigger_source] == ["TRIG", 12, "EXT"]
            assert [client.square_dutycycle, client.pulse_period] == [pytest.approx(50.0), pytest.approx(4e-4)]
            client.output = False
            assert client.complete == "1"
            assert driver.read_output() is False
            client.amplitude = 1.0  # behind the driver's back
            assert client.complete == "1"
            with pytest.raises(BadReply, match="VOLT"):
                driver.set_point(2600.0, 120.0, 50.0, waveform=Shape.SQUARE)
            driver.set_point(1000.0, 60.0, waveform=Shape.DC)
            assert [client.shape, client.offset] == ["DC", pytest.approx(0.6)]
            assert client.check_errors() == []
            assert driver.close() is True


def test_the_last_gate_holds_when_the_drivers_own_reckoning_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench()
    bench.driver.set_point(250.0, 100.0)
    bench.driver.set_output(True)
    right = Agilent33220A._wanted

    def twice_too_much(*arguments: Any) -> Any:
        wanted = right(*arguments)
        return wanted._replace(amplitude_vpp=2.0 * wanted.amplitude_vpp)

    monkeypatch.setattr(Agilent33220A, "_wanted", twice_too_much)
    with pytest.raises(LimitExceeded, match="last gate"):
        bench.driver.set_point(250.0, 200.0)
    assert bench.peak_v == pytest.approx(100.0)
