"""Kinds of lines in: where another instrument says that a recording or a stroke is to begin."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from haptic_driver.config import Within
from haptic_driver.rig.check import Checks, Examination
from haptic_driver.rig.part import Part, PartSection, Wiring
from haptic_driver.rig.parts.event_lines import Code, TriggerBoxSection, ppdev_there

if TYPE_CHECKING:
    from hw.event_line.contract import LineIn

LowSeconds = Annotated[
    float, Within(1e-4, 10.0, "contacts bounce for longer, and edges come more often")
]
BetweenSeconds = Annotated[float, Within(0.0, 3600.0, "nobody waits for longer")]
LOOK = "give an edge while the daemon runs, and see that haptic status counts it"
LOOKS = 5  # at a simulated line, for its own byte


class LineInSection(PartSection):
    """What every line in has: what its edge does, and when a rise is an edge."""

    start: Literal["recording", "stroke"] = Field(
        default="recording",
        description=(
            "`recording`: an edge begins one in the daemon, and the next edge ends it; `stroke`: "
            "each sliding row of `haptic measure` waits for an edge"
        ),
    )
    low_s: LowSeconds = Field(
        default=0.01, description="a rise after a shorter low is bouncing, and no edge"
    )
    folder: str = Field(
        default=".",
        description="of recordings begun by an edge; counts from where the daemon was started",
    )

    def examine(self, at: Examination) -> Checks:
        """Look at the folder, which a recording makes if it can, then at the line."""
        folder = Path(self.folder).absolute()
        there = next(path for path in (folder, *folder.parents) if path.exists())
        writable = there.is_dir() and os.access(there, os.W_OK | os.X_OK)
        if self.start == "recording" and not writable:
            said = f"nothing can be written to {folder}"
            yield at.called("line in, recordings").failed(said, "make it, or change folder")
        yield from self._examine_line(at)

    def make(self, wiring: Wiring) -> Part[LineIn]:
        """The line, not open: whoever hears it opens it, again and again where it is lost."""
        raise NotImplementedError

    def _examine_line(self, at: Examination) -> Checks:
        yield at.unverified("not looked at", LOOK)


class TriggerBoxInConfig(TriggerBoxSection, LineInSection):
    """A byte that a trigger box sends; unverified. What it says when it begins is no edge."""

    code: Code = Field(default=0, description="the byte that is an edge; 0: each but 0")

    def _examine_line(self, at: Examination) -> Checks:
        yield self.opens(at, LOOK)

    def make(self, wiring: Wiring) -> Part[LineIn]:
        from hw.event_line.trigger_box import TriggerBoxIn

        return Part(TriggerBoxIn(self.transport(), self.code, self.settle_s))


class ModemLineInConfig(LineInSection):
    """CTS or DSR of a serial port."""

    kind: Literal["modem_line"]
    port: str = Field(description="serial port whose line it is, of which this is the only user")
    signal: Literal["cts", "dsr"] = Field(default="cts", description="which of its inputs")

    def _examine_line(self, at: Examination) -> Checks:
        said = f"{self.signal.upper()} of {self.port}: opening the port raises its outputs: it is"
        yield at.unverified(f"{said} left", LOOK)

    def make(self, wiring: Wiring) -> Part[LineIn]:
        from hw.event_line.modem_line import ModemLineIn

        return Part(ModemLineIn(self.port, self.signal))


class NiLineInConfig(LineInSection):
    """A digital input of an NI card."""

    kind: Literal["ni"]
    line: str = Field(description="such as Dev1/port0/line8")

    def _examine_line(self, at: Examination) -> Checks:
        """Read it once."""
        with closing(self.make(Wiring()).device) as line:
            line.open()
            level = "high" if line.levels()[-1] else "low"
        yield at.unverified(f"{self.line} is {level} now", LOOK)

    def make(self, wiring: Wiring) -> Part[LineIn]:
        from hw.analog.ni_daq import NiLineIn

        return Part(NiLineIn(self.line))


class ParallelPortInConfig(LineInSection):
    """A status pin of a parallel port, through Linux's ppdev; unverified."""

    kind: Literal["parallel_port"]
    device: str = Field(default="/dev/parport0", description="of ppdev")
    pin: Literal[10, 11, 12, 13, 15] = Field(
        default=10, description="which status pin, at the level that is on it"
    )

    def _examine_line(self, at: Examination) -> Checks:
        """See that it is there."""
        yield ppdev_there(at, self.device, LOOK)

    def make(self, wiring: Wiring) -> Part[LineIn]:
        from hw.event_line.parallel_port import ParallelPortIn

        return Part(ParallelPortIn(self.device, self.pin))


class SimulatedLineInConfig(LineInSection):
    """A trigger box that sends a byte, behind a pseudo-terminal."""

    kind: Literal["simulated"]
    code: Code = Field(default=0, description="the byte that is an edge; 0: each but 0")
    every_s: BetweenSeconds = Field(default=0.0, description="an edge comes so often; 0: none does")

    def _examine_line(self, at: Examination) -> Checks:
        """Send a byte, and look for it."""
        from hw.event_line.simulated import SimulatedLineIn

        line = SimulatedLineIn(self.code)
        seen: Sequence[bool] = ()
        with closing(line):
            line.open()
            line.pulse()
            for _ in range(LOOKS):
                seen = seen or line.levels()
        yield at.ok("an edge arrives") if seen else at.failed("no edge arrives", "try again")

    def make(self, wiring: Wiring) -> Part[LineIn]:
        from hw.event_line.simulated import SimulatedLineIn

        return Part(SimulatedLineIn(self.code, self.every_s))
