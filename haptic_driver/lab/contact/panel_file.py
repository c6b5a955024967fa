"""Capacitive frames as people have them, the areas that a camera saw beside them, calibrations."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_driver.config import parse
from haptic_driver.errors import BadInputError
from haptic_driver.files import write_text
from haptic_driver.lab.contact.judge import NO_FINGER
from haptic_driver.lab.contact.panel_frame import (
    Pairs,
    PanelCalibration,
    calibrated,
    edge_counts,
    find_touches,
)
from haptic_driver.signals import Array
from model.support.reading import read_bytes, read_text, read_toml
from model.support.tables import read_table
from model.support.toml import toml_lines

GIVE = "Give a NumPy file of frames, rows and columns, or a CSV of one frame without a header"
WANTED = "Give a row per frame with contact_area_m2, empty where unknown, and finger if several"
SEVERAL = "several touches"
DAMAGE = (
    ValueError,
    OSError,
    EOFError,
    KeyError,
    SyntaxError,
    MemoryError,
    zipfile.BadZipFile,
    zlib.error,
)


def read_frames(path: Path) -> Array:
    """Frames [n, row, column] of counts: NPY or NPZ, or a CSV of one; BadInputError."""
    ending = path.suffix.lower()
    if ending not in (".npy", ".npz", ".csv"):
        raise BadInputError("bad_frames", f"{path}: is none of .npy, .npz, .csv", GIVE)
    try:
        found = _loaded(path, ending)
    except BadInputError:
        raise
    except DAMAGE as error:
        raise BadInputError("bad_frames", f"{path}: cannot be read: {error}", GIVE) from None
    found = found[None] if found.ndim == 2 else found
    if found.ndim != 3 or not found.size or found.dtype.kind not in "iuf":
        said = f"{path}: holds {found.dtype} of {found.shape}, not frames of rows and columns"
        raise BadInputError("bad_frames", said, GIVE)
    return np.asarray(found, np.float64)


def _loaded(path: Path, ending: str) -> NDArray[Any]:
    if ending == ".csv":
        return np.loadtxt(io.StringIO(read_text(path)), delimiter=",", ndmin=2)
    found: Any = np.load(io.BytesIO(read_bytes(path)), allow_pickle=False)
    if ending == ".npz":
        found = found[found.files[0] if len(found.files) == 1 else "frames"]
    return np.asarray(found)


def calibrated_by(frames: Array, areas: Path) -> tuple[PanelCalibration, dict[str, int]]:
    """The calibration by a table with a row per frame, and how many frames were of no use and why.

    A frame counts where a camera saw its area and it has one whole touch. BadInputError.
    """
    table = read_table(areas, ("contact_area_m2",), WANTED)
    if len(table.rows) != len(frames):
        said = f"{areas}: has {len(table.rows)} rows for {len(frames)} frames"
        raise BadInputError("bad_areas", said, WANTED)
    area_m2 = table.numbers("contact_area_m2", where_empty=np.nan)
    known = np.flatnonzero(np.isfinite(area_m2))
    wrong = known[~((area_m2[known] >= 1e-8) & (area_m2[known] <= 1e-2))]
    if wrong.size:
        said = f"{table.where(int(wrong[0]))}: no finger touches with {area_m2[wrong[0]]:g} m2"
        raise BadInputError("bad_areas", said, WANTED)
    if not known.size:
        raise BadInputError("bad_areas", f"{areas}: has no area", WANTED)
    fingers = table.text("finger") if "finger" in table.columns else [""] * len(frames)
    edge = edge_counts(frames[known])
    used, touches, left = list[int](), [], Counter[str]()
    for i in known.tolist():
        found = find_touches(frames[i], edge)
        why = found[0].bad if len(found) == 1 else SEVERAL if found else NO_FINGER
        if why:
            left[why] += 1
        else:
            used.append(i)
            touches.append(found[0])
    pairs = Pairs(touches, area_m2[used], [fingers[i] for i in used])
    return calibrated(frames.shape[1:], edge, pairs), dict(left)


def write_calibration(calibration: PanelCalibration, path: Path) -> None:
    """As TOML, over what was there."""
    said = calibration.model_dump()
    write_text(path, "# Written by haptic calibrate-panel.\n" + toml_lines(said))


def read_calibration(path: Path) -> PanelCalibration:
    """BadInputError says what is wrong with the file."""
    return parse(PanelCalibration, read_toml(path), str(path))
