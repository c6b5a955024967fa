"""What compiles the stages: `kernel`, numba's njit with the options that all of them share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.extending import register_jitable

from haptic_driver.base.cache import CodeFolder
from haptic_driver.signals import Array

F = TypeVar("F", bound=Callable[..., object])

KERNELS: list[Any] = []


_HERE = Path(__file__).parent
_FOLDER = CodeFolder(
    path
    for path in (*sorted(_HERE.glob("*.py")), _HERE.parent / "signals.py")
    if path.name != "policies.py"  # no kernel reads it, and a new policy shall compile nothing
)


def kernel(function: F) -> F:
    """Compile `function` at its first call with arguments of these types, and keep the machine code
    on disk.

    `nogil`: other threads go on meanwhile. `error_model`: x / 0 is inf or NaN, as in numpy, and
    never an exception.
    """
    with _FOLDER.of(numba.config):
        compiled = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    KERNELS.append(compiled)
    return cast(F, compiled)


def either(function: F) -> F:
    """`function` for kernels and for Python, where it runs as it is written."""
    register_jitable(function)
    return function


def refuse_to_compile() -> None:
    """From here on a kernel in use raises TypeError for arguments it was not compiled for:
    compiling takes seconds.
    """
    for each in KERNELS:
        if each.signatures:
            each.disable_compile()


def laid_out(values: Array) -> Array:
    """The same numbers laid out as kernels get them everywhere: another layout would be compiled
    for anew.
    """
    return np.require(values, np.float64, ["C", "A", "W"])
