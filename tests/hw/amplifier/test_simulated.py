import pytest

from hw.amplifier.simulated import SimulatedAmplifier
from hw.generator.contract import TerminalOutput
from tests.hw.testing.tripping_amplifier import TrippingAmplifier

ON = TerminalOutput(1e3, 1.5, 0.0, True)
OFF = TerminalOutput(1e3, 0.0, 0.0, False)


def test_gain_clip_and_offset():
    amplifier = SimulatedAmplifier(100.0, 300.0, enabled=True)
    assert amplifier.step(0.1, ON) == pytest.approx(150.0)
    assert amplifier.step(0.1, TerminalOutput(1e3, 1.5, -0.5, True)) == pytest.approx(200.0)
    assert amplifier.step(0.1, TerminalOutput(1e3, 5.0, 0.0, True)) == 300.0
    assert amplifier.step(0.1, OFF) == 0.0


@pytest.mark.parametrize(
    ("output", "current_a"),
    [
        (TerminalOutput(1e3, 1.5, 0.0, True), 9.4248e-3),  # 2 pi * 1 kHz * 10 nF * 150 V
        (TerminalOutput(1e3, 1.5, -1.0, True), 9.4248e-3),
        (
            TerminalOutput(1e3, 0.0, 2.0, True),
            0.0,
        ),  # a constant voltage, whatever the frequency was before
    ],
)
def test_only_what_alternates_drives_a_current(output, current_a):
    amplifier = TrippingAmplifier(
        100.0, 300.0, enabled=True, panel_capacitance_f=10e-9, current_limit_a=9.5e-3
    )
    amplifier.drive(output)
    assert amplifier.current_a == pytest.approx(current_a, rel=1e-4)
    assert not amplifier.tripped


def test_it_remembers_the_highest_voltage_and_the_time_with_voltage():
    amplifier = SimulatedAmplifier(100.0, 300.0, enabled=True)
    for output in (ON, OFF, ON, OFF):
        amplifier.step(0.25, output)
    assert amplifier.output_on_s == pytest.approx(0.5)
    assert amplifier.max_voltage_v == pytest.approx(150.0)
