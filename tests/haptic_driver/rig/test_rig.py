"""The rig as drivers see it: when set points are sent, when it switches off, and what it claims to
know then.
"""

import math
import threading
import time
from contextlib import nullcontext, suppress
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

from haptic_driver.errors import HapticError
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.devices import build_rig
from haptic_driver.rig.evidence import Clock, OffEvidence, switch_off
from haptic_driver.rig.part import Wiring
from haptic_driver.rig.parts.analog_inputs import NiAnalogInputsConfig
from haptic_driver.rig.states import RigState, Withdrawals, Withdrawn
from haptic_driver.signals import DriveCommand
from hw.amplifier.analog import AmplifierState
from hw.amplifier.simulated import SimulatedAmplifier
from hw.errors import DeviceTimeout, SwitchedOff
from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.generator.settings import Shape
from hw.safety.interlock import HeartbeatInterlock
from hw.safety.simulated_interlock import SimulatedInterlock
from hw.serving.memory import MemoryTransport
from tests.clock import ManualClock
from tests.haptic_driver.stand_ins import BreakableSensor, Heard
from tests.hw.instruments import IMMEDIATE
from tests.hw.testing.faulty_instrument import Fault, FaultyInstrument
from tests.hw.testing.tripping_amplifier import TrippingAmplifier

OFF = DriveCommand(250.0, 0.0, False)


def on(voltage_v, frequency_hz=250.0):
    return DriveCommand(frequency_hz, voltage_v, True)


class Monitor:
    """The voltage monitor, which can be made to lie."""

    lie_v = None

    def __init__(self, amplifier):
        self.amplifier = amplifier

    def read_v(self):
        return self.amplifier.read_v() if self.lie_v is None else self.lie_v


class Heart:
    """Counts beats; dies when told to."""

    def __init__(self):
        self.beats = self.rests = 0
        self.dead = self.switched_off = False

    def beat(self):
        if self.switched_off:
            self.switched_off = False
            raise SwitchedOff("watchdog: it was not beaten in time")
        if self.dead:
            raise DeviceTimeout("watchdog: it has ended", "start it again")
        self.beats += 1

    def rest(self):
        self.rests += 1

    def times_off(self):
        return int(self.switched_off)


class Bench:
    """A rig on a generator in memory; settings reach the terminals at once."""

    def __init__(self, config, enable=True, monitor=True, wire=Heard, **options):
        self.config = config
        self.amplifier = TrippingAmplifier(100.0, 700.0, enabled=not enable)
        self.generator = Simulated33220A(IMMEDIATE, listener=self.amplifier.drive)
        self.faults = FaultyInstrument(self.generator)
        self.wire = wire(self.faults)
        self.sensor = BreakableSensor()
        line = self.amplifier if enable else None
        self.monitor = Monitor(self.amplifier)
        self.rig = build_rig(
            config,
            MemoryTransport(self.wire),
            self.sensor,
            Wiring(
                enable=line,
                voltage_monitor=self.monitor if monitor else None,
                current_monitor=self.amplifier.current_monitor,
                fault=self.amplifier.fault_line,
            ),
            **options,
        )
        self.rig.connect()
        self.wire.take()

    @property
    def voltage_v(self):
        return self.amplifier.drive(self.generator.output())


@pytest.fixture
def bench(rig_config):
    return Bench(rig_config)


# --- commands
# --------------------------------------------------------------------------------------------------


def test_a_command_does_not_walk_through_the_rigs_file(bench, monkeypatch):
    """It cost half a millisecond of each, a thousand times a second."""
    walked = property(lambda config: pytest.fail("the file was walked"))
    monkeypatch.setattr(RigConfig, "signed_sections", walked)
    bench.rig.command(0.0, on(87.5, 333.0))
    assert bench.voltage_v > 80.0


@pytest.mark.parametrize("frequency_hz", [10e3, 20e3, 40e3, 100e3])
def test_a_carrier_that_the_monitors_alias_is_refused_but_for_a_voltage_that_reads_as_quiet_anyway(
    rig_config, frequency_hz
):
    """At 20 kS/s these carriers read as anything between nothing and their peak."""
    card = NiAnalogInputsConfig(sample_rate_hz=20e3)
    amplifier = rig_config.amplifier.model_copy(update={"voltage_monitor": "Dev1/ai6"})
    bench = Bench(rig_config.model_copy(update={"analog_inputs": card, "amplifier": amplifier}))
    with pytest.raises(HapticError, match="the monitors alias") as error:
        bench.rig.command(0.0, on(5.1, frequency_hz))
    assert "stay at or below 8000 Hz, or 5 V" in error.value.hint
    assert bench.amplifier.max_voltage_v == 0.0
    bench.rig.command(1.0, on(5.0, frequency_hz))
    assert bench.voltage_v == pytest.approx(5.0, rel=1e-2)
    assert rig_config.operating_limits().frequency_high_hz == 1e6
    narrow = rig_config.model_copy(
        update={"analog_inputs": card, "amplifier": amplifier}
    ).operating_limits()
    assert narrow.frequency_high_hz == 8e3  # the controller looks no further


