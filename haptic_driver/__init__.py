"""Real-time haptic rendering for electroadhesion touch screens.

    import haptic_driver as hd

    with hd.connect() as rig, rig.armed():
        rig.set_friction(0.6)

The names of `__all__` are the public Python interface; what they need is imported when they are
first used. Deeper modules may change from one version to the next.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from haptic_driver.daemon.scene import circle, ellipse, mask, polygon, rectangle
    from haptic_driver.errors import BadInputError, HapticError
    from haptic_driver.lab.findings import (
        calibrate,
        diagnose,
        fit_psychometric,
        investigate,
        read_data,
        read_recording,
    )
    from haptic_driver.lab.psychophysics.description import load_experiment
    from haptic_driver.lab.psychophysics.schedule import Schedule
    from haptic_driver.lab.trials import read_rows
    from haptic_driver.lookup.models import load_model
    from haptic_driver.public.commands import command
    from haptic_driver.public.connection import connect
    from haptic_driver.public.predictions import predict
    from haptic_driver.public.rigs import load_texture, simulated_rig
    from haptic_driver.public.surfaces import surface

__all__ = [
    "BadInputError",
    "HapticError",
    "Schedule",
    "calibrate",
    "circle",
    "command",
    "connect",
    "diagnose",
    "ellipse",
    "fit_psychometric",
    "investigate",
    "load_experiment",
    "load_model",
    "load_texture",
    "mask",
    "polygon",
    "predict",
    "read_data",
    "read_recording",
    "read_rows",
    "rectangle",
    "simulated_rig",
    "surface",
]

_HOMES = {
    "daemon.scene": ("circle", "ellipse", "mask", "polygon", "rectangle"),
    "errors": ("BadInputError", "HapticError"),
    "lab.psychophysics.description": ("load_experiment",),
    "lab.psychophysics.schedule": ("Schedule",),
    "public.commands": ("command",),
    "public.connection": ("connect",),
    "lab.findings": (
        "calibrate",
        "diagnose",
        "fit_psychometric",
        "investigate",
        "read_data",
        "read_recording",
    ),
    "public.predictions": ("predict",),
    "public.rigs": ("load_texture", "simulated_rig"),
    "public.surfaces": ("surface",),
    "lab.trials": ("read_rows",),
    "lookup.models": ("load_model",),
}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("haptic-driver")
    for home, names in _HOMES.items():
        if name in names:
            return getattr(importlib.import_module(f"haptic_driver.{home}"), name)
    raise AttributeError(f"module 'haptic_driver' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
