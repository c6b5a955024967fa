"""Small files that only this user can read: tokens."""

from __future__ import annotations

import os
import secrets
from pathlib import Path

from haptic_driver.errors import HapticError


def write_private(path: Path, text: str) -> None:
    """Put `text` into a file of mode 0600, all at once; it is never readable for others, not even for a moment."""
    draft = path.with_name(f".{path.name}.{secrets.token_hex(8)}")
    try:
        with open(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600), "w") as file:
            file.write(text)
        draft.replace(path)
    except OSError as error:
        draft.unlink(missing_ok=True)
        raise HapticError("not_written", f"{path}: cannot be written ({error})", "choose another --socket") from error
