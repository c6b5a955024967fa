"""Reading the files a texture is made of: pictures, arrays and tables -> numbers, or an error that
says where.
"""

from __future__ import annotations

import csv
import io
import struct
import tokenize
import zipfile
import zlib
from array import array
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from haptic_driver.errors import BadInputError
from haptic_driver.signals import Array
from haptic_driver.textures.description import LONGEST_TABLE_ROWS
from haptic_driver.textures.objects import TEXTURE_COF
from model.support.cells import number
from model.support.reading import read_bytes, read_text
from model.support.tables import read_table

LARGEST_MAP_PIXELS = 4_000_000
LARGEST_PICTURE_BYTES = 8 * LARGEST_MAP_PIXELS + (1 << 20)
LARGEST_MASK_PIXELS = 400  # along a side: its outline is then finer than a finger tells
LARGEST_GRID_BYTES = 3 << 20  # as text
PROFILE_HINT = "Begin with the line: position_mm,cof"

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
PNG_GREY = 0  # colour type of the PNG specification, section 11.2.1
# What Pillow and numpy raise on damaged files, found by feeding them such files.
PNG_DAMAGE = (
    OSError,
    ValueError,
    SyntaxError,
    EOFError,
    struct.error,
    zlib.error,
    Image.DecompressionBombError,
)
NPY_DAMAGE = (
    OSError,
    ValueError,
    SyntaxError,
    EOFError,
    tokenize.TokenError,
    zipfile.BadZipFile,
    MemoryError,
)


def read_map(path: Path) -> Array:
    """Rows and columns of a map: 0 to 1 of full scale from PNG, the numbers themselves from .npy
    and .csv.
    """
    readers = {".png": read_png, ".npy": read_npy, ".csv": read_grid}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        said = f"{path}: key 'file' of a map cannot be a '{path.suffix}' file"
        raise BadInputError("bad_texture", said, "use .png, .npy or .csv")
    return reader(path)


def read_png(path: Path) -> Array:
    """A grey picture of 1 to 16 bits as 0 to 1 of full scale, values taken as stored (no gamma)."""
    content = read_bytes(path, LARGEST_PICTURE_BYTES)
    if not content.startswith(PNG_SIGNATURE) or content[12:16] != b"IHDR" or len(content) < 26:
        raise _bad_image(path, "is not a PNG picture", "save the picture as PNG")
    width, height, bits, colour_type = struct.unpack(">IIBB", content[16:26])
    _require_map_size(path, height, width)
    if bits == 16 and colour_type != PNG_GREY:
        raise _bad_image(
            path,
            "is a 16-bit picture with colour or alpha",
            "save it as 16-bit greyscale without alpha",
        )
    try:
        with Image.open(io.BytesIO(content), formats=["PNG"]) as image:
            _require_map_size(path, image.height, image.width)  # of another header, further on
            image.load()
            return _grey_16_bit(image, path) if bits == 16 else _grey_8_bit(image, path)
    except PNG_DAMAGE as error:
        raise _bad_image(
            path, f"is damaged: {error}", "save it again from the program that made it"
        ) from None


def read_mask(path: Path) -> Array:
    """How far outside of what a PNG picture shows each pixel's centre lies, in pixels; inside it is
    negative.

    It shows what is more than half opaque, or more than half bright where nothing is transparent.
    """
    from scipy.ndimage import distance_transform_edt  # noqa: PLC0415

    content = read_bytes(path, LARGEST_PICTURE_BYTES)
    try:
        with Image.open(io.BytesIO(content), formats=["PNG"]) as image:
            _require_map_size(path, image.height, image.width)
            pixels = image.convert("RGBA")
    except PNG_DAMAGE as error:
        raise _bad_image(path, f"is no PNG picture: {error}", "save it as PNG") from None
    pixels.thumbnail((LARGEST_MASK_PIXELS, LARGEST_MASK_PIXELS))
    opaque, bright = pixels.getchannel("A"), pixels.convert("L")
    shown = np.asarray(bright if opaque.getextrema()[0] == 255 else opaque) > 127
    if shown.all() or not shown.any():
        what = "everything" if shown.all() else "nothing"
        raise _bad_image(path, f"shows {what}: it has no outline", "make its ground transparent")
    away: Array = distance_transform_edt(~shown) - distance_transform_edt(shown)
    return away - 0.5 * np.sign(away)  # from the pixel's centre to the edge between two


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
    coloured = (pixels[..., 0] != pixels[..., 1]) | (pixels[..., 0] != pixels[..., 2])
    if coloured.any():
        row, column = _first(coloured)
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
    content = read_bytes(path, LARGEST_PICTURE_BYTES)
    try:
        _require_npy_size(path, content)
        loaded = np.load(io.BytesIO(content), allow_pickle=False)
    except NPY_DAMAGE as error:
        raise BadInputError(
            "bad_map", f"{path} is not a numpy array: {error}", "write it with numpy.save"
        ) from None
    return np.asarray(loaded, dtype=float)


