"""Compiled kernels: `kernel` is numba's njit with the options that the kernels of the model use.

numba's own cache notices a change in the file of a kernel, not in the kernels and constants that it uses from other
files. So the cache lives in a folder named by the hash of all sources of this package: whatever is edited, no stale
machine code runs.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

from model.cache import cache_dir

F = TypeVar("F", bound=Callable[..., object])


def _sources_hash() -> str:
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


_FOLDER = str(cache_dir() / "kernels" / _sources_hash())


def kernel(function: F) -> F:
    """Compile `function` at its first call; the machine code is cached on disk, the GIL is released."""
    return _compiled(function, fastmath=False)


def kernel_of_sums(function: F) -> F:
    """The same for loops that only sum: sums may be taken in any order, so that the loop runs on vectors."""
    return _compiled(function, fastmath={"reassoc", "contract", "nsz"})


def inlined(function: F) -> F:
    """A kernel that becomes part of each kernel that calls it: no array is handed over, no reference counted.

    For what is called per point, with arrays, from one place.
    """
    return _compiled(function, fastmath=False, inline="always")


def uncounted(function: F) -> F:
    """A kernel that makes no arrays, nor do those that it calls: no references are counted in any of them."""
    return _compiled(function, fastmath=False, _nrt=False)


def _compiled(function: F, fastmath: bool | set[str], inline: str = "never", **more: bool) -> F:
    config: Any = numba.config
    before, config.CACHE_DIR = config.CACHE_DIR, _FOLDER
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": fastmath, "inline": inline, **more}
    try:
        return cast(F, numba.njit(cache=True, **options)(function))
    finally:
        config.CACHE_DIR = before


@kernel
def span(start: int, end: int) -> range:
    """range(start, end) of indices that do not count from the end: loops over them can run on vectors."""
    return range(np.uintp(start), np.uintp(end))


@kernel
def copy(source: NDArray[Any], to: NDArray[Any]) -> None:
    """From one contiguous array to another; an assignment makes a third, in case that they overlap."""
    one, other = source.reshape(source.size), to.reshape(to.size)
    for k in range(one.size):
        other[k] = one[k]
