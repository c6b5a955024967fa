from __future__ import annotations

import math
from dataclasses import replace

import pytest

from hw.amplifier.analog import AmplifierSettings, AmplifierState, AnalogAmplifier
from hw.amplifier.simulated import SimulatedAmplifier
from hw.errors import DeviceDisconnected, LimitExceeded
from hw.generator.contract import TerminalOutput
from tests.hw.testing.tripping_amplifier import TrippingAmplifier

SETTINGS = AmplifierSettings(
    gain_v_per_v=100.0,
    voltage_limit_v=300.0,
    current_limit_a=0.01,
    slew_limit_v_per_s=10e6,
    voltage_monitor_v_per_v=0.01,
)


class DeadLine:
    def write(self, value: bool, /) -> None:
        raise DeviceDisconnected("line")

    def read(self) -> bool:
        raise DeviceDisconnected("line")

    def read_v(self) -> float:
        raise DeviceDisconnected("line")


class Monitor:
    def __init__(self, reading_v: float) -> None:
        self.reading_v = reading_v

    def read_v(self) -> float:
        return self.reading_v


def test_the_enable_line_is_set_and_read_back():
    box = SimulatedAmplifier(100.0, 300.0)
    amplifier = AnalogAmplifier(SETTINGS, box, box)
    assert amplifier.state is AmplifierState.DISABLED
    assert amplifier.enable() is AmplifierState.ENABLED
    box.drive(TerminalOutput(1e3, 1.2, 0.0, True))
    assert amplifier.monitor_voltage_v() == pytest.approx(120.0)
    assert amplifier.disable() is AmplifierState.DISABLED
    assert amplifier.monitor_voltage_v() == 0.0


def test_without_lines_nothing_is_known():
    amplifier = AnalogAmplifier(SETTINGS, None, None)
    assert amplifier.enable() is AmplifierState.UNKNOWN
    assert amplifier.disable() is AmplifierState.UNKNOWN
    assert amplifier.state is AmplifierState.UNKNOWN
    assert amplifier.monitor_voltage_v() is None


def test_a_dead_line_is_unknown_and_disabling_does_not_raise():
    amplifier = AnalogAmplifier(SETTINGS, DeadLine(), DeadLine())
    assert amplifier.state is AmplifierState.UNKNOWN
    assert amplifier.disable() is AmplifierState.UNKNOWN
    assert amplifier.monitor_voltage_v() is None
    with pytest.raises(DeviceDisconnected):
        amplifier.enable()


@pytest.mark.parametrize(
    ("reading_v", "voltage_v"), [(2.5, 250.0), (math.nan, None), (math.inf, None)]
)
def test_the_monitor_is_scaled(reading_v, voltage_v):
    assert AnalogAmplifier(SETTINGS, None, Monitor(reading_v)).monitor_voltage_v() == voltage_v


@pytest.mark.parametrize(
    ("frequency_hz", "voltage_v", "current_peak_a", "what"),
    [
        (1e3, 301.0, 0.001, "voltage"),
        (1e3, 100.0, 0.011, "current"),
        (6e3, 280.0, 0.001, "slew rate"),  # 2 pi 6 kHz 280 V = 10.56 V/us
        (1e3, math.nan, 0.001, "voltage"),
        (1e3, 100.0, math.nan, "current"),
    ],
)
def test_what_the_amplifier_cannot_follow_is_refused(frequency_hz, voltage_v, current_peak_a, what):
    amplifier = AnalogAmplifier(SETTINGS, None, None)
    with pytest.raises(LimitExceeded, match=f"peak {what}"):
        amplifier.check_drive(frequency_hz, voltage_v, current_peak_a)
    amplifier.check_drive(5e3, 300.0, 0.01)


def test_senseless_settings_are_refused():
    with pytest.raises(ValueError, match="gain_v_per_v"):
        AmplifierSettings(0.0, 300.0, 0.01, 10e6, 0.01)


class Level:
    def __init__(self, level: bool) -> None:
        self.level = level

    def read(self) -> bool:
        return self.level

    def write(self, value: bool, /) -> None:
        self.level = value


@pytest.mark.parametrize(
    ("enable", "fault", "state"),
    [
        (Level(False), Level(True), AmplifierState.DISABLED),
        (Level(False), DeadLine(), AmplifierState.DISABLED),
        (Level(True), Level(True), AmplifierState.TRIPPED),
        (Level(True), Level(False), AmplifierState.ENABLED),
        (Level(True), DeadLine(), AmplifierState.UNKNOWN),
        (Level(True), None, AmplifierState.ENABLED),
        (None, Level(True), AmplifierState.TRIPPED),
        (None, Level(False), AmplifierState.UNKNOWN),
        (DeadLine(), Level(False), AmplifierState.UNKNOWN),
        (None, None, AmplifierState.UNKNOWN),
    ],
)
def test_what_is_known_from_the_lines_there_are(enable, fault, state):
    assert AnalogAmplifier(SETTINGS, enable, None, fault=fault).state is state


def test_a_fault_line_may_be_low_when_it_means_fault():
    low_is_fault = replace(SETTINGS, fault_level=False)
    assert AnalogAmplifier(low_is_fault, None, None, fault=Level(False)).fault is True
    assert AnalogAmplifier(low_is_fault, None, None, fault=Level(True)).fault is False
    assert AnalogAmplifier(low_is_fault, None, None, fault=DeadLine()).fault is None


def test_current_is_scaled_and_the_simulated_amplifier_trips_on_it():
    box = TrippingAmplifier(
        100.0, 700.0, current_monitor_v_per_a=50.0, current_limit_a=0.01, panel_capacitance_f=1e-8
    )
    settings = replace(SETTINGS, current_monitor_v_per_a=50.0)
    amplifier = AnalogAmplifier(
        settings, box, box, current_monitor=box.current_monitor, fault=box.fault_line
    )
    amplifier.enable()
    box.drive(TerminalOutput(1e3, 1.0, 0.0, True))  # 2 pi 1 kHz 10 nF 100 V = 6.28 mA
    assert amplifier.monitor_current_a() == pytest.approx(6.283e-3, rel=1e-3)
    box.drive(TerminalOutput(1e3, 2.0, 0.0, True))
    assert amplifier.state is AmplifierState.TRIPPED
    assert box.voltage_v == 0.0
    assert amplifier.disable() is AmplifierState.DISABLED
    assert amplifier.fault is False
    assert AnalogAmplifier(SETTINGS, None, None).monitor_current_a() is None


def test_a_line_that_takes_no_order_but_reads_low_is_low():
    class Deaf(Level):
        def write(self, value: bool, /) -> None:
            raise DeviceDisconnected("line")

    assert AnalogAmplifier(SETTINGS, Deaf(False), None).disable() is AmplifierState.DISABLED
    assert AnalogAmplifier(SETTINGS, Deaf(True), None).disable() is AmplifierState.ENABLED
