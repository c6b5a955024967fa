"""Arrays with their names and units, for pandas and xarray: packages that are asked for only
here.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from haptic_driver.errors import optional
from model.support.units import BY_ENDING

UNITS = BY_ENDING | {
    "_v_per_s": "V/s",
    "_a_per_v": "A/V",
    "_a_per_v_m2": "A/(V m²)",
    "electrode_voltage": "V",
    "current": "A",
    "_pct": "%",
    "_c": "°C",
}


def unit_of(name: str) -> str:
    """What a name says of its unit; "1" for a pure number."""
    return UNITS.get(max(filter(name.endswith, UNITS), key=len, default=""), "1")


def frame(columns: Mapping[str, Any], about: Mapping[str, Any]) -> Any:
    """A pandas DataFrame of columns [n]; `attrs` holds `about` and the `units` of every column.

    HapticError where pandas is not installed.
    """
    made = optional("pandas", "tables", "to_frame").DataFrame(dict(columns))
    made.attrs = {**about, "units": {name: unit_of(name) for name in columns}}
    return made


def dataset(axes: Mapping[str, Any], variables: Mapping[str, Any], about: Mapping[str, Any]) -> Any:
    """An xarray Dataset over `axes` in their order; a variable of fewer dimensions lies along the
    first ones.

    Every variable has the attribute `units`. HapticError where xarray is not installed.
    """
    xarray = optional("xarray", "tables", "to_xarray")
    dimensions = list(axes)
    return xarray.Dataset(
        {
            name: (dimensions[: values.ndim], values, {"units": unit_of(name)})
            for name, values in variables.items()
        },
        coords={name: (name, values, {"units": unit_of(name)}) for name, values in axes.items()},
        attrs={name: _attribute(value) for name, value in about.items()},
    )


def _attribute(value: Any) -> Any:
    """What a netCDF file can hold: numbers and texts as they are, all else as JSON."""
    return value if isinstance(value, str | float | int) else json.dumps(value, default=str)
