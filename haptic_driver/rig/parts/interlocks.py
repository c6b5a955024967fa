"""What is in the amplifier's enable line."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import AliasChoices, Field

from haptic_driver.config import Within
from haptic_driver.rig.check import Checks, Examination
from haptic_driver.rig.part import (
    SIMULATED,
    NoPart,
    Part,
    PartSection,
    Resource,
    ServedSection,
    Wiring,
)
from hw.amplifier.served_lines import ServedLines

if TYPE_CHECKING:
    from hw.analog.ni_daq import NiDigitalOutput
    from hw.safety.interlock import HeartbeatInterlock, ModemLine

SERVED_REPLY_S = 0.1


class NoInterlock(NoPart):
    """Nothing in the amplifier's enable line, said plainly: its state stays unknown."""

    def examine(self, at: Examination) -> Checks:
        said = (
            "there is none: the amplifier's state stays unknown, and off means that the"
            " generator says so; where the computer stops, or driver and watchdog do, the"
            " output stays on"
        )
        yield at.warning(said, "wire its enable line to an interlock box, where it has one")


class InterlockBox(PartSection):
    """A heartbeat interlock box; see `hw.safety.interlock`."""

    served_as = "interlock"

    kind: Literal["box"]
    resource: Resource = Field(description="serial port or socket of the box")
    reply_timeout_s: Annotated[
        float, Within(1e-3, 0.1, "the box is asked on the way to every set point")
    ] = Field(default=0.05, description="for one answer of the box")

    def served_at(self, where: str) -> Self:
        """One that shares its processor with everything else is waited for."""
        return self.model_copy(update={"resource": where, "reply_timeout_s": SERVED_REPLY_S})

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

    def make(self, wiring: Wiring) -> Part[HeartbeatInterlock]:
        from hw.safety.interlock import HeartbeatInterlock
        from hw.transport.resource import make_transport

        transport = make_transport(self.resource)
        box = HeartbeatInterlock(transport, reply_timeout_s=self.reply_timeout_s)
        return Part(box, [box.connect], [box.close], heartbeats=[box])


class ModemLineInterlock(PartSection):
    """RTS or DTR of a serial port as enable line."""

    kind: Literal["modem_line"]
    port: str = Field(description="serial port whose line it is")
    signal: Literal["rts", "dtr"] = Field(
        description="which of its outputs; `line` in older files",
        validation_alias=AliasChoices("signal", "line"),
    )
    looped_back: bool = Field(description="true where a wire brings RTS back to CTS, DTR to DSR")

    def examine(self, at: Examination) -> Checks:
        line = f"{self.signal.upper()} of {self.port}"
        said = f"{line}: opening the port may raise the line for a moment: it is left"
        yield at.unverified(said, "a heartbeat interlock box is safer")

    def make(self, wiring: Wiring) -> Part[ModemLine]:
        from hw.safety.interlock import ModemLine

        line = ModemLine(self.port, self.signal, looped_back=self.looped_back)
        return Part(line, [line.connect], [line.close])


class NiInterlock(PartSection):
    """A digital output of an NI card as enable line."""

    kind: Literal["ni"]
    line: str = Field(description="digital output, such as Dev1/port0/line0")

    def examine(self, at: Examination) -> Checks:
        said = f"{self.line}: taking an output may set it, so it is left alone"
        yield at.unverified(said)

    def make(self, wiring: Wiring) -> Part[NiDigitalOutput]:
        from hw.analog.ni_daq import NiDigitalOutput

        line = NiDigitalOutput(self.line)
        return Part(line, [line.open], [line.close])


class SimulatedInterlockConfig(ServedSection):
    """The enable line of a simulated amplifier, and with it its voltage monitor."""

    served_as = "amplifier_lines"

    kind: Literal["simulated"] = "simulated"

    @property
    def monitors(self) -> dict[str, str]:
        return {"voltage monitor": SIMULATED}

    def wire(self, wiring: Wiring) -> Wiring:
        """Both lines of the amplifier are on one connection."""
        lines = served_lines(self._where)
        return replace(wiring, enable=lines, voltage_monitor=lines)

    def make(self, wiring: Wiring) -> Part[ServedLines]:
        lines = wiring.enable
        assert isinstance(lines, ServedLines)  # those of `wire`
        return Part(lines, closing=[lines.close])

    def examine(self, at: Examination) -> Checks:
        yield at.ok("the simulated amplifier's own")


def served_lines(resource: str) -> ServedLines:
    """The lines of a simulated amplifier, not open."""
    from hw.transport.tcp import TcpTransport

    return ServedLines(TcpTransport.from_resource(resource))
