"""Both ways to the electrode: what the simulated amplifier saw, and what a failure leaves there."""

from dataclasses import replace

import numpy as np
import pytest

from haptic_driver.actuator import EnvelopeActuator, EnvelopeCarrier, SetpointActuator
from haptic_driver.errors import HapticError
from haptic_driver.rig import Rig, SafetySettings, amplifier_settings, generator_settings
from haptic_driver.signals import NO_COMMAND, DriveCommand, EnvelopeBlock
from haptic_driver.simulated_rig import SimulatedRig, simulated_amplifier, simulated_generator
from hw.amplifier import AnalogAmplifier
from hw.analog_output import AnalogOutputSettings
from hw.generator_settings import ModulationInput
from hw.simulated.analog_output import SimulatedAnalogOutput
from hw.simulated.finger_plant import FingerPlant
from hw.simulated.force_sensor import SimulatedForceSensor
from hw.transport.memory import MemoryTransport

RATE_HZ, SAMPLES, LEAD_S = 50e3, 50, 0.005
FULL_V = 140.0
MODULATION = ModulationInput(full_scale_v=5.0, amplitude_at_full_scale=1.0)
ON = DriveCommand(250.0, 80.0, True)


class Bench:
    """A rig whose generator is modulated by a simulated analog output; time in steps of one tick."""

    def __init__(self, config, *, tolerance=1.0, zero_level_v=-5.0):
        self.electrode = simulated_amplifier(config)
        self.generator = simulated_generator(config, self.electrode)
        self.output = SimulatedAnalogOutput(AnalogOutputSettings(-5.0, 5.0, zero_level_v, RATE_HZ))
        plant = FingerPlant(lambda f, v, n, s: 0.5 * n)
        self.rig = Rig(
            config,
            EnvelopeCarrier(
                MemoryTransport(self.generator), replace(generator_settings(config), modulation_input=MODULATION)
            ),
            AnalogAmplifier(amplifier_settings(config), self.electrode, self.electrode),
            SimulatedForceSensor(plant, noise_n=0.0, range_n=20.0, seed=1),
            safety=SafetySettings(monitor_tolerance=tolerance),
            sleep=lambda seconds: None,
        )
        self.time_s, self.seen_v = 1.0, []

    def connect(self):
        self.output.open()
        self.generator.set_modulation_input(self.output.terminal_v)
        self.rig.connect()

    def step(self):
        """One tick, sample by sample."""
        for _ in range(SAMPLES):
            self.generator.set_modulation_input(self.output.advance(1.0 / RATE_HZ))
            self.generator.advance(1.0 / RATE_HZ)
            self.electrode.step(1.0 / RATE_HZ, self.generator.output())
            self.seen_v.append(self.electrode.voltage_v)
        self.time_s += 1e-3

    def run(self, actuator, blocks, command=ON):
        for block in blocks:
            actuator.command(self.time_s, command, block)
            self.step()
        return np.array(self.seen_v)


def blocks_of(voltage_v, frequency_hz=250.0):
    return [EnvelopeBlock(frequency_hz, part, True) for part in voltage_v.reshape(-1, SAMPLES)]


@pytest.fixture
def bench(rig_config):
    bench = Bench(rig_config)
    bench.connect()
    yield bench
    bench.output.close()
    assert bench.rig.close().output_on is False


@pytest.fixture
def envelope(bench):
    return EnvelopeActuator(bench.rig, bench.output, MODULATION, FULL_V, lead_s=LEAD_S)


def test_the_electrode_follows_the_envelope(bench, envelope):
    """An 800 Hz texture at the electrode, late by the lead alone."""
    t = np.arange(200 * SAMPLES) / RATE_HZ
    wanted_v = 70.0 + 30.0 * np.sin(2.0 * np.pi * 800.0 * t)
    seen_v = bench.run(envelope, blocks_of(wanted_v))
    late = round(LEAD_S * RATE_HZ)
    settled = slice(120 * SAMPLES, 195 * SAMPLES)  # the carrier has come up over SCPI
    np.testing.assert_allclose(np.roll(seen_v, -late)[settled], wanted_v[settled], rtol=2e-3)
    assert seen_v.max() < 100.0 * 1.002
    assert (envelope.underruns, envelope.dropped) == (0, 0)


