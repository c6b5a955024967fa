"""Monitor lines: what was put on the electrode is what is read back, within what noise and
converter leave.
"""

from math import sqrt

import numpy as np
import pytest

from hw.errors import LimitExceeded
from hw.monitor.lines import MonitorLines, Record, SampledMonitor, Sampling, electrode_reading
from hw.monitor.simulated import ElectrodeState, SimulatedInputs, SimulatedLines

RATE_HZ = 20e3
LINES = MonitorLines(0.01, 100.0, voltage_bandwidth_hz=5e3, current_bandwidth_hz=2e3)
VOLTAGE_V, CURRENT_A = 75.0 * np.exp(-0.2j), 3e-5 * np.exp(1.1j)
SECOND_A, THIRD_A = 2e-6 * np.exp(0.3j), 1e-6j
STATE = ElectrodeState(1234.0, VOLTAGE_V, CURRENT_A, SECOND_A, THIRD_A, direct_v=10.0)


def low_pass(frequency_hz, corner_hz):
    return 1.0 / (1.0 + 1j * frequency_hz / corner_hz)


def written_down(n, start=0.7, noise=0.0, lags_s=(0.0, 0.0, 0.0)):
    """Both lines and the generator, by hand: amplitude, phase, first-order low-pass."""
    rng = np.random.default_rng(1)
    columns = []
    parts = [
        ([(1, VOLTAGE_V * 0.01 * low_pass(1234.0, 5e3))], 0.1),
        (
            [
                (k, a * 100.0 * low_pass(k * 1234.0, 2e3))
                for k, a in ((1, CURRENT_A), (2, SECOND_A), (3, THIRD_A))
            ],
            0.0,
        ),
        ([(1, 1.0)], 0.0),
    ]
    for (harmonics, mean), lag_s in zip(parts, lags_s, strict=True):
        angle = 2 * np.pi * 1234.0 * (np.arange(n) / RATE_HZ + lag_s) + start
        signal = mean + sum(abs(a) * np.cos(k * angle + np.angle(a)) for k, a in harmonics)
        columns.append(signal + noise * rng.standard_normal(n))
    return np.column_stack(columns)


@pytest.mark.parametrize("lags_s", [(0.0, 0.0, 0.0), (0.0, 5e-6, 10e-6)])
def test_gain_bandwidth_skew_and_phase_are_taken_out(lags_s):
    found = electrode_reading(
        Record(written_down(4000, lags_s=lags_s), RATE_HZ, lags_s=lags_s), LINES, 1234.0
    )
    assert found.voltage_v == pytest.approx(VOLTAGE_V, rel=1e-9)
    assert found.current_a == pytest.approx(CURRENT_A, rel=1e-9)
    assert (found.second_a, found.third_a) == pytest.approx((2e-6, 1e-6), rel=1e-9)
    assert found.referenced


def test_without_the_generator_phases_count_from_the_electrodes_voltage():
    found = electrode_reading(Record(written_down(4000)[:, :2], RATE_HZ), LINES, 1234.0)
    assert not found.referenced
    assert found.voltage_v == pytest.approx(75.0)
    assert found.current_a == pytest.approx(3e-5 * np.exp(1.3j), rel=1e-9)


def test_noise_is_told_at_the_electrode():
    found = electrode_reading(Record(written_down(4000, noise=1e-3), RATE_HZ), LINES, 1234.0)
    expected = 1e-3 * sqrt(3.0 / 4000)
    voltage_v, current_a = (
        expected / abs(0.01 * low_pass(1234.0, 5e3)),
        expected / abs(100.0 * low_pass(1234.0, 2e3)),
    )
    assert found.voltage_std_v == pytest.approx(
        np.hypot(voltage_v, 75.0 * expected), rel=0.1
    )  # the generator's, too
    assert found.current_std_a == pytest.approx(np.hypot(current_a, 3e-5 * expected), rel=0.1)
    assert abs(found.current_a - CURRENT_A) < 5 * found.current_std_a


@pytest.mark.parametrize("frequency_hz", [125.0, 1000.0, 1234.5, 4000.0])
def test_the_simulated_card_is_read_back_within_its_own_error(frequency_hz):
    state = STATE._replace(frequency_hz=frequency_hz)
    step_v = 20.0 / 2**16
    z = []
    for seed in range(30):
        lines = SimulatedLines(lambda: state, LINES, (2e-4, 1e-4), seed)
        monitor = SampledMonitor(
            SimulatedInputs(lines, RATE_HZ, 10.0, step_v), LINES, Sampling(0.1, step_v)
        )
        found = monitor.read(frequency_hz, 75.0)
        z += [
            (found.voltage_v - VOLTAGE_V) / found.voltage_std_v,
            (found.current_a - CURRENT_A) / found.current_std_a,
        ]
    rms = sqrt(np.mean(np.abs(z) ** 2) / 2)
    assert (
        0.1 < rms < 1.3
    )  # the generator has no noise that spreads the step: its error is reckoned at its worst


def test_a_card_that_clips_shows_less():
    lines = SimulatedLines(lambda: STATE._replace(voltage_v=1500.0), LINES, (0.0, 0.0), 1)
    inputs = SimulatedInputs(lines, RATE_HZ, 10.0, 1e-4)
    assert np.max(inputs.latest_v(4000)) == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("frequency_hz", "told"), [(0.4, False), (0.5, True), (8e3, True), (8.1e3, False), (1e5, False)]
)
def test_what_the_card_cannot_tell_is_refused(frequency_hz, told):
    lines = SimulatedLines(lambda: STATE._replace(frequency_hz=frequency_hz), LINES, (0.0, 0.0), 1)
    monitor = SampledMonitor(SimulatedInputs(lines, RATE_HZ, 10.0, 1e-4), LINES, Sampling(0.1))
    if told:
        assert abs(monitor.read(frequency_hz, 75.0).voltage_v) == pytest.approx(75.0, rel=1e-3)
    else:
        with pytest.raises(LimitExceeded, match=r"0\.5\.\.8000 Hz"):
            monitor.read(frequency_hz, 75.0)
