"""Tables as people save them: what is read, and what is said of the rest."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from model.diagnosis.data import read_measurements
from model.electric.dielectrics import read_csv
from model.support.cells import read_cell, written_cell
from model.support.errors import ModelError
from model.support.reading import LARGEST_FILE_BYTES, read_bytes
from model.support.tables import BadRowsError, Table, read_table

WANTED = "Give columns a, b"


def table(folder: Path, text: str | bytes) -> Table:
    return read_table(file(folder, text), ("a", "b"), WANTED)


def file(folder: Path, text: str | bytes) -> Path:
    path = folder / "table.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize(
    "text",
    [
        "a,b\n1,2\n",
        "a,b\r\n1,2\r\n",
        "\ufeffa,b\n1,2",
        " a , b \n 1 , 2 \n",
        '"a","b"\n"1","2"\n',
        "a,b,,\n1,2,,\n",
        "a,b\n,\n\n1,2\n , \n",
        "# a measurement of a\na,b\n1,2\n",
        "a;b\n1;2\n",
        "a\tb\n1\t2\n",
        "sep=;\na;b\n1;2\n",
        "a,b\n1,2\n".encode("utf-16"),
        "a,b\n1,2\n".encode("utf-32"),
    ],
)
def test_what_spreadsheets_add_is_no_mistake(tmp_path, text):
    read = table(tmp_path, text)
    assert read.columns == ["a", "b"]
    assert read.rows == [{"a": "1", "b": "2"}]


def test_a_table_knows_its_lines_and_its_bytes(tmp_path):
    content = b'a,b\n1,2\n\n"3\n",4\n'
    read = table(tmp_path, content)
    assert read.lines == [2, 5]  # a cell over two lines: the line where the row ends
    assert read.where(1) == f"{tmp_path / 'table.csv'}, line 5"
    assert read.content_hash == hashlib.sha256(content).hexdigest()


def test_a_column_as_numbers(tmp_path):
    read = table(tmp_path, "a,b\n1,x\n,2\n3,\n")
    np.testing.assert_array_equal(read.numbers("a", where_empty=7.0), [1.0, 7.0, 3.0])
    np.testing.assert_array_equal(
        read.numbers("b", ignored=np.array([True, False, True])), [0.0, 2.0, 0.0]
    )


@pytest.mark.parametrize("text", ["high", "", "nan", "inf", "0,5", "1e999", "75 V", "1_25"])
def test_what_is_no_number_is_named_with_file_line_and_column(tmp_path, text):
    read = table(tmp_path, f'a,b\n1,2\n\n3,"{text}"\n')
    with pytest.raises(ModelError, match=f"line 4: b is '{text}', not a number") as caught:
        read.numbers("b")
    assert caught.value.code == "not_a_number"
    assert WANTED in caught.value.hint


@pytest.mark.parametrize(
    ("text", "code", "says", "hint"),
    [
        ("a,b\n0,5,2\n", "bad_table", "line 2: has more fields", "0.5, not 0,5"),
        ("a,b,b\n1,2,3\n", "bad_table", "'b' stands more than once", "Keep one"),
        ("a,,b,\n1,2,3,4\n", "bad_table", "line 2: has more fields", "commas"),
        ("a,c\n1,2\n", "missing_column", "column b is missing; found: a, c", WANTED),
        ("# a,b\n1,2\n", "bad_table", "its header is commented out, in line 1", "Remove the #"),
        ("Lab 4\n\na,b\n1,2\n", "bad_table", "stands in line 3", "Delete the lines above line 3"),
        ("Test, Rig\n9 N,3\nt,x,y\n1,2,3\n", "bad_table", "stands in line 3", "begin each of them"),
        ("1,2\n3,4\n", "bad_table", "line 1: holds numbers where", "Give a header"),
        ("a b\n1.0 2.0\n", "bad_table", "separated by spaces", "commas between the columns"),
        ("", "missing_column", "column a is missing (the file is empty)", WANTED),
        (b"\x89HDF\r\n\x1a\n\0\0", "file_unreadable", "is not UTF-8 text", "a binary file: export"),
        (b"\xff\xfea\x00b", "file_unreadable", "is not text in utf-16", WANTED),
        ("a;b\n1;2,500\n", "ambiguous_number", "b: '2,500' can be 2500 or 2.500", "decimal"),
        ("a,b\n" + "9" * 200_000, "bad_table", "line 2: is not CSV", WANTED),
    ],
)
def test_what_is_wrong_with_a_table_is_said(tmp_path, text, code, says, hint):
    with pytest.raises(ModelError) as caught:
        table(tmp_path, text)
    assert caught.value.code == code
    assert str(tmp_path / "table.csv") in caught.value.message
    assert says in caught.value.message
    assert hint in caught.value.hint


@pytest.mark.parametrize(
    ("values", "says", "hint"),
    [
        ([0, 1, 1, 2], "line 4: a does not rise: 1 again, as 1 of 4 rows", "more digits"),
        ([0, 1, 2, 0, 1, 2], "line 5: a does not rise: it begins again, from 2 to 0: 2", "Apart"),
        ([0, 2, 1, 3], "line 4: a does not rise: 1 after 2", "Sort the rows by a"),
    ],
)
def test_what_does_not_rise_is_said_by_its_kind(tmp_path, values, says, hint):
    read = table(tmp_path, "a,b\n" + "".join(f"{value},0\n" for value in values))
    with pytest.raises(ModelError) as caught:
        read.require_rising("a", read.numbers("a"), "Apart")
    assert says in caught.value.message
    assert hint in caught.value.hint
    read = table(tmp_path, "a,b\n1,0\n2,0\n")
    read.require_rising("a", read.numbers("a"), "Apart")


def test_a_file_that_cannot_be_read_is_named(tmp_path, monkeypatch):
    for path, code in [
        (tmp_path / "none.csv", "file_not_found"),
        (tmp_path, "file_unreadable"),
        (Path("a\0b"), "file_unreadable"),
    ]:
        with pytest.raises(ModelError) as caught:
            read_bytes(path)
        assert caught.value.code == code
        assert str(path).replace("\0", "\\x00") in caught.value.message
    with (tmp_path / "large.csv").open("wb") as large:
        large.truncate(LARGEST_FILE_BYTES + 1)  # takes no space
    with pytest.raises(ModelError, match="more than 1024 MiB"):
        read_bytes(tmp_path / "large.csv")


# --- the readers of the model
# ----------------------------------------------------------------------------------


HEADER = "frequency_hz,voltage_v,normal_force_n,cof"


def test_measurements_are_read_as_a_spreadsheet_saves_them(tmp_path):
    """Spaces after commas made a header unknown, and a blank waveform was none of the known
    ones.
    """
    text = (
        f"\ufeff{HEADER.replace(',', ', ')}, waveform, session,\r\n250, 75, 0.5, 0.6, ,"
        " B,\r\n,0,0.5,0.5,DC,,\r\n"
    )
    read = read_measurements(file(tmp_path, text))
    np.testing.assert_array_equal(read.columns["voltage_v"], [75.0, 0.0])
    np.testing.assert_array_equal(read.columns["frequency_hz"], [250.0, 0.0])
    assert read.waveform is not None
    assert read.waveform.tolist() == ["sine", "dc"]
    assert [read.session_names[i] for i in read.session] == ["B", "1"]


BAD = f"""{HEADER},cof_std,session
250,75,0.5,0.6,0.01,A
250,75,500,high,0.01,A
250,75,0.5,0.6,,A

