"""Kinds of cameras that see the fingerpad through the screen, triggered at a row's start."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from haptic_driver.config import Within
from haptic_driver.rig.part import Part, PartKind, PartSection, Seconds, Wiring

if TYPE_CHECKING:
    from hw.camera.genicam import GenicamCamera

Scale = Annotated[float, Within(1e-7, 1e-3, "no camera sees ridges with larger or finer pixels")]


class NoCamera(PartSection):
    """Nobody sees the touch."""

    kind: Literal["none"] = "none"


class CameraSection(PartSection):
    """What every camera has: how large a pixel is at the screen, and the burst of a trigger."""

    sees: ClassVar[bool] = True

    scale_m_per_pixel: Scale
    frames: Annotated[int, Field(ge=1, le=1000)] = 5
    interval_s: Seconds = 0.1


class SimulatedCameraConfig(CameraSection):
    """Draws the simulated finger's touch."""

    kind: Literal["simulated"]
    scale_m_per_pixel: Scale = 45e-6
    width: Annotated[int, Field(ge=64, le=4096)] = 360
    height: Annotated[int, Field(ge=64, le=4096)] = 440
    blur_m: Annotated[float, Within(0.0, 1e-3, "nothing would be seen")] = 15e-6
    noise: Annotated[float, Within(0.0, 1.0, "it is a share of white")] = 0.015


class GenicamCameraConfig(CameraSection):
    """A GenICam camera through `harvesters`; unverified.

    `producer`: the .cti file of its transport layer, its path from the rig's file. An empty
    `serial` takes the only camera that is there.
    """

    files = ("producer",)

    kind: Literal["genicam"]
    producer: str
    serial: str = ""
    exposure_s: Seconds = 1e-3
    timeout_s: Seconds = 2.0


def make_genicam(section: GenicamCameraConfig, wiring: Wiring) -> Part[GenicamCamera]:
    from hw.camera.genicam import GenicamCamera, GenicamSettings

    settings = GenicamSettings(
        section.producer,
        section.serial,
        section.frames,
        1.0 / section.interval_s,
        section.exposure_s,
        section.timeout_s,
    )
    camera = GenicamCamera(settings)
    return Part(camera, [camera.open], [camera.close])


NONE = PartKind(NoCamera)
SIMULATED = PartKind(SimulatedCameraConfig)
GENICAM = PartKind(GenicamCameraConfig, make_genicam)
