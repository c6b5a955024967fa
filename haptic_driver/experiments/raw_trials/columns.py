"""The columns of one trial file as they stand there: text, LabVIEW text, NPY, HDF5, MAT, TDMS."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from haptic_driver.errors import BadInputError, HapticError, optional
from haptic_driver.experiments.raw_trials.trial_map import ColumnSaid, FileLook, TrialMap
from haptic_driver.experiments.raw_trials.units import to_si
from haptic_driver.signals import Array
from model.support.reading import read_bytes

KINDS = {
    **dict.fromkeys((".csv", ".txt", ".tsv", ".dat", ".asc"), "text"),
    ".lvm": "labview",
    **dict.fromkeys((".npy", ".npz"), "npy"),
    **dict.fromkeys((".h5", ".hdf5"), "hdf5"),
    ".mat": "mat",
    ".tdms": "tdms",
}
MARKS = {"tab": "\t", "space": None}
HEADER_LINES = 1000  # in which a header is looked for
FEWEST = 10  # samples
LABVIEW_END = "***End_of_Header***"


class Column(NamedTuple):
    """Values [n] and the unit that the file itself says, empty where it says none."""

    values: Array
    unit: str


def kind_of(path: Path, look: FileLook) -> str:
    """How a file is read; BadInputError for an ending that says nothing."""
    kind = look.kind or KINDS.get(path.suffix.lower())
    if kind is None:
        said = f"{path}: '{path.suffix}' says nothing of how to read it"
        raise BadInputError("bad_ending", said, f"Known: {', '.join(KINDS)}; or give file.kind")
    return kind


def read_columns(path: Path, said: TrialMap) -> dict[str, Array]:
    """The columns of a map [n] by their role, in SI; BadInputError for what is not as it says."""
    given = {
        role: getattr(said.columns, role)
        for role in type(said.columns).model_fields
        if getattr(said.columns, role) is not None
    }
    found = _opened(path, said.file, list(given.values()))
    columns = {}
    for role, wanted in given.items():
        column, where = found[role_key(wanted)], f"{path}: columns.{role}"
        unit = column.unit if wanted.unit is None else wanted.unit
        if not unit:
            hint = f"Give columns.{role}.unit, or file.units_row where a row of units stands"
            raise BadInputError("unknown_unit", f"{where} has no unit", hint)
        factor = to_si(role, unit, where, wanted.gain_unit) * wanted.gain * wanted.sign
        columns[role] = factor * (column.values - wanted.offset)
    _check(path, columns)
    if "time" not in columns:
        assert said.file.rate_hz is not None
        columns["time"] = np.arange(columns["lateral_force"].size) / said.file.rate_hz
    return columns


def role_key(said: ColumnSaid) -> tuple[str | int, int | None]:
    """What distinguishes a column from the others of its file."""
    return said.name, said.index


def _check(path: Path, columns: dict[str, Array]) -> None:
    sizes = {role: values.size for role, values in columns.items()}
    if len(set(sizes.values())) > 1:
        said = ", ".join(f"{role} {size}" for role, size in sizes.items())
        raise BadInputError("bad_trial", f"{path}: columns differ in length: {said}")
    if min(sizes.values()) < FEWEST:
        raise BadInputError("bad_trial", f"{path}: has {min(sizes.values())} samples")
    for role, values in columns.items():
        if not np.isfinite(values).all():
            at = int(np.argmin(np.isfinite(values)))
            raise BadInputError("bad_trial", f"{path}: {role} is no number at sample {at + 1}")
    time_s = columns.get("time")
    if time_s is not None and (np.diff(time_s) <= 0.0).any():
        at = int(np.argmax(np.diff(time_s) <= 0.0)) + 2
        raise BadInputError("bad_trial", f"{path}: time does not rise at sample {at}")


Wanted = list[ColumnSaid]
Found = dict[tuple[str | int, int | None], Column]


def _opened(path: Path, look: FileLook, wanted: Wanted) -> Found:
    kind = kind_of(path, look)
    try:
        if kind in ("text", "labview"):
            return _of_text(path, look, wanted, kind)
        read = {"npy": _of_numpy, "hdf5": _of_hdf5, "mat": _of_mat, "tdms": _of_tdms}[kind]
        return {role_key(said): _one(path, read(path, str(said.name)), said) for said in wanted}
    except HapticError:
        raise
    except (OSError, ValueError, KeyError, TypeError, EOFError, NotImplementedError) as error:
        said = f"{path}: cannot be read as {kind} ({type(error).__name__}: {error})"
        raise BadInputError("bad_trial", said, "Is it whole, and of that kind?") from error


def _one(path: Path, found: Any, said: ColumnSaid) -> Column:
    """A column out of what stands under its name: an array [n], or one of [n, columns]."""
    values, unit = found
    values = np.squeeze(np.asarray(values))
    if values.dtype.kind not in "iufb":
        raise BadInputError("bad_trial", f"{path}: {said.name} holds no numbers")
    index = said.index or (said.name if isinstance(said.name, int) else None)
    if values.ndim == 2:
        if index is None or index > values.shape[1]:
            hint = f"Give its column as index = 1 to {values.shape[1]}"
            raise BadInputError("bad_trial", f"{path}: {said.name} is a table", hint)
        values = values[:, index - 1]
    if values.ndim != 1:
        raise BadInputError("bad_trial", f"{path}: {said.name} is of shape {values.shape}")
    return Column(values.astype(float), unit)


def _missing(path: Path, name: str, names: list[str]) -> BadInputError:
    listed = ", ".join(names[:40]) or "none"
    return BadInputError("missing_column", f"{path}: there is no column '{name}'; found: {listed}")


# --- text


@dataclass(frozen=True)
class TextLook:
    """The lines of a text file and where its table stands: `names` and `units` by column, the first
    line of numbers from 0.
    """

    lines: list[str]
    separator: str
    decimal: str
    names: list[str]
    units: list[str]
    first: int


def decoded(path: Path, encoding: str) -> list[str]:
    """The lines of a text; Windows' letters where it is not of that encoding."""
    content = read_bytes(path)
    try:
        return content.decode(encoding).splitlines()
    except (UnicodeDecodeError, LookupError):
        return content.decode("cp1252", errors="replace").splitlines()


