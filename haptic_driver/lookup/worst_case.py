"""What finger and electrode get at most of a voltage, by a model: whatever load, whenever."""

from __future__ import annotations

import numpy as np

from haptic_driver.signals import Array
from model.conditions import sines
from model.description import ModelDescription
from model.touch import SPEED_REFERENCE_M_S
from model.touch_model import TouchModel

CORRECTION_TIMES_S = np.concatenate([[0.0], np.geomspace(0.1, 1e5, 60)])
LOADS_N = np.geomspace(0.01, 50.0, 9)  # of any finger, wherever a surface's axis ends
# of the first step of voltage: stands for 0 V, where what is per volt has a limit
NEXT_TO_NOTHING = 1e-3

WITHIN = (0.25, 0.5, 0.75)  # of a cell of voltage, where a learned term may have a hump


def worst_case(
    description: ModelDescription, frequency_hz: Array, voltage_v: Array
) -> tuple[Array, Array, Array]:
    """Worst-case current of one touch (A rms) and of a square metre, and peak electrode voltage.

    All are [f, v], each per volt that is set.

    A cell of voltage is bounded by its ends (`WorstCase.of`). A learned term may have a hump
    inside, so with one it is asked within cells too; `make limits` tries the catalogue's effects.

    Neither depends on the finger's speed: a stuck finger has none, and what the amplifier does
    comes before it.
    """
    found = _at(description, frequency_hz, voltage_v)
    if description.learned_form is None:
        return found
    for share in WITHIN:
        within_v = voltage_v.copy()
        within_v[1:] = share * voltage_v[1:] + (1.0 - share) * voltage_v[:-1]
        for ends, inside in zip(found, _at(description, frequency_hz, within_v), strict=True):
            hump = inside[:, 1:] > np.maximum(ends[:, :-1], ends[:, 1:])
            ends[:, 1:] = np.where(hump, inside[:, 1:], ends[:, 1:])
    return found


def _at(
    description: ModelDescription, frequency_hz: Array, voltage_v: Array
) -> tuple[Array, Array, Array]:
    """The same at the given voltages [v] alone."""
    touch = TouchModel(description)
    set_v = np.concatenate([[NEXT_TO_NOTHING * voltage_v[1]], voltage_v[1:]])
    stuck_a = per_m2 = electrode_v = np.zeros((frequency_hz.size, voltage_v.size))
    f, v = frequency_hz[:, None, None], set_v[:, None]
    for time_s in CORRECTION_TIMES_S if _changes_with_time(description) else (0.0,):
        with np.errstate(over="ignore", invalid="ignore"):  # who asks looks whether it is finite
            stuck, density, electrode = touch.worst_case(
                sines(f, v, LOADS_N, SPEED_REFERENCE_M_S, float(time_s))
            )
        stuck_a = np.maximum(stuck_a, stuck.max(axis=2))
        per_m2 = np.maximum(per_m2, density.max(axis=2))
        electrode_v = np.maximum(electrode_v, electrode.max(axis=2))
    return stuck_a / set_v, per_m2 / set_v, electrode_v / set_v


def _changes_with_time(description: ModelDescription) -> bool:
    """Whether current or voltage may change with time; what acts on friction alone changes
    neither.
    """
    return any(
        "time_s" in effect.needs and effect.stage != "friction" for effect in description.effects
    )


def needs(description: ModelDescription, what: str) -> bool:
    """Whether any effect depends on the finger's speed or on time."""
    return any(what in effect.needs for effect in description.effects)
