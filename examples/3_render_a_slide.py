"""Render a texture under a sliding finger on the simulated rig.

The finger makes a stroke of its own over a grating. Every command goes as bytes over TCP to a
simulated generator, and friction comes back through a simulated force sensor. The daemon's own
parts render, in simulated time; `record.samples` are what its recordings hold, one entry per tick
of 1 ms.
"""

import numpy as np

from haptic_driver.config import texture_dirs
from haptic_driver.daemon.set_up import render_settings
from haptic_driver.daemon.stepped import render_slide
from haptic_driver.fidelity.said import said
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.slide import TICK_S, Slide
from haptic_driver.simulation.rig import SimulatedRig
from haptic_driver.simulation.slide import score
from haptic_driver.surface.build import build_surface
from haptic_driver.surface.models import load_model
from haptic_driver.textures.library import load_texture
from model.touch_model import TouchModel

time_s = np.arange(0.0, 1.5, TICK_S)
slide = Slide(
    "a stroke at 20 mm/s",
    time_s,
    position_m=0.020 * time_s,
    normal_force_n=np.full(time_s.size, 0.5),
)

config, model = load_rig("simulated"), load_model("reference")
texture = load_texture("grating", texture_dirs())
settings = render_settings(config, build_surface(model, config.operating_limits()))
with SimulatedRig(config, TouchModel(model), envelope=True) as rig:
    record = render_slide(slide, texture, settings, rig)

result = score(record)
print(*said(result.fidelity), sep="\n")
print(f"highest voltage {result.max_voltage_v:.0f} V; output at the end: {record.off}")