def test_a_bias_rises_with_the_amplitude_and_counts_for_the_peak(bench):
    bench.rig.command(0.0, on(60.0), -40.0)
    output = bench.generator.output()
    assert (output.amplitude_v, output.offset_v) == pytest.approx((0.6, -0.4), rel=1e-3)
    assert bench.voltage_v == pytest.approx(100.0, rel=1e-3)
    bench.rig.hold(0.4)
    bench.rig.hold(0.8)  # the monitor, which reads the peak, contradicts nothing
    assert bench.rig.state is RigState.ON


def test_another_waveform_reaches_the_electrode(bench):
    bench.rig.command(0.0, on(60.0), 0.0, Shape.SQUARE)
    assert (bench.generator.output().shape, bench.voltage_v) == (
        Shape.SQUARE,
        pytest.approx(60.0, rel=1e-3),
    )
    bench.rig.off()
    bench.rig.command(1.0, on(60.0), 0.0, Shape.DC)
    assert (bench.generator.output().shape, bench.voltage_v) == (
        Shape.DC,
        pytest.approx(60.0, rel=1e-3),
    )


@pytest.mark.parametrize(
    ("voltage_v", "offset_v", "shape", "said"),
    [
        (60.0, 40.1, Shape.SINE, "a direct voltage of 40.1 V is beyond 40 V"),
        (40.1, 0.0, Shape.DC, "a direct voltage of 40.1 V is beyond 40 V"),
        (120.0, -39.0, Shape.SINE, "159 V at 250 Hz is beyond 150 V"),
    ],
)
def test_a_direct_voltage_or_a_peak_beyond_the_limits_never_comes_on(
    rig_config, voltage_v, offset_v, shape, said
):
    limits = rig_config.limits.model_copy(update={"direct_voltage_v": 40.0})
    bench = Bench(rig_config.model_copy(update={"limits": limits}))
    with pytest.raises(HapticError, match=said):
        bench.rig.command(0.0, on(voltage_v), offset_v, shape)
    assert bench.amplifier.max_voltage_v == 0.0


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


def test_off_and_on_again_wait_for_no_interval_and_never_show_the_old_voltage(bench):
    bench.rig.command(0.000, on(120.0))
    bench.rig.command(0.001, OFF)
    assert bench.voltage_v == 0.0
    assert bench.generator.output().on is False
    assert bench.amplifier.read() is False
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
    "command",
    [
        on(150.1),
        on(math.nan),
        on(math.inf),
        on(50.0, 2e6),
        on(50.0, 0.5),
        on(50.0, math.nan),
        on(50.0, 1e6),
    ],
)  # the last: 1 nF of panel draws 0.31 A, the amplifier gives 0.1 A
def test_a_command_beyond_the_limits_switches_off_and_raises(bench, command):
    bench.rig.command(0.0, on(50.0))
    with pytest.raises(HapticError) as refused:
        bench.rig.command(0.1, command)
    assert refused.value.code == "limit_exceeded"
    assert refused.value.hint
    assert bench.voltage_v == 0.0
    assert bench.amplifier.max_voltage_v <= 50.1


@pytest.mark.parametrize("end", [0, 1])
def test_the_limits_themselves_are_allowed(rig_config, end):
    limits = rig_config.limits.model_copy(update={"frequency_hz": (100.0, 300.0)})
    rig = Bench(rig_config.model_copy(update={"limits": limits})).rig
    rig.command(0.0, on(50.0, limits.frequency_hz[end]))
    assert rig.state is RigState.ON
    with pytest.raises(HapticError, match=r"outside 100\.\.300 Hz"):
        rig.command(0.1, on(50.0, (99.9, 300.1)[end]))


def test_a_dead_force_sensor_switches_off(bench):
    bench.rig.command(0.0, on(50.0))
    bench.sensor.broken = True
    with pytest.raises(HapticError) as failed:
        bench.rig.read_force()
    assert failed.value.code == "device_timeout"
    assert "sensor did not answer" in failed.value.message
    assert "generator says off, amplifier disabled" in failed.value.message
    assert bench.voltage_v == 0.0


# --- evidence
# --------------------------------------------------------------------------------------------------

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
    assert OffEvidence(generator_off, amplifier, None, 5.0).at(5.0).on is output_on


@pytest.mark.parametrize("age_s", [1.001, 30.0, -0.001, math.nan])
def test_what_instruments_said_counts_for_a_second(age_s):
    """Nor does an answer count that is of a time to come."""
    said = OffEvidence(True, DISABLED, 0.0, 5.0)
    assert said.at(6.0).on is False
    assert said.at(5.0 + age_s).on is None


