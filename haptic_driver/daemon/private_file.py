"""Small files that only this user can read, tokens, and folders that nobody else can write to."""

from __future__ import annotations

import os
import secrets
import stat
import string
from contextlib import suppress
from pathlib import Path

from haptic_driver.errors import BadInputError, HapticError

LEAST_TOKEN, MOST_TOKEN = 24, 128  # characters: too many to be guessed
TOKEN_LETTERS = frozenset(string.ascii_letters + string.digits + "-_")


def write_private(path: Path, text: str, option: str = "--socket") -> None:
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
        with suppress(OSError):
            draft.unlink(missing_ok=True)
        raise HapticError(
            "not_written",
            f"{path}: cannot be written ({error.strerror})",
            f"choose another {option}",
        ) from error


def private_folder(folder: Path, option: str = "--socket") -> None:
    """Make it with mode 0700; refuse the folder of somebody else, who could replace what is in
    it.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        owner = folder.stat()
    except OSError as error:
        raise HapticError(
            "no_folder", f"{folder}: cannot be made ({error})", f"choose another {option}"
        ) from error
    if not hasattr(os, "getuid"):
        return  # Windows: who may read is not in the mode, and temporary folders are the user's own
    shared_by_others = (
        owner.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not owner.st_mode & stat.S_ISVTX
    )
    if owner.st_uid not in (os.getuid(), 0) or shared_by_others:
        said = f"{folder}: others may write there"
        raise HapticError(
            "folder_not_private", said, f"chmod 700 {folder}, or choose another {option}"
        )


def kept_token(path: Path) -> str:
    """The token in a file of this user alone; one is made where the file is not there.

    Raises HapticError for a folder or a file that others may read or write, and for no token.
    """
    option = "--token-file"
    try:
        private_folder(path.parent, option)
        if not path.exists():
            write_private(path, secrets.token_urlsafe(LEAST_TOKEN) + "\n", option)
        # a link is not followed, and nothing that waits for a writer is waited for
        how = (
            os.O_RDONLY | os.O_CLOEXEC | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0)
        )
        with open(os.open(path, how)) as file:
            about, token = os.fstat(file.fileno()), file.read(MOST_TOKEN + 2).strip()
    except (OSError, ValueError) as error:
        raise BadInputError(
            "bad_token", f"{path}: cannot be read ({error})", f"Choose another {option}"
        ) from error
    is_ours = not hasattr(os, "getuid") or (
        about.st_uid == os.getuid() and not about.st_mode & (stat.S_IRWXG | stat.S_IRWXO)
    )
    if not (stat.S_ISREG(about.st_mode) and is_ours):
        said = f"{path}: is no file that only you can read and write"
        raise BadInputError("bad_token", said, f"chmod 600 it, or choose another {option}")
    if not LEAST_TOKEN <= len(token) <= MOST_TOKEN or set(token) - TOKEN_LETTERS:
        said = f"{path}: holds no token of {LEAST_TOKEN} to {MOST_TOKEN} letters, digits, - and _"
        raise BadInputError("bad_token", said, "Give a file that is not there: one is made")
    return token
