"""A simulated finger that is any function: its friction, and what it does to the electrode if it
says so.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import sys
from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from haptic_driver.errors import BadInputError, HapticError
from hw.monitor.simulated import ElectrodeState

GIVEN = ("frequency_hz", "voltage_v", "normal_force_n", "speed_m_s", "time_s")


@dataclass(frozen=True)
class FingerFunction:
    """A function of arrays [n] `GIVEN`, as a finger's laws of friction and of the electrode.

    It returns the lateral force in N [n], or (lateral_force_n, current_a, electrode_voltage_v), the
    last two complex peak phasors against the set voltage, stray current included. Without speed it
    rests; without a load there is none. Whatever it raises, and what is no such answer, is a
    HapticError.
    """

    function: Callable[..., Any]
    name: str = "the finger's function"
    source: str = ""

    def friction(self, *condition: float) -> float:
        """The lateral force; a `FrictionLaw`. At rest it need not say one."""
        force_n = float(np.real(self._parts(condition)[0]))
        if not isfinite(force_n):
            if condition[3] == 0.0:
                return 0.0
            raise HapticError(
                "function_failed",
                f"{self.name}: a lateral force of {force_n} N",
                self._hint(condition),
            )
        return force_n

    def electrode(self, *condition: float) -> ElectrodeState | None:
        """Voltage and current; an `ElectrodeLaw`. None where the function gives a force alone."""
        parts = self._parts(condition)
        if len(parts) == 1:
            return None
        current_a, voltage_v = complex(parts[1]), complex(parts[2])
        if not np.isfinite([current_a, voltage_v]).all():
            said = f"{self.name}: a current of {current_a} A, a voltage of {voltage_v} V"
            raise HapticError("function_failed", said, self._hint(condition))
        return ElectrodeState(condition[0], voltage_v, current_a)

    def _parts(self, condition: tuple[float, ...]) -> list[np.complex128]:
        """One answer: a force, or a force, a current and a voltage."""
        if len(condition) > len(GIVEN):
            said = f"{self.name}: knows no bias and no waveform but a sine"
            raise HapticError(
                "function_failed", said, "Leave voltage_offset_v and waveform out of the plan"
            )
        try:
            answer = self.function(*(np.array([value], dtype=np.float64) for value in condition))
            parts = [
                np.asarray(part, dtype=np.complex128)
                for part in (answer if isinstance(answer, tuple) else [answer])
            ]
        except Exception as error:
            raise HapticError(
                "function_failed", f"{self.name}: raised {error!r}", self._hint(condition)
            ) from error
        if len(parts) not in (1, 3) or any(part.size != 1 for part in parts):
            said = (
                f"{self.name}: answered {len(parts)} values of shapes"
                f" {[part.shape for part in parts]}"
            )
            hint = (
                "It returns lateral_force_n, or (lateral_force_n, current_a, electrode_voltage_v),"
                " as long as its input"
            )
            raise HapticError("function_failed", said, hint)
        return [part.ravel()[0] for part in parts]

    @staticmethod
    def _hint(condition: tuple[float, ...]) -> str:
        given = ", ".join(
            f"{name} = {value:g}" for name, value in zip(GIVEN, condition, strict=True)
        )
        return f"It was called with {given}, as arrays"


def load_finger(name: str) -> FingerFunction:
    """By `module:function` or `file.py:function`; BadInputError says why not."""
    module_name, _, function_name = name.rpartition(":")
    hint = "Give module:function or file.py:function"
    try:
        module = (
            _load_file(module_name) if module_name.endswith(".py") else _load_module(module_name)
        )
        function = getattr(module, function_name)
        source = inspect.getsource(module)
    except Exception as error:
        raise BadInputError(
            "bad_function", f"--finger {name}: cannot be loaded ({error!r})", hint
        ) from error
    if not callable(function):
        raise BadInputError("bad_function", f"--finger {name}: is not a function", hint)
    return FingerFunction(function, f"--finger {name}", source)


def _load_file(path: str) -> Any:
    spec = importlib.util.spec_from_file_location(Path(path).stem, path)
    if spec is None or spec.loader is None:
        raise ImportError(path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _load_module(name: str) -> Any:
    """Also from where the command was typed."""
    sys.path.insert(0, "")
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove("")
