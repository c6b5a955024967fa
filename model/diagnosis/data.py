"""Measured friction as the workflow reads it: one row per condition and repeat, checked before anything is fitted."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model.conditions import WAVEFORMS, Conditions
from model.support.arrays import Array, Mask
from model.support.errors import ModelError, nearest
from model.support.tables import Table, read_table

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
    table = read_table(path, REQUIRED, WANTED)
    if not table.rows:
        raise ModelError(f"{path}: has no rows", WANTED)
    waveform = _waveform(table)
    voltage = _column(table, "voltage_v")
    ignored = voltage == 0.0
    if waveform is not None:
        ignored |= waveform == "dc"
    columns = {"voltage_v": voltage, "frequency_hz": _column(table, "frequency_hz", ignored)}
    columns |= {name: _column(table, name) for name in NUMERIC if name not in columns and _says(table, name)}
    sessions = table.text("session") if "session" in table.columns else [""] * len(table.rows)
    names, session = np.unique([name or "1" for name in sessions], return_inverse=True)
    return Measurements(columns, session.ravel(), tuple(map(str, names)), waveform, table.content_hash)


def together(parts: Sequence[tuple[str, Measurements]]) -> Measurements:
    """Several data sets as one, each with its file's name; the sessions of one are never those of another.

    ModelError where one has a column that another lacks: what a row does not say cannot be made up.
    """
    if len(parts) == 1:
        return parts[0][1]
    first_name, first = parts[0]
    for name, data in parts[1:]:
        different = sorted(set(first.columns) ^ set(data.columns))
        if different:
            has, lacks = (first_name, name) if different[0] in first.columns else (name, first_name)
            said = f"{lacks}: has no column {different[0]}, which {has} has"
            raise ModelError(said, "Add the column, or leave it out of every file")
    names: list[str] = []
    sessions = []
    for number, (_, data) in enumerate(parts, start=1):
        sessions.append(data.session + len(names))
        names += [f"file {number}, {session}" for session in data.session_names]
    waveform = None
    if any(data.waveform is not None for _, data in parts):
        said_or_sine = (np.full(d.count, "sine") if d.waveform is None else d.waveform for _, d in parts)
        waveform = np.concatenate(list(said_or_sine))
    hashes = "".join(data.content_hash for _, data in parts)
    return Measurements(
        {name: np.concatenate([data.columns[name] for _, data in parts]) for name in first.columns},
        np.concatenate(sessions),
        tuple(names),
        waveform,
        hashlib.sha256(hashes.encode()).hexdigest(),
    )


def _says(table: Table, name: str) -> bool:
    """Whether a column is there; an optional one that is empty throughout is not."""
    return name in REQUIRED or (name in table.columns and any(table.text(name)))


def _waveform(table: Table) -> NDArray[np.str_] | None:
    """Names of `WAVEFORMS` [n], a sine where nothing is said; None without the column."""
    if "waveform" not in table.columns:
        return None
    names = [name.lower() or "sine" for name in table.text("waveform")]
    for i, name in enumerate(names):
        if name not in WAVEFORMS:
            raise ModelError(f"{table.where(i)}: waveform '{name}' is unknown", nearest(name, list(WAVEFORMS)))
    return np.array(names)


def _column(table: Table, name: str, ignored: Mask | None = None) -> Array:
    """One column [n] within its range; 0 in the rows `ignored`."""
    values = table.numbers(name, ignored=ignored)
    low, high, unit = RANGES.get(name, (-np.inf, np.inf, ""))
    outside = ~((values >= low) & (values <= high))
    if ignored is not None:
        outside &= ~ignored
    if outside.any():
        i = int(np.argmax(outside))
        said = f"{table.where(i)}: {name} = {table.rows[i][name]} is out of range"
        raise ModelError(said, f"It must lie in {low:g}..{high:g} {unit}; is the unit right?")
    return values
