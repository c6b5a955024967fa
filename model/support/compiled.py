"""Compiled kernels: `kernel` is numba's njit with the options that the kernels of the model use."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

from haptic_driver.base.cache import CodeFolder

F = TypeVar("F", bound=Callable[..., object])

# where kernels are, and what they import
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


_FOLDER = CodeFolder(
    path for pattern in SOURCES for path in sorted(Path(__file__).parents[1].glob(pattern))
)


def kernel(function: F) -> F:
    """Compile `function` at its first call; the machine code is cached on disk."""
    return _compiled(function, fastmath=False)


def kernel_of_sums(function: F) -> F:
    """The same for loops that only sum: sums may be taken in any order, so that the loop runs on
    vectors.
    """
    return _compiled(function, fastmath={"reassoc", "contract", "nsz"})


def _compiled(function: F, fastmath: bool | set[str]) -> F:
    with _FOLDER.of(numba.config):
        return cast(F, numba.njit(cache=True, fastmath=fastmath, **OPTIONS)(function))


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
