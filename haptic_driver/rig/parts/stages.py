"""Kinds of stages that carry the finger or the screen."""

from __future__ import annotations

from contextlib import closing
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from haptic_driver.config import Within
from haptic_driver.rig.check import Checks, Examination
from haptic_driver.rig.part import Metres, Part, PartSection, Resource, Wiring

if TYPE_CHECKING:
    from hw.stage.lts150 import Lts150, StageSettings

MOVES = {"velocity_m_s", "acceleration_m_s2", "velocity_limit_m_s", "acceleration_limit_m_s2"}

StageSpeed = Annotated[float, Within(1e-6, 0.5, "no stage of this kind is faster")]
StageAcceleration = Annotated[
    float, Within(1e-6, 5.0, "no stage of this kind gathers speed faster")
]


class StageSection(PartSection):
    """What every stage has: its travel, and how fast it moves."""

    travel_m: Annotated[list[Metres], Field(min_length=2, max_length=2)] = Field(
        description="[lowest, highest] position"
    )
    velocity_m_s: StageSpeed = Field(description="of its moves")
    acceleration_m_s2: StageAcceleration = Field(description="of its moves")
    velocity_limit_m_s: StageSpeed = Field(description="nothing faster is ever asked for")
    acceleration_limit_m_s2: StageAcceleration = Field(
        description="nothing faster is ever asked for"
    )


class Lts150StageConfig(StageSection):
    """A Thorlabs LTS150; see `hw.stage.lts150.StageSettings`."""

    told_by, served_as = "resource", "stage"

    kind: Literal["lts150"] = "lts150"
    resource: Resource = Field(description="serial port, or `simulated`")

    def settings(self) -> StageSettings:
        """The same, as the driver takes it."""
        from hw.stage.lts150 import StageSettings

        low_m, high_m = self.travel_m
        return StageSettings(low_m, high_m, **self.model_dump(include=MOVES))

    def examine(self, at: Examination) -> Checks:
        return examine_lts150(at, self.resource, self.settings())

    def make(self, wiring: Wiring) -> Part[Lts150]:
        stage = lts150(self.resource, self.settings())
        return Part(stage, [stage.connect], [stage.close])


def lts150(resource: str, settings: StageSettings) -> Lts150:
    """The driver of a stage, not open; its protocol is with RTS and CTS."""
    from hw.stage.lts150 import Lts150
    from hw.transport.resource import make_transport
    from hw.transport.serial import SerialTransport

    transport = make_transport(resource, rtscts=True)
    set_rts = transport.set_rts if isinstance(transport, SerialTransport) else None
    return Lts150(transport, settings, set_rts=set_rts)


def examine_lts150(at: Examination, resource: str, settings: StageSettings) -> Checks:
    """Ask a stage who and where it is; nothing moves.

    It hangs up without sending anything: the driver's own closing stops a move.
    """
    from hw.stage.lts150 import Lts150
    from hw.transport.resource import make_transport

    with closing(make_transport(resource)) as transport:
        transport.open()
        stage = Lts150(transport, settings)
        info, status, held = stage.identify(), stage.read_status(), stage.held()
        said = f"{info.model}, serial number {info.serial_number}, firmware {info.firmware}"
        if info.model.startswith(settings.model):
            yield at.ok(said, held)
        else:
            yield at.failed(said, f"not a {settings.model}", held)
        how = f"at {1e3 * status.position_m:.2f} mm" if status.homed else "not homed"
        how += ", moving" if status.moving else ""
        how += ", motion error" if status.motion_error else ""
        state = at.called(f"{at.name} state")
        bad = status.motion_error or status.moving
        yield state.warning(how) if bad else state.ok(how)
