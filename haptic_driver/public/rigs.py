"""A simulated rig and a finger that slides over it, in simulated time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from haptic_driver.config import texture_dirs
from haptic_driver.daemon.set_up import render_settings
from haptic_driver.daemon.stepped import render_slide
from haptic_driver.errors import require_range
from haptic_driver.fidelity.measure import Fidelity
from haptic_driver.fidelity.said import said
from haptic_driver.lookup import labelled
from haptic_driver.lookup.models import load_model
from haptic_driver.pictures.friction_pictures import draw_slide
from haptic_driver.public.picture import Picture
from haptic_driver.public.surfaces import Surface, surface
from haptic_driver.render.texture import Texture, Uniform
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.evidence import KnownOutput
from haptic_driver.rig.slide import Slide
from haptic_driver.signals import TICK_S
from haptic_driver.simulation.rig import SimulatedRig as Bench
from haptic_driver.simulation.slide import Score, SlideRecord, score
from haptic_driver.textures import library
from model.description import ModelDescription
from model.touch_model import TouchModel


@dataclass(frozen=True)
class SlideResult:
    """What a slide was, tick by tick, and how well its friction was rendered."""

    record: SlideRecord
    result: Score
    title: str

    @property
    def score(self) -> Fidelity:
        """How measured friction agrees with the target; `docs/fidelity.md` has the numbers."""
        return self.result.fidelity

    @property
    def max_voltage_v(self) -> float:
        """The highest voltage at the electrode, peak."""
        return self.record.max_voltage_v

    @property
    def off(self) -> KnownOutput:
        """What shows that the output is off at the end."""
        return self.record.off

    def plot(self) -> Picture:
        """Friction asked and felt, voltage and carrier, over position."""
        return Picture(lambda path: draw_slide(self.record, self.title, path))

    def to_frame(self) -> Any:
        """A pandas DataFrame with one row per tick. HapticError where pandas is not installed."""
        samples = self.record.samples
        return labelled.frame({name: samples[name] for name in samples.dtype.names or ()}, {})

    def __str__(self) -> str:
        return "\n".join(said(self.score))


class SimulatedRig:
    """A rig on simulated instruments, and the surface by which it renders.

    `finger` is the model of the finger that slides.
    """

    def __init__(self, surface: Surface, finger: ModelDescription) -> None:
        self.surface = surface
        self.finger = finger

    def slide(
        self,
        texture: str | float,
        speed_m_s: float = 0.02,
        normal_force_n: float = 0.5,
        duration_s: float = 1.5,
    ) -> SlideResult:
        """Slide the finger along x over a texture, by name or file, or over one friction.

        Raises HapticError for what fails on the way; the output is off at the end in any case.
        """
        require_range("speed", speed_m_s, 1e-4, 1.0, unit=" m/s")
        require_range("normal force", normal_force_n, 0.0, 50.0, unit=" N")
        require_range("duration", duration_s, 0.1, 600.0, unit=" s")
        time_s = np.arange(0.0, duration_s, TICK_S)
        load_n = np.full(time_s.size, normal_force_n)
        stroke = Slide(f"{1e3 * speed_m_s:g} mm/s", time_s, speed_m_s * time_s, load_n)
        with Bench(self.surface.rig, TouchModel(self.finger), envelope=True) as bench:
            settings = render_settings(bench.config, self.surface.file)
            record = render_slide(stroke, _texture(texture), settings, bench)
        return SlideResult(record, score(record), f"{texture} at {stroke.name}")


def simulated_rig(
    rig: str = "simulated",
    model: ModelDescription | str = "reference",
    finger: ModelDescription | str | None = None,
) -> SimulatedRig:
    """A simulated rig that renders by `model` under a finger that follows `finger`.

    Without `finger` it follows what the rig's file says, else the same model. Of a real rig its
    figures are taken, and simulated instruments.
    """
    config = load_rig(rig)
    description = load_model(model) if isinstance(model, str) else model
    follows = finger or config.simulation.model or description
    return SimulatedRig(
        surface(description, rig), load_model(follows) if isinstance(follows, str) else follows
    )


def load_texture(name: str) -> Texture:
    """A texture by its name or the path of its file; `.cof_at(x_m, y_m)` is its friction."""
    return library.load_texture(name, texture_dirs())


def _texture(texture: str | float) -> Texture:
    if isinstance(texture, str):
        return load_texture(texture)
    require_range("friction", texture, 1e-3, 10.0)
    return Uniform(texture)
