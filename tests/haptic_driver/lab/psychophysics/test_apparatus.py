"""Trials as a client of the daemon presents them; the daemon is made up."""

from types import SimpleNamespace

import numpy as np
import pytest

from haptic_driver.daemon.messages import LoadPhase, LoadStatus
from haptic_driver.errors import HapticError
from haptic_driver.lab.psychophysics.apparatus import DaemonApparatus
from haptic_driver.lab.psychophysics.description import Stimulus, TrialSettings
from haptic_driver.processes.samples import SAMPLE


class Client:
    """Half a second of sliding each time somebody looks, with friction as it is asked; `done` in
    order.
    """

    def __init__(self):
        self.done, self.cof, self.ticks = [], np.nan, 0
        self.marked = {}

    def samples(self, since_tick=0, most=1000):
        made = np.zeros(500, SAMPLE)
        made["tick"] = self.ticks + np.arange(500)
        self.ticks += 500
        made["time_s"] = 1e-3 * made["tick"]
        made["in_contact"], made["reachable"], made["speed_m_s"] = 1, 1, 0.05
        made["output_on"] = 1
        made["target_cof"] = made["expected_cof"] = made["measured_cof"] = self.cof
        made["normal_force_n"], made["lateral_force_n"] = 0.5, 0.5 * self.cof
        return made

    def mark(self, label, data=None):
        self.done.append(label)
        self.marked[label] = data
        return SimpleNamespace(time_s=0.0, number=len(self.done))

    def status(self):
        return SimpleNamespace(state="rendering", fault=None)

    def set(self, cof, *, nearest=False):
        self.done.append(cof)
        self.cof = cof

    def off(self):
        self.done.append("off")


def test_each_interval_is_told_and_marked_at_both_ends_and_ends_off(tmp_path):
    client, told = Client(), []
    apparatus = DaemonApparatus(client, client, tmp_path, told.append, lambda: told.append("ring"))
    settings = TrialSettings(duration_s=0.4, pause_s=0.0)
    first, second = apparatus.present([Stimulus(0.55), Stimulus(0.66)], settings, settle_s=0.1)
    assert client.done == [
        *("interval 1 begins", 0.55, "off", "interval 1 ends"),
        *("interval 2 begins", 0.66, "off", "interval 2 ends"),
    ]
    assert told == ["1 … slide now", "wait …", "2 … slide now"]
    assert (round(first.felt_cof, 6), round(second.felt_cof, 6)) == (0.55, 0.66)
    assert client.marked["interval 2 begins"] == {"interval": 2, "of": 2, "sound": False}
    when = client.marked["interval 2 ends"]
    assert when["onset_s"] == when["first_touch_s"] == apparatus.onset.onset_s


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ([("flag", "late"), ("lease", "the lease ran out"), ("state", "armed by A")], "the lease"),
        ([], "the daemon is idle"),
    ],
)
def test_an_interval_that_was_cut_off_says_what_the_daemon_told_of_it(tmp_path, told, said):
    """A lease that ran out was "the daemon is idle"."""
    client = Client()
    client.status = lambda: SimpleNamespace(state="idle")
    client.events = lambda since: [
        SimpleNamespace(kind=kind, message=message) for kind, message in told if since == 1
    ]
    with pytest.raises(HapticError, match=f"^{said}") as caught:
        DaemonApparatus(client, client, tmp_path).present(
            [Stimulus(0.55)], TrialSettings(intervals=1, duration_s=0.4), settle_s=0.1
        )
    assert caught.value.code == "stopped"
    assert "off" not in client.done


def test_the_stage_presses_anew_in_each_interval_before_that_begins(tmp_path):
    """It comes to hold the load at the third look; at the end it does no more."""
    client, looks = Client(), []

    def status():
        looks.append(client.done[-1])
        settling = len(looks) % 5 in (1, 2)
        held = LoadStatus(
            phase=LoadPhase.APPROACH if settling else LoadPhase.HOLD,
            target_n=0.4 if len(looks) <= 10 else None,
            load_n=0.05 if settling else 0.41,
            depth_m=0.0,
        )
        return SimpleNamespace(state="rendering", fault=None, load=held)

    client.status = status
    client.hold_load = lambda newtons: client.done.append(("hold", newtons)) or status()
    apparatus = DaemonApparatus(client, client, tmp_path)
    settings = TrialSettings(duration_s=0.4, pause_s=0.0, load_n=0.4)
    apparatus.present([Stimulus(0.55), Stimulus(0.66)], settings, settle_s=0.1)
    one = [("hold", 0.4), "interval 1 begins", 0.55, "off", "interval 1 ends"]
    assert client.done[:5] == one
    assert client.done[5] == ("hold", 0.4)
    assert looks[:3] == [("hold", 0.4)] * 3
    with pytest.raises(HapticError, match="N was not held") as caught:
        apparatus.present([Stimulus(0.55)], settings, settle_s=0.1)
    assert caught.value.code == "load_let_go"


def test_the_only_interval_has_no_number_and_sounds_where_the_file_says_so(tmp_path):
    client, told = Client(), []
    apparatus = DaemonApparatus(client, client, tmp_path, told.append, lambda: told.append("ring"))
    settings = TrialSettings(intervals=1, duration_s=0.4, sound=True)
    apparatus.present([Stimulus(0.55)], settings, settle_s=0.1)
    assert client.done == ["interval 1 begins", 0.55, "off", "interval 1 ends"]
    assert client.marked["interval 1 begins"]["sound"] is True
    assert told == ["slide now", "ring"]


def test_two_regions_are_one_interval(tmp_path):
    client = Client()
    apparatus = DaemonApparatus(client, client, tmp_path)
    client.play = lambda texture, *, nearest=False: client.done.append("regions")
    settings = TrialSettings(place="regions", duration_s=0.4)
    apparatus.present([Stimulus(0.55), Stimulus(0.66)], settings, settle_s=0.1)
    assert client.done == ["interval 1 begins", "regions", "off", "interval 1 ends"]
