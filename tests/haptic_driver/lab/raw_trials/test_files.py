"""Files of every kind, as labs save them, give the numbers that were written into them."""

from __future__ import annotations

import csv
import io
import random
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from haptic_driver.errors import BadInputError
from haptic_driver.lab.raw_trials.cut import tabled
from haptic_driver.lab.raw_trials.propose import in_name
from haptic_driver.lab.raw_trials.trial_map import Conditions
from tests.haptic_driver.lab.raw_trials.made import (
    MAP,
    NAMES,
    TIME_S,
    WINDOW_S,
    refusal,
    rows,
    signals,
    with_keys,
    write_csv,
)

SIGNALS = signals(seed=3)
FILE = settings(
    max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
FEW = settings(FILE, max_examples=5)
# how many of the unit is one in SI, for time, both forces, voltage and position
UNITS = {
    "t": {"s": 1.0, "ms": 1e3, "us": 1e6, "min": 1 / 60},
    "Fx": {"N": 1.0, "mN": 1e3, "gf": 1e3 / 9.80665, "lbf": 1 / 4.4482216152605},
    "Fz": {"N": 1.0, "mN": 1e3, "Newtons": 1.0, "kgf": 1 / 9.80665},
    "U": {"V": 1.0, "kV": 1e-3},
    "x": {"mm": 1e3, "m": 1.0, "um": 1e6},
}
STYLES = ("{n} [{u}]", "{n} ({u})", "{n}, {u}", "{n} / {u}", "{n}_{u}", "row")


def expected() -> float:
    """Mean friction in the window, by numpy alone."""
    inside = (WINDOW_S[0] < TIME_S) & (WINDOW_S[1] > TIME_S)
    return float(SIGNALS["Fx"][inside].mean() / SIGNALS["Fz"][inside].mean())


def without_units() -> dict[str, Any]:
    said = with_keys()
    said["columns"] = {role: {"name": c["name"]} for role, c in MAP["columns"].items()}
    return said


def by_index(name: str) -> dict[str, Any]:
    """Each column by its place in one array."""
    said = with_keys()
    for column in said["columns"].values():
        column |= {"name": name, "index": NAMES.index(column["name"]) + 1}
    return said


@FILE
@given(
    separator=st.sampled_from([",", ";", "\t"]),
    decimal=st.sampled_from([".", ","]),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "cp1252", "utf-32"]),
    quoting=st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL, csv.QUOTE_NONNUMERIC]),
    style=st.sampled_from(STYLES),
    preamble=st.sampled_from(["", "Messung Nr. 4\n\n", "Prüfer;Ö. Ä.\nmade, at noon\n"]),
    units=st.fixed_dictionaries({name: st.sampled_from(sorted(u)) for name, u in UNITS.items()}),
    seed=st.integers(0, 10**6),
)
def test_a_text_however_it_is_written(
    tmp_path, separator, decimal, encoding, quoting, style, preamble, units, seed
):
    order = list(NAMES)
    random.Random(seed).shuffle(order)
    si = SIGNALS | {"x": 1e-3 * SIGNALS["x"]}
    columns = [UNITS[name][units[name]] * si[name] for name in order]
    names = order if style == "row" else [style.format(n=n, u=units[n]) for n in order]
    text = io.StringIO()
    writer = csv.writer(text, delimiter=separator, quoting=quoting, lineterminator="\n")
    writer.writerow(names)
    if style == "row":
        writer.writerow([units[name] for name in order])
    for row in zip(*columns, strict=True):
        writer.writerow([f"{value:.9g}".replace(".", decimal) for value in row])
    path = tmp_path / "trial.csv"
    path.write_bytes((preamble + text.getvalue()).encode(encoding))
    assert rows(path, without_units())[0]["cof"] == pytest.approx(expected(), rel=1e-6)