@pytest.mark.parametrize("enable", [True, False])
@pytest.mark.parametrize("answers", [True, False])
def test_what_off_claims_is_so(rig_config, enable, answers):
    bench = Bench(rig_config, enable=enable)
    bench.rig.command(0.0, on(80.0))
    assert bench.voltage_v == pytest.approx(80.0, rel=1e-3)
    if not answers:
        bench.faults.inject(
            Fault.HANG, count=math.inf
        )  # the message is lost as well: the generator stays on
    evidence = bench.rig.off()
    known_off = enable or answers
    assert evidence.on is not known_off  # a generator that does not answer is seen by the monitor
    assert (bench.voltage_v == 0.0) is known_off
    assert evidence.by.generator_off is (True if answers else None)
    assert evidence.by.monitor_v == pytest.approx(0.0 if known_off else 80.0, rel=1e-3)


@pytest.mark.parametrize("generator_off", [True, None])
def test_off_is_not_claimed_while_the_monitor_reads_high_voltage(generator_off):
    """Two witnesses against each other: what is on the electrode is what the monitor sees there."""
    assert OffEvidence(generator_off, DISABLED, 120.0, 5.0).at(5.0).on is not False


# --- ramps
# ------------------------------------------------------------------------------------------------


def test_it_comes_on_at_the_minimum_and_rises_by_bounded_steps(bench):
    """10 kV/s at 10 ms: 100 V per set point, from the generator's minimum of 1 V."""
    seen = []
    for tick in range(4):
        bench.rig.command(0.01 * tick, on(150.0))
        seen.append(bench.voltage_v)
    assert seen == pytest.approx([101.0, 150.0, 150.0, 150.0], rel=1e-3)
    first_on = next(m for m in bench.wire.take() if "OUTP 1" in m)
    assert bench.amplifier.max_voltage_v <= 150.0 * 1.001
    assert "VOLT 1" not in first_on  # the output itself comes on before the ramp


# --- lease, heartbeats, guard
# ------------------------------------------------------------------------------------


def test_output_that_is_not_refreshed_goes_to_zero(bench):
    bench.rig.command(0.0, on(80.0))
    bench.rig.watch(0.499)
    assert bench.voltage_v == pytest.approx(80.0, rel=1e-3)
    bench.rig.hold(0.5)
    bench.rig.watch(0.999)
    assert bench.voltage_v == pytest.approx(80.0, rel=1e-3)
    bench.rig.watch(1.01)
    assert bench.voltage_v == 0.0
    assert bench.rig.state is RigState.OFF
    bench.rig.hold(1.02)
    assert bench.voltage_v == 0.0  # holding what is off does not bring it back


def test_output_that_lapses_and_is_not_shown_off_is_told_after_one_try(rig_config):
    """It was tried a second time first: of a rig whose instruments all hung the daemon spoke after
    30 s.
    """
    bench = Bench(rig_config, enable=False, monitor=False)
    bench.rig.command(0.0, on(50.0))
    bench.wire.take()
    bench.faults.inject(Fault.HANG, count=math.inf)
    assert bench.rig.off().on is None
    one_try = bench.wire.take()
    assert one_try
    bench.faults.heal()
    bench.rig.command(1.0, on(50.0))
    bench.wire.take()
    bench.faults.inject(Fault.HANG, count=math.inf)
    with pytest.raises(HapticError, match="may still be on"):
        bench.rig.watch(2.0)
    assert bench.wire.take() == one_try


def test_who_watches_does_not_wait_where_another_thread_is_on_the_way_off(bench, monkeypatch):
    """The daemon's thread that watches has others to look after while instruments are silent."""
    asked, answers, write = threading.Event(), threading.Event(), bench.amplifier.write

    def hang(level):
        asked.set()
        assert answers.wait(60.0)
        write(level)

    bench.rig.command(0.0, on(80.0))
    monkeypatch.setattr(bench.amplifier, "write", hang)
    switching = threading.Thread(target=bench.rig.off)
    switching.start()
    assert asked.wait(60.0)
    bench.wire.take()
    bench.rig.watch(1.0)
    assert bench.wire.take() == []
    answers.set()
    switching.join(60.0)
    assert bench.rig.state is RigState.OFF


def test_a_late_command_starts_again_from_the_minimum(bench):
    bench.rig.command(0.00, on(100.0))
    bench.rig.command(0.01, on(150.0))
    bench.rig.command(2.00, on(150.0))
    assert bench.voltage_v == pytest.approx(101.0, rel=1e-3)


def test_hearts_are_beaten_while_refreshed_and_rest_when_off(rig_config):
    heart = Heart()
    bench = Bench(rig_config, heartbeats=[heart])
    assert heart.beats == 0
    for tick in range(101):
        bench.rig.command(1e-3 * tick, on(50.0))
    assert heart.beats == 3  # at 0, 50 and 100 ms
    bench.rig.watch(0.3)
    assert heart.beats == 3  # watching is not the caller's own life
    bench.rig.hold(0.4)
    assert heart.beats == 4
    rests = heart.rests
    bench.rig.off()
    assert heart.rests == rests + 1


