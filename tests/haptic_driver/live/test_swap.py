"""Render goes on with what comes of mending, and back."""

import pytest

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.live.swap import NOTHING_YET, Proposal, Swap, Word


class Installed:
    """What render is told to go by, in the place of a daemon."""

    def __init__(self, base, mended):
        self.surfaces, self.taken, self.words = [], True, []
        self.events = EventLog()
        self.swap = Swap(base, self, self.events.tell, self.words.append)
        self.proposal = Proposal("1 % off now", mended, {"cof_off": 0.5}, [[200.0, 60.0]])

    def __call__(self, surface, too_late):
        if self.taken and not too_late():
            self.surfaces.append(surface)
            return True
        return False

    def told(self):
        return [
            (event.message, event.data.get("rows"))
            for event in self.events.since(0)
            if event.kind == "adapt"
        ]


@pytest.fixture
def installed(small_file, surface_file):
    return Installed(small_file, surface_file)


def test_render_goes_by_what_is_mended_and_back(installed, small_file, surface_file):
    swap = installed.swap
    swap.take(installed.proposal)
    assert installed.surfaces == []  # nobody has asked for it
    swap.adapt(True)
    assert swap.said == NOTHING_YET
    swap.take(installed.proposal)
    swap.take(Proposal("not better"))
    assert installed.surfaces == [surface_file]
    swap.adapt(False)
    swap.adapt(False)
    assert installed.surfaces == [surface_file, small_file]
    assert installed.words == [Word.ADAPT, Word.TAKEN, Word.REST, Word.BASE, Word.REST]
    assert installed.told() == [
        ("refitted: 1 % off now", [[200.0, 60.0]]),
        ("no refit: not better", None),
        ("back to the model as it was", None),
    ]


def test_what_render_does_not_take_up_is_not_told_as_mended(installed):
    installed.swap.adapt(True)
    installed.taken = False
    installed.swap.take(installed.proposal)
    assert installed.told() == []
    assert installed.words == [Word.ADAPT]


def test_a_way_back_that_render_does_not_take_up_is_tried_again(installed, small_file):
    installed.swap.adapt(True)
    installed.swap.take(installed.proposal)
    installed.taken = False
    assert not installed.swap.back()
    installed.taken = True
    assert installed.swap.back()
    assert installed.surfaces[-1] is small_file


def test_nothing_is_swapped_in_the_end(installed):
    installed.swap.adapt(True)
    installed.swap.ending.set()
    installed.swap.take(installed.proposal)
    assert (installed.surfaces, installed.told()) == ([], [])
