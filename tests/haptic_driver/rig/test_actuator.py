"""Both ways to the generator, and an envelope's: what the simulated amplifier saw, and what a
failure leaves there.
"""

import numpy as np
import pytest

from haptic_driver.errors import HapticError
from haptic_driver.rig.actuator import SetpointActuator, make_actuator
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.devices import build_rig, modulation_input
from haptic_driver.rig.envelope_writer import EnvelopeWriter
from haptic_driver.rig.evidence import Clock
from haptic_driver.rig.part import Wiring
from haptic_driver.signals import NO_COMMAND, NO_COURSE, Course, DriveCommand
from haptic_driver.simulation.instruments import simulated_amplifier, simulated_generator
from haptic_driver.simulation.rig import SimulatedRig
from hw.analog.output import AnalogOutputSettings
from hw.finger.plant import FingerPlant
from hw.serving.memory import MemoryTransport
from tests.haptic_driver.stand_ins import PlantSensor
from tests.hw.analog.simulated_analog_output import SteppedAnalogOutput

RATE_HZ, SAMPLES = 50e3, 50
LEAD_S = 0.005
RISE_V_PER_S = 10e3
ON = DriveCommand(250.0, 80.0, True, 150.0)


class Bench:
    """A rig whose generator is modulated by a simulated analog output; time in steps of one
    tick.
    """

    def __init__(self, config):
        self.electrode = simulated_amplifier(config)
        self.generator = simulated_generator(config, self.electrode.drive)
        self.output = SteppedAnalogOutput(AnalogOutputSettings(-5.0, 5.0, -5.0, RATE_HZ))
        sensor = PlantSensor(FingerPlant(lambda f, v, n, s: 0.5 * n), noise_n=0.0)
        self.lie_v = None
        self.rig = build_rig(
            config,
            MemoryTransport(self.generator),
            sensor,
            Wiring(enable=self.electrode, voltage_monitor=self),
            modulated=True,
            clock=Clock(sleep=lambda seconds: None),
        )
        self.time_s, self.seen_v = 1.0, []
        self.actuator = make_actuator(config, self.rig)
        self.writer = EnvelopeWriter(self.output, modulation_input(config), RATE_HZ, RISE_V_PER_S)

    def play(self, course):
        """What the envelope's process does in a turn, while the gate is open."""
        if np.isfinite(self.actuator.carrier_hz):
            self.writer.go_on(course, self.actuator.full_scale_v, LEAD_S)

    def read_v(self):
        return self.electrode.read_v() if self.lie_v is None else self.lie_v

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

    def run(self, voltages_v, steps_each=1):
        """A voltage to be reached in every `steps_each` ticks."""
        for voltage_v in voltages_v:
            self.actuator.command(self.time_s, ON._replace(voltage_v=voltage_v))
            self.play(to(voltage_v, 1e-3 * steps_each))
            for _ in range(steps_each):
                self.step()
        return np.array(self.seen_v)


def to(voltage_v, span_s=1e-3):
    """A course straight to a voltage."""
    return Course(np.array([voltage_v**2]), span_s)


@pytest.fixture
def bench():
    bench = Bench(load_rig("simulated-envelope"))
    bench.connect()
    yield bench
    bench.output.close()
    assert bench.rig.close().on is False


def test_the_electrode_follows_the_voltages_straight_in_their_square_and_late_by_the_lead(bench):
    """A texture of 50 Hz; between two ticks the force, which goes with voltage squared, runs
    straight.
    """
    ticks = np.arange(400)
    wanted_v = 70.0 + 30.0 * np.sin(2.0 * np.pi * 50.0 * ticks * 1e-3)
    seen_v = bench.run(wanted_v)
    ends_s = 1e-3 * ticks + LEAD_S  # played so much after it was commanded
    at_s = (
        np.arange(2, seen_v.size + 2) / RATE_HZ
    )  # a sample is out from its beginning on, and made for its end
    expected_v = np.sqrt(np.interp(at_s, ends_s, wanted_v**2))
    settled = slice(250 * SAMPLES, 395 * SAMPLES)  # the carrier has come up over SCPI
    np.testing.assert_allclose(seen_v[settled], expected_v[settled], rtol=2e-3)
    assert seen_v.max() < 100.0 * 1.002
    assert bench.writer.underruns == 0


