"""The last gate of a device that takes samples instead of words.

It does not use the driver's own state. It checks the samples that are about to be written, and the
rate at which they will be played.
"""

from __future__ import annotations

import numpy as np

from hw.analog.output import Array
from hw.errors import LimitExceeded
from hw.generator.settings import GeneratorSettings

ROUNDING = 1.0 + 1e-9
RATE_ROUNDING = 1e-6


class SampleGate:
    """Lets blocks pass that keep the peak at the electrode within the limit.

    `rate_hz` is what the device got. A stream begins at zero. The first block after `forget` rises
    from there, by no more than a carrier of `frequency_high_hz` does from sample to sample.
    """

    def __init__(self, settings: GeneratorSettings, rate_hz: float) -> None:
        self._limit_v = settings.voltage_limit_v / settings.volts_per_volt
        self._steepest = 2.0 * np.pi * settings.frequency_high_hz / rate_hz
        self._rate_hz = rate_hz
        self._last_v = 0.0

    def forget(self) -> None:
        """The device was taken to zero."""
        self._last_v = 0.0

    def check(self, block_v: Array, rate_hz: float) -> None:
        """Take note of a block that is written next; LimitExceeded for one that must not be."""
        if not abs(rate_hz - self._rate_hz) <= RATE_ROUNDING * self._rate_hz:
            raise self._refusal(f"{rate_hz:g} samples/s, the device plays {self._rate_hz:g}")
        if not (np.abs(block_v) <= self._limit_v * ROUNDING).all():
            peak_v = float(np.abs(block_v).max())
            raise self._refusal(f"a peak of {peak_v:.6g} V, at most {self._limit_v:g} V may pass")
        step_v = np.abs(np.diff(block_v, prepend=self._last_v)).max(initial=0.0)
        if not step_v <= self._steepest * self._limit_v * ROUNDING:
            raise self._refusal(f"a step of {step_v:.6g} V, steeper than the highest carrier")
        self._last_v = float(block_v[-1])

    @staticmethod
    def _refusal(what: str) -> LimitExceeded:
        return LimitExceeded(
            f"the last gate holds back a block with {what}; nothing was written",
            "a fault of the program that makes the samples",
        )
