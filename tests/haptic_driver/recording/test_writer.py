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
import threading
import time
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.processes.samples import SAMPLE
from haptic_driver.processes.shared_memory import RING_SAMPLES, Ring
from haptic_driver.recording import records
from haptic_driver.recording.clock import ClockOffsets
from haptic_driver.recording.event import Event
from haptic_driver.recording.process import Ahead, Recorder
from haptic_driver.recording.read import read_run, run_names
from haptic_driver.recording.records import records_in, records_of, say
from haptic_driver.recording.writer import Chunk, RunHeader, RunWriter
from haptic_driver.recording.writer import record as record_run
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


def test_a_run_that_goes_on_is_read_as_far_as_it_is_on_the_disk(tmp_path, header, samples):
    path = tmp_path / "run.h5"
    record(path, header, Chunk(samples[:10], 0, []))
    writer = RunWriter(path, header)
    for stop in range(0, 1700, 800):
        assert run_names(path) == ["run_0001", "run_0002"]
        run = read_run(path)
        assert run.samples.tobytes() == samples[:stop].tobytes()
        assert run.attributes["complete"] is False
        assert "it is being recorded" in run.attributes["why_incomplete"]
        writer.append(Chunk(samples[stop : stop + 800], 0, []))
    assert sorted(os.listdir(tmp_path)) == ["run.h5", "run.h5.records"]
    assert stat.S_IMODE(records_of(path).stat().st_mode) == 0o600
    with pytest.raises(BadInputError, match="cannot be written"):
        RunWriter(path, header)
    writer.close()
    assert os.listdir(tmp_path) == ["run.h5"]


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


