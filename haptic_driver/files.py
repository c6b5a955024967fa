"""Files that a user gives or asks for: read as a whole, or an error that says why not; and why one was not written."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from haptic_driver.errors import BadInputError, HapticError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LARGEST_FILE_BYTES = 1 << 30
PICTURES = (".png", ".pdf", ".svg")


def read_bytes(path: Path) -> bytes:
    """The whole file."""
    try:
        if path.is_dir():
            raise BadInputError("file_unreadable", f"{path} is a folder, not a file", "name a file in it")
        if path.stat().st_size > LARGEST_FILE_BYTES:
            raise BadInputError(
                "file_too_large", f"{path} has more than {LARGEST_FILE_BYTES >> 20} MiB", "use a smaller file"
            )
        return path.read_bytes()
    except FileNotFoundError:
        raise BadInputError("file_not_found", f"{path} does not exist", "check the name and the folder") from None
    except (OSError, ValueError) as error:
        raise BadInputError("file_unreadable", f"{path} cannot be read: {_reason(error)}", "check what it is") from None


def read_text(path: Path) -> str:
    """The whole file as UTF-8, with or without a byte order mark."""
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise BadInputError(
            "file_unreadable", f"{path} is not UTF-8 text (byte {error.start})", "save it as UTF-8"
        ) from None


def write_picture(figure: Figure, path: Path, dpi: int = 110) -> None:
    """Save a picture, in a folder made for it where there is none; its ending says how."""
    if path.suffix.lower() not in PICTURES:
        raise BadInputError(
            "bad_ending", f"{path}: is no name of a picture", f"Give a name that ends in {', '.join(PICTURES)}"
        )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=dpi)
    except OSError as error:
        raise not_written(path, error) from error


def not_written(path: Path, error: OSError) -> HapticError:
    """What to raise where `path` could not be written."""
    if isinstance(error, IsADirectoryError):
        return HapticError("not_written", f"{path}: cannot be written: it is a folder", "Name a file in it as --out")
    if isinstance(error, FileExistsError | NotADirectoryError):
        return HapticError(
            "not_written", f"{path}: cannot be written: a file stands where a folder is needed", "Choose another --out"
        )
    return HapticError("not_written", f"{path}: cannot be written: {_reason(error)}", "Choose another --out")


def _reason(error: Exception) -> str:
    """In words, without the path again."""
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
