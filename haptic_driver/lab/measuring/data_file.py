"""Measured data on disk: one CSV row at a time, so that whatever interrupts costs at most one row.

Beside `data.csv` lies `data.csv.meta.json`: what was measured on what, as far as a reader may know.
Of the rig there is only a salted hash; what a simulation hides cannot be read from it, nor whether
it hides anything.
"""

from __future__ import annotations

import cmath
import csv
import hashlib
import io
import json
import secrets
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import isfinite, pi, sqrt
from pathlib import Path
from typing import Any, Self, TextIO

import numpy as np

from haptic_driver.errors import BadInputError, optional
from haptic_driver.fidelity.average import WINDOW_COLUMNS, Measured
from haptic_driver.files import open_to_add, whole_lines, write_text, write_through, writing
from haptic_driver.lab.measuring.contact_area import ContactArea
from haptic_driver.lab.measuring.plan import Row
from haptic_driver.lookup import labelled
from hw.monitor.contract import ElectrodeReading
from model.support.reading import read_text

SETTING_COLUMNS = (
    "frequency_hz",
    "voltage_v",
    "normal_force_n",
    "speed_m_s",
    "voltage_offset_v",
    "waveform",
    "finger",
    "intervention",
    "session",
    "trial",
)
ELECTRODE_COLUMNS = (
    "electrode_voltage_v",
    "electrode_voltage_std_v",
    "electrode_voltage_phase_rad",
    "electrode_voltage_phase_std_rad",
    "current_a",
    "current_std_a",
    "current_phase_rad",
    "current_phase_std_rad",
    "current_h2_a",
    "current_h3_a",
)
COLUMNS = (
    *WINDOW_COLUMNS,
    "voltage_offset_v",
    "waveform",
    "finger",
    "intervention",
    *ELECTRODE_COLUMNS,
    "kramers_kronig",
    "contact_area_m2",
    "contact_area_std_m2",
    "measured_normal_force_n",
    "simulated",
    "doubts",
)
FINEST = 1e-5  # of an amount, or rad: no monitor's figures are known better
UNKNOWN_PHASE_RAD = pi / sqrt(3.0)  # standard deviation of a phase of which nothing is known
HINT = "Give another --out, or --force to overwrite it"


@dataclass(frozen=True)
class Identity:
    """What must be the same for a file to be continued; `rig_content` is hashed, never written."""

    plan: str
    plan_hash: str
    seed: int
    model: str
    model_hash: str
    rig: str
    rig_content: str
    simulated: bool

    def meta(self, salt: str) -> dict[str, Any]:
        """What the sidecar says."""
        said = asdict(self)
        content = said.pop("rig_content")
        return said | {
            "salt": salt,
            "rig_hash": hashlib.sha256(f"{salt} {content}".encode()).hexdigest(),
        }


