"""Files that a user gives: read as a whole, or a ModelError that says why not."""

from __future__ import annotations

import codecs
import re
import stat
import tomllib
from pathlib import Path
from typing import Any

from model.support.errors import ModelError

LARGEST_FILE_BYTES = 1 << 30
LARGEST_TEXT_BYTES = 1 << 20
LARGEST_TOML_BYTES = 1 << 19
DEEPEST_KEY = 40  # parts between dots: each is a table of its own


def read_bytes(path: Path, most_bytes: int = LARGEST_FILE_BYTES) -> bytes:
    """The whole file, which is a regular one: a pipe may never end, nor a device."""
    try:
        status = path.stat()
        is_file = stat.S_ISREG(status.st_mode)
        content = path.read_bytes() if is_file and status.st_size <= most_bytes else b""
    except FileNotFoundError:
        raise ModelError(
            f"{path} does not exist", "check the name and the folder", "file_not_found"
        ) from None
    except (OSError, ValueError) as error:
        said = f"{path} cannot be read: {getattr(error, 'strerror', None) or error}"
        raise ModelError(said, "check what it is", "file_unreadable") from None
    if stat.S_ISDIR(status.st_mode):
        raise ModelError(f"{path} is a folder, not a file", "name a file in it", "file_unreadable")
    if not is_file:
        raise ModelError(
            f"{path} is a pipe or a device, not a file",
            "copy what is in it to a file",
            "file_unreadable",
        )
    if status.st_size > most_bytes:
        raise ModelError(
            f"{path} has more than {most_bytes / 2**20:g} MiB",
            "use a smaller file",
            "file_too_large",
        )
    return content


def read_text(path: Path, most_bytes: int = LARGEST_TEXT_BYTES) -> str:
    """The whole file as UTF-8, with or without a byte order mark."""
    return as_text(path, read_bytes(path, most_bytes))


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file."""
    text = read_text(path, LARGEST_TOML_BYTES)
    if max(part.count(".") for part in re.split(r"[,={\n]", text)) >= DEEPEST_KEY:
        said = f"{path}: not valid TOML: a key of {DEEPEST_KEY} parts or more"
        raise ModelError(said, "Correct the TOML syntax there", "bad_toml")
    try:
        return tomllib.loads(text)
    except (
        ValueError,
        RecursionError,
    ) as error:  # ValueError: also a number of thousands of digits
        raise ModelError(
            f"{path}: not valid TOML: {error}", "Correct the TOML syntax there", "bad_toml"
        ) from error


def as_text(path: Path, content: bytes) -> str:
    """The content of a file, as `read_text` reads it."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if b"\0" in content and not content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            raise not_text(path, f"UTF-8 text (byte {error.start})") from None
        said = f"{path} is not UTF-8 text (byte {error.start})"
        raise ModelError(said, "save it as UTF-8", "file_unreadable") from None


def not_text(path: Path, kind: str = "text") -> ModelError:
    """What to raise for a binary file where text is needed."""
    hint = "it is a binary file: export what it holds as text"
    return ModelError(f"{path} is not {kind}", hint, "file_unreadable")