@pytest.fixture
def victims():
    command = [sys.executable, str(VICTIM)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        yield process


def heard(victims):
    """What the victim says, up to its end."""
    while line := victims.stdout.readline().strip():
        yield line
        if line.startswith("ended"):
            return


def tell(victims, call, path):
    victims.stdin.write(f"{call} {path}\n")
    victims.stdin.flush()


def kill_while_it_writes(victims, path, delay_s):
    """Ticks that the victim had reported when it was killed; none before it has reported once."""
    tell(victims, 0, path)
    said = sorted(victims.stdout.readline() for _ in range(2))  # in either order
    time.sleep(delay_s)
    os.kill(int(said[1].removeprefix("pid ")), signal.SIGKILL)
    *more, end = heard(victims)
    assert end == f"ended {signal.SIGKILL:d}"
    return int([said[0], *more][-1])


def check_survived(path, reported, most):
    """The last run is whole up to some piece, of which there is more than was reported."""
    count = read_run(path).samples.size
    assert path.name in os.listdir(path.parent)
    with h5py.File(path, "r") as file:
        run = file[sorted(file)[-1]]
        columns = {name: dataset[...] for name, dataset in run["samples"].items()}
        numbers = run["events/number"][...]
        complete, why = run.attrs["complete"], run.attrs["why_incomplete"].decode()
    assert reported <= count <= most
    np.testing.assert_array_equal(columns["tick"], np.arange(count))
    np.testing.assert_array_equal(columns["position_x_m"], np.arange(count) * 1e-6)
    assert {column.size for column in columns.values()} == {count}
    np.testing.assert_array_equal(numbers, np.arange(1, count // 500 + 1))
    return complete, why


@pytest.mark.process
def test_a_recording_survives_kill_9_at_any_moment(tmp_path, rng, victims):
    path = tmp_path / "run.h5"
    for i in range(6):
        reported = kill_while_it_writes(victims, path, rng.uniform(0.0, 0.12))
        if i % 2:  # else the next recorder puts it away
            complete, why = check_survived(path, reported, reported + 500)
            assert complete == 0.0
            assert "its recorder was killed" in why
            assert os.listdir(tmp_path) == ["run.h5"]
            assert run_names(path) == [f"run_{n + 1:04d}" for n in range(i + 1)]


@pytest.mark.soak
def test_a_recording_survives_200_kills(tmp_path, rng, victims):
    for i in range(200):
        path = tmp_path / f"{i}.h5"
        reported = kill_while_it_writes(victims, path, rng.uniform(0.0, 0.2))
        check_survived(path, reported, reported + 500)


@pytest.mark.process
@pytest.mark.parametrize("runs", [0, 1], ids=["a new file", "a file with a run"])
def test_a_kill_in_the_middle_of_any_step_loses_nothing_and_doubles_nothing(
    tmp_path, header, samples, rng, victims, runs
):
    """The last steps are the end of the run: HDF5 is made, put in place, and the records go."""

    def prepared(name):
        path = tmp_path / name / "run.h5"
        path.parent.mkdir()
        for _ in range(runs):
            record(path, header, Chunk(samples, 0, []))
        return path

    tell(victims, 1 << 30, prepared("undisturbed"))
    calls = next(int(said[5:]) for said in heard(victims) if said.startswith("done"))
    assert next(heard(victims)).startswith("ended")
    for call in {*rng.integers(1, calls + 1, 8).tolist(), *range(calls - 4, calls + 1)}:
        path = prepared(f"{call}")
        tell(victims, call, path)
        *said, end = heard(victims)
        assert end == f"ended {signal.SIGKILL:d}"
        reported = max((int(one) for one in said if one.isdigit()), default=0)
        if not path.exists() and not records_of(path).exists():
            assert reported == 0
            continue
        if len(run_names(path)) == runs:  # nothing had begun
            assert reported == 0
            continue
        complete, why = check_survived(path, reported, 1500)
        assert complete == (why == "")
        assert reported == 1500 or complete == 0.0
        assert run_names(path) == [f"run_{n + 1:04d}" for n in range(runs + 1)]
        seen = [name for name in os.listdir(path.parent) if not name.startswith(".")]
        assert seen == ["run.h5"]


def left_by_a_crash(path, header, *chunks, ended=False):
    """The records of a run, as its recorder has left them beside `path`."""
    writer = RunWriter(path.with_name("other.h5"), header)
    for chunk in chunks:
        writer.append(chunk)
    with records_of(writer.path).open("r+b") as file:
        if ended:
            say(file.fileno(), "", writer.samples)
        left = file.read()
    writer.close()
    writer.path.unlink()
    records_of(path).write_bytes(left)
    return left


def blocks(samples):
    """Ten blocks of 100 ticks, each with an event."""
    return [
        Chunk(samples[100 * n : 100 * n + 100], 0, [EVENTS[0].model_copy(update={"number": n})])
        for n in range(10)
    ]


def test_a_torn_record_is_left_out(tmp_path, header, samples, rng):
    path = tmp_path / "run.h5"
    ends = [len(left_by_a_crash(path, header, *blocks(samples)[:n])) for n in range(11)]
    whole = records_of(path).read_bytes()
    for size in [*rng.integers(ends[0], ends[-1], 2), *ends[::5], ends[4] - 1]:
        records_of(path).write_bytes(whole[:size])
        run = read_run(path)
        kept = sum(end <= size for end in ends[1:])
        assert run.samples.tobytes() == samples[: 100 * kept].tobytes()
        assert [event.number for event in run.events] == list(range(kept))
        assert run.attributes["complete"] is False
        assert "its recorder was killed" in run.attributes["why_incomplete"]
        path.unlink()


def test_a_flipped_bit_costs_at_most_one_block_and_is_said(tmp_path, header, samples, rng):
    path = tmp_path / "run.h5"
    whole = left_by_a_crash(path, header, *blocks(samples), ended=True)
    assert read_run(path).attributes["complete"] is True
    path.unlink()
    of_state, of_header, of_last = (0, 8, 12, 100), (4200, 5000), (len(whole) - 1,)
    for at in [*rng.integers(0, len(whole), 3), *of_state, *of_header, *of_last]:
        flipped = bytearray(whole)
        flipped[at] ^= 1 << int(rng.integers(8))
        records_of(path).write_bytes(flipped)
        run = read_run(path)
        numbers = [event.number for event in run.events]
        assert len(numbers) >= 9
        kept = np.concatenate([samples[100 * n : 100 * n + 100] for n in numbers])
        assert run.samples.tobytes() == kept.tobytes()
        assert run.attributes["samples_lost"] == 1000 - kept.size
        assert run.attributes["complete"] is False
        assert "damaged" in run.attributes["why_incomplete"]
        assert os.listdir(tmp_path) == ["run.h5"]
        path.unlink()


def test_a_block_that_is_longer_than_a_record_may_be_is_read_back(
    tmp_path, header, samples, monkeypatch
):
    """530 markers of 16 kB in one block cost 500 ticks at the end of a good run."""
    monkeypatch.setattr(records, "MOST_BYTES", 1 << 17)
    path, filler = tmp_path / "run.h5", "x" * 16_000
    events = [EVENTS[0].model_copy(update={"number": n, "message": filler}) for n in range(53)]
    record(path, header, Chunk(samples, 0, events), Chunk(samples, 0, []))
    run = read_run(path)
    assert run.samples.tobytes() == 2 * samples.tobytes()
    assert [event.number for event in run.events] == list(range(53))
    assert run.attributes["complete"] is True


def test_an_event_that_no_record_holds_is_refused(tmp_path, header, monkeypatch):
    monkeypatch.setattr(records, "MOST_BYTES", 1 << 17)
    writer = RunWriter(tmp_path / "run.h5", header)
    event = EVENTS[0].model_copy(update={"message": "x" * (1 << 17)})
    with pytest.raises(HapticError) as refused:
        writer.append(Chunk(np.zeros(0, SAMPLE), 0, [event]))
    assert refused.value.code == "too_long"
    assert writer.close() is None


def test_a_header_that_nobody_could_read_begins_no_run(tmp_path, header, monkeypatch):
    monkeypatch.setattr(records, "MOST_BYTES", 1 << 10)
    with pytest.raises(BadInputError, match="longer than 1024"):
        RunWriter(tmp_path / "run.h5", replace(header, config={"x": "x" * 2000}))
    assert os.listdir(tmp_path) == []


def crafted(path, header, changes, said=None):
    """Records whose checksums are right, with other words in the header, or one more block."""
    left_by_a_crash(path, header)
    with records_of(path).open("rb") as file:
        first = next(each for each, _ in filter(None, records_in(file.fileno())) if "run" in each)
    with path.with_name("crafted").open("w+b") as file:
        say(file.fileno(), "", 0)
        records.add(file.fileno(), first | changes)
        if said is not None:
            records.add(file.fileno(), said)
        file.seek(0)
        records_of(path).write_bytes(file.read())
    path.with_name("crafted").unlink()


@pytest.mark.parametrize("name", ["../../x", "run_1/x", "run_0001\n"])
def test_a_run_of_another_kind_of_name_is_put_nowhere(tmp_path, header, name):
    path = tmp_path / "run.h5"
    crafted(path, header, {"run": name})
    with pytest.raises(BadInputError, match="names no run"):
        read_run(path)
    assert not path.exists()


EDGE = {"number": 1, "time_s": 1.0, "kind": "marker", "message": "", "data": "{}"}


@pytest.mark.parametrize(
    "said",
    [
        {"first": 10**30, "events": []},
        {"first": 0, "events": [EDGE | {"number": 10**30}]},
        {"first": 0, "events": [{"number": 1}]},
    ],
)
def test_a_block_of_impossible_numbers_is_damage(tmp_path, header, said):
    path = tmp_path / "run.h5"
    crafted(path, header, {}, said)
    run = read_run(path)
    assert (run.samples.size, run.events) == (0, [])
    assert "damaged" in run.attributes["why_incomplete"]


@pytest.mark.parametrize("size", [0, 1 << 15, 1 << 30])
def test_marks_by_the_thousand_take_no_time_by_their_square(
    tmp_path, header, samples, monkeypatch, size
):
    """64 kB of marks took 2.3 s, ten times as many a hundred times as long."""
    path = tmp_path / "run.h5"
    left = left_by_a_crash(path, header, *blocks(samples))
    marks = records.HEAD.pack(records.MARK, size, 1) * 20_000
    records_of(path).write_bytes(left[:-1] + marks)
    read, pread = [], os.pread
    monkeypatch.setattr(os, "pread", lambda *given: read.append(pread(*given)) or read[-1])
    run = read_run(path)
    assert run.samples.tobytes() == samples[:900].tobytes()
    assert sum(map(len, read)) < 4 * (len(left) + len(marks) + records.MOST_BYTES)


def test_what_somebody_else_has_beside_a_recording_is_not_deleted(tmp_path, header, monkeypatch):
    theirs = tmp_path / ".run.h5.records.part"
    theirs.write_text("mine")
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    with pytest.raises(BadInputError, match="cannot be written"):
        RunWriter(tmp_path / "run.h5", header)
    assert theirs.read_text() == "mine"
    monkeypatch.undo()
    record(tmp_path / "run.h5", header)
    assert os.listdir(tmp_path) == ["run.h5"]


def test_records_without_a_header_stay_and_are_named(tmp_path, header, samples):
    path = tmp_path / "run.h5"
    left = left_by_a_crash(path, header, Chunk(samples, 0, []))
    records_of(path).write_bytes(left[:5000])
    for use in (read_run, lambda path: RunWriter(path, header)):
        with pytest.raises(BadInputError, match="the header of its records") as refused:
            use(path)
        assert refused.value.code == "recording_unreadable"
    assert records_of(path).read_bytes() == left[:5000]


@pytest.fixture
def small_files():
    """A function that lets no file of this process become larger than so many bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
    signal.signal(signal.SIGXFSZ, handler)


def test_what_a_crash_left_is_read_without_room_and_put_away_with_it(
    tmp_path, header, samples, small_files, caplog
):
    path = tmp_path / "run.h5"
    left_by_a_crash(path, header, Chunk(samples, 0, EVENTS))
    small_files(100_000)
    assert read_run(path).samples.tobytes() == samples.tobytes()
    assert os.listdir(tmp_path) == ["run.h5.records"]
    small_files(resource.RLIM_INFINITY)
    assert read_run(path).samples.tobytes() == samples.tobytes()
    assert os.listdir(tmp_path) == ["run.h5"]
    said = f"{path}: a recorder was killed or had no space left, what it wrote is"
    assert f"{said} still in {records_of(path)}" in caplog.messages[0]
    assert caplog.messages[1:] == [f"{said} in it now"]


def tell_ticks(shared, first, count):
    for tick in range(first, first + count):
        shared.ring.write(made_tick(tick))


def await_samples(path, count):
    return until(lambda: (run := read_run(path)).samples.size >= count and run)


@pytest.mark.process
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


@pytest.mark.process
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


@pytest.mark.process
def test_a_full_disk_ends_the_recording_and_keeps_what_there_was(tmp_path, shared, header):
    recorder = Recorder(tmp_path / "run.h5", header, shared)
    tell_ticks(shared, 0, 20)
    await_samples(tmp_path / "run.h5", 20)
    size = records_of(tmp_path / "run.h5").stat().st_size
    resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (size, size))  # no file may grow any more
    tell_ticks(shared, 20, 10_000)
    why = until(recorder.ended)
    assert "recording stopped" in why
    assert "Make room on the disk" in why
    assert ".part" not in why
    run = read_run(tmp_path / "run.h5")
    assert run.samples["tick"].tolist() == list(range(20))
    assert run.attributes["complete"] is False
    assert "File too large" in run.attributes["why_incomplete"]
    assert os.listdir(tmp_path) == ["run.h5"]


@pytest.mark.process
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
        lambda path: records_of(path).unlink(),
        lambda path: shutil.rmtree(path.parent),
        lambda path: records_of(path).rename(path.with_name("moved")),
    ],
    ids=["the file", "its records", "their folder", "moved"],
)
def test_who_deletes_the_file_of_a_running_recording_loses_nothing(
    tmp_path, header, samples, meddle
):
    path = tmp_path / "folder" / "run.h5"
    record(path, header, Chunk(samples[:50], 0, []))
    news = record_meanwhile(path, header, samples, meddle)
    assert read_run(path, "run_0001").samples.tobytes() == samples[:50].tobytes()
    run = read_run(path)
    assert run.samples.tobytes() == samples.tobytes()
    assert run.events == EVENTS
    assert run.attributes["complete"] is True
    assert {*os.listdir(path.parent)} - {"moved"} == {"run.h5"}
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    said = "was deleted while it is recorded, and is put back, whole"
    assert {*news} <= {f"{path} {said}", f"{records_of(path)} {said}"}


@pytest.mark.process
def test_what_a_deleted_file_held_survives_a_kill_once_it_is_put_back(tmp_path, shared, header):
    path = tmp_path / "run.h5"
    recorder = Recorder(path, header, shared)
    tell_ticks(shared, 0, 20)
    await_samples(path, 20)
    records_of(path).unlink()
    assert "was deleted while it is recorded, and is put back" in until(recorder.news)[0]
    os.kill(recorder.pid, signal.SIGKILL)
    why = until(recorder.ended)
    assert "killed by SIGKILL" in why
    assert f"what came before is in {records_of(path)}" in why
    assert read_run(path).samples["tick"].tolist() == list(range(20))
    assert os.listdir(tmp_path) == ["run.h5"]


def append_and_close(writer, chunk):
    writer.append(chunk)
    writer.close()


@pytest.mark.parametrize("runs", [0, 1])
def test_another_file_in_its_place_is_left_alone_and_what_came_before_is_beside_it(
    tmp_path, header, samples, runs
):
    path, mine = tmp_path / "run.h5", tmp_path / "mine"
    for _ in range(runs):
        record(path, header, Chunk(samples, 0, []))
    writer = RunWriter(path, header)
    writer.append(Chunk(samples[:500], 0, EVENTS))
    mine.write_text("mine")
    os.replace(mine, path)
    with pytest.raises(HapticError) as failed:
        append_and_close(writer, Chunk(samples[500:], 0, []))
    assert f"what came before is in {records_of(path)}" in failed.value.message
    assert path.read_text() == "mine"
    with pytest.raises(BadInputError, match="not a readable HDF5 file"):
        read_run(path)
    path.rename(mine)
    kept = samples[:500] if runs else samples
    assert read_run(path).samples.tobytes() == kept.tobytes()


def test_another_file_in_place_of_the_records_is_left_alone(tmp_path, header, samples):
    path = tmp_path / "run.h5"
    writer = RunWriter(path, header)
    writer.append(Chunk(samples[:500], 0, EVENTS))
    records_of(path).unlink()
    records_of(path).write_text("mine")
    with pytest.raises(HapticError, match="another file has taken its place"):
        writer.append(Chunk(samples[500:], 0, []))
    assert records_of(path).read_text() == "mine"
    records_of(path).unlink()
    run = read_run(path)
    assert run.samples.tobytes() == samples[:500].tobytes()
    assert "another file" in run.attributes["why_incomplete"]


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
        (errno.EROFS, "Check the rights"),
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
    assert f"what came before is in {records_of(tmp_path / 'run.h5')}" in failed.value.message


def append_for_ever(writer, chunk):
    while True:
        writer.append(chunk)


def refuse_once(monkeypatch, at_write):
    """The disk has no space left for one write."""
    pwrite, written = os.pwrite, 0

    def refuse(descriptor, data, offset):
        nonlocal written
        written += 1
        if written == at_write:
            raise OSError(28, "No space left on device")
        return pwrite(descriptor, data, offset)

    monkeypatch.setattr(os, "pwrite", refuse)


@pytest.mark.parametrize("at_write", range(1, 6))
def test_no_refused_byte_is_ever_taken_for_written(
    tmp_path, header, samples, monkeypatch, at_write
):
    path = tmp_path / "run.h5"
    writer = RunWriter(path, header)
    writer.append(Chunk(samples[:500], 0, EVENTS[:1]))
    refuse_once(monkeypatch, at_write)
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


@pytest.mark.parametrize("at_write", range(1, 60, 6))
def test_no_byte_refused_at_the_end_is_taken_for_written(
    tmp_path, header, samples, monkeypatch, at_write
):
    """HDF5 prints a full disk and goes on."""
    path = tmp_path / "run.h5"
    writer = RunWriter(path, header)
    writer.append(Chunk(samples, 0, EVENTS))
    refuse_once(monkeypatch, at_write)
    with pytest.raises(HapticError, match="No space left"):
        writer.close()
    run = read_run(path)
    assert (run.samples.tobytes(), run.events) == (samples.tobytes(), EVENTS)
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


@pytest.mark.process
def test_the_process_refuses_like_the_writer(tmp_path, shared, header):
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInputError, match="cannot be written") as refused:
        Recorder(tmp_path / "file" / "run.h5", header, shared)
    assert refused.value.code == "recording_not_made"


@pytest.mark.process
def test_a_run_ends_in_good_order_when_control_is_gone(tmp_path, shared, header):
    recorder = Recorder(tmp_path / "run.h5", header, shared)
    tell_ticks(shared, 0, 30)
    recorder._talk.close()  # as the end of its process does
    until(lambda: recorder._child.ended)
    assert read_run(tmp_path / "run.h5").samples["tick"].tolist() == list(range(30))
    assert read_run(tmp_path / "run.h5").attributes["complete"] is True
    recorder._child.stop()


class Paces:
    """A ring of 100 ticks, with ticks put there, and the thread that takes them, a look at a
    time.
    """

    def __init__(self):
        self.ring = Ring(memoryview(bytearray(64 + 100 * SAMPLE.itemsize)), SAMPLE, 100)
        self._look, self._looked = threading.Semaphore(0), threading.Semaphore(0)
        self.ahead = Ahead(self.ring, 0, sleep=self._sleep)
        self._looked.acquire()

    def put(self, count):
        for _ in range(count):
            self.ring.write(made_tick(self.ring.position))

    def look(self):
        self._look.release()
        self._looked.acquire()

    def _sleep(self, _):
        self._looked.release()
        self._look.acquire()


def test_a_disk_that_stands_still_for_longer_than_the_ring_holds_costs_no_tick(
    tmp_path, header, monkeypatch
):
    """8,602 ticks were once missing, since 25 s passed before the first were on the disk."""
    paces, fsync = Paces(), os.fsync

    def standing_still(descriptor):
        for _ in range(3):
            paces.put(80)
            paces.look()
        fsync(descriptor)

    monkeypatch.setattr("os.fsync", standing_still)
    writer = RunWriter(tmp_path / "run.h5", header)
    ends = iter([((EVENTS[0],), False), ((EVENTS[1],), True)])
    assert record_run(writer, paces.ahead.drain, lambda: next(ends)) is None
    run = read_run(tmp_path / "run.h5")
    assert run.samples["tick"].tolist() == list(range(len(run.samples)))
    assert len(run.samples) > 1000
    assert [event.number for event in run.events] == [4, 5]


def test_ticks_held_for_a_disk_have_an_end_and_those_lost_are_counted(monkeypatch):
    monkeypatch.setattr("haptic_driver.recording.process.MOST_HELD", 150)
    paces = Paces()
    for _ in range(4):
        paces.put(80)
        paces.look()
    first, second, last = paces.ahead.drain()
    assert [len(first.samples), len(second.samples)] == [80, 80]
    assert (last.lost + len(last.samples), last.samples["tick"][-1]) == (160, 319)
    assert last.lost > 0
