"""One raw trial as strokes over a surface, of which a texture can be made."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.lab.importers import Asked, Made
from haptic_driver.lab.importers.strokes import Strokes, over_position
from haptic_driver.lab.raw_trials.cut import BASELINE, Trial, inside, load_of, speed_of
from haptic_driver.lab.raw_trials.folder import TrialFolder
from haptic_driver.signals import Array, Mask


def strokes_of(path: Path, map_file: Path) -> Strokes:
    """The strokes of a trial as its map says; lateral forces outside of its windows are NaN.

    BadInputError where there are several trials, and where nothing says the way or the load.
    """
    folder = TrialFolder.of([path], map_file)
    if len(folder.paths) > 1:
        said = f"{path}: {len(folder.paths)} trials, and a texture is made of one"
        raise BadInputError("bad_strokes", said, f"Give one of them, such as {folder.paths[0]}")
    trials = folder.trials(folder.paths[0], may_turn=True)
    if len(trials) > 1:
        said = f"{path}: {len(trials)} bursts of voltage, and a texture is made of one trial"
        raise BadInputError("bad_strokes", said, "Give voltage_on.start_s of one of them")
    (trial,) = trials
    speed_m_s = _speed_m_s(trial)
    lateral_n = np.where(_counts(trial), trial.columns["lateral_force"], np.nan)
    position_m, doubts = _position_m(trial, speed_m_s), tuple(d.said for d in trial.doubts)
    return Strokes(position_m, load_of(trial), lateral_n, speed_m_s, doubts)


def made(source: Path, asked: Asked) -> Made:
    """See `importers`."""
    assert asked.map_file is not None
    return over_position(strokes_of(source, asked.map_file), source, asked)


def _counts(trial: Trial) -> Mask:
    """Samples [n] that slide in a window after the baseline."""
    spans = [span for span in trial.spans if span.name != BASELINE]
    return np.asarray(
        np.any([inside(trial, span) & trial.moving & trial.usable for span in spans], axis=0)
    )


def _speed_m_s(trial: Trial) -> Array:
    """Speed [n]: measured, from the position, or as set while the finger moves."""
    if "speed" in trial.columns or "position" in trial.columns:
        return speed_of(trial.columns)
    if "speed" in trial.conditions:
        return np.where(trial.moving, float(trial.conditions["speed"]), 0.0)
    said = f"{trial.path}: nothing says where the finger is"
    raise BadInputError("bad_strokes", said, "Give columns.position, columns.speed, or a set speed")


def _position_m(trial: Trial, speed_m_s: Array) -> Array:
    """Position [n]: measured, or the speed with its sign, added up from 0."""
    if "position" in trial.columns:
        return trial.columns["position"]
    way_m = 0.5 * (speed_m_s[1:] + speed_m_s[:-1]) * np.diff(trial.columns["time"])
    return np.concatenate([[0.0], np.cumsum(way_m)])