def cells_of(line: str, separator: str) -> list[str]:
    """The cells of a line, without blanks and quotes around them."""
    return [cell.strip().strip('"') for cell in line.split(MARKS.get(separator, separator))]


def named_unit(name: str) -> tuple[str, str]:
    """A column's name without the unit in brackets behind it, and that unit."""
    match = re.fullmatch(r"(.*?)\s*[\[(/]\s*([^\])/]*(?:/[^\])]*)?)\s*[\])]?", name)
    return (match[1], match[2]) if match and match[1] else (name, "")


def _of_text(path: Path, look: FileLook, wanted: Wanted, kind: str) -> Found:
    lines = decoded(path, look.encoding)
    text = _labview(path, lines) if kind == "labview" else _table(path, look, lines, wanted)
    found = {}
    places = [_place(path, said, text.names) for said in wanted]
    numbers = _numbers(path, text, places)
    for said, place, values in zip(wanted, places, numbers, strict=True):
        unit = text.units[place] if place < len(text.units) else ""
        if not unit and place < len(text.names):
            unit = named_unit(text.names[place])[1]
        found[role_key(said)] = Column(values, unit)
    return found


def _place(path: Path, said: ColumnSaid, names: list[str]) -> int:
    if isinstance(said.name, int):
        return said.name - 1
    bare = [named_unit(name)[0] for name in names]
    for listed in (names, bare):
        if said.name in listed:
            return listed.index(said.name)
    raise _missing(path, said.name, names)


def _table(path: Path, look: FileLook, lines: list[str], wanted: Wanted) -> TextLook:
    named = [said.name for said in wanted if isinstance(said.name, str)]
    at = look.header_line - 1 if look.header_line is not None else None
    if at is None:
        for i, line in enumerate(lines[:HEADER_LINES]):
            cells = cells_of(line, look.separator)
            bare = [named_unit(cell)[0] for cell in cells]
            if all(name in cells or name in bare for name in named):
                at = i
                break
        else:
            said = f"{path}: no line names the columns {', '.join(named)}"
            raise BadInputError("missing_column", said, "See: haptic rows --inspect FILE")
    names = cells_of(lines[at], look.separator) if 0 <= at < len(lines) else []
    row = at + 1
    units = cells_of(lines[row], look.separator) if look.units_row and row < len(lines) else []
    units = [unit.strip("[]() ") for unit in units]
    return TextLook(lines, look.separator, look.decimal, names, units, row + look.units_row)


