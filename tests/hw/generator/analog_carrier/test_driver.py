"""Carrier and envelope on a simulated card: what is at its terminal, and what the gate keeps off
it.
"""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from hw.analog.cards import check_name, make_card
from hw.analog.simulated_output import CardMemory, SimulatedAnalogOutput
from hw.errors import BadReply, DeviceDisconnected, DeviceError, LimitExceeded, SwitchedOff
from hw.generator.analog_carrier.driver import AnalogCarrier, CarrierSettings
from hw.generator.analog_carrier.gate import SampleGate
from hw.generator.settings import ExternalModulation, Shape
from tests.hw.generator.analog_carrier.bench import OUTPUT, SETTINGS, Bench

CREST = 0.0125  # of 20 samples a period none need be at the crest: 1 - cos(pi / 20)


@pytest.fixture
def bench():
    made = Bench()
    made.driver.connect()
    yield made
    made.driver.close()


@pytest.mark.parametrize("frequency_hz", [100.0, 1000.0, 2500.0])
def test_what_is_asked_is_at_the_terminal(bench, frequency_hz):
    bench.driver.set_point(frequency_hz, 120.0)
    assert not bench.driver.is_on()
    bench.driver.set_output(True)
    bench.pass_s(0.1)
    assert bench.driver.is_on()
    there = bench.terminal.output()
    assert there.amplitude_v == pytest.approx(1.2, rel=CREST)
    assert there.frequency_hz == pytest.approx(frequency_hz, rel=1e-3)
    samples_v, rate_hz = bench.card.recent(bench.clock(), 500)
    assert rate_hz == 50e3
    assert np.abs(np.diff(samples_v)).max() <= 1.2 * 2.0 * pi * frequency_hz / 50e3 * 1.001


def test_amplitude_and_carrier_change_without_a_step(bench):
    bench.driver.set_point(1000.0, 20.0)
    bench.driver.set_output(True)
    bench.pass_s(0.05)
    bench.driver.set_point(2000.0, 140.0)
    bench.pass_s(0.05)
    samples_v, _ = bench.card.recent(bench.clock(), 2000)
    assert np.abs(np.diff(samples_v)).max() <= 1.4 * 2.0 * pi * 2000.0 / 50e3 * 1.01
    assert np.abs(samples_v).max() == pytest.approx(1.4, rel=1e-2)


def test_off_is_zero_at_once_and_read_back(bench):
    bench.driver.set_point(1000.0, 120.0)
    bench.driver.set_output(True)
    bench.pass_s(0.05)
    assert bench.driver.off() is True
    assert bench.card.recent(bench.clock(), 5)[0].tolist() == [0.0]
    bench.pass_s(0.05)
    assert bench.terminal.output().amplitude_v == 0.0
    bench.driver.set_output(True)  # again, from zero
    bench.pass_s(0.001)
    assert bench.terminal.output().amplitude_v < 1.2


class Deaf(SimulatedAnalogOutput):
    """Goes to no level that it is told, or does not say."""

    said_v: float | None = 0.7

    def read_back_v(self) -> float | None:
        return self.said_v


def test_what_reads_back_otherwise_is_not_off_and_what_does_not_say_is_unknown():
    output = Deaf(CardMemory, OUTPUT, watch=False)
    driver = AnalogCarrier(output, SETTINGS, CarrierSettings(50e3))
    with pytest.raises(BadReply, match="not at zero"):
        driver.connect()
    assert driver.off() is False
    output.said_v = None
    assert driver.off() is None


def test_samples_that_run_out_go_to_zero_and_are_said(bench):
    bench.driver.set_point(1000.0, 120.0)
    bench.driver.set_output(True)
    bench.pass_s(0.05)
    bench.pass_s(0.1, pumped=False)  # nobody writes: the card stays at its last sample
    assert bench.terminal.output().frequency_hz == 1.0
    bench.driver.pump()
    assert bench.card.recent(bench.clock(), 5)[0].tolist() == [0.0]
    assert not bench.driver.is_on()
    with pytest.raises(SwitchedOff, match="ran out of samples"):
        bench.driver.set_point(1000.0, 120.0)
    bench.driver.set_point(1000.0, 120.0)
    bench.driver.set_output(True)
    bench.pass_s(0.05)
    assert bench.terminal.output().amplitude_v == pytest.approx(1.2, rel=CREST)


def test_a_card_that_another_takes_to_zero_stays_there(bench):
    """As the watchdog does while its driver is stopped."""
    bench.driver.set_point(1000.0, 120.0)
    bench.driver.set_output(True)
    bench.pass_s(0.05)
    CardMemory(bench.memory).set_level(0.0)
    bench.driver.pump()
    assert bench.card.recent(bench.clock(), 5)[0].tolist() == [0.0]
    with pytest.raises(DeviceDisconnected, match="taken by another"):
        bench.driver.set_point(1000.0, 120.0)


@pytest.mark.parametrize(
    "how",
    [
        {"frequency_hz": 99.0},
        {"frequency_hz": 2501.0},
        {"voltage_v": 150.1},
        {"voltage_v": 0.5},
        {"voltage_v": float("nan")},
        {"voltage_offset_v": 1.0},
        {"shape": Shape.DC},
        {"modulation": ExternalModulation()},
    ],
)
def test_what_it_may_not_is_never_written(bench, how):
    asked: dict[str, object] = {"frequency_hz": 1000.0, "voltage_v": 100.0} | how
    with pytest.raises(LimitExceeded, match="nothing was written"):
        bench.driver.set_point(**asked)  # type: ignore[arg-type]


def test_a_card_that_plays_slower_than_its_carriers_need_is_refused():
    bench = Bench(rate_hz=48e3)
    with pytest.raises(BadReply, match="too few for 2500 Hz"):
        bench.driver.connect()


@pytest.mark.parametrize(
    ("block_v", "rate_hz", "said"),
    [
        ([0.1, 1.51], 50e3, "a peak of 1.51"),
        ([0.0, float("nan")], 50e3, "a peak"),
        ([1.0], 50e3, "a step of 1"),  # a stream begins at zero
        ([0.0], 48e3, "48000 samples"),
    ],
)
def test_the_gate_knows_samples_alone(block_v, rate_hz, said):
    gate = SampleGate(SETTINGS, 50e3)
    gate.check(np.array([0.1, 0.2]), 50e3)
    gate.forget()
    with pytest.raises(LimitExceeded, match=said):
        gate.check(np.array(block_v), rate_hz)


def test_a_driver_that_is_wrong_is_held_back_by_the_gate(bench):
    bench.driver.set_point(1000.0, 120.0)
    bench.driver.set_output(True)
    bench.pass_s(0.05)
    bench.driver._amplitude_v = 3.0  # whatever led to it
    bench.driver.pump()
    bench.pass_s(0.01)
    assert bench.terminal.output().amplitude_v == 0.0
    with pytest.raises(DeviceError, match="last gate"):
        bench.driver.set_point(1000.0, 120.0)


def test_cards_are_made_by_name():
    card, descriptor = CardMemory.create()
    card.set_level(0.5)
    output = make_card(f"card:simulated:/proc/self/fd/{descriptor}", OUTPUT)
    assert output.read_back_v() == 0.5  # looked at, not opened
    with output:
        assert output.read_back_v() == 0.0
    for name in ("card:", "Dev1/ao0", "card:nobody:x"):
        with pytest.raises(ValueError, match=r"form card|no card that is installed"):
            check_name(name)