def containers(path: Path, columns: dict[str, np.ndarray], units: dict[str, str]) -> None:
    """A file of the kind of its ending, with units where that kind has a place for them."""
    match path.suffix:
        case ".npz":
            np.savez(path, **columns)  # type: ignore[arg-type]
        case ".mat":
            savemat(path, columns)
        case ".h5":
            with h5py.File(path, "w") as file:
                for i, (name, values) in enumerate(columns.items()):
                    file[name] = values if i % 2 else values[:, None]
                    unit: Any = units[name]
                    file[name].attrs["units"] = [unit, np.array([unit], "S9"), unit.encode()][i % 3]
        case ".tdms":
            with TdmsWriter(path) as writer:
                for name, values in columns.items():
                    said = {"unit_string": units[name]}
                    writer.write_segment([ChannelObject("g", name, values, properties=said)])
        case ".lvm":
            names = "\t".join(["X_Value", *list(columns)[1:], "Comment"])
            head = (
                "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t,\n"
                f"X_Columns\tOne\n***End_of_Header***\t\n\nChannels\t{len(columns) - 1}\t\n"
                f"Y_Unit_Label\t{chr(9).join(units[name] for name in NAMES[1:])}\t\n"
                "***End_of_Header***\t\n"
            )
            lines = [
                "\t".join(f"{v:.9g}".replace(".", ",") for v in row)
                for row in zip(*columns.values(), strict=True)
            ]
            path.write_text(f"{head}{names}\n" + "\n".join(lines) + "\n")


@pytest.mark.parametrize("ending", [".npz", ".mat", ".h5", ".lvm", ".tdms"])
@FILE
@given(units=st.fixed_dictionaries({n: st.sampled_from(sorted(u)) for n, u in UNITS.items()}))
def test_a_file_of_another_kind(tmp_path, ending, units):
    units["t"] = "s" if ending == ".lvm" else units["t"]
    si = SIGNALS | {"x": 1e-3 * SIGNALS["x"]}
    path = tmp_path / f"trial{ending}"
    containers(path, {name: UNITS[name][units[name]] * si[name] for name in NAMES}, units)
    said = without_units()
    for column in said["columns"].values():
        if ending in (".npz", ".mat"):
            column["unit"] = units[column["name"]]
        elif column["name"] == "t" and ending == ".lvm":
            column["name"] = "X_Value"
        if ending == ".tdms":
            column["name"] = f"g/{column['name']}"
    assert rows(path, said)[0]["cof"] == pytest.approx(expected(), rel=1e-6)


def test_a_matlab_table_is_said_to_be_one(tmp_path):
    with h5py.File(tmp_path / "t.mat", "w", userblock_size=512) as file:
        kept = file.create_dataset("T", data=np.array([[3707764736, 2, 1, 1]], dtype=np.uint32))
        kept.attrs["MATLAB_object_decode"] = 3
    content = bytearray((tmp_path / "t.mat").read_bytes())
    content[:19], content[124:128] = b"MATLAB 7.3 MAT-file", b"\x00\x02IM"
    (tmp_path / "t.mat").write_bytes(content)
    assert "table2struct" in refusal(tmp_path / "t.mat", MAP).hint


@pytest.mark.parametrize("transposed", [False, True])
def test_a_matrix_is_read_along_its_longer_side(tmp_path, transposed):
    """MATLAB 7.3 stores a matrix transposed."""
    table = np.column_stack(list(SIGNALS.values()))
    with h5py.File(tmp_path / "t.h5", "w") as file:
        file["data"] = table.T if transposed else table
    found = rows(tmp_path / "t.h5", by_index("data"))
    assert found[0]["cof"] == pytest.approx(expected(), rel=1e-9)


def test_a_cell_array_of_columns_goes_by_index(tmp_path):
    cells = np.empty(len(NAMES), dtype=object)
    for i, values in enumerate(SIGNALS.values()):
        cells[i] = values
    savemat(tmp_path / "t.mat", {"ch": cells})
    found = rows(tmp_path / "t.mat", by_index("ch"))
    assert found[0]["cof"] == pytest.approx(expected(), rel=1e-9)


