"""Edges on a rig's line in: recordings that they begin and end, and a line that fails."""

import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.line_in import LineInWatch
from haptic_driver.daemon.messages import DaemonState
from haptic_driver.processes import kept
from haptic_driver.recording.read import read_run
from haptic_driver.rig.line_in import LineInReader
from haptic_driver.rig.parts.lines_in import SimulatedLineInConfig
from hw.event_line.simulated import SimulatedLineIn
from tests.haptic_driver.daemon.lines import LINE_IN, LOW_S
from tests.haptic_driver.daemon.waiting import LEASE_S, STOOD_STILL, keep_rendering
from tests.waiting import HANG_S, until

DAEMON_RIG = "simulated with lines"
pytestmark = [pytest.mark.timeout(4 * HANG_S), pytest.mark.process]


@pytest.fixture(autouse=True)
def opened_again_soon(monkeypatch):
    monkeypatch.setattr(kept, "RETRY_S", 0.01)


@pytest.fixture
def line():
    return LINE_IN


@pytest.fixture
def heard(daemon, line):
    """Makes an edge of so many pulses, and says when; and the event of what came of it."""
    until(lambda: daemon.status().line_in.lost is None)

    def edge(pulses=1):
        before = daemon.events(0)[-1].number
        time.sleep(1.2 * LOW_S)  # since any other
        made_s, *_ = [line.pulse() for _ in range(pulses)]
        told = until(lambda: [e for e in daemon.events(before) if e.kind == "edge_in"])
        return made_s, told[0]

    yield edge
    until(lambda: not daemon.line_in._acting.is_alive())
    if daemon.status().recording is not None:
        daemon.record(None)


def test_an_edge_begins_a_recording_and_the_next_ends_it(daemon, heard):
    before = daemon.status().line_in
    began_s, began = heard()
    status = daemon.status()
    path = status.recording
    assert path is not None
    assert "edge-" in path
    ended_s, ended = heard()
    until(lambda: [e for e in daemon.events(ended.number) if e.message == f"ended: {path}"])
    run = read_run(Path(path))
    edges = [event for event in run.events if event.kind == "edge_in"]
    assert [(e.number, e.time_s) for e in edges] == [(e.number, e.time_s) for e in (began, ended)]
    assert "begins a recording" in began.message
    assert "ends the recording" in ended.message
    assert began_s <= began.time_s <= run.samples["time_s"][0]
    assert ended_s <= ended.time_s
    after = daemon.status()
    assert after.line_in.edges == before.edges + 2
    assert after.line_in.last_edge_s == ended.time_s
    assert f"{after.line_in.edges} edges" in str(after)
    assert after.state is DaemonState.IDLE  # nothing armed it
    assert after.output_on is False


def test_a_recording_of_somebody_else_is_left_alone(daemon, heard, tmp_path):
    before = daemon.status().line_in
    daemon.record(tmp_path / "mine.h5")
    _, event = heard()
    assert "no edge began" in event.message
    assert daemon.status().recording == str(tmp_path / "mine.h5")
    assert daemon.status().line_in.ignored == before.ignored + 1


def test_an_edge_while_one_is_being_begun_is_counted_and_told(daemon, heard, line):
    before = daemon.status().line_in
    with daemon.targets.changing:  # a recording waits for that
        line.pulse()
        until(lambda: daemon.status().line_in.edges == before.edges + 1)
        assert "just being begun" in heard()[1].message
    until(lambda: daemon.status().recording is not None)
    assert daemon.status().line_in.ignored == before.ignored + 1


@pytest.mark.realtime
def test_a_lost_line_is_told_and_rendering_goes_on(daemon, heard, line):
    lease = daemon.arm(LEASE_S)
    daemon.targets.set(lease.token, 0.65)
    keep_rendering(daemon, lease.token, lambda: daemon.status().state is DaemonState.RENDERING)
    before = daemon.events(0)[-1].number
    ticks = daemon.status().ticks
    line.unplug()
    lost, back = until(
        lambda: (
            found
            if len(found := [e for e in daemon.events(before) if e.kind == "line_in"]) > 1
            else None
        )
    )
    assert lost.message.startswith("no edges are heard: ")
    assert back.message.endswith("is heard again")
    until(lambda: daemon.status().ticks > ticks + 100)
    status = daemon.status()  # a machine that stands still ends it too
    stood_still = any(reason in (status.fault or "") for reason in STOOD_STILL)
    assert status.state is DaemonState.RENDERING or stood_still, status
    assert "begins a recording" in heard()[1].message  # it is as it was