def test_the_voltage_of_a_new_carrier_waits_for_it(bench):
    """SCPI brings the carrier 10 ms after the course of its voltages; what is more than before may
    be too much.
    """
    bench.run(np.full(300, 20.0))
    new = DriveCommand(100.0, 90.0, True, 150.0)
    while_old_v = []
    for tick in range(40):
        may_rise = bench.actuator.carrier_hz == new.frequency_hz
        bench.writer.go_on(to(90.0), 150.0, LEAD_S, may_rise)
        if tick == 10:
            bench.actuator.command(bench.time_s, new)
        old = bench.generator.output().frequency_hz == ON.frequency_hz
        bench.step()
        while_old_v += [max(bench.seen_v[-SAMPLES:])] if old else []
    assert len(while_old_v) >= 10
    assert max(while_old_v) == pytest.approx(20.0, rel=5e-3)
    assert bench.seen_v[-1] == pytest.approx(90.0, rel=2e-3)


def test_the_carrier_alone_puts_nothing_out(bench):
    seen_v = bench.run(np.zeros(300))
    assert seen_v.max() < 0.01
    assert bench.rig.state.value == "on"


def test_a_command_without_output_ends_it_at_once(bench):
    seen_v = bench.run(np.full(300, 90.0))
    assert seen_v[-1] == pytest.approx(90.0, rel=2e-3)
    bench.writer.rest()
    assert bench.output.terminal_v == -5.0
    bench.actuator.command(bench.time_s, NO_COMMAND)
    bench.step()
    assert max(bench.seen_v[-SAMPLES:]) == 0.0
    assert bench.rig.state.value == "off"


def test_an_envelope_that_runs_dry_goes_on_from_where_it_was_by_a_bounded_rise(bench):
    bench.run(np.full(300, 60.0))
    for _ in range(10):  # nobody writes for so many milliseconds
        bench.step()
    assert bench.seen_v[-1] == pytest.approx(60.0, rel=2e-3)
    again = len(bench.seen_v)
    seen_v = bench.run(np.full(30, 140.0))
    assert bench.writer.underruns == 1
    assert seen_v[again:].min() == pytest.approx(60.0, abs=1.0)
    assert (
        np.diff(seen_v[again : again + round(LEAD_S * RATE_HZ)]).max()
        < 2.0 * RISE_V_PER_S / RATE_HZ
    )
    assert seen_v[-1] == pytest.approx(140.0, rel=2e-3)


def test_an_envelope_that_nobody_writes_for_long_is_zero_and_begins_again_from_zero(bench):
    bench.run(np.full(300, 90.0))
    for _ in range(60):
        bench.step()
    assert bench.seen_v[-1] < 0.01
    again = len(bench.seen_v)
    seen_v = bench.run(np.full(30, 90.0))
    assert bench.writer.underruns == 1
    assert seen_v[again:].argmax() > LEAD_S * RATE_HZ - 2
    assert seen_v[-1] == pytest.approx(90.0, rel=2e-3)


def test_commands_faster_or_slower_than_the_output_plays_keep_the_lead(bench):
    within_s = (
        LEAD_S / 8 + 1.1 / RATE_HZ
    )  # nearer to it courses are left as they are: every change bends a texture
    for steps in (1, 2):
        bench.run(np.full(200, 90.0), steps)
        assert bench.output.buffered_s == pytest.approx(LEAD_S - steps * 1e-3, abs=within_s)
    for span_s in (
        0.999e-3,
        1.001e-3,
    ):  # a card whose clock is off by a tenth of a percent, more than any is
        for _ in range(2000):
            bench.play(to(90.0, span_s))
            bench.output.advance(1e-3)
        assert bench.output.buffered_s == pytest.approx(LEAD_S - 1e-3, abs=within_s)
    assert bench.writer.underruns == 0


