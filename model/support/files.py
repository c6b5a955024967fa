"""Files that a user gives: read as a whole, or a ModelError that says why not."""

from __future__ import annotations

from pathlib import Path

from model.support.errors import ModelError

LARGEST_FILE_BYTES = 1 << 30


def read_bytes(path: Path) -> bytes:
    """The whole file."""
    try:
        is_folder, size = path.is_dir(), path.stat().st_size
        content = b"" if is_folder or size > LARGEST_FILE_BYTES else path.read_bytes()
    except FileNotFoundError:
        raise ModelError(f"{path} does not exist", "check the name and the folder", "file_not_found") from None
    except (OSError, ValueError) as error:
        said = f"{path} cannot be read: {getattr(error, 'strerror', None) or error}"
        raise ModelError(said, "check what it is", "file_unreadable") from None
    if is_folder:
        raise ModelError(f"{path} is a folder, not a file", "name a file in it", "file_unreadable")
    if size > LARGEST_FILE_BYTES:
        said = f"{path} has more than {LARGEST_FILE_BYTES >> 20} MiB"
        raise ModelError(said, "use a smaller file", "file_too_large")
    return content


def read_text(path: Path) -> str:
    """The whole file as UTF-8, with or without a byte order mark."""
    return as_text(path, read_bytes(path))


def as_text(path: Path, content: bytes) -> str:
    """The content of a file, as `read_text` reads it."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        said = f"{path} is not UTF-8 text (byte {error.start})"
        raise ModelError(said, "save it as UTF-8", "file_unreadable") from None
