"""What a recording holds, and that neither a kill nor a full disk makes it unreadable."""

import errno
import json
import os
import resource
import shutil
import signal
import socket
import stat
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.processes.samples import SAMPLE
from haptic_driver.processes.shared_memory import RING_SAMPLES
from haptic_driver.recording.clock import ClockOffsets
from haptic_driver.recording.event import Event
from haptic_driver.recording.process import Recorder
from haptic_driver.recording.read import read_run, run_names
from haptic_driver.recording.writer import Chunk, RunHeader, RunWriter, hidden_copy
from tests.haptic_driver.daemon.ticks import made_tick
from tests.waiting import until

VICTIM = Path(__file__).with_name("recording_victim.py")
CONFIG = {"name": "bench 3", "limits": {"voltage_v": 120.0, "frequency_hz": [1.0, 1e6]}}


@pytest.fixture
def header():
    return RunHeader(
        rig="bench 3",
        simulated=True,
        model="reference",
        surface_hash="0123abcd",
        calibration_ids={"force_sensor": "FT12345 2024-03-01"},
        software_version="0.1.0",
        actuator="setpoints over SCPI",
        latency_budget_s={"sensor": 0.004, "total": 0.01},
        config=CONFIG,
        started_s=1234.5,
        started_at="2024-05-06T07:08:09+00:00",
        clock=ClockOffsets(wall_offset_s=1.7e9, lsl_offset_s=0.25),
    )


@pytest.fixture
def samples(rng):
    made = np.zeros(1700, SAMPLE)
    for name in SAMPLE.names:
        values = (
            rng.integers(0, 200, made.size)
            if SAMPLE[name].kind == "u"
            else rng.normal(size=made.size)
        )
        made[name] = values
    made["target_cof"][::7] = np.nan
    return made


LATE = "the recorder came too late for them"
EVENTS = [
    Event(number=4, time_s=1235.0, kind="state", message="armed – lease 0.5 s"),
    Event(
        number=5,
        time_s=1235.5,
        kind="target",
        message="friction 0.6",
        data={"cof": 0.6, "who": ["a", None]},
    ),
]


def record(path, header, *chunks):
    writer = RunWriter(path, header)
    for chunk in chunks:
        writer.append(chunk)
    writer.close()


def plain(path, name):
    with h5py.File(path, "r") as file:
        return file[name][...]


def test_every_field_and_event_comes_back(tmp_path, header, samples):
    path = tmp_path / "run.h5"
    pieces = [
        Chunk(samples[:500], 0, EVENTS[:1]),
        Chunk(samples[500:501], 3, []),
        Chunk(samples[501:], 4, EVENTS[1:]),
    ]
    record(path, header, *pieces)
    with h5py.File(path, "r") as file:  # by h5py alone
        assert list(file) == ["run_0001"]
        run = file["run_0001"]
        for name in SAMPLE.names:
            np.testing.assert_array_equal(run["samples"][name][...], samples[name])
            assert run["samples"][name].dtype == SAMPLE[name]
        assert run["events/message"].asstr()[...].tolist() == [
            "armed – lease 0.5 s",
            "friction 0.6",
        ]
        assert json.loads(run["events/data"].asstr()[1]) == {"cof": 0.6, "who": ["a", None]}
        assert json.loads(run["config"].asstr()[()]) == CONFIG
        assert dict(run.attrs) == {
            "rig": "bench 3",
            "simulated": 1.0,
            "model": "reference",
            "surface_hash": "0123abcd",
            "calibration_ids": '{"force_sensor": "FT12345 2024-03-01"}',
            "software_version": "0.1.0",
            "actuator": "setpoints over SCPI",
            "latency_budget_s": '{"sensor": 0.004, "total": 0.01}',
            "started_s": 1234.5,
            "started_at": "2024-05-06T07:08:09+00:00",
            "samples_lost": 7.0,
            "complete": 0.0,
            "events_lost": 0.0,
            "why_incomplete": f"7 ticks are missing in {path}: {LATE}".encode(),
            "wall_offset_s": 1.7e9,
            "lsl_offset_s": 0.25,
        }
    read = read_run(path)
    assert read.samples.tobytes() == samples.tobytes()
    assert read.events == EVENTS
    assert read.config == CONFIG
    assert read.attributes["calibration_ids"] == {"force_sensor": "FT12345 2024-03-01"}
    assert read.attributes["complete"] is False


