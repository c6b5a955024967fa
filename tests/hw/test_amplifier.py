from __future__ import annotations

import math

import pytest

from hw.amplifier import AmplifierSettings, AmplifierState, AnalogAmplifier
from hw.errors import DeviceDisconnected, LimitExceeded
from hw.simulated.amplifier import SimulatedAmplifier
from hw.simulated.waveform_generator import TerminalOutput

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


def test_the_enable_line_is_set_and_read_back() -> None:
    box = SimulatedAmplifier(100.0, 300.0)
    amplifier = AnalogAmplifier(SETTINGS, box, box)
    assert amplifier.state is AmplifierState.DISABLED
    assert amplifier.enable() is AmplifierState.ENABLED
    box.drive(TerminalOutput(1e3, 1.2, 0.0, True))
    assert amplifier.monitor_voltage_v() == pytest.approx(120.0)
    assert amplifier.disable() is AmplifierState.DISABLED
    assert amplifier.monitor_voltage_v() == 0.0


def test_without_lines_nothing_is_known() -> None:
    amplifier = AnalogAmplifier(SETTINGS, None, None)
    assert amplifier.enable() is AmplifierState.UNKNOWN
    assert amplifier.disable() is AmplifierState.UNKNOWN
    assert amplifier.state is AmplifierState.UNKNOWN
    assert amplifier.monitor_voltage_v() is None


def test_a_dead_line_is_unknown_and_disabling_does_not_raise() -> None:
    amplifier = AnalogAmplifier(SETTINGS, DeadLine(), DeadLine())
    assert amplifier.state is AmplifierState.UNKNOWN
    assert amplifier.disable() is AmplifierState.UNKNOWN
    assert amplifier.monitor_voltage_v() is None
    with pytest.raises(DeviceDisconnected):
        amplifier.enable()


@pytest.mark.parametrize(("reading_v", "voltage_v"), [(2.5, 250.0), (math.nan, None), (math.inf, None)])
def test_the_monitor_is_scaled(reading_v: float, voltage_v: float | None) -> None:
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
def test_what_the_amplifier_cannot_follow_is_refused(
    frequency_hz: float, voltage_v: float, current_peak_a: float, what: str
) -> None:
    amplifier = AnalogAmplifier(SETTINGS, None, None)
    with pytest.raises(LimitExceeded, match=f"peak {what}"):
        amplifier.check_drive(frequency_hz, voltage_v, current_peak_a)
    amplifier.check_drive(5e3, 300.0, 0.01)


def test_senseless_settings_are_refused() -> None:
    with pytest.raises(ValueError, match="gain_v_per_v"):
        AmplifierSettings(0.0, 300.0, 0.01, 10e6, 0.01)
