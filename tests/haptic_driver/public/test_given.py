"""What a script gives goes in by name and unit, and what is no input is a BadInputError."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas as pd
import pint
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

import haptic_driver as hd
from haptic_driver.lab.measured import measurements_of
from haptic_driver.lab.measuring.recordings import read_data
from haptic_driver.public.given import columns_of, in_si
from model.diagnosis.data import COLUMNS
from tests.haptic_driver.lab.raw_trials.made import MAP, signals, with_keys, write_csv
from tests.haptic_driver.lab.refusal import refused

UNITS = pint.UnitRegistry()
TABLE = {
    "frequency_hz": [100.0, 10000.0],
    "voltage_v": [125.0, 50.0],
    "normal_force_n": [0.25, 0.5],
    "cof": [0.9, 0.6],
    "session": ["a", "b"],
}


@pytest.mark.parametrize(
    ("name", "value", "si"),
    [
        ("normal_force_n", UNITS.Quantity(500, "mN"), 0.5),
        ("speed_m_s", xr.DataArray([20.0], attrs={"units": "mm/s"}), [0.02]),
        ("voltage_v", "100,5", 100.5),
        ("voltage_v", [75, None], [75.0, np.nan]),
        ("frequency_hz", pd.array([100, None], dtype="Int64"), [100.0, np.nan]),
        ("time_s", pd.to_timedelta(["1s", None]), [1.0, np.nan]),
        ("time_s", np.array([1500], "timedelta64[ms]"), [1.5]),
    ],
)
def test_a_value_in_its_own_unit(name, value, si):
    np.testing.assert_allclose(in_si(name, value), si, rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("frequency_hz", UNITS.Quantity(1.0, "kg")),
        ("voltage_v", True),
        ("voltage_v", 75.0 + 10.0j),
        ("time_s", np.array([1], "timedelta64")),
        ("time_s", pd.to_datetime(["2026-01-01"])),
    ],
)
def test_what_is_no_value_is_refused(name, value):
    with pytest.raises(hd.BadInputError, match=name):
        in_si(name, value)


CONDITIONS = {"frequency_hz": [250.0], "voltage_v": [75.0], "normal_force_n": [0.5]}


@pytest.mark.parametrize(
    ("table", "match"),
    [
        (pd.DataFrame({**CONDITIONS, "voltage_kv": [0.1]}), "voltage_v and voltage_kv"),
        (pd.concat(2 * [pd.DataFrame(CONDITIONS)], axis=1), "frequency_hz stands more than once"),
        (
            TABLE | {"speed_m_s": pd.Series([0.01, 0.02]), "time_s": pd.Series([1.0, 2.0], [1, 0])},
            "rows of time_s and of other columns have different labels",
        ),
        (
            TABLE | {"speed_m_s": pd.Series([0.01, 0.02], [1, 0])},
            "rows of speed_m_s and of other columns have different labels",
        ),
    ],
    ids=["two units", "twice", "two orders", "beside arrays"],
)
def test_a_table_that_says_two_things_is_refused(table, match):
    with pytest.raises(hd.BadInputError, match=match):
        hd.predict("reference", table)


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5) | st.binary(max_size=3),
    lambda inside: (
        st.lists(inside, max_size=4) | st.dictionaries(st.text(max_size=2), inside, max_size=2)
    ),
    max_leaves=8,
)


@given(name=st.sampled_from(["frequency_hz", "voltage_v", "cof"]), value=ANYTHING)
def test_whatever_is_given_is_numbers_or_refused(name, value):
    with suppress(hd.BadInputError):
        assert in_si(name, value).dtype == np.float64


LAB = {
    "frequency_khz": [0.1, 10.0],
    "voltage (Vpp)": [250.0, 100.0],
    "Normal_Force_N": [0.25, 0.5],
    "COF": [0.9, 0.6],
    "session": ["a", "b"],
}


@pytest.mark.parametrize("kind", ["dict", "frame", "dataset", "file"])
def test_a_table_is_the_same_in_any_form(tmp_path, kind):
    pd.DataFrame(LAB).to_csv(tmp_path / "lab.csv", index=False)
    made = {
        "dict": LAB,
        "frame": pd.DataFrame(LAB),
        "dataset": xr.Dataset({name: ("row", values) for name, values in LAB.items()}),
        "file": tmp_path / "lab.csv",
    }
    found = columns_of(made[kind], COLUMNS)
    for name, values in TABLE.items():
        np.testing.assert_array_equal(found[name], values)


def test_measured_data_in_memory_are_those_of_a_file(tmp_path):
    pd.DataFrame(TABLE).to_csv(tmp_path / "data.csv", index=False)
    expected, found = read_data([tmp_path / "data.csv"]), measurements_of(TABLE, COLUMNS)
    assert found.columns.keys() == expected.columns.keys()
    assert found.session_names == expected.session_names
    for name in found.columns:
        np.testing.assert_array_equal(found.columns[name], expected.columns[name])
    with pytest.raises(hd.BadInputError, match="the table, line 3: cof = -1"):
        measurements_of({**TABLE, "cof": [0.9, -1.0]}, COLUMNS)


def test_a_diagnosis_takes_a_table():
    found = hd.diagnose(pd.DataFrame(TABLE))
    assert found.verdict == "not_testable"
    with refused("bad_picture", "no picture"):
        found.plot("probabilitys")


@pytest.mark.parametrize(
    ("positive", "form", "code"),
    [
        (["yes", "no", "yes"] * 4, "weibull", "bad_answers"),
        ([-1, 1, 1] * 4, "weibull", "bad_answers"),
        ([True] * 5, "weibull", "bad_answers"),
        ([True] * 12, "logistic", "bad_form"),
    ],
)
def test_what_is_no_answer_is_refused(positive, form, code):
    """Answers as -1 and 1 gave a threshold; words and lengths gave the errors of numpy."""
    with refused(code):
        hd.fit_psychometric([1, 2, 3] * 4, positive, form, 0.5)


def test_trials_are_the_same_rows_from_files_and_from_memory(tmp_path):
    columns = signals()
    path = write_csv(tmp_path / "t.csv", columns)
    in_memory = columns | {"Fx": UNITS.Quantity(1e3 * columns["Fx"], "mN")}
    in_memory["t [ms]"] = 1e3 * in_memory.pop("t")
    said = with_keys()
    expected = hd.read_rows(path, map=said)
    for role in ("time", "lateral_force"):
        del said["columns"][role]["unit"]
    found = hd.read_rows(in_memory, map=said)
    # the file has six digits of the forces
    assert float(found.rows[0]["cof"]) == pytest.approx(float(expected.rows[0]["cof"]), rel=1e-5)
    assert float(expected.to_frame()["voltage_v"][0]) == 75.0
    assert expected.save(tmp_path / "rows.csv").exists()
    assert hd.diagnose(found).verdict == "not_testable"


@pytest.mark.parametrize("kind", ["rows", "frame", "file"])
def test_what_a_trial_leaves_in_doubt_stands_beside_the_verdict(tmp_path, kind):
    columns = signals()
    columns["U"][50:53] = 500.0
    found = hd.read_rows(write_csv(tmp_path / "t.csv", columns), map=MAP)
    assert found.doubts == ["a spike of the voltage was passed over, in 1 files (t.csv)"]
    data = {"rows": found, "frame": found.to_frame(), "file": found.save(tmp_path / "rows.csv")}
    said = str(hd.diagnose(data[kind]))
    assert "1 of 1 rows are in doubt" in said
    assert "a spike at 0.2 s" in said


def test_trials_that_cannot_be_used_are_refused_or_left_out(tmp_path):
    columns = signals()
    write_csv(tmp_path / "a.csv", columns)
    write_csv(tmp_path / "b.csv", columns | {"Fx": -columns["Fx"]})
    with pytest.raises(hd.BadInputError, match=r"b\.csv: friction is"):
        hd.read_rows(tmp_path, map=MAP)
    found = hd.read_rows([tmp_path / "a.csv", tmp_path / "b.csv"], map=MAP, leave_out_bad=True)
    assert len(found) == 1
    assert Path(found.left_out[0].split(":")[0]).name == "b.csv"


def test_a_dataset_with_records_among_its_attributes_is_saved(tmp_path):
    from haptic_driver.lookup import labelled

    about = {"rig": "r", "started_s": 1.0, "latency_s": {"generator": 0.01}, "ids": ["a"]}
    made = labelled.dataset({"time_s": np.arange(3.0)}, {"cof": np.ones(3)}, about)
    made.to_netcdf(tmp_path / "run.nc", engine="scipy")
    read = xr.load_dataset(tmp_path / "run.nc", engine="scipy")
    assert read.attrs["latency_s"] == '{"generator": 0.01}'
