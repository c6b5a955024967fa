"""Recordings read back and exported: `haptic_driver/recording/read.py` and `haptic export`."""

import json
import os
import sys

import h5py
import numpy as np
import pytest
from scipy.io import loadmat

from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.lab import tables
from haptic_driver.processes.samples import ADDED, SAMPLE
from haptic_driver.recording import read as recording
from haptic_driver.recording.event import Event
from haptic_driver.recording.structure import EVENT_FIELDS, FORMAT, FORMAT_VERSION
from haptic_driver.recording.writer import Chunk, RunWriter
from tests.haptic_driver.commands import rows_of
from tests.haptic_driver.live.recorded_runs import HEADER

TOLD = ["run", "run_time_s", "wall_time_s"]
EVENTS = [Event(number=1, time_s=0.5, kind="state", message='armed, "quoted"', data={"a": 1})]


@pytest.fixture
def samples():
    made = np.zeros(700, SAMPLE)
    made["tick"] = np.arange(700) + 2**53 + 1  # more than a double can count
    made["time_s"] = 1.0 + np.arange(700) / 3.0
    made["measured_cof"] = np.where(np.arange(700) % 2, np.nan, 0.6)
    return made


@pytest.fixture
def path(tmp_path, samples):
    for part in (samples[:10], samples):
        writer = RunWriter(tmp_path / "run.h5", HEADER)
        writer.append(Chunk(part, 0, EVENTS))
        writer.close()
    return tmp_path / "run.h5"


@pytest.fixture(autouse=True)
def _small_blocks(monkeypatch):
    monkeypatch.setattr(tables, "BLOCK_ROWS", 256)


def test_runs_are_in_the_order_of_their_numbers(tmp_path):
    """run_10000 once came before run_9999, and the last one was not the newest."""
    with h5py.File(tmp_path / "many.h5", "w") as file:
        file.attrs["format"], file.attrs["format_version"] = (FORMAT, FORMAT_VERSION)
        for name in ("run_0001", "run_9999", "run_10000"):
            file.create_group(name)
    assert recording.run_names(tmp_path / "many.h5") == ["run_0001", "run_9999", "run_10000"]


def test_a_recording_of_an_earlier_version_is_read_and_goes_on(tmp_path, samples):
    """As the format is described, by h5py alone; earlier versions wrote both kinds of reasons."""
    path, text = tmp_path / "run.h5", h5py.string_dtype()
    with h5py.File(path, "w") as file:
        file.attrs.update({"format": "haptic-driver recording", "format_version": 1.0})
        for number, why in ((1, ""), (2, np.array(b"the disk was full", "S240"))):
            run = file.create_group(f"run_{number:04d}")
            run.attrs.update(HEADER.attributes() | {"samples_lost": 0.0, "complete": 2.0 - number})
            run.attrs["why_incomplete"] = why
            run.create_dataset("config", data='{"name": "bench"}', dtype=text)
            for name in SAMPLE.names:
                run[f"samples/{name}"] = samples[name]
            for name, cell in {"number": np.uint64(1), "time_s": 0.5}.items():
                run[f"events/{name}"] = [cell]
            for name, cell in {"kind": "state", "message": "armed", "data": "{}"}.items():
                run.create_dataset(f"events/{name}", data=[cell], dtype=text)
    before = recording.read_run(path, "run_0001")
    assert before.samples.tobytes() == samples.tobytes()
    assert before.attributes["complete"] is True
    assert [event.message for event in before.events] == ["armed"]
    assert recording.read_run(path).attributes["why_incomplete"] == "the disk was full"
    writer = RunWriter(path, HEADER)
    writer.append(Chunk(samples[:10], 0, EVENTS))
    writer.close()
    assert recording.run_names(path) == ["run_0001", "run_0002", "run_0003"]
    after = recording.read_run(path, "run_0001")
    assert after.samples.tobytes() == samples.tobytes()
    assert repr((after.attributes, after.events)) == repr((before.attributes, before.events))


