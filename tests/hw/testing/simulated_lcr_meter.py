"""A simulated E4980A on any impedance: SCPI in, resistance and reactance out.

Its level goes in steps of 0.1 to 1 mV rms, by its size, and its frequency in six digits (from
memory of its data sheet: unverified). `*RST` leaves CPD, 1 kHz and 1 V, and its own trigger.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt

import numpy as np

from hw.generator.keysight.scpi import ScpiEngine, ScpiError

SOURCE_OHM = 100.0  # of its terminals
_RESET = {
    "BIAS:STATe": "0",
    "APERture": "MED,1",
    "INITiate:CONTinuous": "0",
    "AMPLitude:ALC": "0",
    "FUNCtion:SMONitor:VAC": "0",
    "FUNCtion:IMPedance[:TYPE]": "CPD",
    "TRIGger:SOURce": "INT",
}
_STEPS_V = ((0.2, 1e-4), (0.5, 2e-4), (1.0, 5e-4))
_SWITCH = {"ON": "1", "OFF": "0"}
NOISE = 3e-4  # of |Z|, a reading
HIGHEST_V_RMS = 2.0


class SimulatedE4980A:
    """Answers over any wire. `impedance_ohm` is what it sees at a frequency; `voltage_v` the peak
    it puts on it now.
    """

    def __init__(self, impedance_ohm: Callable[[float], complex], seed: int = 1) -> None:
        self._impedance_ohm = impedance_ohm
        self._random = np.random.default_rng(seed)
        self.highest_v = 0.0
        self._scpi = ScpiEngine(
            "Agilent Technologies,E4980A,SIM00001,A.06.15",
            reset=self._reset,
            executed=self._executed,
        )
        self._reset()
        self._scpi.command("VOLTage[:LEVel]", self._set_level, lambda _: f"{self._rms_v:+.6E}")
        self._scpi.command(
            "FREQuency[:CW]", self._set_frequency, lambda _: f"{self._frequency_hz:+.9E}"
        )
        for header in (
            "BIAS:STATe",
            "APERture",
            "INITiate:CONTinuous",
            "AMPLitude:ALC",
            "FUNCtion:SMONitor:VAC",
            "FUNCtion:IMPedance[:TYPE]",
            "TRIGger:SOURce",
        ):
            self._word(header)
        self._scpi.command("TRIGger[:IMMediate]", lambda _: self._measure())
        self._scpi.command("FETCh[:IMPedance][:FORMatted]", query=lambda _: self._fetch())
        self._scpi.command(
            "FETCh:SMONitor:VAC", query=lambda _: f"{self.voltage_v / sqrt(2.0):+.6E}"
        )

    @property
    def voltage_v(self) -> float:
        """Behind the source's resistance, on what is measured."""
        impedance = self._impedance_ohm(self._frequency_hz)
        return sqrt(2.0) * self._rms_v * abs(impedance / (impedance + SOURCE_OHM))

    def handle(self, data: bytes) -> bytes:
        """Carry out complete SCPI messages and return their answers."""
        return self._scpi.handle(data)

    def _reset(self) -> None:
        self._rms_v, self._frequency_hz = 1.0, 1e3
        self._words = dict(_RESET)
        self._measured: complex | None = None

    def _word(self, header: str) -> None:
        def write(arguments: list[str]) -> None:
            words = [_SWITCH.get(argument.upper(), argument) for argument in arguments]
            self._words[header] = ",".join(words)

        self._scpi.command(header, write, lambda _: self._words[header])

    def _executed(self) -> None:
        self.highest_v = max(self.highest_v, self.voltage_v)

    def _set_level(self, arguments: list[str]) -> None:
        value = float(arguments[0])
        if not 0.0 <= value <= HIGHEST_V_RMS:
            raise ScpiError(-222)
        step_v = next((step for most, step in _STEPS_V if value <= most), 1e-3)
        self._rms_v = step_v * round(value / step_v)

    def _set_frequency(self, arguments: list[str]) -> None:
        value = float(arguments[0])
        if not 20.0 <= value <= 2e6:
            raise ScpiError(-222)
        self._frequency_hz = float(f"{value:.6g}")

    def _measure(self) -> None:
        if self._words["TRIGger:SOURce"].upper() != "BUS":
            raise ScpiError(-221)
        impedance = self._impedance_ohm(self._frequency_hz)
        self._measured = impedance + NOISE * abs(impedance) * complex(
            *self._random.standard_normal(2)
        )

    def _fetch(self) -> str:
        if self._words["FUNCtion:IMPedance[:TYPE]"].upper() != "RX" or self._measured is None:
            raise ScpiError(-221)
        return f"{self._measured.real:+.6E},{self._measured.imag:+.6E},+0"