def _labview(path: Path, lines: list[str]) -> TextLook:
    """A LabVIEW measurement file says its separators in its header, which ends twice."""
    ends = [i for i, line in enumerate(lines) if line.startswith(LABVIEW_END)]
    if not ends or ends[-1] + 1 >= len(lines):
        raise BadInputError("bad_trial", f"{path}: has no {LABVIEW_END}, as LabVIEW writes it")
    said = dict(line.split(None, 1) for line in lines[: ends[0]] if len(line.split(None, 1)) > 1)
    separator = "," if said.get("Separator", "Tab").strip() == "Comma" else "tab"
    decimal = said.get("Decimal_Separator", ".").strip() or "."
    units: list[str] = []
    for line in lines[ends[0] : ends[-1]]:
        if line.startswith("Y_Unit_Label"):
            units = ["s", *cells_of(line, separator)[1:]]
    names = cells_of(lines[ends[-1] + 1], separator)
    return TextLook(lines, separator, decimal, names, units, ends[-1] + 2)


def _numbers(path: Path, text: TextLook, places: list[int]) -> Iterator[Array]:
    lines = [i for i, line in enumerate(text.lines) if i >= text.first and line.strip()]
    if not lines:
        raise BadInputError("bad_trial", f"{path}: no numbers stand below its header")
    hint = "Is it whole? Do separator and decimal of the map hold for it?"
    for i in lines if any(text.names) else []:
        cells = cells_of(text.lines[i].rstrip(), text.separator)
        if any(cells[len(text.names) :]):
            said = f"{path}, line {i + 1}: has {len(cells)} cells under {len(text.names)} names"
            raise BadInputError("bad_trial", said, hint)
    joined = "\n".join(text.lines[i] for i in lines)
    if text.decimal == ",":
        joined = joined.replace(",", ".")
    mark = MARKS.get(text.separator, text.separator)
    try:
        table = np.loadtxt(
            io.StringIO(joined),
            delimiter=mark,
            usecols=places,
            ndmin=2,
            comments=None,
            quotechar='"',
        )
    except ValueError as error:
        at = re.search(r"row (\d+)", str(error))
        # numpy counts rows from 1 where columns are missing, and else from 0
        row = int(at[1]) - ("invalid column" in str(error)) if at else 0
        reason = re.sub(r" at row \d+,?( column \d+)?", "", str(error)).rstrip(".")
        said = f"{path}, line {lines[row] + 1}: {reason}"
        raise BadInputError("bad_trial", said, hint) from error
    return iter(table.T)


# --- arrays


def _of_numpy(path: Path, name: str) -> tuple[Any, str]:
    loaded = np.load(path, allow_pickle=False)
    if isinstance(loaded, np.ndarray):
        if loaded.dtype.names is None:
            return loaded, ""
        if name not in loaded.dtype.names:
            raise _missing(path, name, list(loaded.dtype.names))
        return loaded[name], ""
    with loaded:
        if name not in loaded.files:
            raise _missing(path, name, loaded.files)
        return loaded[name], ""


def _of_hdf5(path: Path, name: str) -> tuple[Any, str]:
    import h5py  # noqa: PLC0415  (slow to import)

    with h5py.File(path, "r") as file:
        place, _, field = name.partition(":")  # a field of a table of records
        if place not in file or not isinstance(file[place], h5py.Dataset):
            names: list[str] = []
            file.visititems(lambda key, item: names.append(key) if hasattr(item, "shape") else None)
            raise _missing(path, name, names)
        dataset = file[place]
        unit = dataset.attrs.get("units", dataset.attrs.get("unit", ""))
        unit = unit.decode() if isinstance(unit, bytes) else str(unit)
        return (dataset[field] if field else dataset[()]), unit


def _of_mat(path: Path, name: str) -> tuple[Any, str]:
    """A variable, or a field of a struct as data.Fx; files of MATLAB 7.3 are HDF5."""
    from scipy.io import loadmat  # noqa: PLC0415  (slow to import)

    try:
        found: Any = loadmat(path, squeeze_me=True, struct_as_record=False)
    except NotImplementedError:
        return _of_hdf5(path, name.replace(".", "/"))
    first, *fields = name.split(".")
    if first not in found:
        raise _missing(path, name, [key for key in found if not key.startswith("__")])
    found = found[first]
    for field in fields:
        if not hasattr(found, field):
            raise _missing(path, name, list(getattr(found, "_fieldnames", [])))
        found = getattr(found, field)
    return found, ""


def _of_tdms(path: Path, name: str) -> tuple[Any, str]:
    """A channel as group/channel."""
    nptdms = optional("nptdms", "tdms", "a TDMS file")
    file = nptdms.TdmsFile.read(path)
    channels = {f"{g.name}/{c.name}": c for g in file.groups() for c in g.channels()}
    if name not in channels:
        raise _missing(path, name, list(channels))
    return channels[name][:], str(channels[name].properties.get("unit_string", ""))
