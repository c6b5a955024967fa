"""Where results that can be computed again are kept between runs."""

from __future__ import annotations

import hashlib
import os
import stat
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


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


class CodeFolder:
    """Where numba keeps the machine code of kernels, by the hash of all their sources.

    numba's own cache notices a change in the file of a kernel, not in the kernels, constants and
    records that it uses from other files. Here no stale machine code runs, whatever is edited.
    """

    def __init__(self, sources: Iterable[Path]) -> None:
        digest = hashlib.sha256()
        for path in sources:
            digest.update(path.read_bytes())
        self._path = str(code_cache() / digest.hexdigest()[:16])

    @contextmanager
    def of(self, config: Any) -> Iterator[None]:
        """Meanwhile what is compiled is kept here; `config` is numba's."""
        before, config.CACHE_DIR = config.CACHE_DIR, self._path
        try:
            yield
        finally:
            config.CACHE_DIR = before