def test_hearts_hear_from_a_rig_between_two_touches(rig_config):
    """A watchdog that was stopped meanwhile let the next touch have voltage until its period was
    over.
    """
    heart = Heart()
    bench = Bench(rig_config, heartbeats=[heart])
    interval_s = bench.config.safety.beat_interval_s
    bench.rig.command(0.0, on(60.0))
    bench.rig.command(0.1, OFF)
    beats, rests = heart.beats, heart.rests
    for i in range(1, 11):
        bench.rig.command(
            0.1 + i * 0.6 * interval_s, on(0.0)
        )  # something is rendered, and no finger is there
    assert heart.rests == rests + 5
    assert heart.beats == beats
    bench.rig.command(2.0, on(60.0))
    assert heart.beats == beats + 1


def test_a_dead_heart_switches_off(rig_config):
    heart = Heart()
    bench = Bench(rig_config, heartbeats=[heart])
    bench.rig.command(0.0, on(50.0))
    heart.dead = True
    with pytest.raises(HapticError, match="watchdog: it has ended"):
        bench.rig.command(0.1, on(50.0))
    assert bench.voltage_v == 0.0


def test_a_heart_that_switched_off_for_want_of_beats_lets_the_output_come_back_from_the_minimum(
    rig_config,
):
    heart = Heart()
    bench = Bench(rig_config, heartbeats=[heart])
    bench.rig.command(0.0, on(50.0))
    heart.switched_off = True
    bench.rig.command(0.1, on(50.0))
    assert (bench.rig.state, bench.voltage_v) == (RigState.OFF, 0.0)
    assert any("not beaten" in event.reason for event in bench.rig.events)
    bench.rig.command(0.2, on(150.0))
    assert bench.rig.state is RigState.ON
    assert 0.0 < bench.voltage_v < 150.0


def test_a_device_that_fails_since_the_watchdog_took_it_names_the_watchdog(rig_config):
    """As a card does, which has one owner at a time: whoever reads the fault looks at the cause."""
    heart = Heart()
    bench = Bench(rig_config, heartbeats=[heart])
    bench.rig.command(0.0, on(50.0))
    heart.switched_off = True
    bench.sensor.broken = True
    with pytest.raises(HapticError, match="did not answer; watchdog: it switched off, since"):
        bench.rig.read_force()
    heart.switched_off = False
    with pytest.raises(HapticError) as raised:
        bench.rig.read_force()
    assert "watchdog" not in raised.value.message


def test_a_heart_does_not_rest_while_the_output_is_unknown(rig_config):
    heart = Heart()
    bench = Bench(rig_config, enable=False, monitor=False, heartbeats=[heart])
    bench.rig.command(0.0, on(50.0))
    rests = heart.rests
    bench.faults.inject(Fault.HANG, count=math.inf)
    assert bench.rig.off().on is None
    assert heart.rests == rests


# --- trips
# ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lie_v", "last_s"),
    [(0.0, 0.16), (0.3, 0.16), (1.2, 0.0)],  # at 0.01 V per V: 0, 30 and 120 V
)
def test_a_monitor_that_contradicts_the_command_latches_a_trip(bench, lie_v, last_s):
    """Too much at once; too little after the settling time, since a late voltage hurts nobody."""
    bench.rig.command(0.0, on(80.0))
    bench.rig.hold(0.1)
    bench.monitor.lie_v = lie_v
    for look in range(round(100.0 * last_s)):
        bench.rig.hold(0.3 + 0.01 * look)
    with pytest.raises(HapticError) as tripped:
        bench.rig.hold(0.3 + last_s)
    assert tripped.value.code == "tripped"
    assert bench.voltage_v == 0.0
    assert bench.rig.state is RigState.TRIPPED
    bench.monitor.lie_v = None
    with pytest.raises(
        HapticError, match=r"rig is tripped: the monitor reads .* where 80\.\.80 V were commanded"
    ):
        bench.rig.command(0.4, on(80.0))
    bench.rig.command(0.5, OFF)  # off needs no permission
    bench.rig.reset_trip()
    bench.rig.command(1.0, on(80.0))
    assert bench.voltage_v == pytest.approx(80.0, rel=1e-3)


def test_the_monitor_may_lag_by_the_settling_time_and_be_off_by_the_tolerance(bench):
    bench.rig.command(0.0, on(80.0))
    bench.monitor.lie_v = 0.0
    bench.rig.hold(0.14)
    bench.monitor.lie_v = 0.87  # 8.75 % high
    bench.rig.hold(0.3)
    bench.rig.command(0.31, on(40.0))
    bench.rig.hold(0.4)
    assert bench.rig.state is RigState.ON


def test_a_dialogue_that_stalled_is_no_contradiction(bench):
    """A busy machine kept a set point waiting longer than the settling time: what it replaces was
    there until then.
    """
    bench.rig.command(0.0, on(80.0))
    bench.rig.hold(0.2)
    bench.rig.hold(0.4)
    bench.rig.command(0.5, on(40.0))
    bench.monitor.lie_v = 0.8
    bench.rig.hold(0.8)  # the first instant after the dialogue
    bench.rig.hold(0.9)
    with pytest.raises(HapticError, match=r"monitor reads 80 V where 40\.\.40 V"):
        bench.rig.hold(0.96)


