"""Every built-in kind of generator, with its simulator behind its driver, for tests that must hold
for all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from hw.generator.contract import GeneratorKind, GeneratorLatency, TerminalOutput, generator_kind
from hw.generator.settings import GeneratorSettings, ModulationInput
from hw.serving.memory import MemoryTransport
from tests.hw.instruments import IMMEDIATE

GAIN, LIMIT_V = 100.0, 300.0
SETTINGS = GeneratorSettings(GAIN, LIMIT_V, 10.0, 10e3)
MODULATED = replace(SETTINGS, modulation_input=ModulationInput(5.0, 1.0))


@dataclass(frozen=True)
class Words:
    """What somebody may have said to an instrument before the driver comes, or behind its back."""

    left_behind: tuple[str, ...]
    higher: str  # doubles the voltage at an open terminal, or more, while the level shown stays
    on: str
    said_on: bytes


_KEYSIGHT = Words(
    (
        *(
            "OUTP:LOAD 50",
            "OUTP:LOAD INF",
            "OUTP:LOAD 1",
            "VOLT MAX",
            "VOLT 1E9",
            "VOLT:UNIT DBM",
            "VOLT:UNIT VRMS",
        ),
        *(
            "VOLT:OFFS MAX",
            "FUNC SQU",
            "FUNC DC",
            "FREQ MAX",
            "APPL:PULS 1E3,5,1",
            "OUTP 1",
            "BURS:STAT 1",
            "NO",
        ),
        *("AM:SOUR EXT;:AM:STAT 1", "VOLT:RANG:AUTO OFF", "VOLT:LIM:HIGH 0.1", "VOLT:LIM:STAT 1"),
    ),
    "OUTP:LOAD 50;:VOLT 2.4",
    "OUTP 1",
    b"1\n",
)
WORDS = {
    "agilent_33220a": _KEYSIGHT,
    "keysight_33500": _KEYSIGHT,
    "siglent_sdg": Words(
        (
            *(
                "C1:OUTP LOAD,50",
                "C1:OUTP LOAD,HZ",
                "C1:BSWV AMP,20",
                "C1:BSWV AMP,1E9",
                "C1:BSWV OFST,9",
                "NO",
            ),
            *(
                "C1:BSWV WVTP,DC",
                "C1:BSWV WVTP,SQUARE",
                "C1:BSWV FRQ,3E7",
                "C1:OUTP ON",
                "C1:MDWV STATE,ON",
            ),
        ),
        "C1:OUTP LOAD,50\nC1:BSWV AMP,2.4",
        "C1:OUTP ON",
        b"C1:OUTP ON,LOAD,HZ,PLRT,NOR\n",
    ),
}
KINDS = list(WORDS)


class Bench:
    """Driver and simulated generator, and the highest peak times gain that ever was at the
    terminals.
    """

    def __init__(
        self,
        name: str,
        settings: GeneratorSettings = SETTINGS,
        latency: GeneratorLatency = IMMEDIATE,
        *,
        am_full_scale: float = 1.0,
    ) -> None:
        self.kind: GeneratorKind = generator_kind(name)
        self.words = WORDS[name]
        self.peak_v = 0.0
        self.seen: list[TerminalOutput] = []
        self.generator = self.kind.simulator(
            latency, listener=self._listen, am_full_scale=am_full_scale
        )
        self.driver: Any = self.kind.make(MemoryTransport(self.generator), settings)

    def _listen(self, output: TerminalOutput) -> None:
        self.seen.append(output)
        self.peak_v = max(self.peak_v, GAIN * (output.amplitude_v + abs(output.offset_v)))

    def say(self, words: str) -> bytes:
        """Say something to the instrument behind the driver's back."""
        return self.generator.handle(words.encode() + b"\n")

    def connect(self) -> None:
        """Connect; what was there before does not count."""
        self.driver.connect()
        self.peak_v = 0.0
        self.seen.clear()

    @property
    def voltage_v(self) -> float:
        """Amplitude at the electrode now."""
        return GAIN * self.generator.output().amplitude_v
