"""A simulated E4980A on any impedance: SCPI in, resistance and reactance out."""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt

import numpy as np

from hw.generator.keysight.scpi import ScpiEngine, ScpiError

SOURCE_OHM = 100.0  # of its terminals
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
        ):
            self._scpi.command(header, lambda _: None)
        self._scpi.command(
            "FUNCtion:IMPedance[:TYPE]",
            lambda a: setattr(self, "_type", a[0]),
            lambda _: self._type,
        )
        self._scpi.command(
            "TRIGger:SOURce", lambda a: setattr(self, "_source", a[0]), lambda _: self._source
        )
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
        self._rms_v, self._frequency_hz, self._type, self._source = 1.0, 1e3, "CPD", "INT"
        self._measured: complex | None = None

    def _executed(self) -> None:
        self.highest_v = max(self.highest_v, self.voltage_v)

    def _set_level(self, arguments: list[str]) -> None:
        value = float(arguments[0])
        if not 0.0 <= value <= HIGHEST_V_RMS:
            raise ScpiError(-222)
        self._rms_v = value

    def _set_frequency(self, arguments: list[str]) -> None:
        value = float(arguments[0])
        if not 20.0 <= value <= 2e6:
            raise ScpiError(-222)
        self._frequency_hz = value

    def _measure(self) -> None:
        if self._source.upper() != "BUS":
            raise ScpiError(-221)
        impedance = self._impedance_ohm(self._frequency_hz)
        self._measured = impedance + NOISE * abs(impedance) * complex(
            *self._random.standard_normal(2)
        )

    def _fetch(self) -> str:
        if self._type.upper() != "RX" or self._measured is None:
            raise ScpiError(-221)
        return f"{self._measured.real:+.6E},{self._measured.imag:+.6E},+0"
