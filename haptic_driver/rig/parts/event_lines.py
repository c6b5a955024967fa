"""Kinds of event lines: what an EEG amplifier, a motion capture or a camera takes as an edge."""

from __future__ import annotations

import os
from contextlib import closing
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from haptic_driver.config import Section, Within
from haptic_driver.rig.check import Check, Checks, Examination
from haptic_driver.rig.part import Part, PartSection, Resource, Wiring

if TYPE_CHECKING:
    from hw.event_line.contract import EventLine
    from hw.transport.contract import Transport

Code = Annotated[int, Field(ge=0, le=255)]
FirstCode = Annotated[int, Field(ge=0, le=246)]  # a number up to 9 is added
PulseSeconds = Annotated[
    float, Within(1e-4, 0.5, "a shorter pulse is missed, a longer one keeps the next waiting")
]
LOOK = "put one out (haptic mark), and see that it arrives"


class EventCodes(Section):
    """The code of each event, 1 to 255; 0: it has no edge.

    A marker whose data say `{"code": 37}` has that code. To `interval`, `interval_end` and
    `answer` the number of interval or answer is added, counted from 1.
    """

    touch: Code = Field(default=1, description="a finger has touched")
    lift: Code = Field(default=2, description="it has left")
    output_on: Code = Field(default=3, description="the output has come on")
    output_off: Code = Field(default=4, description="the output is known to be off")
    trial: Code = Field(default=10, description="a trial of an experiment begins")
    trial_end: Code = Field(default=11, description="it ends")
    interval: FirstCode = Field(default=20, description="plus its number: an interval begins")
    interval_end: FirstCode = Field(default=30, description="plus its number: it ends")
    answer: FirstCode = Field(default=40, description="plus its number: a trial was answered")
    marker: Code = Field(default=50, description="any other marker")


class EventLineSection(PartSection):
    """What every event line has: how long an edge stays.

    Pulses never overlap: one that is due during another comes `pulse_s` after its end.
    """

    pulse_s: PulseSeconds = Field(
        default=0.005, description="a code stays for so long, then 0 for as long"
    )

    def make(self, wiring: Wiring) -> Part[EventLine]:
        """The line, not open: whoever writes to it opens it, again and again where it is lost."""
        raise NotImplementedError


def ppdev_there(at: Examination, device: str, look: str) -> Check:
    """Whether a parallel port can be opened through Linux's ppdev; `look` checks the rest."""
    if os.access(device, os.R_OK | os.W_OK):
        return at.unverified(f"{device} is there", look)
    said = f"{device} cannot be opened for reading and writing"
    return at.failed(said, "load ppdev (modprobe ppdev), and join the device's group")


class TriggerBoxSection(PartSection):
    """A trigger box behind a serial port."""

    kind: Literal["trigger_box"]
    resource: Resource = Field(description="its serial port, of which this is the only user")
    baud_rate: Annotated[int, Field(ge=300, le=4_000_000)] = Field(
        default=115200, description="of the port"
    )
    settle_s: Annotated[float, Within(0.0, 30.0, "no box takes longer to begin")] = Field(
        default=2.0,
        description="after opening, and after each reopening, the box is left alone for so long",
    )

    def transport(self) -> Transport:
        """Its port, closed."""
        from hw.transport.resource import make_transport

        return make_transport(self.resource, baud_rate=self.baud_rate)

    def opens(self, at: Examination, look: str) -> Check:
        """Open the port, and send nothing; `look` checks the rest."""
        with closing(self.transport()) as transport:
            transport.open()
        return at.unverified(f"{self.resource} opens; nothing came that could be checked", look)


class TriggerBoxConfig(TriggerBoxSection, EventLineSection):
    """A trigger box behind a serial port: one byte per code, then 0; unverified.

    One with an Arduino begins anew when its port is opened, and would swallow what comes first.
    """

    def examine(self, at: Examination) -> Checks:
        yield self.opens(at, LOOK)

    def make(self, wiring: Wiring) -> Part[EventLine]:
        from hw.event_line.trigger_box import TriggerBox

        return Part(TriggerBox(self.transport(), self.settle_s))


class ModemLineConfig(EventLineSection):
    """RTS or DTR of a serial port: one wire, the same edge for every code."""

    kind: Literal["modem_line"]
    port: str = Field(description="serial port whose line it is")
    signal: Literal["rts", "dtr"] = Field(default="rts", description="which of its outputs")

    def examine(self, at: Examination) -> Checks:
        said = f"{self.signal.upper()} of {self.port}: opening the port may raise the line: it is"
        yield at.unverified(f"{said} left", LOOK)

    def make(self, wiring: Wiring) -> Part[EventLine]:
        from hw.event_line.modem_line import ModemEventLine

        return Part(ModemEventLine(self.port, self.signal))


class NiEventLineConfig(EventLineSection):
    """Digital outputs of an NI card, one or up to eight of a port."""

    kind: Literal["ni"]
    line: str = Field(description="such as Dev1/port0/line0:7, or one line: the same edge for all")

    def examine(self, at: Examination) -> Checks:
        yield at.unverified(f"{self.line}: taking an output sets it, so it is left alone", LOOK)

    def make(self, wiring: Wiring) -> Part[EventLine]:
        from hw.analog.ni_daq import NiEventLine

        return Part(NiEventLine(self.line))


class ParallelPortConfig(EventLineSection):
    """The data pins of a parallel port, through Linux's ppdev; unverified."""

    kind: Literal["parallel_port"]
    device: str = Field(default="/dev/parport0", description="of ppdev")

    def examine(self, at: Examination) -> Checks:
        """See that it is there; claiming it would set its pins."""
        yield ppdev_there(at, self.device, LOOK)

    def make(self, wiring: Wiring) -> Part[EventLine]:
        from hw.event_line.parallel_port import ParallelPort

        return Part(ParallelPort(self.device))


class SimulatedEventLineConfig(EventLineSection):
    """A trigger box that writes down its edges, behind a pseudo-terminal."""

    kind: Literal["simulated"]

    def examine(self, at: Examination) -> Checks:
        line = self.make(Wiring()).device
        with closing(line):
            line.open()
        yield at.ok("takes bytes")

    def make(self, wiring: Wiring) -> Part[EventLine]:
        from hw.event_line.simulated import SimulatedEventLine

        return Part(SimulatedEventLine())
