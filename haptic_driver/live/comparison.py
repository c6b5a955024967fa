"""Friction felt in windows beside friction expected there, by a model or by its surface."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from haptic_driver.live.window import Window
from haptic_driver.signals import Array
from haptic_driver.simulation.finger_model import FrictionLaw
from model.conditions import Conditions
from model.description import ModelDescription
from model.touch_model import TouchModel

# of friction, 1 sigma: no finger is quite the model's, and a wobble may outlast a window
FORM = 0.01


def columns(windows: Sequence[Window]) -> dict[str, Array]:
    """Conditions, friction, its error and time of n > 0 windows, [n] each."""
    return dict(zip(Window._fields[:7], np.array([each[:7] for each in windows]).T, strict=True))


def by_surface(law: FrictionLaw, windows: Sequence[Window]) -> Array:
    """Friction [n] that a surface's law expects, without the gains that feedback has learnt."""
    return np.array([law(*each[:4], each.time_s) / each.normal_force_n for each in windows])


def by_model(description: ModelDescription, windows: Sequence[Window]) -> Array:
    """Friction [n] that a model expects."""
    f, v, n, s, _, _, t = columns(windows).values()
    return TouchModel(description).predict(Conditions(f, v, n, speed_m_s=s, time_s=t)).cof


def compared(windows: Sequence[Window], expected_cof: Array) -> tuple[Array, Array]:
    """Logarithms [n] of friction felt over friction expected, and their 1 sigma."""
    at = columns(windows)
    return np.log(at["cof"] / expected_cof), np.hypot(at["cof_std"] / at["cof"], FORM)