@pytest.mark.realtime
def test_a_thousand_edges_a_second_leave_rendering_and_the_events_alone(
    daemon, heard, line, monkeypatch
):
    """Each is one as soon as the line was low at all; most come to nothing, and are counted."""
    monkeypatch.setattr(daemon.line_in._reader, "_low_s", 1e-4)
    lease = daemon.arm(LEASE_S)
    daemon.targets.set(lease.token, 0.65)
    keep_rendering(daemon, lease.token, lambda: daemon.status().state is DaemonState.RENDERING)
    mark = daemon.mark("before", {})
    before = daemon.status()
    with running_alongside(lambda: line.pulse() and time.sleep(1e-3)):
        keep_rendering(
            daemon, lease.token, lambda: daemon.status().line_in.edges > before.line_in.edges + 1500
        )
        status = daemon.status()
    stood_still = any(reason in (status.fault or "") for reason in STOOD_STILL)
    assert status.state is DaemonState.RENDERING or stood_still, status
    assert status.line_in.ignored > before.line_in.ignored + 1000
    kept = daemon.events(0)
    assert [event for event in kept if event.number == mark.number]
    assert len([event for event in kept if event.kind == "edge_in"]) == 1000


@contextmanager
def running_alongside(work):
    """Do it again and again, in a thread of its own."""
    ending = threading.Event()

    def again():
        while not ending.is_set():
            work()

    thread = threading.Thread(target=again)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join()


def test_an_edge_in_fault_records_and_leaves_the_fault(daemon, heard):
    daemon.supervisor._orders.fail("by hand")
    assert "begins a recording" in heard()[1].message
    status = daemon.status()
    assert (status.state, status.fault) == (DaemonState.FAULT, "by hand")
    assert status.output_on is False
    assert status.recording is not None


def test_a_folder_that_cannot_be_made_is_told_once(daemon, heard, monkeypatch, tmp_path):
    section = daemon.line_in._section
    (tmp_path / "file").write_text("")
    no_folder = section.model_copy(update={"folder": str(tmp_path / "file" / "runs")})
    monkeypatch.setattr(daemon.line_in, "_section", no_folder)
    before, ignored = daemon.events(0)[-1].number, daemon.status().line_in.ignored
    for _ in range(3):
        assert "no recording could be begun" in heard()[1].message
    told = [event.message for event in daemon.events(before) if event.kind == "line_in"]
    assert len(told) == 1
    assert "Not a directory" in told[0]
    assert daemon.status().line_in.ignored == ignored + 3
    assert daemon.status().recording is None
    monkeypatch.undo()
    assert "begins a recording" in heard()[1].message


def test_a_line_that_stays_high_has_one_edge_at_most():
    """None where it was high from the start."""
    line, found = SimulatedLineIn(), []
    levels = iter([[True], [True], [False], [], [True]])
    line.levels = lambda: next(levels, [True])
    reader = LineInReader(line, 1e-4, found.append, lambda said: None)
    reader.start()
    until(lambda: next(levels, None) is None and found)
    time.sleep(0.05)
    reader.close()
    assert [edge.number for edge in found] == [1]


def test_a_line_whose_driver_fails_in_closing_too_is_opened_again():
    line, told = SimulatedLineIn(), []
    close, fails = line.close, iter([True])

    def failing_close():
        close()
        if next(fails, False):
            raise OSError("the card is gone")

    line.close = failing_close
    reader = LineInReader(line, 1e-3, lambda edge: None, told.append)
    reader.start()
    until(lambda: reader.lost is None)
    line.unplug()
    until(lambda: told and "is heard again" in told[-1])
    reader.close()
    assert told[0].startswith("no edges are heard")


def test_a_line_that_is_not_there_is_said_in_the_status():
    """And one whose edges are for strokes begins no recording."""
    events, recorded = EventLog(), []
    section = SimulatedLineInConfig(kind="simulated", start="stroke", low_s=1e-3)
    line = SimulatedLineIn()
    watch = LineInWatch(line, section, recorded.append, lambda: None, events)
    assert watch.status().lost is not None
    watch.start()
    until(lambda: watch.status().lost is None)
    line.pulse()
    until(lambda: [event for event in events.since(0) if event.kind == "edge_in"])
    line.open = lambda: line.no_such_port  # AttributeError: whatever a driver raises
    line.unplug()
    assert "LOST" in str(until(lambda: status if (status := watch.status()).lost else None))
    watch.close()
    assert watch.status().edges == 1
    assert not recorded
