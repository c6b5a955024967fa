"""What is in the amplifier's enable line."""

from __future__ import annotations

from contextlib import closing
from typing import Annotated, Literal

from pydantic import Field

from haptic_driver.config import Section, Within
from haptic_driver.rig.check import Checks, Examination
from haptic_driver.rig.part import Resource


class NoInterlock(Section):
    """Nothing in the amplifier's enable line, said plainly: its state stays unknown."""

    kind: Literal["none"] = "none"

    def examine(self, at: Examination) -> Checks:
        said = (
            "there is none: the amplifier's state stays unknown, and off means that the"
            " generator says so; where the computer stops, or driver and watchdog do, the"
            " output stays on"
        )
        yield at.warning(said, "wire its enable line to an interlock box, where it has one")


class InterlockBox(Section):
    """A heartbeat interlock box; see `hw.safety.interlock`."""

    kind: Literal["box"]
    resource: Resource = Field(description="serial port or socket of the box")
    reply_timeout_s: Annotated[
        float, Within(1e-3, 0.1, "the box is asked on the way to every set point")
    ] = Field(default=0.05, description="for one answer of the box")

    def examine(self, at: Examination) -> Checks:
        """Hang up without sending anything: the driver's own closing opens the contact."""
        from hw.safety.interlock import IDENTITY, HeartbeatInterlock
        from hw.transport.resource import make_transport

        with closing(make_transport(self.resource)) as transport:
            box = HeartbeatInterlock(transport, reply_timeout_s=10.0 * self.reply_timeout_s)
            box.identify()
            closed, reason, beat = box.status()
            said = f"{IDENTITY}: {'ON' if closed else 'OFF'} {reason} {beat}"
            if closed:
                yield at.warning(said, "its contact is closed: somebody uses the rig")
            else:
                yield at.ok(said)
            yield at.called("interlock contact").unverified("its wiring shows only when it closes")


class ModemLineInterlock(Section):
    """RTS or DTR of a serial port as enable line."""

    kind: Literal["modem_line"]
    port: str = Field(description="serial port whose line it is")
    line: Literal["rts", "dtr"] = Field(
        description="which line: `rts` or `dtr` of a port, or a digital output of a card"
    )
    looped_back: bool = Field(description="true where a wire brings RTS back to CTS, DTR to DSR")

    def examine(self, at: Examination) -> Checks:
        line = f"{self.line.upper()} of {self.port}"
        said = f"{line}: opening the port may raise the line for a moment: it is left"
        yield at.unverified(said, "a heartbeat interlock box is safer")


class NiInterlock(Section):
    """A digital output of an NI card as enable line."""

    kind: Literal["ni"]
    line: str = Field(
        description="which line: `rts` or `dtr` of a port, or a digital output of a card"
    )

    def examine(self, at: Examination) -> Checks:
        said = f"{self.line}: taking an output may set it, so it is left alone"
        yield at.unverified(said)


InterlockConfig = Annotated[
    NoInterlock | InterlockBox | ModemLineInterlock | NiInterlock, Field(discriminator="kind")
]
