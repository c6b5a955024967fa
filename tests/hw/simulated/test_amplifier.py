from __future__ import annotations

import pytest

from hw.simulated.amplifier import SimulatedAmplifier
from hw.simulated.waveform_generator import TerminalOutput

ON = TerminalOutput(1e3, 1.5, 0.0, True)
OFF = TerminalOutput(1e3, 0.0, 0.0, False)


def test_gain_clip_and_offset() -> None:
    amplifier = SimulatedAmplifier(100.0, 300.0, enabled=True)
    assert amplifier.step(0.1, ON) == pytest.approx(150.0)
    assert amplifier.step(0.1, TerminalOutput(1e3, 1.5, -0.5, True)) == pytest.approx(200.0)
    assert amplifier.step(0.1, TerminalOutput(1e3, 5.0, 0.0, True)) == 300.0
    assert amplifier.step(0.1, OFF) == 0.0


def test_no_voltage_without_enable() -> None:
    amplifier = SimulatedAmplifier(100.0, 300.0)
    assert amplifier.step(0.1, ON) == 0.0
    amplifier.write(True)
    assert amplifier.read() is True
    assert amplifier.voltage_v == pytest.approx(150.0)
    assert amplifier.read_v() == pytest.approx(1.5)


def test_it_remembers_the_highest_voltage_and_the_time_with_voltage() -> None:
    amplifier = SimulatedAmplifier(100.0, 300.0, enabled=True)
    for output in (ON, OFF, ON, OFF):
        amplifier.step(0.25, output)
    assert amplifier.output_on_s == pytest.approx(0.5)
    assert amplifier.max_voltage_v == pytest.approx(150.0)
