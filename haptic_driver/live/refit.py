"""A finger's own numbers fitted to what was felt while rendering.

Older windows count less, and friction as a whole may drift from one LEVEL_S to the next. What a
finger keeps over hours has the spread of the model's file. Friction without voltage, leak,
moisture, a film in the gap and the area of contact may change within minutes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from haptic_driver.live.comparison import by_model, columns, compared
from haptic_driver.live.window import Window
from haptic_driver.signals import Array
from model.analysis.calibration import BARELY_LEARNT, Calibration, calibrate
from model.description import ModelDescription
from model.diagnosis.data import Measurements
from model.effects.skin_hydration import SkinHydration
from model.support.errors import ModelError

MEMORY_S = 40.0  # by which a window's variance grows e-fold
# in which friction as a whole hardly drifts; in between it may by 5 %, as from session to session
LEVEL_S = 10.0
# prior standard deviations: no finger is that far from its model by drying or pressing otherwise
FARTHEST = 4.0
CHANGES = ("contact_area_m2", "gap_offset_m")  # beside what every calibration fits


class Refitted(NamedTuple):
    """A model with the finger's numbers, and these in words."""

    model: ModelDescription
    said: str


def refit(windows: Sequence[Window], description: ModelDescription, now_s: float) -> Refitted:
    """`description`, the model as its file has it, fitted to windows as they count at `now_s`.

    Takes a second or two of one core. ModelError where no finger comes of it.
    """
    found = calibrate(
        description, _data(windows, now_s), CHANGES, (SkinHydration,), same_finger=True
    )
    if np.any(np.abs(found.fit.vector) > FARTHEST):
        said = "the finger's numbers would have to be far from any finger's: ask haptic why"
        raise ModelError(said)
    if found.at_an_end:
        raise ModelError(f"{found.warnings[-1]}: ask haptic why")
    return Refitted(_at_level(found.model, windows), _numbers(found))


def _numbers(found: Calibration) -> str:
    """What the new model says of the finger."""
    wetness = found.model.effect_parameters[SkinHydration.name]["wetness"]
    told = [p for p in found.parameters if p.learnt <= BARELY_LEARNT]
    fitted = [f"{p.name} {p.value:.3g} {p.unit}".strip() for p in told]
    untold = [p.name for p in found.parameters if p not in told]
    rest = f"; the rows say next to nothing of {', '.join(untold)}" if untold else ""
    return ", ".join([*fitted, f"skin hydration {wetness.value:+.2f}"]) + rest


def weighted(
    model: ModelDescription, windows: Sequence[Window], now_s: float
) -> tuple[Array, Array]:
    """Logarithms [n] of friction felt over what a model expects, and their weights at `now_s`."""
    off, std = compared(windows, by_model(model, windows))
    return off, 1.0 / _aged(std, columns(windows)["time_s"], now_s) ** 2


def _aged(std: Array, time_s: Array, now_s: float) -> Array:
    return std * np.exp(0.5 * (now_s - time_s) / MEMORY_S)


def _at_level(model: ModelDescription, windows: Sequence[Window]) -> ModelDescription:
    """The model with friction without voltage as the newest LEVEL_S have it."""
    newest_s = max(each.time_s for each in windows)
    newest = [each for each in windows if newest_s - each.time_s < LEVEL_S]
    off, weight = weighted(model, newest, newest_s)
    drift = float(np.exp(np.average(off, weights=weight)))
    return model.with_values(cof_off=drift * model.parameters["cof_off"].value)


def _data(windows: Sequence[Window], now_s: float) -> Measurements:
    """Windows as data with errors that grow with their age; session 0 is the newest LEVEL_S."""
    at = columns(windows)
    _, std = compared(windows, at["cof"])
    at["cof_std"] = at["cof"] * _aged(std, at["time_s"], now_s)
    session = ((at["time_s"].max() - at["time_s"]) / LEVEL_S).astype(np.intp)
    names = tuple(map(str, range(session.max() + 1)))
    digest = hashlib.sha256(b"".join(values.tobytes() for values in at.values())).hexdigest()
    return Measurements(at, session, names, None, digest)