@pytest.mark.parametrize("late_s", [0.001, 0.2])
def test_a_command_timed_before_another_threads_look_forgets_nothing(bench, late_s):
    """Found after 22 minutes of rendering: the history began anew, without the zero that was still
    on the monitor.
    """
    bench.rig.command(0.0, on(80.0))
    bench.rig.watch(0.230)
    bench.rig.command(0.235, on(90.0))
    bench.rig.watch(0.240)
    bench.monitor.lie_v = 0.8  # not there yet
    bench.rig.command(0.245 - late_s, on(60.0))
    bench.rig.watch(0.25)
    assert bench.rig.state is RigState.ON


def test_a_voltage_that_comes_late_and_then_comes_is_no_trip(bench):
    """Found after 13 minutes of rendering on a busy machine: 0 V for a moment where 91 V had been
    commanded.
    """
    bench.rig.command(0.0, on(80.0))
    bench.rig.hold(0.3)
    bench.monitor.lie_v = 0.0
    bench.rig.hold(0.4)
    bench.monitor.lie_v = None
    bench.rig.hold(0.5)
    bench.monitor.lie_v = 0.0
    bench.rig.hold(0.6)  # counts anew
    bench.rig.hold(0.74)
    assert bench.rig.state is RigState.ON


@pytest.mark.parametrize("seen_by", ["watch", "command"])
@pytest.mark.parametrize("began", ["before", "meanwhile"])
def test_an_off_of_another_thread_is_no_contradiction(bench, monkeypatch, seen_by, began):
    """Found in the daemon: who looked while somebody switched off saw the enable line low, and
    tripped.
    """
    bench.rig.command(0.0, on(80.0))
    bench.rig.hold(0.3)
    reading, thread = bench.amplifier.read, threading.Thread(target=bench.rig.off)

    def off_begins():
        thread.start()
        while reading():  # until its line is low; it then waits for who looks
            time.sleep(0.001)

    def read():
        if not thread.ident:
            off_begins()
        return reading()

    if began == "meanwhile":
        monkeypatch.setattr(bench.amplifier, "read", read)
    else:
        bench.rig._switch._lock.acquire()
        off_begins()
    bench.rig.watch(0.4) if seen_by == "watch" else bench.rig.command(0.4, on(81.0))
    if began == "before":
        bench.rig._switch._lock.release()
    thread.join()
    assert bench.rig.state is RigState.OFF
    assert bench.voltage_v == 0.0
    bench.rig.command(1.0, on(80.0))
    assert bench.voltage_v == pytest.approx(80.0, rel=1e-3)


def test_a_trip_stays_while_its_reason_may(bench):
    bench.rig.command(0.0, on(80.0))
    bench.monitor.lie_v = 2.0
    with pytest.raises(HapticError, match="monitor reads 200 V"):
        bench.rig.hold(0.3)
    with pytest.raises(HapticError) as remains:
        bench.rig.reset_trip()
    assert remains.value.code == "trip_remains"
    bench.monitor.lie_v = None
    bench.rig.reset_trip()
    assert bench.rig.state is RigState.OFF


def test_voltage_that_appears_while_off_is_a_trip(bench):
    bench.monitor.lie_v = 0.5
    with pytest.raises(HapticError, match=r"the monitor reads 50 V where 0\.\.0 V were commanded"):
        bench.rig.watch(1.0)


@pytest.mark.parametrize("monitor", [True, False])
def test_a_generator_that_somebody_switches_on_while_off_is_a_trip(rig_config, monitor):
    """Off was once what the last command had left, however long ago; a second program's 95 V were
    "idle, 0 V".
    """
    bench = Bench(rig_config, monitor=monitor)
    bench.rig.watch(10.0)
    bench.rig.watch(10.4)
    assert len([said for said in bench.wire.take() if "OUTP?" in said]) == 1  # not with every look
    bench.generator.handle(b"OUTP ON\n")
    with pytest.raises(HapticError, match="somebody else switched it on"):
        bench.rig.watch(11.1)
    assert bench.rig.state is RigState.TRIPPED
    assert not bench.generator.output().on


def test_a_generator_that_is_switched_off_for_the_night_is_no_fault_where_the_line_says_off(bench):
    """And it is not asked every second then."""
    bench.faults.inject(Fault.HANG, count=math.inf)
    for second in range(25):
        bench.rig.watch(100.0 + second)
    assert bench.rig.state is RigState.OFF
    assert len(bench.rig.events) <= 4


def test_an_amplifier_that_trips_or_loses_its_enable_line_is_a_trip(bench):
    bench.rig.command(0.0, on(80.0))
    bench.amplifier.trip()
    with pytest.raises(HapticError, match="fault line says fault"):
        bench.rig.hold(0.01)
    bench.rig.reset_trip()
    bench.rig.command(1.0, on(80.0))
    bench.amplifier.write(False)  # an E-stop in the line
    with pytest.raises(HapticError, match="enable line reads low: interlock or E-stop"):
        bench.rig.command(1.1, on(81.0))


