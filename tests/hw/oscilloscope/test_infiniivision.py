"""The oscilloscope's driver against its simulator: what is at the electrode is what is read."""

from __future__ import annotations

import re

import numpy as np
import pytest

from hw.errors import BadReply, DeviceError, InstrumentRejected
from hw.monitor.lines import MonitorLines
from hw.monitor.simulated import ElectrodeState, SimulatedLines
from hw.oscilloscope.infiniivision import MODEL, InfiniiVision, Oscilloscope
from tests.hw.testing.memory import MemoryTransport
from tests.hw.testing.simulated_oscilloscope import SimulatedInfiniiVision

LINES = MonitorLines(0.01, 500.0, 1e6, 5e5)


def bench(state, lines=LINES, noise_v=(2e-4, 2e-4), core=None):
    simulated = core or SimulatedInfiniiVision(SimulatedLines(lambda: state, lines, noise_v, 3))
    scope = InfiniiVision(MemoryTransport(simulated), Oscilloscope(), lines)
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
        ({rb"DATA\?": b"#8XX000002ab\n"}, BadReply, "length of a block"),
        ({rb"DATA\?": b"#10\n"}, BadReply, "no record"),
        ({rb"DATA\?": b"#800000100ab"}, DeviceError, "did not answer|in time"),
    ],
)
def test_what_makes_no_sense_is_a_device_error(answers, error, said):
    core = SimulatedInfiniiVision(
        SimulatedLines(lambda: ElectrodeState(1e4, 5.0, 1e-4j), LINES, (0.0, 0.0), 1)
    )
    with pytest.raises(error, match=said):
        bench(None, core=Answering(core, answers)).read(1e4, 5.0)


@pytest.mark.parametrize("name", ["DSO-X 3024T", "MSO-X 4104A", "DSOX1204G", "MSOX3104G"])
def test_its_series_are_known(name):
    assert MODEL.fullmatch(name)
