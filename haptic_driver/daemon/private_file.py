"""Small files that only this user can read, tokens, and folders that nobody else can write to."""

from __future__ import annotations

import os
import secrets
import stat
import string
from pathlib import Path

from haptic_driver.errors import BadInputError, HapticError

LEAST_TOKEN = 24  # characters: too many to be guessed
TOKEN_LETTERS = frozenset(string.ascii_letters + string.digits + "-_")


def write_private(path: Path, text: str) -> None:
    """Put `text` into a file of mode 0600, all at once; it is never readable for others, not even
    for a moment.
    """
    draft = path.with_name(f".{path.name}.{secrets.token_hex(8)}")
    try:
        with open(
            os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600), "w"
        ) as file:
            file.write(text)
        draft.replace(path)
    except OSError as error:
        draft.unlink(missing_ok=True)
        raise HapticError(
            "not_written", f"{path}: cannot be written ({error})", "choose another --socket"
        ) from error


def private_folder(folder: Path) -> None:
    """Make it with mode 0700; refuse the folder of somebody else, who could replace what is in
    it.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        owner = folder.stat()
    except OSError as error:
        raise HapticError(
            "no_folder", f"{folder}: cannot be made ({error})", "choose another --socket"
        ) from error
    if not hasattr(os, "getuid"):
        return  # Windows: who may read is not in the mode, and temporary folders are the user's own
    shared_by_others = (
        owner.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not owner.st_mode & stat.S_ISVTX
    )
    if owner.st_uid not in (os.getuid(), 0) or shared_by_others:
        said = f"{folder}: others may write there"
        raise HapticError(
            "folder_not_private", said, f"chmod 700 {folder}, or choose another --socket"
        )


def kept_token(path: Path) -> str:
    """The token in a file of this user alone; one is made where the file is not there.

    Raises BadInputError for a file that others may read or write, and for no token.
    """
    if not path.exists():
        write_private(path, secrets.token_urlsafe(LEAST_TOKEN) + "\n")
    try:
        about, token = path.stat(), path.read_text().strip()
    except (OSError, UnicodeDecodeError) as error:
        raise BadInputError(
            "bad_token", f"{path}: cannot be read ({error})", "Choose another --token-file"
        ) from error
    if hasattr(os, "getuid") and (about.st_uid != os.getuid() or about.st_mode & 0o077):
        said = f"{path}: others may read or write this token"
        raise BadInputError("bad_token", said, f"Remove it, and a new one is made: rm {path}")
    if len(token) < LEAST_TOKEN or set(token) - TOKEN_LETTERS:
        said = f"{path}: holds no token of {LEAST_TOKEN} or more letters, digits, - and _"
        raise BadInputError("bad_token", said, f"Remove it, and a new one is made: rm {path}")
    return token
