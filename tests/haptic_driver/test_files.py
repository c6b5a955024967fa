"""Files are written as a whole or not at all."""

import os

import pytest

from haptic_driver.errors import HapticError
from haptic_driver.files import replacing, write_rows


def test_a_new_file_in_a_new_folder(tmp_path):
    with replacing(tmp_path / "a" / "b.txt") as part:
        part.write_text("new")
        assert not (tmp_path / "a" / "b.txt").exists()
    assert [f.name for f in (tmp_path / "a").iterdir()] == ["b.txt"]
    assert (tmp_path / "a" / "b.txt").read_text() == "new"


def test_what_fails_leaves_the_old_file(tmp_path):
    path = tmp_path / "b.txt"
    path.write_text("old")

    def write_half():
        with replacing(path) as part:
            part.write_text("half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write_half()
    assert path.read_text() == "old"
    assert [f.name for f in tmp_path.iterdir()] == ["b.txt"]


def test_a_folder_in_the_way_is_said(tmp_path):
    with pytest.raises(HapticError, match="it is a folder") as failed, replacing(tmp_path) as part:
        part.write_text("x")
    assert failed.value.code == "not_written"
    assert list(tmp_path.parent.glob("*.part")) == []


def test_rows(tmp_path):
    write_rows(tmp_path / "t.csv", [{"name": "a, b", "n": 1.5}, {"name": "c", "n": 2}])
    assert (tmp_path / "t.csv").read_bytes() == b'name,n\r\n"a, b",1.5\r\nc,2\r\n'


def test_rows_hold_no_formulas_and_negative_numbers_as_they_are(tmp_path):
    write_rows(
        tmp_path / "t.csv",
        [{"=name": "=cmd|x", "n": -1.5, "t": "-2.5"}, {"=name": "@x", "n": 2, "t": "+"}],
    )
    assert (tmp_path / "t.csv").read_text().splitlines() == [
        "'=name,n,t",
        "'=cmd|x,-1.5,-2.5",
        "'@x,2,'+",
    ]


def test_a_disk_that_is_full_keeps_the_old_file_and_is_said(tmp_path, monkeypatch):
    path = tmp_path / "b.txt"
    path.write_text("old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(HapticError, match="No space left") as failed, replacing(path) as part:
        part.write_text("new")
    assert failed.value.code == "not_written"
    assert [f.read_text() for f in tmp_path.iterdir()] == ["old"]
