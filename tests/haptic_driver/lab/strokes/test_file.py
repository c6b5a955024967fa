"""The file of strokes: what it holds for others, and what a kill, a resume and a stranger do."""

from __future__ import annotations

import os
from pathlib import Path

import h5py
import numpy as np
import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.lab.strokes.file import (
    StrokesFile,
    export_strokes,
    is_strokes,
    read_strokes,
    strokes_path,
)
from haptic_driver.recording import records
from tests.haptic_driver.commands import rows_of
from tests.haptic_driver.lab.refusal import refused
from tests.haptic_driver.lab.strokes.stroke_files import ABOUT, stroke, written


@pytest.fixture
def path(tmp_path):
    return strokes_path(tmp_path / "data.csv")


def killed(path: Path, *rows: int) -> None:
    """Strokes as a kill leaves them: records, and no HDF5."""
    begun = StrokesFile.create(path, ABOUT)
    for row in rows:
        begun.append(stroke(row, cof=0.5 + 0.01 * row))
    os.close(begun._descriptor)


def test_it_lies_beside_its_data_and_h5py_alone_reads_it(path):
    assert path.name == "data.strokes.h5"
    written(path, [stroke(1, cof=0.55), stroke(2, cof=0.6, trial=2)])
    with h5py.File(path) as file:
        assert file["rows/row"][:].tolist() == [1, 2]
        assert file["rows/trial"][:].tolist() == [1, 2]
        assert file["rows/waveform"].asstr()[:].tolist() == ["sine", "sine"]
        assert file["rows/first_sample"][:].tolist() == [0, 350]
        assert file["rows/samples"][:].tolist() == [350, 350]
        lateral_n = file["samples/lateral_force_n"][:]
        steady = file["samples/steady"][:] == 1
        assert file["samples"].attrs.keys() == set()
        assert (file.attrs["plan"], file.attrs["simulated"]) == ("p", 1.0)
    assert lateral_n.size == 700
    assert lateral_n[:350][steady[:350]] == pytest.approx(0.5 * 0.55)
    assert lateral_n[350:][steady[350:]] == pytest.approx(0.5 * 0.6)
    assert not records.records_of(path).exists()


def test_what_is_read_is_what_was_written(path):
    given = [stroke(1), stroke(2, frequency_hz=0.0, voltage_v=0.0)]
    found = read_strokes(written(path, given))
    assert [one.row for one in found.strokes] == [one.row for one in given]
    for one, other in zip(found.strokes, given, strict=True):
        for name in one.samples.dtype.names or ():
            np.testing.assert_array_equal(one.samples[name], other.samples[name])


def test_a_kill_leaves_every_stroke_that_was_whole(path):
    killed(path, 1, 2, 3)
    left = records.records_of(path)
    os.truncate(left, left.stat().st_size - 100)  # in the middle of the third
    assert not path.exists()
    assert is_strokes(path)
    assert [one.row.row for one in read_strokes(path).strokes] == [1, 2]


def test_what_a_kill_has_left_is_gone_on_with(path):
    killed(path, 1, 2)
    with StrokesFile.resume(path, ABOUT) as file:
        assert [one.row.row for one in read_strokes(path).strokes] == [1, 2]
        file.append(stroke(2, cof=0.9))  # its row had not been written
        file.append(stroke(3))
    assert not records.records_of(path).exists()
    found = read_strokes(path).strokes
    assert [one.row.row for one in found] == [1, 2, 3]
    assert found[1].samples["lateral_force_n"][-1] == pytest.approx(0.5 * 0.9)


def test_a_new_one_forgets_what_was_there(path):
    killed(path, 1, 2)
    assert [one.row.row for one in read_strokes(written(path, [stroke(7)])).strokes] == [7]


def test_a_failure_while_measuring_leaves_hdf5(path):
    file = StrokesFile.create(path, ABOUT)
    file.append(stroke(1))
    file.__exit__(KeyboardInterrupt, KeyboardInterrupt(), None)
    assert len(read_strokes(path).strokes) == 1
    assert path.exists()


def test_as_a_table_every_line_says_what_was_commanded(path, tmp_path):
    written(path, [stroke(1), stroke(2, trial=2, cof=0.7)])
    assert export_strokes(path, tmp_path / "s.csv") == 700
    last = rows_of(tmp_path / "s.csv")[-1]
    assert (last["row"], last["trial"], last["frequency_hz"]) == ("2", "2", "250.0")
    assert (last["commanded_normal_force_n"], last["steady"]) == ("0.5", "1")
    assert float(last["lateral_force_n"]) == pytest.approx(0.35)
    assert last["monitor_current_a"] == ""
    with pytest.raises(BadInputError, match="exists already"):
        export_strokes(path, tmp_path / "s.csv")


def test_pandas_and_parquet(path, tmp_path):
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    written(path, [stroke(1, cof=0.6), stroke(2, trial=2, cof=0.7)])
    export_strokes(path, tmp_path / "s.parquet")
    for table in (pandas.read_parquet(tmp_path / "s.parquet"), read_strokes(path).to_frame()):
        steady = table[table.steady == 1]
        cof = steady.lateral_force_n / steady.normal_force_n
        assert cof.groupby(steady.trial).mean().to_list() == pytest.approx([0.6, 0.7])


def version(file: h5py.File) -> None:
    file.attrs["format_version"] = 2.0


def claims_more(file: h5py.File) -> None:
    file["rows/samples"][0] = 1000


def without(file: h5py.File) -> None:
    del file["samples/steady"]


def elsewhere(file: h5py.File) -> None:
    del file["samples/steady"]
    file["samples/steady"] = h5py.ExternalLink("other.h5", "/steady")


def foreign(file: h5py.File) -> None:
    file.clear()
    file.attrs.clear()


@pytest.mark.parametrize(
    ("harm", "code"),
    [
        (version, "strokes_version"),
        (claims_more, "strokes_unreadable"),
        (without, "strokes_unreadable"),
        (elsewhere, "strokes_unreadable"),
        (foreign, "strokes_foreign"),
    ],
)
def test_what_is_no_file_of_strokes_is_refused(path, harm, code):
    with h5py.File(written(path, [stroke()]), "r+") as file:
        harm(file)
    with refused(code, str(path)):
        read_strokes(path)


def test_what_is_no_hdf5_is_refused(path):
    with refused("no_strokes", str(path)):
        read_strokes(path)
    path.write_text("frequency_hz,cof\n")
    with refused("strokes_unreadable", str(path)):
        read_strokes(path)
