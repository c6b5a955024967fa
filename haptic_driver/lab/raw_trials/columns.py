"""The columns of one trial file as they stand there: text, LabVIEW text, NPY, HDF5, MAT, TDMS."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from haptic_driver.errors import BadInputError, HapticError, optional
from haptic_driver.lab.raw_trials.layout import TextTable, text_table
from haptic_driver.lab.raw_trials.trial_map import ColumnSaid, FileLook
from haptic_driver.public.given import own_unit, require_one_index
from haptic_driver.signals import Array
from model.support.errors import did_you_mean
from model.support.reading import read_bytes
from model.support.text import numbers, times
from model.support.units import named_unit

KINDS = {
    **dict.fromkeys((".csv", ".txt", ".tsv", ".dat", ".asc"), "text"),
    ".lvm": "labview",
    **dict.fromkeys((".npy", ".npz"), "npy"),
    **dict.fromkeys((".h5", ".hdf5"), "hdf5"),
    ".mat": "mat",
    ".tdms": "tdms",
}
MOST_LISTED = 40  # names in an error
UNIT_ATTRIBUTES = ("units", "unit", "unit_string", "NI_UnitDescription")
PACKED = (("scale_factor", "add_offset"), ("conversion", "offset"))  # of CF, and of NWB
SCALES = ("scale", "scaling", "gain")
ITS_DATES = "its dates"
NO_TABLES = "A MATLAB table cannot be read: save table2struct(T, 'ToScalar', true)"


@dataclass(frozen=True)
class Column:
    """A column as its file has it: the name as written, and the unit that the file itself says.

    `scaled`: what its attributes say of a scale that no convention defines.

    `unit_from`: where it says that. `index` counts from 1 in a table of several columns under one
    name. `read` gives the values [n], NaN where none stands. `rate_hz` and `began`: of a waveform
    whose file says them. `place`: the number of a text's column, from 1.
    """

    name: str
    read: Callable[[], Array]
    unit: str = ""
    unit_from: str = ""
    index: int | None = None
    rate_hz: float | None = None
    began: str = ""
    place: int | None = None
    scaled: str = ""

    @property
    def bare(self) -> str:
        """The name without a unit behind it."""
        return named_unit(self.name).bare


@dataclass(frozen=True)
class Source:
    """A file's columns of numbers; `lines` [n]: where each sample stands in a text, empty else."""

    path: Path
    columns: list[Column]
    lines: Sequence[int] = ()
    text: TextTable | None = field(default=None, repr=False)

    def find(self, said: ColumnSaid) -> Column:
        """The column that a map names; BadInputError where it is none, or not one alone."""
        if isinstance(said.name, int):
            places = [column.place or i for i, column in enumerate(self.columns, start=1)]
            if said.name not in places:
                raise self._missing(str(said.name))
            return self.columns[places.index(said.name)]
        for key in ("name", "bare"):
            found = [c for c in self.columns if getattr(c, key) == said.name]
            if said.index is not None:
                found = [c for c in found if c.index in (None, said.index)] or found
            if len(found) == 1 and (said.index is None or found[0].index in (None, said.index)):
                return found[0]
            if found:
                raise self._several(said, found)
        raise self._missing(said.name)

    def _several(self, said: ColumnSaid, found: list[Column]) -> BadInputError:
        if all(column.index is not None for column in found):
            hint = f"Give its column as index = 1 to {max(c.index or 0 for c in found)}"
            return BadInputError("bad_trial", f"{self.path}: {said.name} is a table", hint)
        whole = ", ".join(f"'{column.name}'" for column in found)
        told = f"{self.path}: {said.name} stands more than once: {whole}"
        return BadInputError("bad_trial", told, "Give the whole name, or the column's number")

    def _missing(self, name: str) -> BadInputError:
        names = list(dict.fromkeys(column.name for column in self.columns))
        listed = ", ".join(names[:MOST_LISTED]) or "none"
        hint = f"{did_you_mean(name, names)}See: haptic rows --inspect {self.path.name}"
        hint += f". {NO_TABLES}" if self.path.suffix.lower() == ".mat" else ""
        told = f"{self.path}: there is no column '{name}'; found: {listed}"
        return BadInputError("missing_column", told, hint)


def kind_of(path: Path, look: FileLook) -> str:
    """How a file is read; BadInputError for an ending that says nothing."""
    kind = look.kind or KINDS.get(path.suffix.lower())
    if kind is None:
        said = f"{path}: '{path.suffix}' says nothing of how to read it"
        raise BadInputError("bad_ending", said, f"Known: {', '.join(KINDS)}; or give file.kind")
    return kind


