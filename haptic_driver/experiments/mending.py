"""A finger's model mended by what was felt while rendering: its own numbers, refitted to the rows
of the last minutes.

Older rows count less, and friction as a whole may drift from one LEVEL_S to the next. What a finger
keeps over hours is believed as far as the model's file says; friction without voltage, leak,
moisture, a film in the gap and the area of contact may change within minutes. A new model must
predict the most recent strokes, of which it has seen nothing, better than the present one; else it
is dropped.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from haptic_driver.experiments.recorded import Recorded
from haptic_driver.signals import Array
from model.analysis.calibration import Calibration, calibrate
from model.description import ModelDescription
from model.diagnosis.data import Measurements
from model.effects.skin_hydration import SkinHydration
from model.support.errors import ModelError
from model.touch_model import TouchModel

MEMORY_S = 40.0  # by which a row's variance grows e-fold
# in which friction as a whole hardly drifts; in between it may by 5 %, as from session to session
LEVEL_S = 10.0
MOST_ROWS = 400  # the newest: older ones would cost time and say little
LEAST_HELD_OUT = 5
FORM = 0.01  # of friction, 1 sigma: no finger is quite the model's, and a wobble may outlast a row
BETTER = 3.0  # nats, by which the unseen rows must be more probable
# prior standard deviations: no finger is that far from its model by drying or pressing otherwise
FARTHEST = 4.0
CHANGES = ("contact_area_m2", "gap_offset_m")  # beside what every calibration fits


class Mended(NamedTuple):
    """A model that predicts the unseen rows better; `said` in words what changed and by how much it
    is better.
    """

    model: ModelDescription
    said: str


class Dropped(NamedTuple):
    """Why there is no new model."""

    said: str


def mend(
    rows: Sequence[Recorded],
    description: ModelDescription,
    held_out_rows: Sequence[Recorded],
    present: ModelDescription | None = None,
) -> Mended | Dropped:
    """Refit `description`, the model as its file has it, to `rows`, and judge it by later ones.

    `present`: the model in use, mended before; None for `description` itself. Takes a second or two
    of one core.
    """
    if len(held_out_rows) < LEAST_HELD_OUT:
        return Dropped(f"{len(held_out_rows)} rows of strokes to judge by are too few: slide on")
    newest_s = max(row.measured.time_s for row in (*rows, *held_out_rows))
    newest = sorted(rows, key=lambda row: row.measured.time_s)[-MOST_ROWS:]
    try:
        found = calibrate(
            description, _data(newest, newest_s), CHANGES, (SkinHydration,), same_finger=True
        )
        model = _at_level(found)
    except ModelError as error:
        return Dropped(str(error))
    if np.any(np.abs(found.fit.vector) > FARTHEST):
        return Dropped(
            "the finger's numbers would have to be far from any finger's: ask haptic why"
        )
    unseen, before = _data(held_out_rows, newest_s), present or description
    (old, old_off), (new, new_off) = (_misfit(each, unseen) for each in (before, model))
    told = (
        f"{_percent(old_off)} off before, {_percent(new_off)} now, over {len(held_out_rows)} unseen"
        " rows"
    )
    if not new + BETTER < old:
        return Dropped(f"a new model is not better than the present one: {told}")
    return Mended(model, f"{told}; {_numbers(found)}")


def _at_level(found: Calibration) -> ModelDescription:
    """The fitted model with friction without voltage as the newest session has it."""
    data = found.data.subset(found.data.session == 0)
    off, weight = _off(found.model, data)
    own = found.model.parameters["cof_off"]
    drifted = replace(own, value=own.value * float(np.exp(np.average(off, weights=weight))))
    return replace(found.model, parameters=found.model.parameters | {"cof_off": drifted})


def _data(rows: Sequence[Recorded], now_s: float) -> Measurements:
    """Rows as data with errors that grow with their age; session 0 is the newest LEVEL_S, 1 the one
    before, ...
    """
    settings, measured = [row.row.setting for row in rows], [row.measured for row in rows]
    columns = {
        name: np.array([getattr(setting, name) for setting in settings])
        for name in ("frequency_hz", "voltage_v", "normal_force_n", "speed_m_s")
    } | {
        name: np.array([getattr(each, name) for each in measured])
        for name in ("cof", "cof_std", "time_s")
    }
    relative = np.hypot(columns["cof_std"] / columns["cof"], FORM) * np.exp(
        0.5 * (now_s - columns["time_s"]) / MEMORY_S
    )
    columns["cof_std"] = relative * columns["cof"]
    session = ((columns["time_s"].max() - columns["time_s"]) / LEVEL_S).astype(np.intp)
    names = tuple(map(str, range(session.max() + 1)))
    digest = hashlib.sha256(b"".join(values.tobytes() for values in columns.values())).hexdigest()
    return Measurements(columns, session, names, None, digest)


def _misfit(model: ModelDescription, data: Measurements) -> tuple[float, float]:
    """Half the chi-square of rows under a model, and how far their friction is off, relative, in
    the mean square.
    """
    off, weight = _off(model, data)
    squares = weight * np.nan_to_num(off**2, nan=np.inf)
    return 0.5 * float(np.sum(squares)), float(np.sqrt(np.sum(squares) / np.sum(weight)))


def _off(model: ModelDescription, data: Measurements) -> tuple[Array, Array]:
    """Logarithms [n] of friction felt over friction expected, and their weights: 1 over their
    variance.
    """
    off = np.log(data.columns["cof"] / TouchModel(model).predict(data.conditions()).cof)
    return off, (data.columns["cof"] / data.columns["cof_std"]) ** 2


def _numbers(found: Calibration) -> str:
    """What the new model says of the finger."""
    wetness = found.model.effect_parameters[SkinHydration.name]["wetness"]
    fitted = [f"{p.name} {p.value:.3g} {p.unit}".strip() for p in found.parameters]
    return ", ".join([*fitted, f"skin hydration {wetness.value:+.2f}"])


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %"