@pytest.mark.parametrize(("late_s", "step_s"), [(0, 0.004), (3, 0.004), (0, 0.001)])
def test_waveforms_of_other_times_are_refusal(tmp_path, late_s, step_s):
    """Channels were put beside each other whenever they began, at the map's rate."""
    path, began = tmp_path / "t.tdms", np.datetime64("2015-11-20T20:13:43")
    with TdmsWriter(path) as writer:
        for name in NAMES[1:]:
            start = began + np.timedelta64(late_s if name == "Fz" else 0, "s")
            said = {"wf_increment": step_s, "wf_start_time": start}
            writer.write_segment([ChannelObject("g", name, SIGNALS[name], properties=said)])
    said = with_keys(file={"rate_hz": 250.0})
    del said["columns"]["time"]
    for column in said["columns"].values():
        column["name"] = f"g/{column['name']}"
    if not late_s and step_s == 0.004:
        assert rows(path, said)[0]["cof"] == pytest.approx(expected(), rel=1e-9)
    else:
        wanted = "begin at different times" if late_s else "is at 1000 Hz by the file"
        assert wanted in refusal(path, said).message


@pytest.mark.parametrize("style", STYLES[:5])
@pytest.mark.parametrize(
    ("name", "role", "mapped", "header"),
    [
        ("Fx", "lateral_force", "N", "mN"),
        ("Fz", "normal_force", "N", "V"),
        ("x", "position", "mm", "um"),
    ],
)
def test_a_unit_of_the_map_is_compared_with_the_files(tmp_path, name, role, mapped, header, style):
    """A map's N counted over a header's mN, without a word."""
    names = [style.format(n=name, u=header) if each == name else each for each in NAMES]
    path = write_csv(tmp_path / "t.csv", SIGNALS, names)
    error = refusal(path, MAP)
    assert error.code == "unit_conflict"
    assert f"in {mapped} by the map, and in {header} by " in error.message
    said = with_keys(**{role: {"overrides_file": True}})
    assert rows(path, said)[0]["cof"] == pytest.approx(expected(), rel=1e-5)


@pytest.mark.parametrize("names", [("Fx [V]", "Fx [N]"), ("Fx", "Fx")])
def test_a_name_that_stands_twice_is_refusal(tmp_path, names):
    columns = {"t": TIME_S, "a": SIGNALS["Fx"] / 3.0, "b": SIGNALS["Fx"]}
    columns |= {name: SIGNALS[name] for name in ("Fz", "U", "x")}
    path = write_csv(tmp_path / "t.csv", columns, ["t", *names, "Fz", "U", "x"])
    assert f"Fx stands more than once: '{names[0]}', '{names[1]}'" in refusal(path, MAP).message
    if names[0] != names[1]:
        said = with_keys(lateral_force={"name": "Fx [N]"})
        assert rows(path, said)[0]["cof"] == pytest.approx(expected(), rel=1e-5)


def test_a_comma_that_can_be_either_is_asked_about(tmp_path):
    scaled = SIGNALS | {"Fz": np.full(TIME_S.size, 77.0)}
    text = write_csv(tmp_path / "t.csv", scaled).read_text().replace(",", ";")
    path = tmp_path / "u.csv"
    path.write_text(text.replace("77.000000", "77,000"))
    error = refusal(path, MAP)
    assert "'77,000' can be 77000 or 77.000" in error.message
    for decimal, load_n in ((",", 77.0), (".", 77000.0)):
        said = with_keys(file={"decimal": decimal})
        assert rows(path, said)[0]["normal_force_n"] == load_n


def lvm_segment(columns: dict[str, np.ndarray]) -> str:
    rows = ["\t".join(f"{v:.9g}" for v in row) for row in zip(*columns.values(), strict=True)]
    head = f"Channels\t{len(columns)}\n***End_of_Header***\n"
    return f"{head}{chr(9).join(['X_Value', *columns])}\n" + "".join(f"\t{r}\n" for r in rows)


