"""A forced-choice trial on the simulated rig, through the daemon: edges on its line, in order."""

from __future__ import annotations

import re

import pytest

from haptic_driver.client import HapticClient
from haptic_driver.daemon.place import Place
from haptic_driver.daemon.web.server import serve
from haptic_driver.lab.psychophysics.apparatus import DaemonApparatus
from haptic_driver.lab.psychophysics.data import SessionFiles
from haptic_driver.lab.psychophysics.rehearsal import pretended
from haptic_driver.lab.psychophysics.run import run_session
from haptic_driver.recording.read import read_run
from tests.haptic_driver.daemon.lines import LINE
from tests.haptic_driver.daemon.waiting import LEASE_S
from tests.haptic_driver.lab.psychophysics.files import made
from tests.waiting import until

pytestmark = pytest.mark.process

DAEMON_RIG = "simulated with lines"
ONE_TRIAL = """[trial]
strokes = 1
pause_s = 0.1
[delivery]
settle_s = 0.0
least_sliding_s = 0.0
least_share = 0.0
[method]
kind = "constant"
levels = [0.1]
repeats = 1
"""
OF_THE_TRIAL = re.compile(r"trial|interval|answered")


def up_to_its_end(codes: list[int]) -> list[int]:
    """The finger slides on: what it does after the last trial is none of it."""
    return codes[: len(codes) - codes[::-1].index(11)]


def test_a_forced_choice_trial_puts_its_edges_on_the_line_in_order(daemon, tmp_path):
    experiment = made(tmp_path, tables=ONE_TRIAL, conditions='[[condition]]\nname = "a"\ncof = 0.6')
    files = SessionFiles(tmp_path / "out", "P1", "01", "made")
    recording = tmp_path / "run.h5"
    place = Place(tmp_path / "d.sock")
    with serve(daemon, place, None), HapticClient(place.path) as client:
        client.record(str(recording))
        with client.armed(LEASE_S) as session:
            apparatus = DaemonApparatus(client, session, tmp_path)
            somebody = pretended(experiment, "P1", "01")
            assert run_session(experiment, files, apparatus, somebody, {}).done
        until(lambda: [edge.code for edge in LINE.box.edges if edge.code >= 10][-1:] == [11])
        client.record(None)
    place.close()
    row = files.rows()[-1]  # on a busy machine the first may not have been delivered
    answer = 40 + ("first", "second").index(row.response) + 1

    edges = LINE.box.edges
    assert [edge.code for edge in edges][1::2] == [0] * (len(edges) // 2)
    codes = [edge.code for edge in edges if edge.code]
    codes = up_to_its_end(codes[len(codes) - codes[::-1].index(10) - 1 :])
    assert [code for code in codes if code >= 10] == [10, 21, 31, 22, 32, answer, 11]
    # on in each interval, off at its end; on a busy machine more often
    for begin, end in ((21, 31), (22, 32)):
        switched = [c for c in codes[codes.index(begin) : codes.index(end)] if c in (3, 4)]
        assert switched == [3, 4] * (len(switched) // 2)
        assert switched

    run = read_run(recording)
    told = [event for event in run.events if event.kind == "edge"]
    assert up_to_its_end([event.data["code"] for event in told])[-len(codes) :] == codes
    marked = {event.number: event for event in run.events if event.kind == "marker"}
    for event in told:
        assert event.data["late_s"] >= 0.0
        if OF_THE_TRIAL.match(event.message):
            of = marked[event.data["event"]]
            assert (of.message, of.time_s) == (
                event.message,
                pytest.approx(event.time_s - event.data["late_s"]),
            )


def test_a_marker_touch_and_lift_of_the_simulated_finger_are_edges(daemon):
    daemon.mark("flash", {"code": 77})
    until(lambda: {1, 2, 77} <= {edge.code for edge in LINE.box.edges})
    told = {event.message: event for event in daemon.events(0) if event.kind == "edge"}
    assert told["flash"].data["code"] == 77
    assert (told["touch"].data["code"], told["lift"].data["code"]) == (1, 2)