def test_no_attribute_is_an_integer(tmp_path, header, samples):
    record(tmp_path / "run.h5", header, Chunk(samples, 0, EVENTS))
    attributes = {}
    with h5py.File(tmp_path / "run.h5", "r") as file:
        attributes |= dict(file.attrs)
        file.visititems(
            lambda name, item: attributes.update({f"{name}.{k}": v for k, v in item.attrs.items()})
        )
    assert len(attributes) == 18
    assert {type(value) for value in attributes.values()} == {str, np.bytes_, np.float64}


def test_only_its_owner_may_read_it_and_nothing_is_left_beside_it(tmp_path, header, samples):
    path = tmp_path / "deep" / "run.h5"
    record(path, header, Chunk(samples, 0, []))
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert os.listdir(path.parent) == ["run.h5"]


def test_another_run_is_added_to_a_recording(tmp_path, header, samples):
    path = tmp_path / "run.h5"
    record(path, header, Chunk(samples[:100], 0, EVENTS))
    record(path, header, Chunk(samples[100:300], 0, []))
    assert run_names(path) == ["run_0001", "run_0002"]
    assert read_run(path, "run_0001").samples.tobytes() == samples[:100].tobytes()
    assert read_run(path).samples.tobytes() == samples[100:300].tobytes()
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_the_visible_file_is_whole_after_every_piece(tmp_path, header, samples):
    path = tmp_path / "run.h5"
    writer = RunWriter(path, header)
    assert plain(path, "run_0001/samples/tick").size == 0
    for stop in range(400, 1700, 400):
        writer.append(Chunk(samples[stop - 400 : stop], 0, []))
        copy = shutil.copy(path, tmp_path / "copy.h5")
        np.testing.assert_array_equal(
            plain(copy, "run_0001/samples/time_s"), samples["time_s"][:stop]
        )
        assert read_run(path).attributes["complete"] is False
    writer.close()


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("run.csv", "bad_ending"),
        ("run", "bad_ending"),
        ("foreign.h5", "recording_foreign"),
        ("text.h5", "recording_unreadable"),
    ],
)
def test_what_is_no_recording_is_not_touched(tmp_path, header, name, code):
    with h5py.File(tmp_path / "foreign.h5", "w") as file:
        file["mine"] = 1.0
    (tmp_path / "text.h5").write_text("not HDF5")
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    with pytest.raises(BadInputError) as refused:
        RunWriter(tmp_path / name, header)
    assert refused.value.code == code
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


def test_a_relative_path_and_an_impossible_place_are_refused(tmp_path, header):
    with pytest.raises(BadInputError, match="another folder"):
        RunWriter(Path("run.h5"), header)
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInputError, match="cannot be written"):
        RunWriter(tmp_path / "file" / "run.h5", header)


