"""Lookup surfaces, and the operating points that they give."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from haptic_driver.lookup.build import build_surface
from haptic_driver.lookup.file import SurfaceFile
from haptic_driver.lookup.models import load_model
from haptic_driver.lookup.operating_point import controller_by, operating_point
from haptic_driver.pictures.friction_pictures import draw_surface
from haptic_driver.public.picture import Picture
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.signals import OperatingPoint
from model.description import ModelDescription


@dataclass(frozen=True)
class Surface:
    """A model solved over frequency, voltage and normal force, within the limits of a rig."""

    file: SurfaceFile
    rig: RigConfig

    def solve(
        self,
        friction: float,
        normal_force_n: float = 0.5,
        policy: str | None = None,
        frequency_hz: float | None = None,
    ) -> OperatingPoint:
        """Find frequency and voltage for a friction, by the rig's policy unless one is named.

        BadInputError where it is out of reach, with what is in reach; HapticError where the safety
        gate refuses the point.
        """
        return operating_point(
            self._controller(policy, frequency_hz), self.file, friction, normal_force_n
        )

    def reachable(self, normal_force_n: float = 0.5) -> tuple[float, float]:
        """The lowest and the highest friction under a load."""
        low, high = self._controller().reachable(normal_force_n)
        return low, high

    def plot(self, normal_force_n: float = 0.5) -> Picture:
        """Friction over frequency and voltage, with what the limits forbid."""
        return Picture(lambda path: draw_surface(self.file, normal_force_n, path))

    def save(self, path: Path | str) -> Path:
        """Write the HDF5 file that `haptic surface build` writes."""
        self.file.write(Path(path))
        return Path(path)

    def to_xarray(self) -> Any:
        """An xarray Dataset. HapticError where xarray is not installed."""
        return self.file.to_xarray()

    def _controller(self, policy: str | None = None, frequency_hz: float | None = None) -> Any:
        settings = self.rig.controller.model_dump()
        return controller_by(self.file, self.rig.operating_limits(), settings, policy, frequency_hz)

    def __str__(self) -> str:
        model, (low, high) = self.file.provenance["model"]["name"], self.reachable()
        return f"surface of model '{model}': friction {low:.3f} to {high:.3f} under 0.5 N"


def surface(model: ModelDescription | str = "reference", rig: str = "simulated") -> Surface:
    """Solve a model over all operating points that a rig may use; it takes about a second."""
    config = load_rig(rig)
    description = load_model(model) if isinstance(model, str) else model
    return Surface(build_surface(description, config.operating_limits()), config)
