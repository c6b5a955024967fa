"""Rows of a plan that wait for an edge of the rig's line in."""

from __future__ import annotations

import time

import pytest

from haptic_driver.errors import HapticError
from haptic_driver.lab.measuring import start_line as waiting
from haptic_driver.lab.measuring.benches import bench_for
from haptic_driver.lab.measuring.data_file import DataFile
from haptic_driver.lab.measuring.plan import Plan, load_plan
from haptic_driver.lab.measuring.run import prepare, run
from haptic_driver.lab.measuring.start_line import StartLine, start_line
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.part import NoPart
from haptic_driver.rig.parts.lines_in import SimulatedLineInConfig
from haptic_driver.rig.states import RigState
from hw.event_line.simulated import SimulatedLineIn
from tests.haptic_driver.lab.refusal import refused
from tests.waiting import HANG_S, until

pytestmark = pytest.mark.timeout(2 * HANG_S)
LOW_S = 1e-3


def two_rows() -> Plan:
    plan = load_plan("paper")
    short = {"repeats": 1, "sessions": 1, "settle_s": 0.2, "average_s": 1.0}
    short |= {"settings": plan.settings[:2], "voltage_off_every": 0}
    return plan.model_copy(update=short)


@pytest.mark.parametrize("rig", ["simulated", "simulated-paper"])
def test_each_row_waits_for_its_edge_with_the_output_off(rig, model, tmp_path):
    """The first row's edge is followed by another, which comes to nothing."""
    unseen = load_rig(rig).model_copy(update={"camera": NoPart()})  # drawing takes seconds
    experiment = prepare(unseen, model, two_rows())
    line, said, states = SimulatedLineIn(), [], []

    def tell(what: str) -> None:
        said.append(what)
        if "waiting" in what:
            states.append((bench.rig.state, data.done))
            until(lambda: start.reader.lost is None)
            for edges in (1, 2) if len(states) == 1 else (3,):
                time.sleep(5 * LOW_S)
                line.pulse()
                until(lambda edges=edges: start.reader.edges == edges)

    start = StartLine(line, LOW_S, tell)
    bench = bench_for(experiment, 0, None, lambda what: None)
    bench.await_start = start.wait
    start.reader.start()
    with DataFile.create(tmp_path / "d.csv", experiment.identity()) as data, bench:
        run(experiment, bench, data)
        assert data.done == len(experiment.rows) == 2
    start.reader.close()
    assert states == [(RigState.OFF, 0), (RigState.OFF, 1)]
    assert start.ignored == 1
    assert "row 2: edges that came meanwhile and began nothing: 1" in said


def test_no_edge_ends_the_plan_with_the_output_off(model, tmp_path, monkeypatch):
    monkeypatch.setattr(waiting, "LONGEST_S", 0.05)
    experiment = prepare(load_rig("simulated"), model, two_rows())
    start = StartLine(SimulatedLineIn(), LOW_S, print)
    bench = bench_for(experiment, 0, None, print)
    bench.await_start = start.wait
    kept = DataFile.create(tmp_path / "d.csv", experiment.identity())
    with kept as data, bench, refused("no_edge", hint="not open yet", kind=HapticError):
        run(experiment, bench, data)
    assert bench.rig.state is RigState.OFF
    assert data.done == 0


def test_only_a_rig_that_says_so_waits():
    rig = load_rig("simulated")
    with start_line(rig, print) as none:
        assert none is None
    for start in ("recording", "stroke"):
        section = SimulatedLineInConfig(kind="simulated", start=start, every_s=1e-3)
        with start_line(rig.model_copy(update={"line_in": section}), print) as line:
            assert (line is not None) is (start == "stroke")
            if line is not None:
                line.wait("row 1")