def test_nothing_but_zero_amplitude_goes_before_the_carrier(bench, envelope):
    seen_v = bench.run(envelope, blocks_of(np.zeros(50 * SAMPLES)))
    assert seen_v.max() < 0.01
    assert bench.rig.state.value == "on"


@pytest.mark.parametrize("last", [None, EnvelopeBlock(250.0, np.zeros(SAMPLES), False)])
def test_a_tick_without_output_ends_it_at_once(bench, envelope, last):
    seen_v = bench.run(envelope, blocks_of(np.full(150 * SAMPLES, 90.0)))
    assert seen_v[-1] == pytest.approx(90.0, rel=2e-3)
    envelope.command(bench.time_s, NO_COMMAND, last)
    assert bench.output.terminal_v == -5.0
    bench.step()
    assert max(bench.seen_v[-SAMPLES:]) == 0.0
    assert bench.rig.state.value == "off"


def test_blocks_that_stop_coming_are_zero_and_counted(bench, envelope):
    block = EnvelopeBlock(250.0, np.full(SAMPLES, 90.0), True)
    bench.run(envelope, [block] * 150)
    for _ in range(20):
        bench.step()
    assert bench.seen_v[-1] < 0.01
    seen_v = bench.run(envelope, [block] * 30)
    assert envelope.underruns == 1
    assert seen_v[-1] == pytest.approx(90.0, rel=2e-3)


def test_blocks_faster_than_they_are_played_are_left_out(bench, envelope):
    block = EnvelopeBlock(250.0, np.full(SAMPLES, 90.0), True)
    for k in range(300):
        envelope.command(bench.time_s + 1e-4 * k, ON, block)
    assert envelope.dropped > 150
    assert bench.output.buffered_s <= bench.output.settings.buffer_s


@pytest.mark.parametrize("broken", ["output", "beyond"])
def test_what_fails_is_off_before_it_is_told(bench, envelope, broken):
    bench.run(envelope, blocks_of(np.full(150 * SAMPLES, 90.0)))
    block = EnvelopeBlock(250.0, np.full(SAMPLES, 90.0 if broken == "output" else FULL_V * 1.01), True)
    bench.output.broken = broken == "output"
    with pytest.raises(HapticError) as failed:
        envelope.command(bench.time_s, ON, block)
    assert failed.value.code == ("device_disconnected" if broken == "output" else "beyond_full_scale")
    assert bench.rig.state.value == "off"
    assert bench.electrode.voltage_v == 0.0
    bench.output.broken = False


def test_off_and_stop_leave_nothing(bench, envelope):
    for end in (envelope.off, envelope.stop):
        bench.run(envelope, blocks_of(np.full(60 * SAMPLES, 90.0)))
        assert end().output_on is False
        bench.step()
        assert bench.seen_v[-1] == 0.0


def test_an_output_that_rests_at_half_amplitude_is_refused(rig_config):
    bench = Bench(rig_config, zero_level_v=0.0)
    with pytest.raises(HapticError, match="-5 V for no amplitude"):
        EnvelopeActuator(bench.rig, bench.output, MODULATION, FULL_V)


def test_a_monitor_that_would_trip_is_refused(rig_config):
    bench = Bench(rig_config, tolerance=0.1)
    with pytest.raises(HapticError, match="monitor"):
        EnvelopeActuator(bench.rig, bench.output, MODULATION, FULL_V)


def test_set_points_are_the_command(rig_config, touch):
    with SimulatedRig(rig_config, touch) as bench:
        bench.rig.connect()
        actuator = SetpointActuator(bench.rig)
        for k in range(100):
            actuator.command(1e-3 * k, ON)
            bench.step(1e-3, 0.5, 0.04)
        assert bench.voltage_v == pytest.approx(80.0, rel=1e-3)
        assert actuator.stop().output_on is False
        assert bench.voltage_v == 0.0
