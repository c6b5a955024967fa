"""The output pump in its loop, from render through the instruments to the finger, in made-up
time.
"""

import math

import numpy as np
import pytest

from haptic_driver.daemon.envelope_process import EnvelopeLoop
from haptic_driver.daemon.output_pump import OUTPUT_STALE_S, START_S, OutputPump
from haptic_driver.daemon.render_process import Renderer
from haptic_driver.daemon.set_up import render_settings
from haptic_driver.processes.real_time import Due
from haptic_driver.processes.shared_memory import NO_ORDER, NOT_PLAYED, Sensed, SharedState
from haptic_driver.render.texture import Grating, Uniform
from haptic_driver.rig.actuator import make_actuator
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.devices import build_rig, modulation_input
from haptic_driver.rig.envelope_writer import EnvelopeWriter, Lead
from haptic_driver.rig.evidence import Clock
from haptic_driver.rig.part import Wiring
from haptic_driver.rig.parts.analog_outputs import NoAnalogOutput
from haptic_driver.rig.states import RigState
from haptic_driver.simulation.finger_model import surface_friction
from haptic_driver.simulation.instruments import simulated_amplifier, simulated_generator
from hw.analog.output import AnalogOutputSettings
from hw.finger.plant import FingerPlant
from hw.serving.memory import MemoryTransport
from tests.haptic_driver.stand_ins import PlantSensor
from tests.hw.analog.simulated_analog_output import SteppedAnalogOutput

TICK_S = 0.001
FORCE_N, SPEED_M_S = 0.5, 0.04
STARTED_S = START_S + 0.1  # the latency included


class Loop:
    """A finger that slides steadily, with friction `gain` times the surface's, on a rig by its
    name.
    """

    def __init__(self, name, surface_file, gain):
        config = load_rig(name)
        law = surface_friction(surface_file, config.operating_limits())
        self.amplifier = simulated_amplifier(config)
        self.generator = simulated_generator(config, self.amplifier.drive)
        self.plant = FingerPlant(lambda f, v, n, s: gain * law(f, v, n, s, 0.0))
        sensor = PlantSensor(self.plant)
        analog = config.analog_output
        self.card = None
        if not isinstance(analog, NoAnalogOutput):
            self.card = SteppedAnalogOutput(
                AnalogOutputSettings(-5.0, 5.0, -5.0, analog.sample_rate_limit_hz)
            )
            self.card.open()
            rise_v_per_s = config.output.voltage_rise_v_per_s
            self.writer = EnvelopeWriter(self.card, modulation_input(config), 50e3, rise_v_per_s)
            self.generator.set_modulation_input(self.card.terminal_v)
        self.rig = build_rig(
            config,
            MemoryTransport(self.generator),
            sensor,
            Wiring(enable=self.amplifier, voltage_monitor=self.amplifier),
            modulated=self.card is not None,
            clock=Clock(lambda: self.now_s, lambda seconds: None),
        )
        self.now_s = 1000.0
        self.rig.connect()
        self.shared, self.order, self.number = SharedState(), NO_ORDER, 0
        self.failures = []
        self.pump = OutputPump(
            self.shared,
            config.output.setpoint_interval_s,
            config.output.linger_s,
            self.failures.append,
            lambda: self.now_s,
        )
        self.pump.actuator = make_actuator(config, self.rig)
        self.envelope = None
        if self.card is not None:
            self.envelope = EnvelopeLoop(self.shared, self.writer, Lead(None, analog.buffer_s))
        self.renderer = Renderer(
            render_settings(config, surface_file), self.shared, clock=lambda: self.now_s
        )

    def set(self, cof):
        """What control does when somebody asks for a friction."""
        self.play(Uniform(cof))

    def play(self, target):
        """The same for a texture."""
        number = self.order.number + 1
        self.shared.targets.write(self.order.target + 1, target)
        self.order = self.order._replace(
            number=number,
            arming=1,
            rendering=True,
            lease_until_s=math.inf,
            target=self.order.target + 1,
        )
        self.pump.open(number)

    def run(self, seconds, rendering=True):
        """Let so much time pass, in which render may hang; the samples."""
        position = self.shared.ring.position
        for _ in range(round(seconds / TICK_S)):
            self.now_s += TICK_S
            self.number += 1
            if self.card is not None:
                self.generator.set_modulation_input(self.card.advance(TICK_S))
            self.generator.advance(TICK_S)
            output = self.generator.output()
            voltage_v = self.amplifier.step(TICK_S, output)
            self.plant.step(TICK_S, output.frequency_hz, voltage_v, FORCE_N, SPEED_M_S)
            felt, x_m = self.rig.read_force(), 0.01 + SPEED_M_S * (self.now_s - 1000.0)
            self.shared.sensed.write(
                Sensed(
                    self.now_s,
                    x_m,
                    0.03,
                    True,
                    self.now_s,
                    felt.normal_force_n,
                    felt.lateral_force_n,
                    False,
                )
            )
            self.order = self.order._replace(beat_s=self.now_s)
            self.shared.order.write(self.order)
            self.pump.turn(self.now_s)  # may read what render said a tick ago
            if rendering:
                self.renderer.step(Due(self.number, self.now_s, 0.0, 0))
            if self.envelope is not None:
                self.envelope.turn(self.now_s)
        return self.shared.ring.read(position).samples

    def close(self):
        assert self.rig.close().on is False
        if self.card is not None:
            self.card.close()
        self.shared.close()