def test_csv_holds_every_number_to_the_last_bit(path, samples, tmp_path):
    done = []
    assert tables.export(path, tmp_path / "run.csv", progress=done.append) == 700
    assert done == [256, 512, 700]
    rows = rows_of(tmp_path / "run.csv")
    assert list(rows[0]) == [*SAMPLE.names, *TOLD]
    assert [int(row["tick"]) for row in rows] == samples["tick"].tolist()
    assert [float(row["time_s"]) for row in rows] == samples["time_s"].tolist()
    assert [row["measured_cof"] for row in rows[:3]] == ["0.6", "", "0.6"]


def test_parquet_holds_the_same_and_where_it_comes_from(path, samples, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    assert tables.export(path, tmp_path / "run.parquet") == 700
    read = parquet.read_table(tmp_path / "run.parquet")
    for name in SAMPLE.names:
        np.testing.assert_array_equal(read[name].to_numpy(), samples[name])
    about = json.loads(read.schema.metadata[b"haptic_driver"])
    assert about["run"] == "run_0002"
    assert about["simulated"] is True
    assert about["surface_hash"] == "ab12"


def test_all_runs_become_one_table_whose_times_are_each_runs_own(path, samples, tmp_path):
    assert tables.export(path, tmp_path / "all.csv", every=True) == 710
    rows = rows_of(tmp_path / "all.csv")
    assert [row["run"] for row in rows] == ["1"] * 10 + ["2"] * 700
    time_s = [*samples["time_s"][:10].tolist(), *samples["time_s"].tolist()]
    assert [float(row["time_s"]) for row in rows] == time_s
    assert [float(row["run_time_s"]) for row in rows] == [s - HEADER.started_s for s in time_s]
    wall_s = [s + HEADER.clock.wall_offset_s for s in time_s]
    assert [float(row["wall_time_s"]) for row in rows] == wall_s


def test_mat_holds_a_variable_for_each_column(path, samples, tmp_path):
    tables.export(path, tmp_path / "run.mat", run="2")
    read = loadmat(tmp_path / "run.mat")
    for name in SAMPLE.names:
        np.testing.assert_array_equal(read[name], samples[name][:, None])
    assert read["run"].tolist() == [[2]] * 700
    assert json.loads(read["about"].item())["surface_hash"] == "ab12"
    tables.export(path, tmp_path / "events.mat", events=True, every=True)
    read = loadmat(tmp_path / "events.mat")
    assert [cell.item() for (cell,) in read["message"]] == ['armed, "quoted"'] * 2


def test_a_recording_older_than_a_column_has_nothing_in_it(path, samples, tmp_path):
    with h5py.File(path, "r+") as file:
        for name in ADDED:
            del file[f"run_0002/samples/{name}"]
    found = recording.read_run(path).samples
    assert np.isnan(found["current_a"]).all()
    np.testing.assert_array_equal(found["measured_cof"], samples["measured_cof"])
    assert tables.export(path, tmp_path / "old.csv") == 700
    assert {row["estimated_cof"] for row in rows_of(tmp_path / "old.csv")} == {""}


def test_another_run_and_its_events(path, tmp_path):
    assert tables.export(path, tmp_path / "first.csv", run="run_0001") == 10
    assert tables.export(path, tmp_path / "events.csv", events=True) == 1
    (row,) = rows_of(tmp_path / "events.csv")
    run_s, wall_s = float(row.pop("run_time_s")), float(row.pop("wall_time_s"))
    assert (run_s, wall_s) == (0.5 - HEADER.started_s, 0.5 + HEADER.clock.wall_offset_s)
    assert row == {
        "number": "1",
        "time_s": "0.5",
        "kind": "state",
        "message": 'armed, "quoted"',
        "data": '{"a": 1}',
        "run": "2",
    }


def test_a_run_without_samples_is_a_table_without_rows(tmp_path):
    RunWriter(tmp_path / "run.h5", HEADER).close()
    assert tables.export(tmp_path / "run.h5", tmp_path / "run.csv") == 0
    assert (tmp_path / "run.csv").read_text() == ",".join([*SAMPLE.names, *TOLD]) + "\n"


def test_nothing_is_overwritten_unless_forced(path, tmp_path):
    out = tmp_path / "run.csv"
    out.write_text("mine")
    with pytest.raises(BadInputError, match="exists already"):
        tables.export(path, out)
    assert out.read_text() == "mine"
    tables.export(path, out, force=True)
    assert out.read_text().startswith("tick,")


def test_a_missing_package_names_its_extra(path, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(HapticError) as missing:
        tables.export(path, tmp_path / "run.parquet")
    assert missing.value.hint == "Install it: pip install 'haptic-driver[parquet]'"
    assert os.listdir(tmp_path) == ["run.h5"]


@pytest.mark.parametrize(
    ("spoil", "code"),
    [
        (lambda path: path.unlink(), "recording_not_found"),
        (lambda path: os.truncate(path, path.stat().st_size // 2), "recording_unreadable"),
        (lambda path: set_attribute(path, "format", "other"), "recording_foreign"),
        (lambda path: set_attribute(path, "format_version", 9.0), "recording_version"),
        (lambda path: remove(path, "run_0002/samples/tick"), "recording_unreadable"),
        (lambda path: remove(path, "run_0001", "run_0002"), "no_runs"),
    ],
)
def test_what_is_no_whole_recording_is_named(path, tmp_path, spoil, code):
    spoil(path)
    for use in (recording.read_run, lambda p: tables.export(p, tmp_path / "run.csv")):
        with pytest.raises(BadInputError) as refused:
            use(path)
        assert refused.value.code == code
        assert str(path) in refused.value.message
        assert refused.value.hint


def with_run(change):
    """A spoiler that changes the last run, from its group on."""

    def spoil(path):
        with h5py.File(path, "r+") as file:
            change(file["run_0002"])

    return spoil


def put(group, name, **made):
    del group[name]
    group.create_dataset(name, **made)


def put_link(group, name, link):
    del group[name]
    group[name] = link


def put_virtual(group, name):
    layout = h5py.VirtualLayout(shape=(700,), dtype="f8")
    layout[:] = h5py.VirtualSource("/etc/hostname", "x", shape=(700,))
    del group[name]
    group.create_virtual_dataset(name, layout)


ELSEWHERE = [("/etc/passwd", 0, 5600)]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda run: put(run, "samples/time_s", shape=(700,), dtype="f8", external=ELSEWHERE),
            "another file",
        ),
        (lambda run: put_virtual(run, "samples/time_s"), "another file"),
        (
            lambda run: put_link(run, "samples/time_s", h5py.ExternalLink("/etc/passwd", "/x")),
            "link to elsewhere",
        ),
        (
            lambda run: put_link(run, "samples", h5py.SoftLink("/run_0001/samples")),
            "link to elsewhere",
        ),
        (
            lambda run: put_link(run, "config", h5py.ExternalLink("other.h5", "/x")),
            "link to elsewhere",
        ),
        (
            lambda run: [run[f"samples/{name}"].resize(10**12, axis=0) for name in SAMPLE.names],
            "claims 2.* bytes",
        ),
        (lambda run: run["samples/time_s"].resize(699, axis=0), "differ in length"),
        (
            lambda run: put(run, "samples/time_s", data=np.zeros(700), compression="gzip"),
            "is packed",
        ),
        (
            lambda run: put(run, "samples/time_s", data=np.zeros((700, 2))),
            "not as a recording has it",
        ),
        (
            lambda run: put(run, "samples/time_s", data=np.zeros(700, "f4")),
            "not as a recording has it",
        ),
        (lambda run: put(run, "samples/time_s", data=["text"] * 700), "not as a recording has it"),
        (
            lambda run: put(run, "config", data="[" * 100_000, dtype=h5py.string_dtype()),
            "recursion|damaged",
        ),
        (lambda run: put(run, "events/data", data=["{"], dtype=h5py.string_dtype()), "damaged"),
        (lambda run: run.attrs.__setitem__("complete", [1.0, 2.0]), "damaged"),
        (lambda run: put(run, "config", data=h5py.Empty("f8")), "not as a recording has it"),
    ],
)
def test_a_recording_from_anybody_leads_nowhere_else(path, change, said):
    """External storage once made a recording of /etc/passwd."""
    with_run(change)(path)
    with pytest.raises(BadInputError, match=said) as refused:
        recording.read_run(path)
    assert refused.value.code == "recording_unreadable"


def test_a_run_that_is_a_link_is_not_followed(path, tmp_path):
    with h5py.File(tmp_path / "links.h5", "w") as file:
        file.attrs["format"], file.attrs["format_version"] = (FORMAT, FORMAT_VERSION)
        file["run_0001"] = h5py.ExternalLink(str(path), "/run_0001")
    for use in (recording.read_run, tables.row_count):
        with pytest.raises(BadInputError, match="link to elsewhere"):
            use(tmp_path / "links.h5")


def test_one_text_that_many_rows_point_to_is_not_read_for_each(path):
    """A reference of 16 bytes a row stands for a text of any length."""
    with h5py.File(path, "r+") as file:
        events = file["run_0002/events"]
        for name in EVENT_FIELDS:
            events[name].resize(5000, axis=0)
        events["message"][:64] = "x" * 100_000
        at = events["message"].id.get_chunk_info(0).byte_offset
    with h5py.File(path, "r+") as file:
        file["run_0002/events/message"][64:] = "y"
        offsets = [
            file["run_0002/events/message"].id.get_chunk_info(i).byte_offset for i in range(78)
        ]
    first = bytes(path.read_bytes()[at : at + 64 * 16])
    content = bytearray(path.read_bytes())
    for offset in offsets[1:]:
        content[offset : offset + 64 * 16] = first
    path.write_bytes(content)
    with pytest.raises(BadInputError, match="more text than the file"):
        recording.read_run(path)


def set_attribute(path, name, value):
    with h5py.File(path, "r+") as file:
        file.attrs[name] = value


def remove(path, *names):
    with h5py.File(path, "r+") as file:
        for name in names:
            del file[name]


def test_the_command_says_what_it_wrote(haptic, path, tmp_path):
    done = haptic("export", path, "--out", tmp_path / "run.csv", "--json")
    assert done.status == 0
    assert done.err == ""
    assert done.said == {
        "recording": str(path),
        "out": str(tmp_path / "run.csv"),
        "run": "run_0002",
        "runs": ["run_0001", "run_0002"],
        "rows": 700,
    }
    again = ["export", path, "--out", tmp_path / "run.csv", "--force"]
    assert "700 rows of run_0002, one of 2 runs (--all takes all)" in haptic(*again).out
    assert "10 rows of run_0001, one of 2 runs" in haptic(*again, "--run", "1").out
    assert "710 rows of run_0001, run_0002" in haptic(*again, "--all").out


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["--out", "run.txt"], "bad_ending"),
        (["--out", "run.csv", "--run", "run_0009"], "no_such_run"),
        (["--out", "run.csv", "--run", "1", "--all"], "usage"),
    ],
)
def test_the_command_refuses_with_status_2(haptic, path, tmp_path, monkeypatch, arguments, code):
    monkeypatch.chdir(tmp_path)
    done = haptic("export", path, *arguments, "--json")
    assert done.status == 2
    assert done.said["error"]["code"] == code
    assert os.listdir(tmp_path) == ["run.h5"]
