"""When the model is mended, by which rows, and that render goes on with what comes of it."""

from __future__ import annotations

import threading

import pytest

from haptic_driver.daemon.adaptation import PERIOD_S, Adaptation, split
from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.observation import Observed, Proposal
from haptic_driver.daemon.observer import NOTHING_YET, Observer
from haptic_driver.experiments.average import Measured
from haptic_driver.experiments.mending import LEAST_HELD_OUT, Dropped, Mended
from haptic_driver.experiments.plan import Row, Setting
from haptic_driver.experiments.recorded import Recorded


def rows(*strokes, begin_s=0.0):
    """One row a second, so many in each stroke."""
    found = []
    for stroke, count in enumerate(strokes, start=1):
        for _ in range(count):
            measured = Measured(0.6, 0.01, 0.5, begin_s + len(found))
            found.append(Recorded(Row(Setting(200.0, 60.0, 0.5, 0.03), 1, stroke), measured))
    return found


@pytest.mark.parametrize(
    ("strokes", "held_out"), [((4, 4, 7), 7), ((4, 4, 4), 8), ((9, 2, 3), 5), ((3,), 3)]
)
def test_the_newest_strokes_judge_and_no_stroke_is_on_both_sides(strokes, held_out):
    known, judges = split(rows(*strokes))
    assert len(judges) == held_out
    assert [*known, *judges] == rows(*strokes)
    assert not {row.row.trial for row in known} & {row.row.trial for row in judges}


def test_a_better_model_is_proposed_with_its_numbers_and_rows_and_is_the_next_one_to_beat(
    model_description, limits
):
    asked = []

    def mend(known, description, held_out, present):
        asked.append(present)
        if len(asked) == 2:
            return Dropped("not better")
        return Mended(description, "better")

    adaptation = Adaptation(model_description, limits, mend)
    assert adaptation.add(rows(LEAST_HELD_OUT - 1)) is None
    adaptation.begin()
    found = adaptation.add(rows(8, 8))
    assert (found.said, found.surface.provenance["model"]["name"]) == (
        "better",
        model_description.name,
    )
    assert len(found.rows) == 16
    assert found.rows[0] == [200.0, 60.0, 0.5, 0.03, 0.6, 0.01, 0.0]
    assert found.numbers["cof_off"] == model_description.parameters["cof_off"].value
    adaptation.taken()
    assert adaptation.add(rows(1, begin_s=15.0 + 0.9 * PERIOD_S)) is None
    assert adaptation.add(rows(8, 8, begin_s=30.0)) == Proposal("not better")
    adaptation.add([])
    assert asked == [model_description, model_description]


class Installed:
    """What render is told to go by, in the place of a daemon."""

    def __init__(self, surface_file):
        self.surfaces, self.taken, self.ending = [], True, threading.Event()
        self.events = EventLog()
        self.observer = Observer(None, self.events, self)
        self.proposal = Proposal("1 % off now", surface_file, {"cof_off": 0.5}, [[200.0, 60.0]])

    def __call__(self, surface, too_late):
        if self.taken and not too_late():
            self.surfaces.append(surface)
        return self.taken

    def told(self):
        return [
            (event.message, event.data.get("rows"))
            for event in self.events.since(0)
            if event.kind == "adapt"
        ]


@pytest.fixture
def installed(surface_file):
    return Installed(surface_file)


def test_render_goes_by_what_is_mended_and_back(installed, small_file, surface_file, limits):
    observer = installed.observer
    observer.hear(Observed([], [], [], installed.proposal), small_file, installed.ending)
    assert installed.surfaces == []  # nobody has asked for it
    observer.adapt(True)
    assert observer.adaptation == NOTHING_YET
    observer.hear(Observed([], [], [], installed.proposal), small_file, installed.ending)
    observer.hear(Observed([], [], [], Proposal("not better")), small_file, installed.ending)
    assert installed.surfaces == [surface_file]
    observer.adapt(False)
    observer.adapt(False)
    assert installed.surfaces == [surface_file, small_file]
    assert installed.told() == [
        ("mended: 1 % off now", [[200.0, 60.0]]),
        ("not mended: not better", None),
        ("back to the model as it was", None),
    ]


def test_what_render_does_not_take_up_is_not_told_as_mended(installed, small_file):
    installed.observer.adapt(True)
    installed.taken = False
    installed.observer.hear(Observed([], [], [], installed.proposal), small_file, installed.ending)
    assert installed.told() == []
