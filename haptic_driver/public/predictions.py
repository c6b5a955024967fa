"""The model's answers for numbers, arrays and tables."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_driver.errors import BadInputError
from haptic_driver.files import bad_input
from haptic_driver.lookup import labelled
from haptic_driver.lookup.models import load_model
from haptic_driver.public.given import bad_given, columns_of, in_si, require_one_index
from model.conditions import Conditions
from model.description import ModelDescription
from model.support.errors import nearest
from model.touch_model import Prediction, TouchModel

ASKED = tuple(field.name for field in fields(Conditions))
SHOWN = ("electrostatic_force_n", "cof", "current_rms_a")


@dataclass(frozen=True)
class Predictions:
    """Answers of the model; every array has the common shape of what was asked.

    `conditions` holds what was asked, by name. All are NaN where the contact pulls in or its
    pressure leaves the contact theory's table, `cof` also where no finger slides.
    """

    conditions: dict[str, NDArray[Any]]
    electrostatic_force_n: NDArray[np.float64]
    cof: NDArray[np.float64]
    current_rms_a: NDArray[np.float64]
    notes: tuple[str, ...]

    def to_frame(self) -> Any:
        """A pandas DataFrame, one row per condition. HapticError where pandas is not installed."""
        return labelled.frame({name: np.ravel(v) for name, v in self._columns().items()}, {})

    def to_xarray(self) -> Any:
        """An xarray Dataset over `row`. HapticError where xarray is not installed."""
        columns = {name: np.ravel(v) for name, v in self._columns().items()}
        return labelled.dataset({"row": np.arange(self.cof.size)}, columns, {})

    def _columns(self) -> dict[str, NDArray[Any]]:
        return self.conditions | {name: getattr(self, name) for name in SHOWN}

    def __str__(self) -> str:
        columns = self._columns()
        rows = zip(*(np.ravel(values).tolist() for values in columns.values()), strict=True)
        lines = ["  ".join(columns)]
        for row in rows:
            cells = (f"{v:.4g}" if isinstance(v, float) else str(v) for v in row)
            lines.append("  ".join(f"{c:>{len(n)}}" for c, n in zip(cells, columns, strict=True)))
        return "\n".join(lines)


def predict(model: ModelDescription | str, table: Any = None, **conditions: Any) -> Predictions:
    """Ask a model for force, friction and current.

    Conditions are named as in data files: `frequency_hz`, `voltage_v` (peak at the electrode),
    `normal_force_n`, and what else `model.conditions.Conditions` has. They may be numbers or arrays
    that broadcast, with units by pint. Or they are columns of a `table`: a CSV, a pandas DataFrame
    or a dict, whose names may say other units, as `speed_mm_s`. BadInputError for an unknown name
    and for a value without physical meaning.
    """
    for name in conditions:
        if name not in ASKED:
            raise BadInputError(
                "bad_condition", f"{name} is no condition", nearest(name, list(ASKED))
            )
    given = {} if table is None else columns_of(table, ASKED)
    require_one_index(conditions)
    given |= {name: in_si(name, value) for name, value in conditions.items()}
    for name in ASKED[:3]:
        if name not in given:
            raise BadInputError("bad_condition", f"{name} is missing", f"Give {name}=...")
    with bad_given("bad_condition", "the conditions"):
        whole = dict(zip(given, np.broadcast_arrays(*given.values()), strict=True))
    description = load_model(model) if isinstance(model, str) else model
    with bad_input("bad_condition"):
        answer = TouchModel(description).predict(
            Conditions(**{name: np.ravel(values) for name, values in whole.items()})
        )
    return _shaped(whole, answer)


def _shaped(whole: dict[str, NDArray[Any]], answer: Prediction) -> Predictions:
    shape = next(iter(whole.values())).shape
    shown = {name: np.reshape(getattr(answer, name), shape) for name in SHOWN}
    return Predictions(whole, notes=answer.notes, **shown)