@FEW
@given(
    cofs=st.lists(st.floats(0.2, 1.5), min_size=2, max_size=4),
    title=st.booleans(),
    units=st.booleans(),
    labview=st.booleans(),
)
def test_of_several_tables_one_is_taken(tmp_path, cofs, title, units, labview):
    tables = [signals(cof, 0.001) for cof in cofs]
    path = tmp_path / ("t.lvm" if labview else "t.csv")
    if labview:
        head = "LabVIEW Measurement\nSeparator\tTab\n***End_of_Header***\n"
        path.write_text(head + "\n".join(map(lvm_segment, tables)))
    else:
        texts = [write_csv(path, table).read_text() for table in tables]
        below = "t,Fx,Fz,U,x\n" + "s,N,N,V,mm\n" * units
        text = "".join(("Trial\n" * title) + t.replace("t,Fx,Fz,U,x\n", below) for t in texts)
        path.write_text(text)
    error = refusal(path, MAP)
    assert error.code == "several_tables"
    assert f"holds {len(cofs)} tables, in lines " in error.message
    lines = path.read_text().splitlines()
    spans = [span.split(" to ") for span in error.message.split("in lines ")[1].split(", ")]
    for number, ((first, last), cof) in enumerate(zip(spans, cofs, strict=True), start=1):
        assert "Fx" in lines[int(first) - 1]
        assert lines[int(last) - 1].strip().startswith(f"{TIME_S[-1]:.3f}")
        found = rows(path, with_keys(file={"table": number}))
        # five standard errors of 250 samples with 1 mN of noise, over 0.5 N
        assert found[0]["cof"] == pytest.approx(cof, abs=5e-3 / 0.5 / 250**0.5 * (1 + cof))
    assert "tables" in refusal(path, with_keys(file={"table": len(cofs) + 1})).message


@FILE
@given(
    content=st.binary(min_size=2, max_size=400), mark=st.sampled_from([b"\xff\xfe", b"\xfe\xff"])
)
def test_what_only_begins_like_a_text_is_no_text(tmp_path, content, mark):
    path = tmp_path / "t.csv"
    path.write_bytes(mark + bytes(byte | 0x80 for byte in content))
    error = refusal(path, MAP)
    assert error.code == "file_unreadable"
    assert "is not text" in error.message


@pytest.mark.parametrize("separator", [",", "\t"])
def test_a_column_is_counted_as_it_stands_in_the_file(tmp_path, separator):
    """Columns of words were not counted: of a unit beside each number, the next was taken."""
    names = {1: "time", 3: "lateral_force", 5: "normal_force", 7: "voltage", 9: "position"}
    said = with_keys(file={"header_line": 0}, **{role: {"name": n} for n, role in names.items()})
    cells = zip(*SIGNALS.values(), strict=True)
    lines = [separator.join(f"{v:.9g}{separator}V" for v in row) for row in cells]
    path = tmp_path / "t.csv"
    path.write_text("\n".join(lines))
    assert rows(path, said)[0]["cof"] == pytest.approx(expected(), rel=1e-6)


@pytest.mark.parametrize(
    ("column", "written"),
    [("t", lambda v: f"{1e6 * v:,.3f}".replace(",", "'")), ("Fx", lambda v: f"\u2212{v:.9g}")],
)
def test_numbers_with_swiss_thousands_or_a_minus_of_print(tmp_path, column, written):
    path = write_csv(tmp_path / "t.csv", SIGNALS)
    head, *lines = (line.split(",") for line in path.read_text().splitlines())
    at = head.index(column)
    for line, value in zip(lines, SIGNALS[column], strict=True):
        line[at] = written(value)
    path.write_text("\n".join(map(",".join, [head, *lines])))
    said = with_keys(lateral_force={"sign": -1} if column == "Fx" else {})
    said["columns"]["time"]["unit"] = "us" if column == "t" else "s"
    assert rows(path, said)[0]["cof"] == pytest.approx(expected(), rel=1e-5)


