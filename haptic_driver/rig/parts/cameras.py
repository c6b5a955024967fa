"""Kinds of cameras that see the fingerpad through the screen, triggered at a row's start."""

from __future__ import annotations

from contextlib import closing
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from haptic_driver.config import Within
from haptic_driver.rig.check import Checks, Examination
from haptic_driver.rig.part import Part, PartSection, Seconds, Wiring

if TYPE_CHECKING:
    from hw.camera.genicam import GenicamCamera

Scale = Annotated[float, Within(1e-7, 1e-3, "no camera sees ridges with larger or finer pixels")]


SCALE = "how large a pixel is at the screen, from a film of a ruler"


class CameraSection(PartSection):
    """What every camera has: how large a pixel is at the screen, and the burst of a trigger."""

    sees: ClassVar[bool] = True

    scale_m_per_pixel: Scale = Field(description=SCALE)
    frames: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=5, description="taken after each trigger, at a row's start"
    )
    interval_s: Seconds = Field(default=0.1, description="from one to the next")
    contact: Literal["dark", "bright"] | None = Field(
        default=None, description="what it looks like; guessed, and said in each row, if left out"
    )

    def examine(self, at: Examination) -> Checks:
        """Open it, which sets it up; a burst is not taken."""
        part = self.make(Wiring())
        if part is None:
            return
        with closing(part.device):
            part.device.open()
            yield at.ok(f"{self.kind}, answers and takes its settings")
            hint = "film a ruler: haptic contact --scale-from"
            yield at.called("camera scale").unverified("nobody looked", hint)


class SimulatedCameraConfig(CameraSection):
    """Draws the simulated finger's touch."""

    kind: Literal["simulated"]
    scale_m_per_pixel: Scale = Field(default=45e-6, description=SCALE)
    width: Annotated[int, Field(ge=64, le=4096)] = Field(
        default=360, description="pixels of the simulated picture"
    )
    height: Annotated[int, Field(ge=64, le=4096)] = Field(
        default=440, description="the same, downwards"
    )
    blur_m: Annotated[float, Within(0.0, 1e-3, "nothing would be seen")] = Field(
        default=15e-6, description="standard deviation of a point's image"
    )
    noise: Annotated[float, Within(0.0, 1.0, "it is a share of white")] = Field(
        default=0.015, description="standard deviation of a pixel, as a share of white"
    )


class GenicamCameraConfig(CameraSection):
    """A GenICam camera through `harvesters`; unverified."""

    files = ("producer",)

    kind: Literal["genicam"]
    producer: str = Field(
        description="the .cti file of its transport layer; its path counts from the rig's file"
    )
    serial: str = Field(default="", description="which camera; empty: the only one")
    exposure_s: Seconds = Field(
        default=1e-3,
        description="of a frame: a sliding finger must not move by a tenth of a ridge meanwhile",
    )
    timeout_s: Seconds = Field(default=2.0, description="for one frame")

    @property
    def addresses(self) -> list[str]:
        """Which camera; the only one behind its producer, where the file does not say."""
        return [f"camera:{self.serial or self.producer}"]

    def make(self, wiring: Wiring) -> Part[GenicamCamera]:
        from hw.camera.genicam import GenicamCamera, GenicamSettings

        settings = GenicamSettings(
            self.producer,
            self.serial,
            self.frames,
            1.0 / self.interval_s,
            self.exposure_s,
            self.timeout_s,
        )
        camera = GenicamCamera(settings)
        return Part(camera, [camera.open], [camera.close])
