"""The LCR meter's driver against its simulator; a voltage is on the electrode only while it
reads.
"""

import numpy as np
import pytest

from hw.errors import BadReply, DeviceError, LimitExceeded
from hw.impedance.e4980a import E4980A, LcrMeter
from hw.serving.memory import MemoryTransport
from tests.hw.testing.simulated_lcr_meter import SimulatedE4980A


def touch_ohm(frequency_hz):
    """300 pF beside 50 kohm in series with 1 nF."""
    w = 2 * np.pi * frequency_hz
    return complex(1 / (300e-12j * w + 1 / (50e3 + 1 / (1e-9j * w))))


class Bench:
    def __init__(self, core=None):
        self.simulated = SimulatedE4980A(touch_ohm)
        self.meter = E4980A(MemoryTransport(core or self.simulated), LcrMeter())
        self.meter.open()


@pytest.mark.parametrize("frequency_hz", [20.0, 1e3, 1e5, 2e6])
def test_voltage_and_current_are_peaks_at_the_electrode(frequency_hz):
    bench = Bench()
    assert bench.simulated.voltage_v == 0.0
    found = bench.meter.read(frequency_hz, 2.0)
    assert found.voltage_v / found.current_a == pytest.approx(touch_ohm(frequency_hz), rel=2e-3)
    assert found.voltage_v.real == pytest.approx(
        2.0**0.5 * 1.414 * abs(touch_ohm(frequency_hz) / (touch_ohm(frequency_hz) + 100.0)),
        rel=1e-4,
    )
    assert found.current_std_a == pytest.approx(1e-3 * abs(found.current_a))
    assert bench.simulated.voltage_v == 0.0  # and off again


@pytest.mark.parametrize(
    ("frequency_hz", "voltage_v"), [(10.0, 1.0), (3e6, 1.0), (1e3, 3.0), (1e3, 0.0), (1e3, np.nan)]
)
def test_what_it_may_not_do_is_never_sent(frequency_hz, voltage_v):
    bench = Bench()
    bench.simulated.highest_v = 0.0
    with pytest.raises(LimitExceeded, match="nothing was sent"):
        bench.meter.read(frequency_hz, voltage_v)
    assert bench.simulated.highest_v == 0.0


class Failing:
    """Answers a fetch with nonsense."""

    def __init__(self, core, answer):
        self._core, self._answer = core, answer

    def handle(self, data):
        return self._answer if b"FETC:IMP" in data else self._core.handle(data)


@pytest.mark.parametrize("answer", [b"nonsense\n", b"+9.9E37,+9.9E37,+1\n", b"0,0,0\n"])
def test_whatever_fails_the_voltage_goes(answer):
    core = SimulatedE4980A(touch_ohm)
    bench = Bench(Failing(core, answer))
    with pytest.raises(DeviceError):
        bench.meter.read(1e3, 2.0)
    assert core.highest_v > 1.0
    assert core.voltage_v == 0.0


class Stuck(Failing):
    """Keeps its level."""

    def handle(self, data):
        return b"+1.0E+00\n" if b"VOLT:LEV?" in data else self._core.handle(data)


def test_a_level_that_stays_is_said():
    with pytest.raises(BadReply, match="holds 1 V"):
        Bench(Stuck(SimulatedE4980A(touch_ohm), b""))