def test_a_column_of_words_is_named_with_its_first_cell(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("t,Fx,Fz,U,x\n" + "".join(f"{t:.3f},0.3 mN,1,75,1\n" for t in TIME_S))
    assert "column Fx has no number; its first cell is '0.3 mN'" in refusal(path, MAP).message


@FILE
# the voltage is felt by two counts and more: a signal of two values alone may have a spike
@given(scale=st.floats(1e-4, 4e-2), offset=st.floats(-1.0, 1.0))
def test_what_a_file_packs_is_unpacked(tmp_path, scale, offset):
    """The counts of a force with scale_factor and add_offset were taken as newtons."""
    path = tmp_path / "t.h5"
    counts = np.round((SIGNALS["Fx"] - offset) / scale).astype(np.int32)
    with h5py.File(path, "w") as file:
        for name in NAMES:
            file[name] = SIGNALS[name]
        del file["Fx"]
        file["Fx"] = counts
        file["Fx"].attrs.update(scale_factor=scale, add_offset=offset, _FillValue=np.int32(1 << 30))
    # a count is a step of `scale`
    assert rows(path, MAP)[0]["cof"] == pytest.approx(expected(), abs=scale)
    with h5py.File(path, "a") as file:
        file["Fx"][int(np.argmax(TIME_S > 1.8))] = 1 << 30
    assert "lateral_force is no number at 1.804 s" in refusal(path, MAP).message


@pytest.mark.parametrize("name", ["conversion", "scale", "gain"])
def test_a_scale_beside_the_numbers_is_applied_or_refusal(tmp_path, name):
    path = tmp_path / "t.h5"
    with h5py.File(path, "w") as file:
        for key in NAMES:
            file[key] = SIGNALS[key] / (0.002 if key == "Fx" else 1.0)
        file["Fx"].attrs[name] = 0.002
    if name != "conversion":
        assert f"its attribute says {name} = 0.002" in refusal(path, MAP).message
    gain = {} if name == "conversion" else {"gain": 0.002}
    assert rows(path, with_keys(lateral_force=gain))[0]["cof"] == pytest.approx(expected())


def test_a_name_and_a_row_of_units_that_differ_are_refusal(tmp_path):
    path = write_csv(tmp_path / "t.csv", SIGNALS, ["t_s", "Fx_mN", "Fz_N", "U_V", "x_mm"])
    head, body = path.read_text().split("\n", 1)
    path.write_text(f"{head}\ns,N,N,V,mm\n{body}")
    names = zip(MAP["columns"], ("t_s", "Fx_mN", "Fz_N", "U_V", "x_mm"), strict=True)
    said = with_keys()
    said["columns"] = {role: {"name": name} for role, name in names}
    assert "is in mN by its name, and in N by the row of units" in refusal(path, said).message


@pytest.mark.parametrize("text", ["1e-3Hz", "1k5Hz", "2.5-7Hz"])
def test_the_tail_of_a_number_is_none(text):
    assert set(in_name(Path(f"slide_{text}_100V.csv"))) == {"voltage"}
    assert set(in_name(Path(f"slide_f0p5Hz_{text}.csv"))) == {"frequency"}


def test_a_header_of_more_names_than_cells_is_refusal(tmp_path):
    """Commas within names without quotes moved every name by a column."""
    path = write_csv(tmp_path / "t.csv", SIGNALS)
    path.write_text(path.read_text().replace("t,Fx,Fz", "t,Fx, N,Fz"))
    assert "5 cells under 6 names" in refusal(path, MAP).message


@pytest.mark.parametrize(
    "stamp", ["{:%Y-%m-%dT%H:%M:%S.%f}", "{:%Y/%m/%d %H:%M:%S.%f}", "{:%H:%M:%S.%f}"]
)
def test_dates_and_times_of_day_are_times(tmp_path, stamp):
    start = datetime(2024, 5, 1, 23, 59, 59)
    stamps = [stamp.format(start + timedelta(seconds=float(s))) for s in TIME_S]
    cells = zip(stamps, *list(SIGNALS.values())[1:], strict=True)
    path = tmp_path / "t.csv"
    path.write_text("\n".join(["t,Fx,Fz,U,x", *(",".join(map(str, row)) for row in cells)]))
    assert rows(path, MAP)[0]["cof"] == pytest.approx(expected(), rel=1e-6)


def test_a_file_that_stands_twice_among_the_conditions_is_refusal(tmp_path):
    (tmp_path / "set.csv").write_text("file,voltage\na.csv,10\na.csv,20\n")
    with pytest.raises(BadInputError, match=r"line 3: a.csv stands more than once"):
        tabled(Conditions(table="set.csv"), tmp_path)
