"""The rig as drivers see it: when set points are sent, when it switches off, and what it claims to know then."""

import math

import pytest

from haptic_driver.config import RigConfig
from haptic_driver.errors import HapticError
from haptic_driver.rig import OffEvidence, build_rig
from haptic_driver.signals import DriveCommand
from hw.amplifier import AmplifierState
from hw.errors import DeviceTimeout
from hw.force_sensor import ForceReading
from hw.simulated.amplifier import SimulatedAmplifier
from hw.simulated.faults import Fault, FaultyInstrument
from hw.simulated.waveform_generator import GeneratorLatency, Simulated33220A
from hw.transport.memory import MemoryTransport

OFF = DriveCommand(250.0, 0.0, False)


def on(voltage_v, frequency_hz=250.0):
    return DriveCommand(frequency_hz, voltage_v, True)


class Wire:
    """Keeps every message that changes the amplitude or switches the output."""

    def __init__(self, core):
        self.core = core
        self.messages = []

    def handle(self, data):
        self.messages.append(data.decode())
        return self.core.handle(data)

    def take(self):
        taken, self.messages = self.messages, []
        return taken


class Sensor:
    """A force sensor that can be broken."""

    broken = False

    def read(self):
        if self.broken:
            raise DeviceTimeout("sensor did not answer", "check its cable")
        return ForceReading(0.0, 0.5, 0.3, False)


class Bench:
    """A rig on a generator in memory; settings reach the terminals at once."""

    def __init__(self, config, enable=True, monitor=True):
        self.amplifier = SimulatedAmplifier(100.0, 700.0, enabled=not enable)
        self.generator = Simulated33220A(GeneratorLatency(0.0, 0.0, 0.0, 0.0), listener=self.amplifier.drive)
        self.faults = FaultyInstrument(self.generator)
        self.wire = Wire(self.faults)
        self.sensor = Sensor()
        line = self.amplifier if enable else None
        self.rig = build_rig(config, MemoryTransport(self.wire), self.sensor, line, self.amplifier if monitor else None)
        self.rig.connect()
        self.wire.take()

    @property
    def voltage_v(self):
        return self.amplifier.drive(self.generator.output())


@pytest.fixture
def bench(rig_config: RigConfig):
    return Bench(rig_config)


# --- commands --------------------------------------------------------------------------------------------------


def test_connecting_leaves_everything_off(bench):
    assert bench.voltage_v == 0.0
    assert bench.amplifier.read() is False
    assert bench.generator.output().on is False


def test_a_command_brings_its_peak_voltage_and_frequency_to_the_electrode(bench):
    bench.rig.command(0.0, on(87.5, 333.0))
    assert bench.voltage_v == pytest.approx(87.5, rel=1e-3)  # the generator's amplitude tolerance
    assert bench.generator.output().frequency_hz == pytest.approx(333.0, rel=1e-9)
    assert bench.amplifier.read() is True


def test_set_points_are_coalesced_to_the_newest_of_each_interval(bench):
    seen = []
    for tick in range(101):
        bench.rig.command(1e-3 * tick, on(50.0 + 0.1 * tick))
        seen.append(bench.voltage_v)
    amplitudes = [m for m in bench.wire.take() if "VOLT 0" in m or "VOLT 1" in m]
    assert len(amplitudes) == 11  # 100 ms at 10 ms, and the first at once
    assert seen[0] == pytest.approx(50.0, rel=1e-3)
    assert seen[9] == seen[0]
    assert seen[10] == pytest.approx(51.0, rel=1e-3)
    assert seen[100] == pytest.approx(60.0, rel=1e-3)


def test_off_never_waits_for_the_interval(bench):
    bench.rig.command(0.000, on(50.0))
    bench.rig.command(0.001, OFF)
    assert bench.voltage_v == 0.0
    assert bench.generator.output().on is False
    assert bench.amplifier.read() is False


def test_on_again_never_waits_either_and_never_shows_the_old_voltage(bench):
    bench.rig.command(0.000, on(120.0))
    bench.rig.command(0.001, OFF)
    bench.rig.command(0.002, on(30.0))
    assert bench.voltage_v == pytest.approx(30.0, rel=1e-3)


def test_an_off_rig_that_is_told_off_says_nothing(bench):
    bench.rig.command(0.0, OFF)
    bench.rig.command(1.0, OFF)
    assert bench.wire.take() == []


