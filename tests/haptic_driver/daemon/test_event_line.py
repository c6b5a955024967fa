"""Events of the daemon as edges on a line: codes, order, times, and a line that fails."""

import time
from itertools import pairwise

import numpy as np
import pytest

from haptic_driver.daemon.event_line import Codes, EventLineWriter
from haptic_driver.daemon.event_log import EventLog
from haptic_driver.processes import kept
from haptic_driver.processes.samples import SAMPLE
from haptic_driver.processes.shared_memory import SharedState
from haptic_driver.recording.event import Event
from haptic_driver.rig.evidence import KnownOutput
from haptic_driver.rig.parts.event_lines import EventCodes
from hw.event_line.simulated import SimulatedEventLine, SimulatedTriggerBox
from hw.event_line.trigger_box import TriggerBox
from hw.serving.responder import Disconnect
from hw.serving.serial import SerialServer
from hw.transport.serial import SerialTransport
from tests.waiting import HANG_S, until

pytestmark = pytest.mark.timeout(2 * HANG_S)
PULSE_S = 1e-3


def marker(label, kind="marker", **data):
    return Event(number=1, time_s=0.0, kind=kind, message=label, data=data)


@pytest.mark.parametrize(
    ("event", "code"),
    [
        (marker("trial begins"), 10),
        (marker("trial ends", response="first"), 11),
        (marker("interval 1 begins"), 21),
        (marker("interval 2 ends"), 32),
        (marker("answered", answer=2), 42),
        (marker("answered", answer="second"), 0),
        (marker("stimulus"), 50),
        (marker("stimulus", code=37), 37),
        (marker("stimulus", code=256), 50),
        (marker("session begins"), 0),
        (marker("answer", answer="go on"), 0),  # to no question
        (marker("interval 1 begins", kind="edge", code=21), 0),
        (marker("idle", kind="state"), 0),
    ],
)
def test_an_event_has_the_code_of_the_table(event, code):
    assert Codes(EventCodes()).of(event) == code


def test_a_code_of_0_in_the_table_is_no_edge():
    codes = Codes(EventCodes(interval=0, answer=0, marker=0, trial=0))
    events = [marker("interval 1 begins"), marker("answered", answer=1), marker("x")]
    assert [codes.of(event) for event in (*events, marker("trial begins"))] == [0, 0, 0, 0]


@pytest.mark.parametrize("answer", [marker("second"), marker("answer", answer="second")])
def test_an_answer_counts_once_by_its_place_among_those_of_the_question(answer):
    codes = Codes(EventCodes())
    assert codes.of(marker("question", text="?", answers=["first", "second"])) == 0
    assert codes.of(answer) == 42
    assert codes.of(marker("answer", answer="second")) == 0
    assert codes.of(marker("question", text="A break.", answers=["go on"])) == 0
    assert codes.of(marker("answer", answer="go on")) == 0


class Bench:
    """A writer on a line, with samples and an output as a test has them."""

    def __init__(self, line):
        self.shared, self.events, self.output_on, self.misses = SharedState(), EventLog(), False, 0
        self.ticks = 0
        self.writer = EventLineWriter(
            line,
            PULSE_S,
            EventCodes(),
            self.shared.ring,
            lambda: KnownOutput(self.output_on, "generator says off", 0.2),
            self.events,
            self.miss,
        )

    def miss(self):
        self.misses += 1

    def tick(self, in_contact, time_s):
        self.ticks += 1
        sample = np.zeros(1, SAMPLE)
        sample["tick"], sample["time_s"], sample["in_contact"] = self.ticks, time_s, in_contact
        self.shared.ring.write(sample[0].item())

    def told(self, kind):
        return [event for event in self.events.since(0) if event.kind == kind]


@pytest.fixture
def bench_on():
    benches = []

    def made(line):
        benches.append(Bench(line))
        benches[-1].writer.start()
        return benches[-1]

    yield made
    for bench in benches:
        bench.writer.close()
        bench.shared.close()


def codes_of(box):
    return [edge.code for edge in box.edges]


