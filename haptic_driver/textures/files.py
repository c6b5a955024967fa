"""Reading the files a texture is made of: pictures, arrays and tables -> numbers, or an error that says where."""

from __future__ import annotations

import csv
import io
import struct
import tokenize
import zipfile
import zlib
from pathlib import Path

import numpy as np
from PIL import Image

from haptic_driver.errors import BadInputError
from haptic_driver.files import bad_input, read_bytes, read_text
from haptic_driver.signals import Array
from haptic_driver.textures.description import TEXTURE_COF
from model.support.tables import read_table

LARGEST_MAP_PIXELS = 64_000_000
PROFILE_HINT = "Begin with the line: position_mm,cof"

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
PNG_GREY = 0  # colour type of the PNG specification, section 11.2.1
# What Pillow and numpy raise on damaged files, found by feeding them such files.
PNG_DAMAGE = (OSError, ValueError, SyntaxError, EOFError, struct.error, zlib.error)
NPY_DAMAGE = (OSError, ValueError, SyntaxError, EOFError, tokenize.TokenError, zipfile.BadZipFile, MemoryError)


def read_map(path: Path) -> Array:
    """Rows and columns of a map: 0 to 1 of full scale from PNG, the numbers themselves from .npy and .csv."""
    readers = {".png": read_png, ".npy": read_npy, ".csv": read_grid}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        said = f"{path}: key 'file' of a map cannot be a '{path.suffix}' file"
        raise BadInputError("bad_texture", said, "use .png, .npy or .csv")
    return reader(path)


def read_png(path: Path) -> Array:
    """A grey picture of 1 to 16 bits as 0 to 1 of full scale, values taken as stored (no gamma)."""
    content = read_bytes(path)
    if not content.startswith(PNG_SIGNATURE) or content[12:16] != b"IHDR" or len(content) < 26:
        raise _bad_image(path, "is not a PNG picture", "save the picture as PNG")
    width, height, bits, colour_type = struct.unpack(">IIBB", content[16:26])
    _require_map_size(path, height, width)
    if bits == 16 and colour_type != PNG_GREY:
        raise _bad_image(path, "is a 16-bit picture with colour or alpha", "save it as 16-bit greyscale without alpha")
    try:
        with Image.open(io.BytesIO(content), formats=["PNG"]) as image:
            image.load()
            return _grey_16_bit(image, path) if bits == 16 else _grey_8_bit(image, path)
    except PNG_DAMAGE as error:
        raise _bad_image(path, f"is damaged: {error}", "save it again from the program that made it") from None


def _grey_16_bit(image: Image.Image, path: Path) -> Array:
    if "transparency" in image.info:
        raise _transparent(path)
    return np.asarray(image, dtype=float) / 65535.0


def _grey_8_bit(image: Image.Image, path: Path) -> Array:
    if image.mode == "L" and "transparency" not in image.info:
        return np.asarray(image, dtype=float) / 255.0
    pixels = np.asarray(image.convert("RGBA"))
    if np.any(pixels[..., 3] != 255):
        raise _transparent(path)
    coloured = np.argwhere(np.ptp(pixels[..., :3], axis=2) != 0)
    if len(coloured):
        row, column = coloured[0]
        said = f"has colour, first at row {row}, column {column}"
        raise _bad_image(path, said, "friction has no colour: save it as greyscale")
    return np.asarray(pixels[..., 0], dtype=float) / 255.0


def _transparent(path: Path) -> BadInputError:
    hint = "friction has no transparency: save it as greyscale without alpha"
    return _bad_image(path, "is partly transparent", hint)


def _bad_image(path: Path, problem: str, hint: str) -> BadInputError:
    return BadInputError("bad_image", f"{path} {problem}", hint)


def read_npy(path: Path) -> Array:
    """A numpy array of two dimensions, of numbers."""
    content = read_bytes(path)
    try:
        array = np.load(io.BytesIO(content), allow_pickle=False)
    except NPY_DAMAGE as error:
        raise BadInputError("bad_map", f"{path} is not a numpy array: {error}", "write it with numpy.save") from None
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiub" or array.ndim != 2:
        shape = getattr(array, "shape", "no array")
        raise BadInputError("bad_map", f"{path} is not a table of numbers ({shape})", "save rows and columns of floats")
    _require_map_size(path, *array.shape)
    return np.asarray(array, dtype=float)


