"""The section `[line_in]` of a rig's file, what the doctor says, and when a rise is an edge."""

from __future__ import annotations

import datetime
from collections.abc import Iterator, Sequence
from threading import Event

import pytest

from haptic_driver.config import parse
from haptic_driver.errors import BadInputError
from haptic_driver.rig.check import Check, CheckStatus, Examination
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.line_in import EdgeIn, LineInReader
from haptic_driver.rig.part import Wiring
from haptic_driver.rig.parts.lines_in import (
    LineInSection,
    ModemLineInConfig,
    NiLineInConfig,
    ParallelPortInConfig,
    SimulatedLineInConfig,
    TriggerBoxInConfig,
)
from hw.analog.ni_daq import NiLineIn
from hw.event_line.modem_line import ModemLineIn
from hw.event_line.parallel_port import ParallelPortIn
from hw.event_line.simulated import SimulatedLineIn
from hw.event_line.trigger_box import TriggerBoxIn
from tests.waiting import HANG_S, until

pytestmark = pytest.mark.timeout(2 * HANG_S)
TODAY = datetime.date(2024, 6, 1)


def rig_with(**section: object) -> RigConfig:
    said = load_rig("simulated").model_dump() | {"line_in": section}
    return parse(RigConfig, said, "rig.toml")


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ({"kind": "ni", "line": "Dev1/port0/line8"}, r"line_in\.kind disagree"),
        ({"kind": "simulated", "start": "output"}, "start"),
    ],
)
def test_what_a_file_may_not_say(section, said):
    with pytest.raises(BadInputError, match=said):
        rig_with(**section)


def test_lines_out_and_in_need_ports_of_their_own():
    port = "/dev/ttyUSB0"
    real = load_rig("template").model_dump()
    real |= {"event_line": {"kind": "modem_line", "port": port}}
    real |= {"line_in": {"kind": "modem_line", "port": port}}
    with pytest.raises(BadInputError, match="each needs a port of its own"):
        parse(RigConfig, real, "rig.toml")


def test_each_kind_has_its_driver_and_address():
    made: dict[LineInSection, type] = {
        TriggerBoxInConfig(kind="trigger_box", resource="/dev/ttyUSB0"): TriggerBoxIn,
        ModemLineInConfig(kind="modem_line", port="/dev/ttyUSB1"): ModemLineIn,
        NiLineInConfig(kind="ni", line="Dev1/port0/line8"): NiLineIn,
        ParallelPortInConfig(kind="parallel_port"): ParallelPortIn,
    }
    simulated = load_rig("simulated")
    for section, kind in made.items():
        line = section.make(Wiring()).device
        assert isinstance(line, kind)
        rig = simulated.model_copy(update={"line_in": section})
        (own,) = set(rig.addresses) - set(simulated.addresses)
        assert own in line.resource
    section = SimulatedLineInConfig(kind="simulated")
    assert isinstance(section.make(Wiring()).device, SimulatedLineIn)


def checks_of(section: LineInSection) -> list[Check]:
    rig = load_rig("simulated").model_copy(update={"line_in": section})
    return list(Examination("line in", rig, TODAY).told(section.examine))


def test_the_doctor_says_of_each_kind_what_it_could_see(tmp_path):
    gone = str(tmp_path / "gone")
    (box,) = checks_of(TriggerBoxInConfig(kind="trigger_box", resource="/dev/no-such-port"))
    (modem,) = checks_of(ModemLineInConfig(kind="modem_line", port="/dev/ttyUSB1"))
    (port,) = checks_of(ParallelPortInConfig(kind="parallel_port", device=gone))
    (simulated,) = checks_of(SimulatedLineInConfig(kind="simulated", code=9))
    assert [check.status for check in (box, modem, port, simulated)] == [
        CheckStatus.FAILED,
        CheckStatus.NOT_VERIFIED,
        CheckStatus.FAILED,
        CheckStatus.OK,
    ]
    assert "haptic status" in modem.hint