def open_columns(path: Path, look: FileLook, wanted: Sequence[str] = ()) -> Source:
    """All columns of numbers of a file; `wanted` are names by which a text's header is known.

    BadInputError for a file that is none of its kind.
    """
    kind = kind_of(path, look)
    try:
        if kind in ("text", "labview"):
            return _text(path, look, wanted, labview=kind == "labview")
        listed = {"npy": _of_numpy, "hdf5": _of_hdf5, "mat": _of_mat, "tdms": _of_tdms}[kind]
        return Source(path, list(listed(path)))
    except HapticError:
        raise
    except (OSError, ValueError, KeyError, TypeError, EOFError, NotImplementedError) as error:
        said = f"{path}: cannot be read as {kind} ({type(error).__name__}: {error})"
        raise BadInputError("bad_trial", said, "Is it whole, and of that kind?") from error


def given_columns(given: Mapping[str, Any], where: str) -> Source:
    """The columns of a table in memory: a dict of arrays, a DataFrame, quantities with units."""
    found = list[Column]()
    require_one_index(given)
    for name in given:
        values = given[name]
        unit = own_unit(str(name), values)
        values = np.asarray(getattr(values, "magnitude", values))
        from_name = named_unit(str(name)).unit
        said_by = "its own unit" if unit else "its name"
        found += _columns(
            str(name), values, unit or from_name, said_by if unit or from_name else ""
        )
    return Source(Path(where), found)


def _text(path: Path, look: FileLook, wanted: Sequence[str], *, labview: bool) -> Source:
    table = text_table(path, read_bytes(path), look.layout(), wanted, labview)
    columns = []
    for place in range(table.width):
        name = table.names[place] if place < len(table.names) else ""
        unit = table.units[place] if place < len(table.units) else ""
        unit_from = ("the file's head" if labview else "the row of units") if unit else ""
        if not unit:
            unit = named_unit(name).unit
            unit_from = "the header" if unit else ""
        cells = table.cells(place)
        if not any(character.isdigit() for cell in cells for character in cell):
            continue
        if times(cells[:1]) is not None and not cells[0].isdigit():
            unit, unit_from = "s", ITS_DATES
        read = partial(_numbers, f"{path}: {name or f'column {place + 1}'}", cells, table.decimal)
        columns.append(Column(name or str(place + 1), read, unit, unit_from, place=place + 1))
    return Source(path, columns, [row.number for row in table.rows], table)


def _numbers(where: str, cells: Sequence[str], decimal: Any) -> Array:
    passed_s = None if cells[0].isdigit() else times(cells)
    return numbers(where, cells, decimal) if passed_s is None else passed_s


# --- arrays


def _columns(name: str, values: Any, unit: str = "", unit_from: str = "") -> Iterator[Column]:
    """An array as columns: one of [n], or several of a table, whose samples lie along its longer
    side; nothing of what holds no numbers.
    """
    values = np.squeeze(values)
    if values.dtype.kind == "M":
        values = (values - values.flat[0]) / np.timedelta64(1, "s")
        unit, unit_from = "s", ITS_DATES
    if values.dtype.kind not in "iufb" or values.ndim not in (1, 2):
        return
    if values.ndim == 1:
        yield Column(name, partial(np.asarray, values, np.float64), unit, unit_from)
        return
    table = values if values.shape[0] >= values.shape[1] else values.T
    for index, column in enumerate(table.T, start=1):
        yield Column(name, partial(np.asarray, column, np.float64), unit, unit_from, index)


def _of_numpy(path: Path) -> Iterator[Column]:
    loaded = np.load(path, allow_pickle=False)
    if not isinstance(loaded, np.ndarray):
        with loaded:
            for name in loaded.files:
                yield from _records(name, loaded[name], ".")
    elif loaded.dtype.names is None:
        for column in _columns("", loaded):
            yield Column(str(column.index or 1), column.read)
    else:
        yield from _records("", loaded, "")


def _records(name: str, values: Any, sign: str) -> Iterator[Column]:
    """An array as columns; of records each field, by its name behind that of the array."""
    for field_name in values.dtype.names or ():
        yield from _columns(f"{name}{sign}{field_name}", values[field_name])
    if not values.dtype.names:
        yield from _columns(name, values)