def _require_npy_size(path: Path, content: bytes) -> None:
    """By the header, before anything is made of that size (NEP 1)."""
    file = io.BytesIO(content)
    read_header = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    version = np.lib.format.read_magic(file)
    if version not in read_header:
        raise ValueError(f"format version {version}")
    shape, _, dtype = read_header[version](file)
    if dtype.kind in "fiub" and len(shape) == 2:
        _require_map_size(path, *shape)
    else:
        said = f"{path} is not a table of numbers ({shape})"
        raise BadInputError("bad_map", said, "save rows and columns of floats")


def read_grid(path: Path) -> Array:
    """A CSV table of numbers without a header: each line a row of the map."""
    values, columns = array("d"), 0
    for line, cells in _csv_lines(path):
        columns = columns or len(cells)
        if len(cells) != columns:
            said = f"{path} line {line} is of unequal length: {len(cells)} numbers, not {columns}"
            raise BadInputError("bad_map", said, "give a full table, no header")
        try:
            values.extend(map(number, cells))
        except ValueError:
            raise _no_number(path, line, cells) from None
    if not values:
        raise BadInputError("bad_map", f"{path} has no rows", "give a full table, no header")
    return np.array(values).reshape(-1, columns)


def require_cof(path: Path, cof: Array) -> None:
    """Refuse a map with a value that is no coefficient of friction."""
    _require_values(
        path, cof, *TEXTURE_COF, "with cof_black and cof_white a map holds 0 to 1 of full scale"
    )


def require_shares(path: Path, shares: Array) -> None:
    """Refuse a map with a value outside 0 to 1."""
    _require_values(
        path,
        shares,
        0.0,
        1.0,
        "bring it to 0 to 1 (less its least value, over its range), or drop cof_black and"
        " cof_white if it holds cof",
    )


def _require_values(path: Path, values: Array, low: float, high: float, hint: str) -> None:
    bad = ~((values >= low) & (values <= high))  # NaN is outside every range
    if bad.any():
        row, column = _first(bad)
        said = (
            f"{path}: {values[row, column]:g} at row {row}, column {column} is outside {low} to"
            f" {high}"
        )
        raise BadInputError("bad_map", said, hint)


def _first(mask: NDArray[np.bool_]) -> tuple[int, int]:
    """Row and column of the first that is true."""
    row, column = divmod(int(mask.argmax()), mask.shape[1])
    return row, column


def _require_map_size(path: Path, rows: int, columns: int) -> None:
    if rows * columns == 0:
        raise BadInputError("bad_map", f"{path} is empty", "give at least one pixel")
    if rows * columns > LARGEST_MAP_PIXELS:
        said = (
            f"{path} has {columns} x {rows} pixels, more than {LARGEST_MAP_PIXELS // 1_000_000}"
            " million"
        )
        raise BadInputError(
            "map_too_large", said, "scale it down, or cut out the part that is touched"
        )


def read_profile(path: Path) -> tuple[list[float], list[float]]:
    """Positions in metres and frictions of a CSV file with columns position_mm or position_m, and
    cof.
    """
    known = ("position_m", "position_mm")
    table = read_table(path, ["cof"], PROFILE_HINT, LONGEST_TABLE_ROWS, known)
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


def _csv_lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of every line that is neither empty nor a comment."""
    reader = csv.reader(io.StringIO(read_text(path, LARGEST_GRID_BYTES), newline=""))
    try:
        for cells in reader:
            if "".join(cells).strip() and not cells[0].lstrip().startswith("#"):
                yield reader.line_num, cells
    except csv.Error as error:
        said = f"{path} line {reader.line_num} is not CSV: {error}"
        raise BadInputError("file_unreadable", said, "separate the numbers by commas") from None


def _no_number(path: Path, line: int, cells: list[str]) -> BadInputError:
    for cell in cells:
        try:
            number(cell)
        except ValueError:
            said = f"{path} line {line}: {cell.strip()[:40]!r} is no number"
            return BadInputError("bad_map", said, "use numbers such as 0.62")
    raise AssertionError("all of them are numbers")