@pytest.fixture
def victims():
    command = [sys.executable, str(VICTIM)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        yield process


def kill_while_it_writes(victims, path, delay_s):
    """Samples that the victim had reported when it was killed; none before it has reported once."""
    victims.stdin.write(f"{path}\n")
    victims.stdin.flush()
    said = [victims.stdout.readline() for _ in range(2)]  # in either order
    pid, reported = (
        line.removeprefix("pid ")
        for line in sorted(said, key=lambda line: not line.startswith("pid"))
    )
    time.sleep(delay_s)
    os.kill(int(pid), signal.SIGKILL)
    while (line := victims.stdout.readline()) and not line.startswith(
        "ended"
    ):  # what was in the pipe
        reported = line
    assert line == f"ended {signal.SIGKILL:d}\n"
    return int(reported)


def check_survived(path, reported):
    with h5py.File(path, "r") as file:
        run = file[sorted(file)[-1]]
        columns = {name: dataset[...] for name, dataset in run["samples"].items()}
        numbers = run["events/number"][...]
    count = columns["tick"].size
    assert reported <= count <= reported + 500
    np.testing.assert_array_equal(columns["tick"], np.arange(count))
    np.testing.assert_array_equal(columns["position_x_m"], np.arange(count) * 1e-6)
    assert {column.size for column in columns.values()} == {count}
    np.testing.assert_array_equal(numbers, np.arange(1, count // 500 + 1))


def test_a_recording_survives_kill_9_at_any_moment(tmp_path, rng, victims):
    path = tmp_path / "run.h5"
    for i in range(10):
        reported = kill_while_it_writes(victims, path, rng.uniform(0.0, 0.12))
        check_survived(path, reported)
        assert run_names(path) == [f"run_{n + 1:04d}" for n in range(i + 1)]


@pytest.mark.soak
def test_a_recording_survives_200_kills(tmp_path, rng, victims):
    for i in range(200):
        path = tmp_path / f"{i}.h5"
        check_survived(path, kill_while_it_writes(victims, path, rng.uniform(0.0, 0.2)))


def tell_ticks(shared, first, count):
    for tick in range(first, first + count):
        shared.ring.write(made_tick(tick))


def await_samples(path, count):
    return until(lambda: (run := read_run(path)).samples.size >= count and run)


def test_the_process_records_the_ring_from_now_on_and_events(tmp_path, shared, header):
    tell_ticks(shared, 0, 50)
    recorder = Recorder(tmp_path / "run.h5", header, shared)
    tell_ticks(shared, 50, 100)
    recorder.note(EVENTS[0])
    assert await_samples(tmp_path / "run.h5", 100).attributes["complete"] is False
    assert recorder.ended() is None
    tell_ticks(shared, 150, 10)
    recorder.note(EVENTS[1])
    assert recorder.stop() is None
    run = read_run(tmp_path / "run.h5")
    assert run.samples["tick"].tolist() == list(range(50, 160))
    assert run.events == EVENTS
    assert run.attributes["complete"] is True
    assert os.listdir(tmp_path) == ["run.h5"]


def test_samples_that_came_too_fast_are_counted(tmp_path, shared, header):
    recorder = Recorder(tmp_path / "run.h5", header, shared)
    os.kill(recorder.pid, signal.SIGSTOP)
    tell_ticks(shared, 0, RING_SAMPLES + 999)
    os.kill(recorder.pid, signal.SIGCONT)
    said = f"1000 ticks are missing in {tmp_path / 'run.h5'}: {LATE}"
    assert until(lambda: recorder.news() or recorder.missing) == said  # while it goes on
    assert recorder.stop() == said
    run = read_run(tmp_path / "run.h5")
    assert run.attributes["samples_lost"] == 1000  # one place of the ring is the writer's
    assert run.attributes["complete"] is False
    assert run.attributes["why_incomplete"] == said[:240]
    assert run.samples["tick"].tolist() == list(range(1000, RING_SAMPLES + 999))


def test_a_killed_recorder_is_noticed_and_its_file_is_readable(tmp_path, shared, header):
    recorder = Recorder(tmp_path / "run.h5", header, shared)
    tell_ticks(shared, 0, 10)
    await_samples(tmp_path / "run.h5", 10)
    assert hidden_copy(tmp_path / "run.h5").exists()
    os.kill(recorder.pid, signal.SIGKILL)
    assert "killed by SIGKILL" in until(recorder.ended)
    assert read_run(tmp_path / "run.h5").samples["tick"].tolist() == list(range(10))
    assert os.listdir(tmp_path) == ["run.h5"]


def test_a_full_disk_ends_the_recording_and_keeps_what_there_was(tmp_path, shared, header):
    recorder = Recorder(tmp_path / "run.h5", header, shared)
    tell_ticks(shared, 0, 20)
    await_samples(tmp_path / "run.h5", 20)
    size = (tmp_path / "run.h5").stat().st_size
    resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (size, size))  # no file may grow any more
    tell_ticks(shared, 20, 10_000)
    why = until(recorder.ended)
    assert "recording stopped" in why
    assert "Make room on the disk" in why
    assert ".behind" not in why
    run = read_run(tmp_path / "run.h5")
    assert run.samples["tick"].tolist() == list(range(20))
    assert run.attributes["complete"] is False
    assert "File too large" in run.attributes["why_incomplete"]
    assert os.listdir(tmp_path) == ["run.h5"]


def test_its_last_word_is_heard_though_it_leaves_an_event_unread(tmp_path, shared, header):
    """A full disk was once told as "ended with status 1": the kernel first tells of the event that
    nobody has read.
    """
    recorder = Recorder(tmp_path / "run.h5", header, shared)
    recorder._talk.close()
    recorder._talk, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    recorder.note(EVENTS[0])
    theirs.send(b'{"why": "the disk is full"}')
    theirs.close()
    assert recorder.stop() == "the disk is full"


def record_meanwhile(path, header, samples, meddle):
    """A recording with whose files somebody meddles in the middle; what its writer says of it."""
    writer = RunWriter(path, header)
    writer.append(Chunk(samples[:500], 0, EVENTS[:1]))
    writer.append(Chunk(samples[500:900], 0, []))
    meddle(path)
    for start in range(900, 1700, 200):
        writer.append(Chunk(samples[start : start + 200], 0, EVENTS[1:] if start == 900 else []))
    news = writer.news()
    assert writer.close() is None
    return news


@pytest.mark.parametrize(
    "meddle",
    [
        lambda path: path.unlink(),
        lambda path: hidden_copy(path).unlink(),
        lambda path: shutil.rmtree(path.parent),
        lambda path: [path.unlink(), hidden_copy(path).unlink()],
    ],
    ids=["the file", "the hidden copy", "their folder", "both"],
)
def test_who_deletes_the_file_of_a_running_recording_loses_nothing(
    tmp_path, header, samples, meddle
):
    """The hidden copy was once deleted as well: all was lost, while the message said that it was
    kept.
    """
    path = tmp_path / "folder" / "run.h5"
    news = record_meanwhile(path, header, samples, meddle)
    run = read_run(path)
    assert run.samples.tobytes() == samples.tobytes()
    assert run.events == EVENTS
    assert run.attributes["complete"] is True
    assert os.listdir(path.parent) == ["run.h5"]
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert all(
        said == f"{path} was deleted while it is recorded, and is put back, whole" for said in news
    )


def test_a_deleted_file_is_told_and_put_back(tmp_path, shared, header):
    recorder = Recorder(tmp_path / "run.h5", header, shared)
    tell_ticks(shared, 0, 20)
    await_samples(tmp_path / "run.h5", 20)
    (tmp_path / "run.h5").unlink()
    assert "was deleted while it is recorded, and is put back" in until(recorder.news)[0]
    tell_ticks(shared, 20, 5)
    assert recorder.stop() is None
    assert read_run(tmp_path / "run.h5").samples["tick"].tolist() == list(range(25))
    assert os.listdir(tmp_path) == ["run.h5"]


def test_what_a_killed_recorder_has_left_of_a_deleted_file_is_put_back(tmp_path, shared, header):
    path = tmp_path / "run.h5"
    recorder = Recorder(path, header, shared)
    tell_ticks(shared, 0, 20)
    await_samples(path, 20)
    os.kill(recorder.pid, signal.SIGSTOP)
    until(
        lambda: Path(f"/proc/{recorder.pid}/stat").read_text().rpartition(")")[2].split()[0] == "T"
    )
    path.unlink()
    os.kill(recorder.pid, signal.SIGKILL)
    why = until(recorder.ended)
    if path.exists():  # else it was killed while it wrote, and the message says that too
        assert why.endswith(f"what came before is in {path}")
        assert read_run(path).attributes["complete"] is False
    else:
        assert why.endswith(f"what came before is lost: somebody has deleted {path}")
    assert os.listdir(tmp_path) in (["run.h5"], [])


def test_another_file_in_its_place_is_left_alone_and_what_came_before_is_beside_it(
    tmp_path, header, samples
):
    path, mine = tmp_path / "run.h5", tmp_path / "mine"
    writer = RunWriter(path, header)
    writer.append(Chunk(samples[:500], 0, EVENTS))
    mine.write_text("mine")
    os.replace(mine, path)
    with pytest.raises(HapticError, match="another file has taken its place") as failed:
        writer.append(Chunk(samples[500:], 0, []))
    assert failed.value.message.endswith(f"what came before is in {tmp_path / 'run-kept-2.h5'}")
    assert failed.value.hint.startswith("Leave the file and its folder alone")
    assert path.read_text() == "mine"
    run = read_run(tmp_path / "run-kept-2.h5")
    assert run.samples.tobytes() == samples[:500].tobytes()
    assert "another file" in run.attributes["why_incomplete"]
    assert sorted(os.listdir(tmp_path)) == ["run-kept-2.h5", "run.h5"]


def test_events_that_are_missing_are_counted_whatever_their_order(tmp_path, header, samples):
    writer = RunWriter(tmp_path / "run.h5", header)
    numbers = [12, 11, 15, 14, 10]
    writer.append(
        Chunk(samples, 0, [EVENTS[0].model_copy(update={"number": number}) for number in numbers])
    )
    assert writer.close() == f"1 events are missing in {tmp_path / 'run.h5'}: {LATE}"
    attributes = read_run(tmp_path / "run.h5").attributes
    assert (attributes["complete"], attributes["events_lost"]) == (False, 1.0)


@pytest.mark.parametrize(
    ("number", "hint"),
    [
        (errno.ENOSPC, "Make room on the disk"),
        (errno.EDQUOT, "Make room on the disk"),
        (errno.EFBIG, "Make room on the disk"),
        (errno.EROFS, "Check the rights"),
        (errno.EACCES, "Check the rights"),
        (errno.ENOENT, "Leave the file and its folder alone"),
        (errno.EIO, "Look at the disk"),
    ],
)
def test_the_hint_fits_what_went_wrong(tmp_path, header, samples, monkeypatch, number, hint):
    """It was "make room on the disk" whatever had happened."""

    def refuse(*_):
        raise OSError(number, os.strerror(number))

    writer = RunWriter(tmp_path / "run.h5", header)
    with monkeypatch.context() as meanwhile:
        meanwhile.setattr(os, "pwrite", refuse)
        with pytest.raises(HapticError) as failed:
            writer.append(Chunk(samples, 0, []))
    assert failed.value.hint.startswith(hint)
    assert failed.value.message.endswith(f"what came before is in {tmp_path / 'run.h5'}")


def append_for_ever(writer, chunk):
    while True:
        writer.append(chunk)


@pytest.mark.parametrize("at_write", range(1, 12, 2))
def test_no_refused_byte_is_ever_taken_for_written(
    tmp_path, header, samples, monkeypatch, at_write
):
    """HDF5 prints a full disk and goes on: such a run once said it was complete, with a fifth of
    its ticks gone.
    """
    path = tmp_path / "run.h5"
    writer = RunWriter(path, header)
    writer.append(Chunk(samples[:500], 0, EVENTS[:1]))
    pwrite, written = os.pwrite, 0

    def refuse_once(descriptor, data, offset):
        nonlocal written
        written += 1
        if written == at_write:
            raise OSError(28, "No space left on device")
        return pwrite(descriptor, data, offset)

    monkeypatch.setattr(os, "pwrite", refuse_once)
    with pytest.raises(HapticError, match="No space left") as failed:
        append_for_ever(writer, Chunk(samples[500:], 0, EVENTS[1:]))
    assert failed.value.code == "recording_failed"
    run = read_run(path)
    assert run.samples.size == writer.samples
    assert run.samples[:500].tobytes() == samples[:500].tobytes()
    assert run.samples[500:].tobytes() == samples[500:].tobytes() * ((writer.samples - 500) // 1200)
    assert run.attributes["complete"] is False
    assert "No space left on device" in run.attributes["why_incomplete"]
    assert os.listdir(tmp_path) == ["run.h5"]


def test_what_the_system_takes_in_pieces_is_whole(tmp_path, header, samples, monkeypatch):
    pwrite = os.pwrite
    monkeypatch.setattr(
        os, "pwrite", lambda descriptor, data, offset: pwrite(descriptor, data[:999], offset)
    )
    record(
        tmp_path / "run.h5", header, Chunk(samples[:900], 0, EVENTS), Chunk(samples[900:], 0, [])
    )
    assert read_run(tmp_path / "run.h5").samples.tobytes() == samples.tobytes()


def test_the_process_refuses_like_the_writer(tmp_path, shared, header):
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInputError, match="cannot be written") as refused:
        Recorder(tmp_path / "file" / "run.h5", header, shared)
    assert refused.value.code == "recording_not_made"


def test_a_run_ends_in_good_order_when_control_is_gone(tmp_path, shared, header):
    recorder = Recorder(tmp_path / "run.h5", header, shared)
    tell_ticks(shared, 0, 30)
    recorder._talk.close()  # as the end of its process does
    until(lambda: recorder._child.ended)
    assert read_run(tmp_path / "run.h5").samples["tick"].tolist() == list(range(30))
    assert read_run(tmp_path / "run.h5").attributes["complete"] is True
    recorder._child.stop()
