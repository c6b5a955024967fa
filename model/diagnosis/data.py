"""Measured friction as the workflow reads it: one row per condition and repeat, checked before anything is fitted."""

from __future__ import annotations

import csv
import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.errors import ModelError
from model.touch_model import WAVEFORMS, Conditions

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

REQUIRED = ("frequency_hz", "voltage_v", "normal_force_n", "cof")
NUMERIC = (*REQUIRED, "cof_std", "speed_m_s", "time_s", "voltage_offset_v", "humidity_pct", "temperature_c")
RANGES = {
    "frequency_hz": (1e-3, 1e9, "Hz"),
    "voltage_v": (0.0, 1e4, "V"),
    "normal_force_n": (1e-3, 100.0, "N"),
    "cof": (1e-3, 20.0, ""),
    "cof_std": (1e-9, 20.0, ""),
    "speed_m_s": (0.0, 10.0, "m/s"),
    "time_s": (-1e9, 1e9, "s"),
    "voltage_offset_v": (-1e4, 1e4, "V"),
}
WANTED = f"Give a CSV with columns {', '.join(REQUIRED)}; optional cof_std, speed_m_s, time_s, session, trial"


@dataclass(frozen=True)
class Measurements:
    """A data set of n rows: `columns` [n] as floats, `session` [n] as numbers of `session_names`.

    Optional columns that the file does not have are absent from `columns`. `effects_on` [n]: the rows in which an
    effect under test is on; None for all of them.
    """

    columns: dict[str, Array]
    session: NDArray[np.intp]
    session_names: tuple[str, ...]
    waveform: NDArray[np.str_] | None
    content_hash: str
    effects_on: Mask | None = None

    @property
    def count(self) -> int:
        """Number of rows."""
        return int(self.session.size)

    @property
    def driven(self) -> Mask:
        """Rows with voltage."""
        bias = self.columns.get("voltage_offset_v", np.zeros(self.count))
        return np.asarray((self.columns["voltage_v"] != 0.0) | (bias != 0.0))

    def varies(self, name: str) -> bool:
        """Whether a column is there and takes more than one value (frequency: among driven rows)."""
        if name not in self.columns:
            return False
        values = self.columns[name][self.driven] if name == "frequency_hz" else self.columns[name]
        return bool(values.size and np.ptp(values) > 0.0)

    def conditions(self) -> Conditions:
        """The rows as the model takes them."""
        c = self.columns
        return Conditions(
            frequency_hz=c["frequency_hz"],
            voltage_v=c["voltage_v"],
            normal_force_n=c["normal_force_n"],
            voltage_offset_v=c.get("voltage_offset_v"),
            waveform=self.waveform,
            speed_m_s=c.get("speed_m_s"),
            time_s=c.get("time_s"),
        )

    def subset(self, rows: Mask) -> Measurements:
        """Some of the rows."""
        return Measurements(
            {name: values[rows] for name, values in self.columns.items()},
            self.session[rows],
            self.session_names,
            None if self.waveform is None else self.waveform[rows],
            self.content_hash,
            None if self.effects_on is None else self.effects_on[rows],
        )

    def replicate_groups(self) -> NDArray[np.intp]:
        """A number per row, equal for rows of the same session and settings; time and repeat do not count."""
        keys = ["voltage_v", "normal_force_n", "speed_m_s", "voltage_offset_v"]
        settings = [np.where(self.driven, self.columns["frequency_hz"], 0.0), self.session.astype(float)]
        settings += [self.columns[key] for key in keys if key in self.columns]
        if self.waveform is not None:
            settings.append(np.unique(self.waveform, return_inverse=True)[1].astype(float))
        _, group = np.unique(np.round(np.stack(settings, axis=1), 12), axis=0, return_inverse=True)
        return group.ravel()


def read_measurements(path: Path) -> Measurements:
    """Read a data file; ModelError names the line and column that is wrong."""
    try:
        raw = path.read_bytes()
        rows = list(csv.DictReader(raw.decode("utf-8-sig").splitlines()))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ModelError(f"{path}: cannot be read ({error})", WANTED) from error
    if not rows:
        raise ModelError(f"{path}: has no rows", WANTED)
    for name in REQUIRED:
        if name not in rows[0]:
            raise ModelError(f"{path}: column {name} is missing", WANTED)
    waveform = None
    if "waveform" in rows[0]:
        waveform = np.array([(row["waveform"] or "sine").strip().lower() for row in rows])
        for line, name in enumerate(waveform, start=2):
            if name not in WAVEFORMS:
                raise ModelError(f"{path}, line {line}: waveform '{name}' is unknown", f"Known: {', '.join(WAVEFORMS)}")
    voltage = _column(rows, "voltage_v", path, np.zeros(len(rows), bool))
    ignored = voltage == 0.0
    if waveform is not None:
        ignored |= waveform == "dc"
    columns = {"voltage_v": voltage}
    for name in NUMERIC:
        if name in rows[0] and name != "voltage_v":
            skip = ignored if name == "frequency_hz" else np.zeros(len(rows), bool)
            values = _column(rows, name, path, skip, optional=name not in REQUIRED)
            if values is not None:
                columns[name] = values
    sessions = [str(row.get("session") or "1") for row in rows]
    names, session = np.unique(sessions, return_inverse=True)
    digest = hashlib.sha256(raw).hexdigest()
    return Measurements(columns, session.ravel(), tuple(map(str, names)), waveform, digest)


def _column(rows: list[dict[str, Any]], name: str, path: Path, ignored: Mask, optional: bool = False) -> Any:
    """One column; None where it is optional and empty throughout."""
    texts = [(row[name] or "").strip() for row in rows]
    if optional and not any(texts):
        return None
    low, high, unit = RANGES.get(name, (-np.inf, np.inf, ""))
    values = np.zeros(len(rows))
    for i, text in enumerate(texts):
        if ignored[i]:
            continue
        try:
            values[i] = float(text)
        except ValueError:
            values[i] = np.nan
        if not np.isfinite(values[i]):
            raise ModelError(f"{path}, line {i + 2}: {name} is '{text}', not a number", WANTED)
        if not low <= values[i] <= high:
            raise ModelError(
                f"{path}, line {i + 2}: {name} = {text} is out of range",
                f"It must lie in {low:g}..{high:g} {unit}; is the unit right?",
            )
    return values
