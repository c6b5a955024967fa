"""A simulated InfiniiVision on monitor lines: SCPI in, records out, triggered by the generator."""

from __future__ import annotations

from math import pi

import numpy as np

from hw.analog.output import Array
from hw.generator.keysight.scpi import Query, ScpiEngine, ScpiError, Write
from hw.monitor.simulated import SimulatedLines

POINTS = 8000
NOISE_SHARE = 2e-4  # of the range, per point
RANGE_V = (8e-3, 40.0)


class SimulatedInfiniiVision:
    """Answers over any wire; channel 1 is the voltage monitor, channel 2 the current monitor."""

    def __init__(self, lines: SimulatedLines, seed: int = 1) -> None:
        self._lines = lines
        self._random = np.random.default_rng(seed)
        self._scpi = ScpiEngine(
            "KEYSIGHT TECHNOLOGIES,DSO-X 3024T,SIM00001,07.50",
            reset=self._reset,
            executed=lambda: None,
        )
        self._reset()
        number, word = self._number, self._word
        for n in (1, 2):
            self._scpi.command(
                f"CHANnel{n}:RANGe", number(f"range{n}", RANGE_V), self._ask(f"range{n}")
            )
            for name in ("DISPlay", "COUPling", "OFFSet"):
                self._scpi.command(f"CHANnel{n}:{name}", word(f"{name}{n}"))
        self._scpi.command("TIMebase:RANGe", number("window", (1e-8, 500.0)), self._ask("window"))
        for header in (
            "TIMebase:REFerence",
            "ACQuire:TYPE",
            "TRIGger:MODE",
            "TRIGger[:EDGE]:SOURce",
            "TRIGger[:EDGE]:SLOPe",
            "TRIGger:SWEep",
            "WAVeform:FORMat",
            "WAVeform:BYTeorder",
            "WAVeform:UNSigned",
            "WAVeform:POINts:MODE",
            "WAVeform:SOURce",
        ):
            self._scpi.command(header, word(header))
        self._scpi.command("DIGitize", lambda _: self._digitize())
        self._scpi.command("WAVeform:PREamble", query=lambda _: self._preamble())
        self._scpi.command("WAVeform:DATA", query=lambda _: self._data())

    def handle(self, data: bytes) -> bytes:
        """Carry out complete SCPI messages and return their answers."""
        return self._scpi.handle(data)

    def _reset(self) -> None:
        self._numbers = {"range1": 40.0, "range2": 40.0, "window": 1e-3}
        self._words: dict[str, str] = {}
        self._record: Array | None = None

    def _number(self, name: str, limits: tuple[float, float]) -> Write:
        def write(arguments: list[str]) -> None:
            value = float(arguments[0])
            if not limits[0] <= value <= limits[1]:
                raise ScpiError(-222)
            self._numbers[name] = value

        return write

    def _word(self, name: str) -> Write:
        def write(arguments: list[str]) -> None:
            self._words[name] = arguments[0]

        return write

    def _ask(self, name: str) -> Query:
        return lambda _: f"{self._numbers[name]:.6E}"

    @property
    def _dt_s(self) -> float:
        return self._numbers["window"] / POINTS

    def _digitize(self) -> None:
        """One sweep from the trigger on: the generator's sine rises through zero at time 0."""
        if self._words.get("TRIGger[:EDGE]:SOURce") != "EXT":
            raise ScpiError(-221)
        self._record = self._lines.signals_v(
            np.arange(float(POINTS)) * self._dt_s, start_phase_rad=-0.5 * pi
        )[:, :2]

    def _channel(self) -> tuple[int, float]:
        n = int(self._words.get("WAVeform:SOURce", "CHAN1")[-1])
        return n - 1, self._numbers[f"range{n}"]

    def _preamble(self) -> str:
        _, range_v = self._channel()
        return f"1,0,{POINTS},1,{self._dt_s:.8E},0.0E+00,0,{range_v / 65536:.8E},0.0E+00,32768"

    def _data(self) -> str:
        """Words, the upper byte first, cut at the screen's edge; twelve bits are real."""
        if self._record is None:
            raise ScpiError(-221)
        i, range_v = self._channel()
        signal = self._record[:, i] + NOISE_SHARE * range_v * self._random.standard_normal(POINTS)
        words = np.clip(np.round(signal / range_v * 4096.0) * 16.0 + 32768.0, 16.0, 65520.0).astype(
            ">u2"
        )
        data = words.tobytes().decode("latin-1")
        return f"#8{len(data):08d}{data}"
