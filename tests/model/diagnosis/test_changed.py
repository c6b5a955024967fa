"""The ranges in which an effect changes friction."""

from __future__ import annotations

from itertools import product

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from model.diagnosis.changed import places
from model.diagnosis.data import Measurements

GRID = np.array([(f, v, n) for f, v, n in product((1.0, 10.0, 1e3), (50.0, 100.0), (0.2, 0.5))])
REST = np.array([(0.0, 0.0, n) for n in (0.2, 0.5)])  # no voltage, so no frequency
ROWS = np.vstack([GRID, REST])
NAMES = ("frequency_hz", "voltage_v", "normal_force_n")


def measured() -> Measurements:
    columns = dict(zip(NAMES, ROWS.T, strict=True)) | {"cof": np.ones(len(ROWS))}
    return Measurements(columns, np.zeros(len(ROWS), np.intp), ("1",), None, "")


@given(st.lists(st.booleans(), min_size=len(ROWS), max_size=len(ROWS)))
@settings(max_examples=50)
def test_ranges_hold_the_rows_and_no_others(rows):
    data, wanted = measured(), np.array(rows)
    held = np.zeros(len(ROWS), bool)
    for box in places(data, np.where(wanted, 0.9, 0.1)):
        inside = np.ones(len(ROWS), bool)
        for name, (low, high) in box.items():
            values = data.columns[name]
            inside &= (values >= low) & (values <= high)
            inside &= data.driven if name == "frequency_hz" else True
        held |= inside
    assert list(held) == list(wanted)


def test_one_range_is_one_range_by_the_fewest_inputs():
    high = ROWS[:, 1] > 60.0
    found = places(measured(), high.astype(float))
    assert found == [{"voltage_v": (100.0, 100.0)}]