250,-75,0.5,0.6,,A
250,75,0,5,0,6,0.01,A
250,75,0.5,0.61,0.01,B
"""


def test_all_that_is_wrong_is_told_at_once(tmp_path):
    path = file(tmp_path, BAD)
    with pytest.raises(BadRowsError) as caught:
        read_measurements(path)
    assert caught.value.code == "bad_rows"
    told = (
        f"{path}: 4 of 6 rows cannot be used: line 3: normal_force_n = 500 is out of range"
        " 0.001..100 N, cof is 'high', not a number; line 4: cof_std is '', not a number;"
        " line 6: voltage_v = -75 is out of range 0..10000 V, cof_std is '', not a number;"
        " line 7: has more fields than the header (8, not 6)"
    )
    assert sorted(caught.value.message.split("; ")) == sorted(told.split("; "))
    assert "change its sign" not in caught.value.hint


def test_what_is_wrong_in_many_rows_alike_is_told_once(tmp_path):
    good, bad = "250,75,0.5,0.6\n", "250,75,500,0.6\n"
    with pytest.raises(BadRowsError) as caught:
        read_measurements(file(tmp_path, f"{HEADER}\n{good}{bad}{bad}{bad}{good}{bad}"))
    assert "4 of 6 rows cannot be used: lines 3 to 5, 7: normal_force_n" in caught.value.message
    assert caught.value.message.count("out of range") == 1
    assert "?." not in caught.value.hint


def test_bad_rows_are_left_out_on_request_and_told(tmp_path):
    read = read_measurements(file(tmp_path, BAD), leave_out_bad=True)
    np.testing.assert_array_equal(read.columns["cof"], [0.6, 0.61])
    assert read.session_names == ("A", "B")
    assert [said.partition(":")[0] for said in read.bad_rows] == [f"line {i}" for i in (3, 4, 6, 7)]


def test_a_file_of_bad_rows_alone_is_refused(tmp_path):
    with pytest.raises(BadRowsError, match="2 of 2 rows"):
        read_measurements(
            file(tmp_path, f"{HEADER}\n250,75,500,0.6\n250,75,600,0.6\n"), leave_out_bad=True
        )


def test_an_optional_column_that_is_empty_throughout_is_not_there(tmp_path):
    read = read_measurements(file(tmp_path, f"{HEADER},speed_m_s,time_s\n250,75,0.5,0.6,,3\n"))
    assert set(read.columns) == {*HEADER.split(","), "time_s"}


def test_a_dielectric_table_is_read_by_the_same_rules(tmp_path):
    """The last of two columns of one name was taken, unsaid."""
    header = "frequency_hz,eps_real,conductivity_s_per_m"
    assert read_csv(
        file(tmp_path, f"{header.replace(',', ', ')}\n1,10,1e-4\n2,11,1e-4\n")
    ).eps_real == (10.0, 11.0)
    with pytest.raises(ModelError, match="stands more than once"):
        read_csv(file(tmp_path, f"{header},eps_real\n1,10,1e-4,5\n2,11,1e-4,5\n"))
    european = f"{header}\n1,10,1e-4\n2,11.5,1e-4\n".replace(",", ";").replace(".", ",")
    assert read_csv(file(tmp_path, european)).eps_real == (10.0, 11.5)


FORMULAS = [
    "=cmd|' /C calc'!A0",
    "+1+1",
    "-2+3+cmd|x",
    "@SUM(A1)",
    "\t=1",
    "\r=1",
    "\n=1",
    "＝1",
    "'=1",
    "''-x",
    "-",
]


@pytest.mark.parametrize("text", FORMULAS)
def test_a_formula_is_written_as_text_and_read_as_it_was(text):
    written = written_cell(text)
    assert written == f"'{text}"
    assert read_cell(written) == text


AS_THEY_ARE = ["-3", "-3.5e-7", "+2", "-inf", "", "linen", "it's", "'n' = 3", "a=b", -3, -0.5, None]


@pytest.mark.parametrize("value", AS_THEY_ARE)
def test_a_number_and_plain_text_are_written_as_they_are(value):
    assert written_cell(value) == value
    if isinstance(value, str):
        assert read_cell(value) == value


def test_a_table_is_read_as_it_was_before_its_formulas_became_text(tmp_path):
    read = table(tmp_path, "a,b,'=c\n'=x,-1,'y\n")
    assert read.columns == ["a", "b", "=c"]
    assert read.rows == [{"a": "=x", "b": "-1", "=c": "'y"}]


WIDE = """
import resource, sys
from pathlib import Path
from model.support.tables import BadRowsError, read_table

resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
print(len(read_table(Path(sys.argv[1]), ("c0",), "").columns))
"""


@pytest.mark.process
def test_a_table_of_very_many_columns_takes_time_in_proportion_to_its_size(tmp_path):
    """It took time by the square of its columns. 400,000 of them take seconds of the processor, or
    else an hour.
    """
    count = 400_000
    lines = [",".join(f"c{i}" for i in range(count)) + "," * count, "1" + "," * 2 * count]
    path = file(tmp_path, "\n".join(lines))
    done = subprocess.run(
        [sys.executable, "-c", WIDE, path], capture_output=True, text=True, check=True
    )
    assert done.stdout == f"{count}\n"


def test_a_missing_column_does_not_say_all_of_very_many(tmp_path):
    with pytest.raises(ModelError, match=r"c0, c1, .*, c39, and 60 more$") as refused:
        read_table(file(tmp_path, ",".join(f"c{i}" for i in range(100))), ("a",), "")
    assert refused.value.code == "missing_column"


@pytest.mark.parametrize(
    ("header", "factor"),
    [
        ("speed_mm_s", 1e-3),
        ("Speed_M_S", 1.0),
        ("speed (mm/s)", 1e-3),
        ("speed [m/s]", 1.0),
        ('"speed, cm/s"', 1e-2),
        ("speed_m_s [mm/s]", 1e-3),
    ],
)
def test_a_column_of_ours_in_another_unit_counts_and_is_told(tmp_path, header, factor):
    """It was passed over without a word."""
    path = file(tmp_path, f"a,{header}\n1,20\n")
    read = read_table(path, ("a",), WANTED, known=("speed_m_s",))
    assert read.numbers("speed_m_s")[0] == pytest.approx(20 * factor)
    assert read.notes == (f"column {header.strip(chr(34))} counts as speed_m_s, times {factor:g}",)


@pytest.mark.parametrize(
    ("waveform", "factor"), [("", 2**0.5), ("sine", 2**0.5), ("square", 1.0), ("dc", 1.0)]
)
def test_a_root_mean_square_is_peak_by_the_waveform(tmp_path, waveform, factor):
    path = file(tmp_path, f"a,voltage_Vrms,waveform\n1,10,{waveform}\n")
    read = read_table(path, ("a", "voltage_v"), WANTED)
    assert read.numbers("voltage_v")[0] == pytest.approx(10 * factor)


def test_a_name_without_its_unit_is_asked_about(tmp_path):
    path = file(tmp_path, "a,voltage_offset\n1,50\n")
    with pytest.raises(ModelError, match="voltage_offset may be voltage_offset_v") as refused:
        read_table(path, ("a",), WANTED, known=("voltage_offset_v",))
    assert "--column voltage_offset_v=voltage_offset:V" in refused.value.hint