def test_markers_touch_and_output_are_edges_in_order_and_events_with_times(bench_on):
    bench = bench_on(line := SimulatedEventLine())
    box, touched_s = line.box, time.monotonic()
    steps = [
        lambda: bench.events.tell("marker", "stimulus", code=37),
        lambda: bench.tick(True, touched_s),
        lambda: setattr(bench, "output_on", True),
        lambda: setattr(bench, "output_on", None),  # nobody knows
        lambda: bench.events.tell("state", "armed"),
        lambda: setattr(bench, "output_on", False),
        lambda: bench.tick(False, touched_s + 1e-3),
    ]
    edges = [37, 1, 3, None, None, 4, 2]
    for step, code in zip(steps, edges, strict=True):
        before = len(box.edges)
        step()
        until(lambda code=code, before=before: code is None or len(box.edges) == before + 2)
    assert codes_of(box) == [37, 0, 1, 0, 3, 0, 4, 0, 2, 0]
    told = bench.told("edge")
    whats = ["stimulus", "touch", "output on", "output off", "lift"]
    assert [event.message for event in told] == whats
    assert [event.data["code"] for event in told] == [37, 1, 3, 4, 2]
    assert told[3].data["evidence"] == "off (generator says off, 0.2 s ago)"
    stimulus, touch = bench.told("marker")[0], told[1]
    assert told[0].data["event"] == stimulus.number
    assert told[0].time_s == pytest.approx(stimulus.time_s + told[0].data["late_s"])
    assert touch.time_s == pytest.approx(touched_s + touch.data["late_s"])


def test_edges_of_one_moment_come_one_after_the_other(bench_on):
    bench = bench_on(line := SimulatedEventLine())
    for code in range(1, 11):
        bench.events.tell("marker", "burst", code=code)
    until(lambda: len(line.box.edges) == 20)
    assert codes_of(line.box) == [code for n in range(1, 11) for code in (n, 0)]
    times_s = [edge.time_s for edge in bench.told("edge")]
    assert min(b - a for a, b in pairwise(times_s)) >= 2 * PULSE_S  # high, then low


def test_an_edge_that_would_come_too_late_is_left_out_and_counted(bench_on):
    """600 markers at once made the next edge 6.6 s late, and nothing said so."""
    bench = bench_on(line := SimulatedEventLine())
    now_s = time.monotonic()
    for code, ago_s in ((1, 10.0), (2, 2.0), (3, 0.2)):
        bench.events.add("marker", "crowded", {"code": code}, now_s - ago_s)
    until(lambda: bench.told("event_line") and len(line.box.edges) == 2)
    assert codes_of(line.box) == [3, 0]
    (edge,) = bench.told("edge")
    assert (edge.data["code"], edge.data["late"]) == (3, True)
    assert [said.data["missing"] for said in bench.told("event_line")] == [bench.misses] == [2]


class FailsAt99(SimulatedTriggerBox):
    """Is unplugged by the first byte of that value."""

    failed = False

    def handle(self, data):
        if 99 in data and not self.failed:
            self.failed = True
            raise Disconnect(b"")
        return super().handle(data)


def test_a_line_that_fails_is_told_tried_again_and_leaves_out_what_was_due(bench_on, monkeypatch):
    monkeypatch.setattr(kept, "RETRY_S", 0.05)
    box = FailsAt99()
    with SerialServer(box, framed=False) as server:
        bench = bench_on(TriggerBox(SerialTransport(server.path), settle_s=0.0))

        def mark_until_it_fails():
            bench.events.tell("marker", "unplugged", code=99)
            return bench.misses

        until(mark_until_it_fails)
        until(lambda: any("is back" in event.message for event in bench.told("event_line")))
        bench.events.tell("marker", "again", code=7)
        until(lambda: 7 in codes_of(box))
    lost, back = bench.told("event_line")
    assert lost.message.startswith("no edges: ")
    assert back.data["missing"] == bench.misses > 0


def test_a_line_that_is_not_there_is_told_once(bench_on, monkeypatch):
    monkeypatch.setattr(kept, "RETRY_S", 0.01)
    bench = bench_on(TriggerBox(SerialTransport("/dev/no-such-port")))
    until(lambda: bench.told("event_line"))
    for _ in range(3):
        before = bench.misses
        bench.events.tell("marker", "x")
        until(lambda before=before: bench.misses > before)
    told = [event.message for event in bench.told("event_line")]
    assert [said.partition(":")[0] for said in told] == ["no edges"]
    assert bench.told("edge") == []