def read_grid(path: Path) -> Array:
    """A CSV table of numbers without a header: each line a row of the map."""
    rows = [[_number(path, line, cell) for cell in cells] for line, cells in _csv_lines(path)]
    if not rows or len({len(row) for row in rows}) != 1:
        raise BadInputError("bad_map", f"{path} has no rows, or rows of unequal length", "give a full table, no header")
    _require_map_size(path, len(rows), len(rows[0]))
    return np.array(rows, dtype=float)


def require_cof(path: Path, cof: Array) -> None:
    """Refuse a map with a value that is no coefficient of friction."""
    _require_values(path, cof, *TEXTURE_COF, "with cof_black and cof_white a map holds 0 to 1 of full scale")


def require_shares(path: Path, shares: Array) -> None:
    """Refuse a map with a value outside 0 to 1."""
    _require_values(path, shares, 0.0, 1.0, "divide by full scale, or drop cof_black and cof_white if it holds cof")


def _require_values(path: Path, values: Array, low: float, high: float, hint: str) -> None:
    bad = np.argwhere(~((values >= low) & (values <= high)))  # NaN is outside every range
    if len(bad):
        row, column = bad[0]
        said = f"{path}: {values[row, column]:g} at row {row}, column {column} is outside {low} to {high}"
        raise BadInputError("bad_map", said, hint)


def _require_map_size(path: Path, rows: int, columns: int) -> None:
    if rows * columns == 0:
        raise BadInputError("bad_map", f"{path} is empty", "give at least one pixel")
    if rows * columns > LARGEST_MAP_PIXELS:
        said = f"{path} has {columns} x {rows} pixels, more than {LARGEST_MAP_PIXELS // 1_000_000} million"
        raise BadInputError("map_too_large", said, "scale it down, or cut out the part that is touched")


def read_profile(path: Path) -> tuple[list[float], list[float]]:
    """Positions in metres and frictions of a CSV file with columns position_mm or position_m, and cof."""
    with bad_input():
        table = read_table(path, ["cof"], PROFILE_HINT)
        in_mm = "position_mm" in table.columns and "position_m" not in table.columns
        position, metres = ("position_mm", 1e-3) if in_mm else ("position_m", 1.0)
        table.require(position)
        along, cof = table.numbers(position), table.numbers("cof")
    for row in np.flatnonzero(~((cof >= TEXTURE_COF[0]) & (cof <= TEXTURE_COF[1]))).tolist():
        hint = f"cof lies in {TEXTURE_COF[0]} to {TEXTURE_COF[1]}"
        raise BadInputError("bad_profile", f"{table.where(row)}: cof {cof[row]:g}", hint)
    for row in (1 + np.flatnonzero(np.diff(along) <= 0.0)).tolist():
        hint = "positions increase from line to line"
        raise BadInputError("bad_profile", f"{table.where(row)}: {position} {along[row]:g}", hint)
    if cof.size < 2:
        raise BadInputError("bad_profile", f"{path} has {cof.size} points", "give at least two")
    return (along * metres).tolist(), cof.tolist()


def _csv_lines(path: Path) -> list[tuple[int, list[str]]]:
    """Line number and cells of every line that is neither empty nor a comment."""
    reader = csv.reader(io.StringIO(read_text(path), newline=""))
    try:
        return [
            (reader.line_num, cells)
            for cells in reader
            if any(cell.strip() for cell in cells) and not cells[0].lstrip().startswith("#")
        ]
    except csv.Error as error:
        said = f"{path} line {reader.line_num} is not CSV: {error}"
        raise BadInputError("file_unreadable", said, "separate the numbers by commas") from None


def _number(path: Path, line: int, cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        said = f"{path} line {line}: {cell.strip()[:40]!r} is no number"
        raise BadInputError("bad_map", said, "use numbers such as 0.62") from None
