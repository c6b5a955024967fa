"""Trials whose friction is known, as signals and as the files that labs write."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.lab.raw_trials.cut import Row
from haptic_driver.lab.raw_trials.folder import Cut, TrialFolder
from haptic_driver.lab.raw_trials.trial_map import TrialMap

RATE_HZ, LOAD_N, OFF_COF = 250.0, 0.5, 0.4
TIME_S = np.arange(650) / RATE_HZ
ON_S = (1.0, 2.4)
WINDOW_S = (1.302, 2.298)  # between samples, so that no rounding moves one in or out
NAMES = ("t", "Fx", "Fz", "U", "x")
MAP: dict[str, Any] = {
    "columns": {
        "time": {"name": "t", "unit": "s"},
        "lateral_force": {"name": "Fx", "unit": "N"},
        "normal_force": {"name": "Fz", "unit": "N"},
        "voltage": {"name": "U", "unit": "V"},
        "position": {"name": "x", "unit": "mm"},
    },
    "conditions": {"values": {"voltage": 75, "frequency": 100}, "units": {}},
    "voltage_on": {"column": "voltage"},
    "windows": [{"start_s": 0.302, "end_s": 1.298}],
}
MAP["conditions"]["units"] = {"voltage": "V", "frequency": "Hz"}


def signals(cof: float = 0.6, noise_n: float = 0.002, seed: int = 0) -> dict[str, np.ndarray]:
    """A slide of one stroke, with voltage in ON_S; forces in N, position in mm."""
    random = np.random.default_rng(seed)
    on = (ON_S[0] <= TIME_S) & (ON_S[1] >= TIME_S)
    force = LOAD_N * np.where(on, cof, OFF_COF) + noise_n * random.standard_normal(TIME_S.size)
    load = LOAD_N + noise_n * random.standard_normal(TIME_S.size)
    return dict(zip(NAMES, (TIME_S, force, load, 75.0 * on, 20.0 * TIME_S), strict=True))


def with_keys(**keys: dict[str, Any]) -> dict[str, Any]:
    """The map with more keys in its columns and sections."""
    found = {name: dict(part) if isinstance(part, dict) else part for name, part in MAP.items()}
    found["columns"] = {role: dict(column) for role, column in MAP["columns"].items()}
    for name, values in keys.items():
        place = found["columns"] if name in found["columns"] else found
        place[name] = {**place.get(name, {}), **values}
    return found


def cut(path: Path, said: dict[str, Any]) -> Cut:
    """The rows of one file."""
    return TrialFolder([path], TrialMap.model_validate(said), {}).cut()


def rows(path: Path, said: dict[str, Any]) -> list[Row]:
    """The rows of one file that can be used; what is wrong with it is raised."""
    found = cut(path, said)
    for _, error in found.bad:
        raise error
    return found.rows


def refusal(path: Path, said: dict[str, Any]) -> BadInputError:
    """Why a file is refused."""
    with pytest.raises(BadInputError) as caught:
        rows(path, said)
    return caught.value


def write_csv(path: Path, columns: dict[str, np.ndarray], header: Sequence[str] = ()) -> Path:
    """A CSV with these columns."""
    names = [f'"{name}"' if "," in name else name for name in header or columns]
    lines = [",".join(f"{x:.6f}" for x in row) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join([",".join(names), *lines, ""]))
    return path


def write_npz(path: Path, columns: dict[str, np.ndarray]) -> Path:
    """The same without text."""
    np.savez(path, **columns)  # type: ignore[arg-type]
    return path