def test_every_change_of_state_is_told_once_with_its_reason(rig_config):
    told = []
    bench = Bench(rig_config, on_event=told.append)
    bench.rig.command(0.0, on(80.0))
    bench.rig.command(0.1, on(90.0))
    bench.rig.command(0.2, OFF)
    bench.rig.off()
    assert [(event.time_s, event.state) for event in told[1:]] == [
        (0.0, RigState.ON),
        (0.2, RigState.OFF),
    ]
    assert told[0].state is RigState.OFF
    assert "generator says off" in told[2].reason
    assert list(bench.rig.events) == told


def test_an_off_that_was_not_heard_is_tried_again(rig_config):
    bench = Bench(rig_config, enable=False, monitor=False)
    bench.rig.command(0.0, on(80.0))
    bench.faults.inject(Fault.HANG, count=2)
    with pytest.raises(HapticError, match="may still be on"):
        bench.rig.command(0.1, OFF)
    assert bench.voltage_v == pytest.approx(80.0, rel=1e-3)
    bench.rig.command(0.2, OFF)  # too early to try again
    assert bench.rig.state is RigState.UNKNOWN
    bench.rig.command(0.7, OFF)
    assert bench.voltage_v == 0.0
    assert bench.rig.state is RigState.OFF


def test_an_interlock_box_opens_by_itself_when_the_caller_stalls(rig_config):
    """The box is enable line and heartbeat at once; nobody calls the rig any more, and nobody needs
    to.
    """
    clock = ManualClock()
    box = SimulatedInterlock(clock)
    interlock = HeartbeatInterlock(MemoryTransport(box))
    interlock.connect()
    amplifier = SimulatedAmplifier(100.0, 700.0, enabled=True, interlock=lambda: box.closed)
    generator = Simulated33220A(IMMEDIATE, listener=amplifier.drive)
    rig = build_rig(
        rig_config,
        MemoryTransport(generator),
        BreakableSensor(),
        Wiring(enable=interlock, voltage_monitor=amplifier),
        heartbeats=[interlock],
    )
    rig.connect()
    for tick in range(1000):
        clock.now_s = 1e-3 * tick
        rig.command(clock.now_s, on(80.0))
        assert amplifier.voltage_v == pytest.approx(80.0, rel=1e-3)
    clock.sleep(0.25)
    assert amplifier.voltage_v == 0.0
    with pytest.raises(HapticError, match=r"has opened its contact \(silent\)"):
        rig.command(clock.now_s, on(80.0))
    assert rig.state is RigState.OFF


# --- errors that are no DeviceError
# ----------------------------------------------------------------------------


class Dropped(Heard):
    """A link whose library has errors of its own, as pyvisa-py for a dropped HiSLIP link."""

    dropped = False

    def handle(self, data):
        if self.dropped:
            raise RuntimeError("hislip: connection dropped")
        return super().handle(data)


@pytest.fixture
def dropping(rig_config):
    bench = Bench(rig_config, wire=Dropped)
    bench.rig.command(0.0, on(60.0))
    assert bench.voltage_v > 50.0
    return bench


def test_off_over_a_link_with_errors_of_its_own_concludes_and_frees_the_rig(dropping):
    dropping.wire.dropped = True
    evidence = dropping.rig.off()
    assert evidence.by.generator_off is None
    assert evidence.on is False  # the enable line and the monitor say so
    assert dropping.rig.state is RigState.OFF
    dropping.wire.dropped = False
    others = []
    other = threading.Thread(target=lambda: others.append(dropping.rig.off()))
    other.start()
    other.join()
    assert others[0].by.generator_off is True  # it got the lock: no "unknown"
    dropping.rig.command(1.0, on(60.0))
    assert dropping.rig.state is RigState.ON


def test_a_command_over_a_link_with_errors_of_its_own_is_off_and_a_clear_error(dropping):
    dropping.wire.dropped = True
    with pytest.raises(HapticError, match="RuntimeError: hislip: connection dropped") as error:
        dropping.rig.command(1.0, on(80.0))
    assert error.value.code == "device_error"
    assert dropping.voltage_v == 0.0
    assert dropping.rig.state is RigState.OFF


@pytest.mark.parametrize("broken", ["disable", "monitor_voltage_v"])
def test_whatever_step_of_off_fails_the_others_are_tried(bench, monkeypatch, broken):
    def fails():
        raise OSError("driver gone")

    bench.rig.command(0.0, on(60.0))
    monkeypatch.setattr(bench.rig._amplifier, broken, fails)
    evidence = bench.rig.off()
    assert evidence.by.generator_off is True
    assert bench.generator.output().on is False
    assert bench.rig.state is RigState.OFF


