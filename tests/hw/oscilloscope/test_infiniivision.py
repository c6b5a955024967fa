"""The oscilloscope's driver against its simulator: what is at the electrode is what is read."""

import re

import numpy as np
import pytest

from hw.errors import BadReply, DeviceError, DeviceTimeout, InstrumentRejected
from hw.monitor.lines import MonitorLines
from hw.monitor.simulated import ElectrodeState, SimulatedLines
from hw.oscilloscope.infiniivision import InfiniiVision, Oscilloscope
from hw.serving.memory import MemoryTransport
from tests.clock import ManualClock
from tests.hw.testing.simulated_oscilloscope import SimulatedInfiniiVision, Sync

LINES = MonitorLines(0.01, 500.0, 1e6, 5e5)
WIRED = Oscilloscope()


def bench(state, lines=LINES, noise_v=(2e-4, 2e-4), core=None, wiring=WIRED, sync=Sync):
    """A scope whose time passes while it waits."""
    simulated = core or SimulatedInfiniiVision(
        SimulatedLines(lambda: state, lines, noise_v, 3), sync=sync
    )
    clock = ManualClock(0.0)
    transport = MemoryTransport(simulated)
    scope = InfiniiVision(transport, wiring, lines, clock=clock, sleep=clock.sleep)
    scope.open()
    return scope


@pytest.mark.parametrize(
    ("frequency_hz", "capacitance_f"),
    [(100.0, 1e-9), (8e3, 30e-12), (8e3, 1e-9), (1e5, 30e-12), (1e6, 1e-9)],
)
def test_voltage_and_current_are_read_with_their_phases(frequency_hz, capacitance_f):
    voltage = 4.9 * np.exp(-0.3j)
    current = voltage * (2j * np.pi * frequency_hz * capacitance_f + 1e-9)
    found = bench(ElectrodeState(frequency_hz, voltage, current)).read(frequency_hz, 5.0)
    assert found.referenced
    assert abs(found.voltage_v - voltage) < 5e-4 * abs(voltage) + 4 * found.voltage_std_v
    assert abs(found.current_a - current) < 5e-4 * abs(current) + 4 * found.current_std_a
    assert found.voltage_std_v < 0.01 * abs(voltage)


def test_the_lease_is_kept_while_ranges_are_sought():
    beats = []
    bench(ElectrodeState(1e5, 5.0, 1e-6j)).read(1e5, 5.0, lambda: beats.append(1))
    assert len(beats) >= 2


@pytest.mark.parametrize("start_v", np.geomspace(10.0, 100.0, 7))
def test_no_two_ranges_follow_each_other_for_ever(start_v):
    """At voltages over one decade, by ranges in steps of 1, 2 and 5."""
    for voltage_v in start_v * np.linspace(1.0, 1.4, 5):
        found = bench(ElectrodeState(1e4, voltage_v, 1e-5j)).read(1e4, voltage_v)
        assert abs(found.voltage_v) == pytest.approx(voltage_v, rel=2e-3)


def test_a_signal_that_no_range_shows_whole_is_an_error():
    with pytest.raises(BadReply, match="largest range"):
        bench(ElectrodeState(1e4, 5e3, 1e-4j)).read(1e4, 5e3)


class Answering:
    """Another instrument, or one that answers otherwise."""

    def __init__(self, core, answers):
        self._core, self._answers = core, answers

    def handle(self, data):
        for pattern, answer in self._answers.items():
            if re.search(pattern, data):
                return answer
        return self._core.handle(data)


@pytest.mark.parametrize(
    ("answers", "error", "said"),
    [
        ({rb"IDN": b"RIGOL TECHNOLOGIES,DS1054Z,1,2\n"}, BadReply, "DS1054Z"),
        ({rb"SYST:ERR": b'-113,"Undefined header"\n'}, InstrumentRejected, "Undefined header"),
        ({rb"PRE\?": b"1,2,3\n"}, BadReply, "10 numbers"),
        ({rb"DATA\?": b"1.0,2.0\n"}, BadReply, "no block"),
        ({rb"DATA\?": b"#800000100ab"}, DeviceError, "did not answer|in time"),
    ],
)
def test_what_makes_no_sense_is_a_device_error(answers, error, said):
    core = SimulatedInfiniiVision(
        SimulatedLines(lambda: ElectrodeState(1e4, 5.0, 1e-4j), LINES, (0.0, 0.0), 1)
    )
    with pytest.raises(error, match=said):
        bench(None, core=Answering(core, answers)).read(1e4, 5.0)


VOLTAGE_V = 4.9 * np.exp(-0.3j)  # behind the generator, which is what Sync shows


def test_the_trigger_is_between_the_levels_of_a_sync_of_a_logic_family():
    """At 0 V, where a reset leaves it, the phase came out anywhere."""
    for sync in (Sync(), Sync(0.1, 2.4), Sync(0.0, 5.0)):
        state = ElectrodeState(8e3, VOLTAGE_V, 1e-6j)
        found = bench(state, sync=lambda sync=sync: sync).read(8e3, 5.0)
        assert np.angle(found.voltage_v) == pytest.approx(-0.3, abs=2e-3)


class Cable:
    """What it carries may change."""

    def __init__(self, carries):
        self.carries = carries

    def __call__(self):
        return self.carries()


@pytest.mark.parametrize(
    ("sync", "level_v"), [(lambda: None, 1.2), (lambda: Sync(0.0, 0.8), 1.2), (Sync, 4.5)]
)
def test_a_trigger_that_does_not_come_is_named_and_the_scope_answers_again(sync, level_v):
    cable = Cable(sync)
    core = SimulatedInfiniiVision(
        SimulatedLines(lambda: ElectrodeState(8e3, VOLTAGE_V, 1e-6j), LINES, (0.0, 0.0), 1),
        sync=cable,
    )
    scope = bench(None, core=core, wiring=Oscilloscope(trigger_level_v=level_v))
    with pytest.raises(DeviceTimeout, match=rf"no trigger came at EXT, {level_v:g} V") as caught:
        scope.read(8e3, 5.0)
    assert "Sync" in caught.value.hint
    cable.carries = lambda: Sync(0.0, 5.0)
    assert abs(scope.read(8e3, 5.0).voltage_v) == pytest.approx(4.9, rel=1e-3)


class Silent:
    """Answers nothing while it acquires, as one does that waits inside a command."""

    def __init__(self, core):
        self._core, self.heard = core, []

    def handle(self, data):
        self.heard.append(data)
        return b"" if b"TER?" in data else self._core.handle(data)


def test_a_scope_that_falls_silent_is_cleared_and_the_key_of_its_time_is_named():
    core = Silent(
        SimulatedInfiniiVision(
            SimulatedLines(lambda: ElectrodeState(8e3, 5.0, 1e-6j), LINES, (0.0, 0.0), 1)
        )
    )
    with pytest.raises(DeviceTimeout, match="no trigger came") as caught:
        bench(None, core=core).read(8e3, 5.0)
    assert [line for line in core.heard if b"SYST" not in line][-2:] == [b":STOP\n", b"*CLS\n"]
    assert "reply_timeout_s" in caught.value.__cause__.hint
