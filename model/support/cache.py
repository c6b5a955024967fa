"""Where results that can be computed again are kept between runs."""

from __future__ import annotations

import os
from pathlib import Path


def cache_dir() -> Path:
    """`HAPTIC_CACHE_DIR`, else `haptic-driver` in the user's cache folder."""
    root = os.environ.get("HAPTIC_CACHE_DIR")
    if root:
        return Path(root)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "haptic-driver"
