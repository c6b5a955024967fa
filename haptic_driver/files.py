"""Files that a user gives or asks for: read as a whole, written as a whole, or an error that says
why not.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

from haptic_driver.errors import BadInputError, HapticError
from model.support.cells import written_cells
from model.support.errors import ModelError
from model.support.reading import as_text, read_bytes

LONGEST_NAME_BYTES = 240  # file systems allow 255, what stands beside it or behind it included


@contextmanager
def bad_input(code: str) -> Iterator[None]:
    """What a reader of `model` refuses gets another code: what the file was given for."""
    try:
        yield
    except ModelError as error:
        raise ModelError(error.message, error.hint, code) from error


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """What the system refuses while something is written to `path` becomes a HapticError."""
    try:
        yield
    except OSError as error:
        raise not_written(path, error) from error


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Where to write what shall be at `path`: it takes its place at the end of the block, or
    nothing does.

    The folder is made where there is none. A reader sees the old file or the new one, never half of
    one. HapticError where it cannot be written.
    """
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            yield part
            os.replace(part, path)
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def listed(folder: Path, endings: Collection[str], apart: Collection[Path] = ()) -> list[Path]:
    """The files of a folder with these endings, by name.

    Hidden ones are left out, as macOS leaves one beside each file; so are those `apart`.
    """
    left = {path.resolve() for path in apart}
    return [
        path
        for path in sorted(folder.iterdir())
        if path.suffix.lower() in endings
        and path.is_file()
        and not path.name.startswith(".")
        and path.resolve() not in left
    ]


def write_text(path: Path, text: str) -> None:
    """A whole file of UTF-8, on the disk; the names of files that are none are escaped in it."""
    with (
        replacing(path) as part,
        part.open("w", encoding="utf-8", errors="backslashreplace") as file,
    ):
        write_through(file, text)


def write_through(file: TextIO, text: str) -> None:
    """Write text, and wait until the disk has it."""
    file.write(text)
    file.flush()
    os.fsync(file.fileno())


def whole_lines(path: Path) -> str:
    """The lines of a file that only grows, without what a crash left of the last; empty where there
    is no file.
    """
    content = read_bytes(path) if path.exists() else b""
    return as_text(path, content[: content.rfind(b"\n") + 1])


def open_to_add(path: Path) -> TextIO:
    """A file of lines to add to, new where there is none; what a crash left of the last is cut off.

    OSError where it cannot be opened.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists():
        os.truncate(path, path.read_bytes().rfind(b"\n") + 1)
    return path.open("a", encoding="utf-8", newline="")


def write_rows(path: Path, rows: Sequence[Mapping[str, str | float]]) -> None:
    """A CSV of records with the same keys, at least one; the keys are its header."""
    with replacing(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        names = list(rows[0])
        writer.writerow(written_cells(names))
        writer.writerows(written_cells(row[name] for name in names) for row in rows)


def require_free(path: Path, force: bool | None = None, option: str = "--out") -> None:
    """BadInputError where `path` would be overwritten unasked; `force` is None where nobody can."""
    if path.exists() and not force:
        hint = f"Give {'' if force is None else '--force or '}another {option}"
        raise BadInputError("file_exists", f"{path}: exists already", hint)


def require_ending(path: Path, endings: Collection[str]) -> None:
    """BadInputError for a name that ends otherwise."""
    if path.suffix.lower() not in endings:
        known = ", ".join(endings)
        said = f"{path}: its ending is none of {known}"
        raise BadInputError("bad_ending", said, f"Give a name that ends in {known}")


def not_written(path: Path, error: OSError) -> HapticError:
    """What to raise where `path` could not be written."""
    if isinstance(error, IsADirectoryError):
        return HapticError(
            "not_written",
            f"{path}: cannot be written: it is a folder",
            "Name a file in it as --out",
        )
    if isinstance(error, FileExistsError | NotADirectoryError):
        said = f"{path}: cannot be written: a file stands where a folder is needed"
        return HapticError("not_written", said, "Choose another --out")
    reason = error.strerror or str(error)  # without the path again
    return HapticError(
        "not_written", f"{path}: cannot be written: {reason}", "Choose another --out"
    )