def test_ctrl_c_in_the_middle_of_off_concludes_that_nothing_is_known(bench, monkeypatch):
    def interrupted():
        raise KeyboardInterrupt

    bench.rig.command(0.0, on(60.0))
    monkeypatch.setattr(bench.rig._generator, "off", interrupted)
    with pytest.raises(KeyboardInterrupt):
        bench.rig.off()
    assert bench.rig.state is RigState.UNKNOWN
    monkeypatch.undo()
    bench.rig.command(1.0, OFF)
    assert bench.rig.state is RigState.OFF


def test_a_heart_that_cannot_rest_and_a_listener_that_fails_keep_nobody_from_off(rig_config):
    class Restless(Heart):
        def rest(self):
            raise BrokenPipeError

    def deaf(event):
        raise ValueError(event)

    bench = Bench(rig_config, heartbeats=[Restless()], on_event=deaf)
    bench.rig.command(0.0, on(60.0))
    assert bench.rig.off().on is False
    assert bench.rig.state is RigState.OFF
    bench.rig.command(1.0, on(60.0))
    assert bench.rig.state is RigState.ON


def test_closing_over_a_link_with_errors_of_its_own_does_not_raise(dropping):
    dropping.wire.dropped = True
    assert dropping.rig.close().on is False


# --- faults that no test noticed once
# --------------------------------------------------------------------------------


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_more_current_than_the_amplifier_may_give_is_a_trip(bench, monkeypatch, sign):
    bench.rig.command(0.0, on(80.0))
    limit_a = bench.config.amplifier.current_limit_a
    reading_v = sign * limit_a * bench.config.amplifier.current_monitor_v_per_a
    monkeypatch.setattr(bench.amplifier.current_monitor, "read_v", lambda: 0.99 * reading_v)
    bench.rig.hold(0.3)
    assert bench.rig.state is RigState.ON
    monkeypatch.setattr(bench.amplifier.current_monitor, "read_v", lambda: 1.01 * reading_v)
    with pytest.raises(HapticError, match="the current monitor reads"):
        bench.rig.hold(0.4)
    assert bench.rig.state is RigState.TRIPPED
    assert bench.voltage_v == 0.0


@pytest.mark.parametrize(("share", "pause", "trips"), [(0.98, 0, 0), (1.02, 0, 1), (1.02, 7, 0)])
@pytest.mark.parametrize("noise_a", [0.0, 2e-3])
def test_current_beyond_panel_and_allowed_contact_is_a_trip_once_it_lasts(
    bench, monkeypatch, noise_a, share, pause, trips
):
    """50 V at 250 Hz charge 1 nF with 79 uA, 0.5 mA rms may go through people, a tenth is the
    tolerance. The monitor of a large amplifier reads more than that of nothing.
    """
    most_a = 1.1 * (2.0 * math.pi * 250.0 * 50.0 * 1e-9 + math.sqrt(2.0) * 0.5e-3)
    v_per_a = bench.config.amplifier.current_monitor_v_per_a
    monkeypatch.setattr(bench.amplifier.current_monitor, "read_v", lambda: noise_a * v_per_a)
    reading_v = (share * most_a + noise_a) * v_per_a
    bench.rig.command(0.0, on(50.0))
    bench.rig.hold(0.1)
    bench.rig.hold(0.3)
    for look in range(15):
        reads_v = 0.0 if pause and look == pause else reading_v
        monkeypatch.setattr(bench.amplifier.current_monitor, "read_v", lambda v=reads_v: v)
        bench.rig.hold(0.31 + 0.01 * look)
    with (
        pytest.raises(HapticError, match=r"more touches than limits\.touching_area_m2")
        if trips
        else nullcontext()
    ):
        bench.rig.hold(0.461)
    assert bench.rig.state is (RigState.TRIPPED if trips else RigState.ON)
    assert bench.voltage_v == pytest.approx(0.0 if trips else 50.0, rel=1e-3)


def test_current_that_is_still_shown_when_the_output_comes_on_again_is_no_noise(bench, monkeypatch):
    v_per_a = bench.config.amplifier.current_monitor_v_per_a
    reads_a = [0.0]
    monkeypatch.setattr(bench.amplifier.current_monitor, "read_v", lambda: reads_a[0] * v_per_a)
    bench.rig.command(0.0, on(50.0))
    bench.rig.command(0.1, OFF)
    reads_a[0] = 2e-3
    bench.rig.command(1.0, on(50.0))
    for look in range(30):
        bench.rig.hold(1.01 + 0.01 * look)
    with pytest.raises(HapticError, match="more touches than"):
        bench.rig.hold(1.33)


def test_the_amplifiers_fast_line_goes_first_and_once_more_last(bench, monkeypatch):
    bench.rig.command(0.0, on(80.0))
    order = []
    generator, write, off = bench.rig._generator, bench.amplifier.write, bench.rig._generator.off
    monkeypatch.setattr(
        bench.amplifier, "write", lambda value: (order.append(("enable", value)), write(value))
    )
    monkeypatch.setattr(generator, "off", lambda: (order.append(("generator", False)), off())[1])
    bench.rig.off()
    assert order == [("enable", False), ("generator", False), ("enable", False)]