def test_the_doctor_looks_where_recordings_would_be_written(tmp_path):
    """A folder that is not there is made by the first recording; below a file it cannot be."""
    to_make, file = str(tmp_path / "a" / "b"), tmp_path / "file"
    file.write_text("")
    (line,) = checks_of(SimulatedLineInConfig(kind="simulated", folder=to_make))
    assert line.status is CheckStatus.OK
    below = str(file / "runs")
    folder, line = checks_of(SimulatedLineInConfig(kind="simulated", folder=below))
    assert (folder.status, line.status) == (CheckStatus.FAILED, CheckStatus.OK)
    assert below in folder.message
    strokes = SimulatedLineInConfig(kind="simulated", folder=below, start="stroke")
    assert [check.status for check in checks_of(strokes)] == [CheckStatus.OK]


class Levels:
    """A line that has one level after the other, a millisecond each, then stays low."""

    resource = "levels"

    def __init__(self, levels: str) -> None:
        self._levels: Iterator[bool] = (level == "1" for level in levels)
        self.now_s = 0.0
        self.is_over = False

    def open(self) -> None:
        """Nothing."""

    def levels(self) -> Sequence[bool]:
        self.now_s = round(self.now_s + 1e-3, 6)
        level = next(self._levels, None)
        self.is_over = level is None
        return (bool(level),)

    def close(self) -> None:
        """Nothing."""


@pytest.mark.parametrize(
    ("levels", "edges_ms", "bounces"),
    [
        ("0010000100", [3, 8], 0),
        ("0011111111", [3], 0),  # high for however long
        ("001010100000100", [3, 13], 2),  # it bounces as it rises
        ("0011100101000001", [3, 16], 2),  # and as it falls
        ("1111000010000", [9], 0),  # high when it was opened
    ],
)
def test_a_rise_is_an_edge_after_three_milliseconds_of_low(levels, edges_ms, bounces):
    line = Levels(levels)
    heard: list[EdgeIn] = []
    reader = LineInReader(line, 3.5e-3, heard.append, print, lambda: line.now_s)
    reader.start()
    until(lambda: line.is_over)
    reader.close()
    assert [round(1e3 * edge.time_s) for edge in heard] == edges_ms
    assert [edge.number for edge in heard] == list(range(1, len(edges_ms) + 1))
    assert (reader.edges, reader.bounces) == (len(edges_ms), bounces)
    assert all(edge.within_s == pytest.approx(1e-3) for edge in heard)


def test_a_line_is_not_heard_before_its_level_is_known():
    """What rises between its opening and the first look is no edge, so nobody says it is heard."""
    looking, may_answer, line = Event(), Event(), Levels("0010")
    levels = line.levels
    line.levels = lambda: looking.set() or (may_answer.wait(HANG_S) and levels())
    reader = LineInReader(line, 1e-3, print, print, lambda: line.now_s)
    reader.start()
    assert looking.wait(HANG_S)
    assert reader.lost is not None
    may_answer.set()
    until(lambda: reader.lost is None and line.is_over)
    reader.close()
    assert reader.edges == 1


class Looks(Levels):
    """All the levels of one look at once, which came some time after the look before."""

    def __init__(self, looks: list[tuple[float, str]]) -> None:
        super().__init__("")
        self._looks = iter([(0.001, "0"), *looks])

    def levels(self) -> Sequence[bool]:
        passed_s, levels = next(self._looks, (0.001, ""))
        self.is_over = not levels
        self.now_s += passed_s
        return [level == "1" for level in levels]


@pytest.mark.parametrize(
    ("looks", "edges", "bounces"),
    [
        ([(0.050, "1010")], 2, 0),  # a late look: they may have been 50 ms apart
        ([(0.002, "1010")], 1, 1),
        ([(0.002, "10"), (0.002, "10")], 1, 1),
        ([(0.002, "10"), (0.050, "10")], 2, 0),
        ([(0.002, "1"), (0.050, "01")], 2, 0),
        ([(0.050, "1"), (0.002, "01")], 1, 1),
    ],
)
def test_two_edges_in_one_late_look_are_no_bounce(looks, edges, bounces):
    line = Looks(looks)
    heard: list[EdgeIn] = []
    reader = LineInReader(line, 10e-3, heard.append, print, lambda: line.now_s)
    reader.start()
    until(lambda: line.is_over)
    reader.close()
    assert (reader.edges, reader.bounces) == (edges, bounces)
    late_s = max(passed_s for passed_s, _ in looks)
    assert all(edge.within_s <= late_s + 1e-9 for edge in heard)