def _of_hdf5(path: Path, sign: str = "/") -> Iterator[Column]:
    """Datasets by their paths; a field of a table of records as path:field."""
    import h5py  # noqa: PLC0415  (slow to import)

    with h5py.File(path, "r") as file:
        datasets: dict[str, Any] = {}
        file.visititems(lambda key, item: datasets.update({key: item}))
        for key, dataset in datasets.items():
            is_object = "MATLAB_object_decode" in dataset.attrs
            if not isinstance(dataset, h5py.Dataset) or key.startswith("#") or is_object:
                continue
            name, values, unit = key.replace("/", sign), dataset[()], _unit_of(dataset.attrs)
            unit_from = "its attribute" if unit else ""
            if dataset.attrs.get("MATLAB_class") == b"cell":
                for index, reference in enumerate(np.ravel(values), start=1):
                    yield from _cell(name, file[reference][()], index)
            elif dataset.dtype.names:
                yield from _records(name, values, ":")
            else:
                scaled = _scaled(dataset.attrs)
                values = _unpacked(np.asarray(values), dataset.attrs)
                for column in _columns(name, values, unit, unit_from):
                    yield replace(column, scaled=scaled)


def _unpacked(values: Any, attributes: Mapping[str, Any]) -> Any:
    """Numbers as attributes of the CF conventions (section 8.1) or of NWB say they are packed."""
    names = next((pair for pair in PACKED if set(pair) & set(attributes)), PACKED[0])
    if values.dtype.kind not in "iuf" or not {"_FillValue", *names} & set(attributes):
        return values
    blank, scale, offset = (
        float(np.ravel(attributes.get(key, default))[0])
        for key, default in zip(("_FillValue", *names), (np.nan, 1.0, 0.0), strict=True)
    )
    return np.where(values == blank, np.nan, scale * values.astype(np.float64) + offset)


def _scaled(attributes: Mapping[str, Any]) -> str:
    """Attributes of a scale that `_unpacked` does not know, as gain = 2."""
    said = []
    for name in SCALES:
        value = np.ravel(attributes.get(name, 1.0))
        if not (value.size == 1 and value.dtype.kind in "iuf" and value[0] == 1.0):
            said.append(f"{name} = {attributes[name]}")
    return ", ".join(said)


def _cell(name: str, values: Any, index: int) -> Iterator[Column]:
    """An array in a cell array, by its place there from 1."""
    for column in _columns(name, np.asarray(values)):
        if column.index is None:
            yield Column(name, column.read, index=index)


def _unit_of(attributes: Mapping[str, Any]) -> str:
    """What attributes say of the unit: text, bytes, or an array of one of them."""
    said: Any = next((attributes[key] for key in UNIT_ATTRIBUTES if key in attributes), "")
    if isinstance(said, np.ndarray):
        said = said.flat[0] if said.size == 1 else ""
    return said.decode(errors="replace") if isinstance(said, bytes) else str(said)


def _of_mat(path: Path) -> Iterator[Column]:
    """Variables, and fields of structs as data.Fx; files of MATLAB 7.3 are HDF5."""
    from scipy.io import loadmat  # noqa: PLC0415  (slow to import)

    try:
        found: Any = loadmat(path, squeeze_me=True, struct_as_record=False)
    except NotImplementedError:
        yield from _of_hdf5(path, sign=".")
        return
    for name, value in found.items():
        if not name.startswith("__"):
            yield from _of_variable(name, value)


def _of_variable(name: str, value: Any) -> Iterator[Column]:
    if hasattr(value, "_fieldnames"):
        for each in value._fieldnames:
            yield from _of_variable(f"{name}.{each}", getattr(value, each))
        return
    values = np.asarray(value)
    if values.dtype.kind == "O":
        for index, inside in enumerate(values.flat, start=1):
            yield from _cell(name, inside, index)
        return
    yield from _columns(name, values)


def _of_tdms(path: Path) -> Iterator[Column]:
    """Channels as group/channel."""
    nptdms = optional("nptdms", "tdms", "a TDMS file")
    for group in nptdms.TdmsFile.read(path).groups():
        for channel in group.channels():
            unit = _unit_of(channel.properties)
            unit_from = "its property" if unit else ""
            step_s = float(channel.properties.get("wf_increment", 0.0))
            began = str(channel.properties.get("wf_start_time", ""))
            for column in _columns(f"{group.name}/{channel.name}", channel[:], unit, unit_from):
                yield replace(column, rate_hz=1.0 / step_s if step_s else None, began=began)