class DataFile:
    """A CSV of measured rows that is only ever appended to; `done` is how many of the rows it has.

    `last_time_s` is the `time_s` of the last of them, None without any. Use as a context manager.
    """

    def __init__(
        self, file: TextIO, simulated: bool, done: int = 0, last_time_s: float | None = None
    ) -> None:
        self._file = file
        self._simulated = simulated
        self.done = done
        self.last_time_s = last_time_s

    @classmethod
    def create(cls, path: Path, identity: Identity, *, force: bool = False) -> Self:
        """A new file, with its header and sidecar; BadInputError where one exists, unless
        `force`.
        """
        if path.is_dir():
            raise BadInputError(
                "file_exists", f"{path}: is a folder, not a file", "Name a file in it as --out"
            )
        if path.exists() and not force:
            raise BadInputError(
                "file_exists", f"{path}: exists already", "Give --resume, --force or another --out"
            )
        with writing(path):
            path.unlink(missing_ok=True)
            write_text(
                meta_path(path), json.dumps(identity.meta(secrets.token_hex(16)), indent=1) + "\n"
            )
            data = cls(open_to_add(path), identity.simulated)
            data._write(COLUMNS)
        return data

    @classmethod
    def resume(cls, path: Path, identity: Identity, rows: Sequence[Row]) -> Self:
        """Continue a file that holds the first of `rows`; a last line cut short is dropped. New
        where there is none.
        """
        if not path.exists():
            return cls.create(path, identity)
        _check_identity(path, identity)
        try:
            whole = whole_lines(path)
            reader = csv.DictReader(io.StringIO(whole))
            table = list(reader)
            _check_rows(path, reader.fieldnames, table, rows)
            file = open_to_add(path)
        except (OSError, csv.Error) as error:
            raise BadInputError(
                "file_unreadable", f"{path}: cannot be continued ({error})", HINT
            ) from error
        data = cls(
            file, identity.simulated, len(table), float(table[-1]["time_s"]) if table else None
        )
        if not whole:
            data._write(COLUMNS)
        return data

    def append(
        self,
        row: Row,
        measured: Measured,
        electrode: ElectrodeReading | None = None,
        area: ContactArea | None = None,
    ) -> None:
        """Write one row through to the disk; what was not measured is left empty."""
        texts = row_texts(row, measured, electrode, area, simulated=self._simulated)
        with writing(Path(self._file.name)):
            self._write([texts[name] for name in COLUMNS])
        self.done += 1
        self.last_time_s = measured.time_s

    def _write(self, texts: Sequence[str]) -> None:
        line = io.StringIO()
        csv.writer(line, lineterminator="\n").writerow(texts)
        write_through(self._file, line.getvalue())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Close; every row is on the disk already."""
        self._file.close()


def row_texts(
    row: Row,
    measured: Measured,
    electrode: ElectrodeReading | None = None,
    area: ContactArea | None = None,
    *,
    simulated: bool,
) -> dict[str, str]:
    """One row of measured data, as text by column; what was not measured is empty."""
    texts = dict.fromkeys(COLUMNS, "") | dict(
        zip(SETTING_COLUMNS, _setting_texts(row), strict=True)
    )
    texts |= {} if electrode is None else _electrode_texts(electrode)
    if area is not None:
        texts["contact_area_m2"] = _text(area.area_m2)
        texts["contact_area_std_m2"] = _text(area.std_m2, digits=4)
        texts["doubts"] = area.doubts
    return texts | {
        "cof": _text(measured.cof),
        "cof_std": _text(measured.cof_std, digits=4),
        "time_s": f"{measured.time_s:.6f}",
        "measured_normal_force_n": _text(measured.normal_force_n),
        "simulated": "true" if simulated else "false",
    }


def measured_frame(path: Path) -> Any:
    """A data file as a pandas DataFrame. `electrode_voltage` and `current` are complex peak phasors
    where both amount and phase are there. `attrs` holds `units` and the content of the sidecar.
    HapticError without pandas.
    """
    pandas = optional("pandas", "tables", "measured_frame")
    table = pandas.read_csv(io.StringIO(read_text(path)))
    for name, amount in (("electrode_voltage", "electrode_voltage_v"), ("current", "current_a")):
        if {amount, f"{name}_phase_rad"} <= set(table):
            table[name] = table[amount] * np.exp(1j * table[f"{name}_phase_rad"])
    sidecar = meta_path(path)
    about = json.loads(read_text(sidecar)) if sidecar.exists() else {}
    return labelled.frame(table, about)


def meta_path(path: Path) -> Path:
    """Where the sidecar of a data file lies."""
    return path.with_name(f"{path.name}.meta.json")


def note(path: Path, said: dict[str, Any]) -> None:
    """Say more in the sidecar of a data file, such as a calibration that came with it."""
    with writing(meta_path(path)):
        found = json.loads(meta_path(path).read_text(encoding="utf-8"))
        write_text(meta_path(path), json.dumps(found | said, indent=1) + "\n")


def _setting_texts(row: Row) -> list[str]:
    setting = row.setting
    told = (getattr(setting, name) for name in SETTING_COLUMNS[:-2])
    texts = [value if isinstance(value, str) else f"{value:.9g}" for value in told]
    return [*texts, str(row.session), str(row.trial)]


def _electrode_texts(reading: ElectrodeReading) -> dict[str, str]:
    """By column. Phases count from the generator's output; the electrode's own is left empty where
    nobody looked.
    """
    texts: dict[str, str] = {}
    for name, unit, phasor, std, phase_std_rad in (
        (
            "electrode_voltage",
            "v",
            reading.voltage_v,
            reading.voltage_std_v,
            reading.voltage_phase_std_rad,
        ),
        ("current", "a", reading.current_a, reading.current_std_a, reading.current_phase_std_rad),
    ):
        own_rad = phase_std_rad if isfinite(phase_std_rad) else std / abs(phasor)
        texts |= {
            f"{name}_{unit}": _text(abs(phasor)),
            f"{name}_std_{unit}": _text(max(std, FINEST * abs(phasor)), digits=4),
            f"{name}_phase_rad": _text(cmath.phase(phasor)),
            f"{name}_phase_std_rad": _text(min(max(own_rad, FINEST), UNKNOWN_PHASE_RAD), digits=4),
        }
    if not reading.referenced:
        texts |= {"electrode_voltage_phase_rad": "", "electrode_voltage_phase_std_rad": ""}
    return texts | {
        "current_h2_a": _text(reading.second_a, digits=4),
        "current_h3_a": _text(reading.third_a, digits=4),
    }


def _text(value: float, digits: int = 6) -> str:
    """A number, or nothing where it is none."""
    return f"{value:.{digits}g}" if isfinite(value) else ""


def _check_identity(path: Path, identity: Identity) -> None:
    sidecar = meta_path(path)
    if not sidecar.exists():
        said = (
            f"{path}: cannot be continued: haptic measure did not write it ({sidecar.name} is"
            " missing)"
        )
        raise BadInputError("not_resumable", said, HINT)
    try:
        found = json.loads(sidecar.read_text(encoding="utf-8"))
        expected = identity.meta(str(found["salt"]))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadInputError(
            "not_resumable", f"{sidecar}: cannot be read ({error})", HINT
        ) from error
    by_name_first = sorted(expected, key=lambda key: key.endswith("_hash"))
    different = [key for key in by_name_first if found.get(key) != expected[key]]
    if different:
        key = different[0]
        if key.endswith("_hash"):
            said = f"another {key.removesuffix('_hash')}, or it has changed since"
        else:
            said = f"{key} {found.get(key)}, not {expected[key]}"
        raise BadInputError(
            "not_resumable", f"{path}: was begun with {said}", f"Resume it as it was begun. {HINT}"
        )


def _check_rows(
    path: Path, header: Sequence[str] | None, table: list[dict[str, str]], rows: Sequence[Row]
) -> None:
    if header is not None and tuple(header) != COLUMNS:
        raise BadInputError("not_resumable", f"{path}: has columns {', '.join(header)}", HINT)
    if len(table) > len(rows):
        raise BadInputError(
            "not_resumable", f"{path}: has {len(table)} rows, the plan {len(rows)}", HINT
        )
    for line, (found, row) in enumerate(zip(table, rows, strict=False), start=2):
        texts = [found.get(name) for name in SETTING_COLUMNS]
        if texts != _setting_texts(row) or not found.get("time_s"):
            raise BadInputError(
                "not_resumable", f"{path}, line {line}: is not the plan's row {line - 1}", HINT
            )