def test_without_anything_new_the_last_voltage_is_held_and_not_for_nothing(bench):
    bench.run(np.full(300, 90.0))
    for _ in range(20):  # render stalls
        bench.play(NO_COURSE)
        bench.step()
    assert min(bench.seen_v[-20 * SAMPLES :]) == pytest.approx(90.0, rel=2e-3)
    assert bench.writer.underruns == 0
    bench.play(NO_COURSE)
    waiting_s = bench.output.buffered_s
    bench.play(NO_COURSE)  # at once again, as a thread that is late does: nothing is put in between
    assert bench.output.buffered_s == waiting_s


def test_a_thread_that_plays_late_or_early_does_not_bend_the_texture(bench):
    """Courses come in time with the ticks, two at once now and then: on the electrode they are as
    long as they were.
    """
    bench.run(np.full(300, 90.0))
    ticks = np.arange(400)
    powers_v2 = (70.0 + 30.0 * np.sin(2.0 * np.pi * 100.0 * ticks * 1e-3)) ** 2
    began, pending, late = len(bench.seen_v), [], np.random.default_rng(3).random(ticks.size) < 0.3
    for power_v2, is_late in zip(powers_v2, late, strict=True):
        pending.append(power_v2)
        if not is_late or len(pending) == 2:
            bench.play(Course(np.array(pending), 1e-3 * len(pending)))
            pending = []
        bench.step()
    seen_v2 = np.array(bench.seen_v[began:]) ** 2
    at_s = np.arange(2, seen_v2.size + 2) / RATE_HZ
    expected_v2 = np.interp(at_s, 1e-3 * ticks + LEAD_S, powers_v2)
    # Nothing is stretched: what is late is within an eighth of the lead.
    assert np.abs(seen_v2 - expected_v2)[50 * SAMPLES : 395 * SAMPLES].max() < 2e-3 * np.ptp(
        powers_v2
    )
    assert bench.writer.underruns == 0


def test_a_course_beyond_full_scale_leaves_zero(bench):
    bench.run(np.full(300, 90.0))
    with pytest.raises(HapticError) as failed:
        bench.play(to(151.0))  # of 150 V
    assert failed.value.code == "beyond_full_scale"
    assert bench.output.terminal_v == -5.0


@pytest.mark.parametrize(
    ("monitor_v", "trips"), [(0.0, False), (1.49, False), (1.70, True)]
)  # at 0.01 V per V
def test_a_monitor_may_show_less_than_the_carrier_and_never_more(bench, monitor_v, trips):
    bench.run(np.full(300, 90.0))
    bench.lie_v = monitor_v
    if trips:
        with pytest.raises(HapticError, match="the monitor reads 170 V"):
            bench.rig.watch(bench.time_s)
        bench.lie_v = 0.0
        bench.rig.reset_trip()
    else:
        bench.rig.watch(bench.time_s)
    bench.lie_v = None


def test_what_is_asked_to_be_little_stays_on_at_the_lowest_voltage(rig_config, touch):
    """A valley of a texture below the friction without voltage; a relay would have clicked at each
    of them.
    """
    with SimulatedRig(rig_config, touch) as bench:
        bench.rig.connect()
        actuator = SetpointActuator(bench.rig, 1.0)
        for k in range(400):
            valley = k // 50 % 2 == 1
            actuator.command(1e-3 * k, ON._replace(voltage_v=0.0 if valley else 80.0))
            bench.step(1e-3, 0.5, 0.04)
            if valley and k % 50 == 49:
                assert bench.instruments.voltage_v == pytest.approx(
                    bench.rig.minimum_voltage_v, rel=1e-3
                )
        assert actuator.switched == 1


def test_a_relay_has_its_pause_before_it_comes_on_again_and_none_before_it_goes_off(
    rig_config, touch
):
    with SimulatedRig(rig_config, touch) as bench:
        bench.rig.connect()
        actuator = SetpointActuator(bench.rig, relay_interval_s=0.5)
        came_on = []
        for k in range(1200):
            time_s = 1e-3 * k
            actuator.command(time_s, ON if k % 100 < 50 else NO_COMMAND)
            if k % 100 >= 50:
                assert bench.rig.state.value == "off"
            elif bench.rig.state.value == "on" and k % 100 == 0:
                came_on.append(time_s)
            bench.step(1e-3, 0.5, 0.04)
        assert came_on == pytest.approx([0.0, 0.5, 1.0])
        assert actuator.switched == 3
