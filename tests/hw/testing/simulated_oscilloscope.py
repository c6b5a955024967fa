"""A simulated InfiniiVision on monitor lines: SCPI in, records out, triggered by the generator.

Its time base and its ranges go in steps of 1, 2 and 5, its trigger level in steps of 1/128 of the
external input's range; it says nothing of what it makes of a value. `*RST` leaves the trigger on
channel 1 at 0 V, sweeping by itself. The states after `*RST` are the Programmer's Guides'; the
steps without vernier are assumed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import floor, log10, pi

import numpy as np

from hw.analog.output import Array
from hw.generator.keysight.scpi import Query, ScpiEngine, ScpiError, Write
from hw.monitor.simulated import SimulatedLines

POINTS = 8000
NOISE_SHARE = 2e-4  # of the range, per point
RANGE_V = (8e-3, 40.0)
EXT_RANGE_V = 8.0
RUNNING = 8  # of the operation status condition register
_RESET = {
    "WAVeform:SOURce": "CHAN1",
    "TRIGger:SWEep": "AUTO",
    "TRIGger[:EDGE]:SOURce": "CHAN1",
    "TRIGger[:EDGE]:SLOPe": "POS",
    "CHANnel1:PROBe": "1",
    "CHANnel2:PROBe": "1",
    "CHANnel1:IMPedance": "ONEM",
    "CHANnel2:IMPedance": "ONEM",
}


@dataclass(frozen=True)
class Sync:
    """What the generator's Sync output puts on EXT: two levels, and noise on both."""

    low_v: float = 0.0
    high_v: float = 3.3
    noise_v: float = 0.02


class SimulatedInfiniiVision:
    """Answers over any wire; channel 1 is the voltage monitor, channel 2 the current monitor.

    A comparator looks at EXT, on which is `sync()`; None is a cable that carries nothing. A level
    inside the noise of one of its levels triggers anywhere, one outside both never.
    """

    def __init__(
        self, lines: SimulatedLines, seed: int = 1, sync: Callable[[], Sync | None] = Sync
    ) -> None:
        self._lines, self._sync = lines, sync
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
                f"CHANnel{n}:RANGe", number(f"range{n}", RANGE_V, 8.0), self._ask(f"range{n}")
            )
            for name in ("DISPlay", "COUPling", "IMPedance", "INVert", "OFFSet", "PROBe"):
                word(f"CHANnel{n}:{name}")
        self._scpi.command(
            "TIMebase:RANGe", number("window", (1e-8, 500.0), 10.0), self._ask("window")
        )
        self._scpi.command("TRIGger[:EDGE]:LEVel", self._set_level, self._ask("level"))
        for header in (
            "TIMebase:REFerence",
            "ACQuire:TYPE",
            "EXTernal:PROBe",
            "TRIGger:MODE",
            "TRIGger[:EDGE]:SOURce",
            "TRIGger[:EDGE]:SLOPe",
            "TRIGger[:EDGE]:COUPling",
            "TRIGger:SWEep",
            "WAVeform:FORMat",
            "WAVeform:BYTeorder",
            "WAVeform:UNSigned",
            "WAVeform:POINts:MODE",
            "WAVeform:SOURce",
        ):
            word(header)
        self._scpi.command("SINGle", lambda _: self._arm())
        self._scpi.command("STOP", lambda _: self._stop())
        self._scpi.command("TER", query=lambda _: self._take_trigger())
        self._scpi.command(
            "OPERegister:CONDition", query=lambda _: f"{RUNNING if self._waiting else 0}"
        )
        self._scpi.command("WAVeform:PREamble", query=lambda _: self._preamble())
        self._scpi.command("WAVeform:DATA", query=lambda _: self._data())

    def handle(self, data: bytes) -> bytes:
        """Carry out complete SCPI messages and return their answers."""
        return self._scpi.handle(data)

    def _reset(self) -> None:
        self._numbers = {"range1": 40.0, "range2": 40.0, "window": 1e-3, "level": 0.0}
        self._words = dict(_RESET)
        self._record: Array | None = None
        self._waiting = self._triggered = False

    def _number(self, name: str, limits: tuple[float, float], divisions: float) -> Write:
        def write(arguments: list[str]) -> None:
            value = float(arguments[0])
            if not limits[0] <= value <= limits[1]:
                raise ScpiError(-222)
            self._numbers[name] = divisions * _one_two_five(value / divisions)

        return write

    def _set_level(self, arguments: list[str]) -> None:
        value_v = float(arguments[0])
        if abs(value_v) > EXT_RANGE_V:
            raise ScpiError(-222)
        step_v = EXT_RANGE_V / 128.0
        self._numbers["level"] = step_v * round(value_v / step_v)

    def _word(self, header: str) -> None:
        def write(arguments: list[str]) -> None:
            self._words[header] = arguments[0]

        self._scpi.command(header, write, lambda _: self._words.get(header, "0"))

    def _ask(self, name: str) -> Query:
        return lambda _: f"{self._numbers[name]:.6E}"

    def _stop(self) -> None:
        self._waiting = False

    def _take_trigger(self) -> str:
        """The register of triggers, which reading empties."""
        triggered, self._triggered = self._triggered, False
        return f"{triggered:d}"

    @property
    def _dt_s(self) -> float:
        return self._numbers["window"] / POINTS

    def _arm(self) -> None:
        """One sweep from the trigger on, where one comes; in AUTO anywhere, without one."""
        start_rad = self._trigger_rad()
        self._triggered = start_rad is not None
        self._waiting = start_rad is None and self._words["TRIGger:SWEep"].upper() != "AUTO"
        if self._waiting:
            return
        if start_rad is None:
            start_rad = self._random.uniform(0.0, 2.0 * pi)
        self._record = self._lines.signals_v(
            np.arange(float(POINTS)) * self._dt_s, start_phase_rad=start_rad - 0.5 * pi
        )[:, :2]

    def _trigger_rad(self) -> float | None:
        """Where in the generator's sine the comparator finds its slope; None where nowhere."""
        sync, level_v = self._sync(), self._numbers["level"]
        if sync is None or not self._words["TRIGger[:EDGE]:SOURce"].upper().startswith("EXT"):
            return None
        near_v = 4.0 * sync.noise_v
        if sync.low_v + near_v < level_v < sync.high_v - near_v:
            return 0.0 if self._words["TRIGger[:EDGE]:SLOPe"].upper().startswith("POS") else pi
        if sync.low_v - near_v <= level_v <= sync.high_v + near_v:
            return float(self._random.uniform(0.0, 2.0 * pi))
        return None

    def _channel(self) -> tuple[int, float]:
        n = int(self._words["WAVeform:SOURce"][-1])
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


def _one_two_five(value: float) -> float:
    """The nearest step of 1, 2, 5 and 10 times a power of ten."""
    decade = 10.0 ** floor(log10(value))
    return min(
        (decade * step for step in (1.0, 2.0, 5.0, 10.0)), key=lambda step: abs(step - value)
    )