@pytest.mark.parametrize("voltage_v", [0.99, 0.01, 1e-12, 0.0])
def test_below_the_generators_minimum_is_off(bench, voltage_v):
    """10 mV peak is the least the generator makes: 1 V at the electrode."""
    bench.rig.command(0.000, on(50.0))
    bench.rig.command(0.001, on(voltage_v))
    assert bench.voltage_v == 0.0
    bench.rig.command(0.050, on(voltage_v))
    assert bench.generator.output().on is False
    bench.rig.command(0.060, on(1.001))
    assert bench.voltage_v == pytest.approx(1.001, rel=1e-3)


@pytest.mark.parametrize(
    "command", [on(150.1), on(math.nan), on(math.inf), on(50.0, 2e6), on(50.0, 0.5), on(50.0, math.nan), on(50.0, 1e6)]
)  # the last: 1 nF of panel draws 0.31 A, the amplifier gives 0.1 A
def test_a_command_beyond_the_limits_switches_off_and_raises(bench, command):
    bench.rig.command(0.0, on(50.0))
    with pytest.raises(HapticError) as refused:
        bench.rig.command(0.1, command)
    assert refused.value.code == "limit_exceeded"
    assert refused.value.hint
    assert bench.voltage_v == 0.0
    assert bench.amplifier.max_voltage_v <= 50.1


def test_a_dead_force_sensor_switches_off(bench):
    bench.rig.command(0.0, on(50.0))
    bench.sensor.broken = True
    with pytest.raises(HapticError) as failed:
        bench.rig.read_force()
    assert failed.value.code == "device_timeout"
    assert "sensor did not answer" in failed.value.message
    assert "generator says off, amplifier disabled" in failed.value.message
    assert bench.voltage_v == 0.0


# --- evidence --------------------------------------------------------------------------------------------------

ENABLED, DISABLED, UNKNOWN = AmplifierState.ENABLED, AmplifierState.DISABLED, AmplifierState.UNKNOWN


@pytest.mark.parametrize(
    ("generator_off", "amplifier", "output_on"),
    [
        (True, DISABLED, False),
        (True, UNKNOWN, False),
        (True, ENABLED, False),
        (False, DISABLED, False),
        (None, DISABLED, False),
        (None, UNKNOWN, None),
        (None, ENABLED, None),
        (False, UNKNOWN, True),
        (False, ENABLED, True),
    ],
)
def test_off_is_claimed_only_with_evidence(generator_off, amplifier, output_on):
    assert OffEvidence(generator_off, amplifier, None).output_on is output_on


def test_evidence_in_words():
    assert str(OffEvidence(None, UNKNOWN, None)) == "generator does not answer, amplifier unknown, no monitor"
    assert str(OffEvidence(False, ENABLED, 87.66)) == "generator says ON, amplifier enabled, monitor reads 87.7 V"


@pytest.mark.parametrize("enable", [True, False])
@pytest.mark.parametrize("answers", [True, False])
def test_what_off_claims_is_so(rig_config, enable, answers):
    bench = Bench(rig_config, enable=enable)
    bench.rig.command(0.0, on(80.0))
    assert bench.voltage_v == pytest.approx(80.0, rel=1e-3)
    if not answers:
        bench.faults.inject(Fault.HANG, count=math.inf)  # the message is lost as well: the generator stays on
    evidence = bench.rig.off()
    known_off = enable or answers
    assert evidence.output_on is not known_off  # a generator that does not answer is seen by the monitor
    assert (bench.voltage_v == 0.0) is known_off
    assert evidence.generator_off is (True if answers else None)


def test_the_monitors_reading_is_volts_at_the_electrode(rig_config):
    bench = Bench(rig_config, enable=False)
    bench.rig.command(0.0, on(80.0))
    assert bench.voltage_v == pytest.approx(80.0, rel=1e-3)
    bench.faults.inject(Fault.HANG, count=math.inf)
    assert bench.rig.off().monitor_v == pytest.approx(80.0, rel=1e-3)


@pytest.mark.parametrize("generator_off", [True, None])
def test_off_is_not_claimed_while_the_monitor_reads_high_voltage(generator_off):
    """Two witnesses against each other: what is on the electrode is what the monitor sees there."""
    assert OffEvidence(generator_off, DISABLED, 120.0).output_on is not False


def test_no_monitor_is_no_reading(rig_config):
    assert Bench(rig_config, monitor=False).rig.off().monitor_v is None


def test_closing_switches_off_and_says_so(bench):
    bench.rig.command(0.0, on(80.0))
    assert bench.rig.close().output_on is False
    assert bench.voltage_v == 0.0
