"""Compiled kernels: `kernel` is numba's njit with the options that the kernels of the model use.

numba's own cache notices a change in the file of a kernel, not in the kernels and constants that it
uses from other files. So the cache lives in a folder named by the hash of the files that
have kernels and of what these import. Whatever is edited there, no stale machine code runs.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

from haptic_driver.base.cache import code_cache

F = TypeVar("F", bound=Callable[..., object])

SOURCES = ("contact/*.py", "electric/*.py", "support/*.py", "solver.py")
MUCH = 4096  # rows; fewer are done before a second thread has started

OPTIONS: dict[str, Any] = {
    "nogil": True,  # rows are solved on several threads
    "error_model": "numpy",  # a division by zero gives infinity, as in arrays
    # Arrays are made outside of kernels. Without numba's counts of references to them, records of
    # arrays are handed from kernel to kernel for nothing; with them a look-up takes three times as
    # long.
    "_nrt": False,
}


def _sources_hash() -> str:
    digest = hashlib.sha256()
    for pattern in SOURCES:
        for path in sorted(Path(__file__).parents[1].glob(pattern)):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


_FOLDER = str(code_cache() / _sources_hash())


def kernel(function: F) -> F:
    """Compile `function` at its first call; the machine code is cached on disk."""
    return _compiled(function, fastmath=False)


def kernel_of_sums(function: F) -> F:
    """The same for loops that only sum: sums may be taken in any order, so that the loop runs on
    vectors.
    """
    return _compiled(function, fastmath={"reassoc", "contract", "nsz"})


def _compiled(function: F, fastmath: bool | set[str]) -> F:
    config: Any = numba.config
    before, config.CACHE_DIR = config.CACHE_DIR, _FOLDER
    try:
        return cast(F, numba.njit(cache=True, fastmath=fastmath, **OPTIONS)(function))
    finally:
        config.CACHE_DIR = before


def in_slices(work: Callable[[slice], None], count: int) -> None:
    """`work` on all of `count` rows, slice by slice on as many threads as there are cores where
    there are many rows.
    """
    slices = [slice(start, start + MUCH) for start in range(0, count, MUCH)]
    if len(slices) < 2:
        work(slice(0, count))
        return
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    with ThreadPoolExecutor(cores) as threads:
        list(threads.map(work, slices))
