"""Where results that can be computed again are kept between runs."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path


def cache_dir() -> Path:
    """`HAPTIC_CACHE_DIR`, else `haptic-driver` in the user's cache folder."""
    root = os.environ.get("HAPTIC_CACHE_DIR")
    if root:
        return Path(root)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "haptic-driver"


def code_cache() -> Path:
    """A folder for machine code, which runs without being looked at: nobody else may write there.

    It is made with mode 0700, whatever the umask. A folder of somebody else's is not used, nor one
    that cannot be made: the code is compiled anew for each process then.
    """
    folder = cache_dir() / "kernels"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not hasattr(os, "getuid"):
            return folder  # Windows: the user's own folders are private
        found = folder.lstat()
        if stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid():
            folder.chmod(0o700)
            return folder
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix="haptic-kernels-"))
