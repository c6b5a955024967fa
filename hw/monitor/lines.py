"""The monitor lines of an amplifier: what they make of voltage and current, and back from a sampled
record of both.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, pi, sqrt

import numpy as np

from hw.analog.demodulation import (
    HARMONICS,
    ComplexArray,
    demodulate,
    highest_carrier_hz,
    whole_periods,
)
from hw.analog.lines import SampledInputs
from hw.analog.output import Array
from hw.errors import LimitExceeded
from hw.monitor.contract import ElectrodeReading, nothing


@dataclass(frozen=True)
class MonitorLines:
    """What the lines do: volts per volt and per ampere, and the corner of a first-order low-pass
    each.
    """

    voltage_v_per_v: float
    current_v_per_a: float
    voltage_bandwidth_hz: float = inf
    current_bandwidth_hz: float = inf

    def response(self, frequency_hz: float) -> ComplexArray:
        """Volts on the lines per volt and per ampere at the electrode [2]."""
        gain = np.array([self.voltage_v_per_v, self.current_v_per_a])
        corner_hz = np.array([self.voltage_bandwidth_hz, self.current_bandwidth_hz])
        return np.asarray(gain / (1.0 + 1j * frequency_hz / corner_hz))


@dataclass(frozen=True)
class Record:
    """Both lines, and the generator's output where it is sampled too [n, 2 or 3], V.

    `resolution_v` is the converter's step. `lags_s` is how much later than the first each channel
    is sampled.
    """

    samples_v: Array
    sample_rate_hz: float
    resolution_v: float = 0.0
    lags_s: Sequence[float] = (0.0, 0.0, 0.0)


def electrode_reading(record: Record, lines: MonitorLines, frequency_hz: float) -> ElectrodeReading:
    """Phasors at the electrode from what was sampled on its lines.

    Where too little noise spreads the converter's step, its error counts as one that every period
    repeats. It also does where a period is a whole number of samples. ValueError for a carrier that
    the record cannot tell, see `demodulate`.
    """
    found = demodulate(record.samples_v, record.sample_rate_hz, frequency_hz)
    channels = record.samples_v.shape[1]
    orders = np.arange(1, HARMONICS + 1)[:, None]
    lead = np.exp(-2j * pi * frequency_hz * orders * np.asarray(record.lags_s[:channels]))
    phasors = np.array([found.fundamental, found.second, found.third]) * lead
    response = np.array([lines.response(k * frequency_hz) for k in range(1, HARMONICS + 1)])
    electrode = phasors[:, :2] / response
    n, per_period = len(record.samples_v), record.sample_rate_hz / frequency_hz
    spread = found.std * sqrt(n / 3.0) > 0.6 * record.resolution_v
    step_v = np.where(spread, 0.0, record.resolution_v / sqrt(12.0) * sqrt(3.0 / per_period))
    noise_v = np.hypot(found.std, step_v)
    std = noise_v[:2] / np.abs(response[0])
    zero = electrode[0, 0]
    if channels > 2:
        zero = phasors[0, 2]
        std = np.hypot(std, np.abs(electrode[0]) * noise_v[2] / np.abs(zero))
    voltage_v, current_a = electrode[0] * np.conj(zero) / np.abs(zero)
    return ElectrodeReading(
        complex(voltage_v),
        float(std[0]),
        complex(current_a),
        float(std[1]),
        abs(electrode[1, 1]),
        abs(electrode[2, 1]),
        referenced=channels > 2,
    )


@dataclass(frozen=True)
class Sampling:
    """What is made of samples; a record lasts `record_s`, or one period where that is longer and in
    the buffer.
    """

    record_s: float
    resolution_v: float = 0.0


class SampledMonitor:
    """Monitor lines on inputs that sample all the time, such as a card's: voltage, current, maybe
    the generator.
    """

    drives = False

    def __init__(self, inputs: SampledInputs, lines: MonitorLines, sampling: Sampling) -> None:
        self._inputs, self._lines, self._sampling = inputs, lines, sampling

    @property
    def frequency_range_hz(self) -> tuple[float, float]:
        """One period in the buffer, and what does not alias."""
        return 1.0 / self._inputs.buffer_s, highest_carrier_hz(self._inputs.sample_rate_hz)

    def read(
        self, frequency_hz: float, voltage_v: float, alive: Callable[[], object] = nothing
    ) -> ElectrodeReading:
        low_hz, high_hz = self.frequency_range_hz
        if not low_hz <= frequency_hz <= high_hz:
            raise LimitExceeded(
                f"monitors: {frequency_hz:g} Hz is outside {low_hz:g}..{high_hz:g} Hz, what the"
                " card tells",
                "read it with a faster monitor, or let the sweep end there",
            )
        rate_hz, lags_s = self._inputs.sample_rate_hz, self._inputs.lags_s
        count = whole_periods(frequency_hz, rate_hz, self._sampling.record_s)
        record = Record(self._inputs.latest_v(count), rate_hz, self._sampling.resolution_v, lags_s)
        return electrode_reading(record, self._lines, frequency_hz)