def test_an_enable_line_that_reads_low_after_enabling_is_an_error_and_off(bench, monkeypatch):
    write = bench.amplifier.write
    monkeypatch.setattr(bench.amplifier, "write", lambda value: write(False))
    with pytest.raises(HapticError, match="its enable line reads low after being raised"):
        bench.rig.command(0.0, on(80.0))
    assert bench.rig.state is RigState.OFF
    assert bench.voltage_v == 0.0


def test_a_permit_ends_with_every_withdrawal_and_a_new_one_holds_however_many_there_were():
    withdrawals = Withdrawals()
    for _ in range(1000):
        permit = withdrawals.permit()
        withdrawals.begin()
        withdrawals.begin()
        withdrawals.end()
        assert withdrawals.under_way
        for one in (permit, withdrawals.permit()):
            with pytest.raises(Withdrawn):
                one.check()
        withdrawals.end()
        assert not withdrawals.under_way
        withdrawals.permit().check()


class Withdrawing:
    """Wraps a step on the way to voltage: right after it, the first time, another thread begins to
    switch off.

    `steps` lists the steps that followed.
    """

    def __init__(self, bench, monkeypatch, after):
        self.bench, self.steps, self.after, self.thread = (
            bench,
            [],
            after,
            threading.Thread(target=bench.rig.off),
        )
        switch = bench.rig._switch
        self.withdrawals, self.before = switch._withdrawals, switch._withdrawals.begun
        for owner, name in (
            (switch, "check"),
            (switch._generator, "set_point"),
            (switch._generator, "set_output"),
            (switch._amplifier, "enable"),
        ):
            monkeypatch.setattr(owner, name, self.wrapped(name, getattr(owner, name)))

    def wrapped(self, name, step):
        def taken(*given, **options):
            if self.thread.ident:
                self.steps.append(name)
            done = step(*given, **options)
            if name == self.after and not self.thread.ident:
                self.thread.start()
                while self.bench.amplifier.read() or self.withdrawals.begun == self.before:
                    time.sleep(0.001)
                return self.bench.rig._switch._amplifier.state if name == "enable" else done
            return done

        return taken


@pytest.mark.parametrize("after", ["set_point", "set_output", "enable"])
def test_who_switches_on_stops_at_the_next_step_after_somebody_switches_off(
    bench, monkeypatch, after
):
    withdrawing = Withdrawing(bench, monkeypatch, after)
    bench.rig.command(0.0, on(80.0))  # says nothing: it is no fault that somebody switches off
    withdrawing.thread.join()
    assert withdrawing.steps == []
    assert bench.rig.state is RigState.OFF
    assert bench.voltage_v == 0.0
    assert not [event for event in bench.rig.events if event.state is RigState.TRIPPED]


def test_a_set_point_after_somebody_has_switched_off_is_not_sent(bench, monkeypatch):
    bench.rig.command(0.0, on(80.0))
    withdrawing = Withdrawing(bench, monkeypatch, "check")
    bench.rig.command(1e-3 + bench.config.output.setpoint_interval_s, on(81.0))
    withdrawing.thread.join()
    assert withdrawing.steps == []
    assert bench.rig.state is RigState.OFF
    assert bench.voltage_v == 0.0


def test_off_waits_for_whoever_is_switching_on_as_long_as_four_answers_may_take(bench, rig_config):
    """No longer: a thread that hangs while it switches on keeps nobody from knowing that the output
    is unknown.
    """
    waited_s = []

    def taken(blocking=True, timeout=0.0):
        waited_s.append(timeout if blocking else 0.0)
        return False

    bench.rig._switch._lock = SimpleNamespace(acquire=taken)
    assert bench.rig.off().on is None
    assert waited_s == [0.0, 4.0 * rig_config.waveform_generator.reply_timeout_s]


@pytest.mark.parametrize(("quiet_after_s", "seen_v"), [(0.1, 0.0), (math.inf, 100.0)])
def test_an_electrode_has_the_settling_time_to_discharge_and_no_more(quiet_after_s, seen_v):
    clock, generator, amplifier = ManualClock(), MagicMock(), MagicMock()
    amplifier.monitor_voltage_v = lambda: 100.0 if clock() < quiet_after_s - 1e-6 else 0.0
    found = switch_off(generator, amplifier, 0.15, Clock(clock, clock.sleep))
    assert found.monitor_v == seen_v
    assert clock() == pytest.approx(min(quiet_after_s, 0.15))


def test_the_lock_is_free_after_a_command_and_after_a_stop(bench):
    """Whoever keeps it keeps everybody else from switching on."""
    found, lock = [], bench.rig._switch._lock

    def look():
        with suppress(RuntimeError):  # not ours to release
            found.append(lock.acquire(timeout=1.0))
            lock.release()

    for act in (lambda: bench.rig.command(0.0, on(80.0)), bench.rig.off):
        act()
        other = threading.Thread(target=look)
        other.start()
        other.join()
    assert found == [True, True]