@pytest.fixture(params=["simulated", "simulated-envelope"])
def start(request, surface_file):
    """A loop whose finger slides already, 0.3 s, when output is asked for."""
    loops = []

    def begin(gain):
        loops.append(Loop(request.param, surface_file, gain))
        loops[-1].run(0.3)
        return loops[-1]

    yield begin
    for loop in loops:
        assert loop.failures == []
        loop.close()


@pytest.mark.parametrize(("gain", "cof"), [(1.0, 0.7), (1.4, 0.95)])
def test_a_start_under_a_sliding_finger_teaches_nothing_wrong(start, gain, cof):
    loop = start(gain)
    loop.set(cof)
    samples = loop.run(0.6)
    assert samples["voltage_v"].max() > 50.0
    learnt = samples["feedback_gain"]
    assert learnt.min() > 1.0 - 0.03
    assert learnt.max() < gain * 1.03
    assert learnt[-1] == pytest.approx(gain, rel=0.02)
    felt = samples["measured_cof"][round(STARTED_S / TICK_S) + 100 :]
    assert np.convolve(felt, np.full(20, 0.05), "valid") == pytest.approx(cof, rel=0.05)


def test_another_target_goes_on_without_a_gap(start):
    loop = start(1.0)
    loop.set(0.65)
    loop.run(0.5)
    for cof in (0.7, 0.68):
        loop.set(cof)
        loop.run(0.05)
        assert loop.amplifier.voltage_v > 50.0
    assert [event.state.name for event in loop.rig.events] == ["OFF", "ON"]


def test_nothing_goes_out_through_a_closed_gate(start):
    loop = start(1.0)
    loop.set(0.65)
    loop.run(0.5)
    assert loop.amplifier.voltage_v > 50.0
    assert loop.pump.output.on is True
    loop.pump.close()
    assert loop.pump.output.on is None  # a fault and what it leaves unknown are told in one step
    loop.run(0.05)
    assert loop.pump.output.on is False
    assert loop.amplifier.voltage_v == 0.0
    assert loop.rig.events[-1].state is RigState.OFF


def test_what_render_said_long_ago_goes_out_no_more(start):
    loop = start(1.0)
    loop.set(0.65)
    loop.run(0.5)
    loop.run(0.9 * OUTPUT_STALE_S, rendering=False)
    assert loop.rig.events[-1].state is RigState.ON
    loop.run(0.2 * OUTPUT_STALE_S, rendering=False)
    assert loop.amplifier.voltage_v == 0.0
    assert loop.rig.events[-1].state is RigState.OFF


def test_gaps_of_an_envelope_are_counted_and_teach_nothing(surface_file):
    loop = Loop("simulated-envelope", surface_file, 1.0)
    loop.set(0.7)
    loop.run(0.6)
    for _ in range(10):  # nobody plays meanwhile
        loop.card.advance(TICK_S)
    after = loop.run(0.3)
    assert loop.shared.played.read().underruns == 1
    assert np.abs(after["feedback_gain"] - 1.0).max() < 0.03
    assert (
        2 <= np.count_nonzero(after["output_on"] == 0) <= 5
    )  # what was commanded there is no row's
    loop.close()


def test_an_envelope_that_cannot_be_played_is_a_failure(surface_file):
    loop = Loop("simulated-envelope", surface_file, 1.0)
    loop.run(0.1)
    loop.envelope = None
    loop.shared.played.write(NOT_PLAYED._replace(failure="the card is gone"))
    loop.run(0.01)
    loop.close()
    assert {(told.code, told.message) for told in loop.failures} == {
        ("envelope_failed", "the card is gone")
    }


def test_a_texture_faster_than_half_the_ticks_reaches_the_electrode(surface_file):
    """800 Hz at 40 mm/s; held from tick to tick it would be 200 Hz."""
    loop = Loop("simulated-envelope", surface_file, 1.0)
    loop.run(0.3)
    loop.play(Grating(0.65, 0.03, SPEED_M_S / 800.0))
    loop.run(1.0)
    began = len(loop.card.played_v)
    loop.run(0.25)
    voltage_v = (np.array(loop.card.played_v[began:]) + 5.0) / 10.0 * 150.0
    force = np.fft.rfft(voltage_v**2) / voltage_v.size
    hz = np.fft.rfftfreq(voltage_v.size, 1.0 / 50e3)
    loop.close()
    assert hz[1 + np.abs(force[1:]).argmax()] == pytest.approx(800.0, rel=0.01)
    assert (
        np.abs(force[np.abs(hz - 800.0) < 40.0]).max()
        > 20.0 * np.abs(force[np.abs(hz - 200.0) < 40.0]).max()
    )
    assert loop.failures == []
