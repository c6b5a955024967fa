"""A person is guided through passes; here a finger that does what it is told, in simulated time."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from haptic_driver.config import texture_dirs
from haptic_driver.daemon.set_up import render_settings
from haptic_driver.daemon.stepped import UP_TICKS, SteppedDaemon
from haptic_driver.errors import HapticError
from haptic_driver.lab.papers.sheet_numbers import cof_in_blocks, mean_of, responses
from haptic_driver.lab.papers.sheet_passes import ALWAYS, Pass, edges, steps
from haptic_driver.lab.papers.sheet_person import TRIES, GuidedSlider
from haptic_driver.processes.samples import SAMPLE
from haptic_driver.render.texture import Script, Uniform
from haptic_driver.simulation.rig import SimulatedRig
from haptic_driver.textures.library import load

FROM_M, STROKE_M = 0.01, 0.09


class Person:
    """Does what it is told, `clumsiness` times as fast; client, session and clock of a daemon that
    runs as it waits.
    """

    def __init__(self, config, touch, surface_file, clumsiness=1.0):
        self._bench = SimulatedRig(config, touch, envelope=True)
        self._settings = render_settings(config, surface_file, feedback=False)
        self._clumsiness = clumsiness
        self._load_n, self._speed_m_s, self._way_m = 0.0, 0.0, 0.0
        self.played, self.switched_off = [], 0

    def __enter__(self):
        self._bench.__enter__()
        self._daemon = SteppedDaemon(self._settings, self._bench, Uniform(ALWAYS))
        self._daemon.connect()
        self.sleep(1e-3 * UP_TICKS)
        return self

    def __exit__(self, *_):
        self._bench.rig.off()
        self._daemon.close()
        self._bench.__exit__(None, None, None)

    def tell(self, said):
        found = re.search(r"([\d.]+) N at ([\d.]+) mm/s", said)
        told = (float(found[1]), 1e-3 * float(found[2])) if found else (0.0, 0.0)
        self._load_n, self._speed_m_s = told[0], self._clumsiness * told[1]

    def clock(self):
        return self._bench.instruments.time_s

    def sleep(self, duration_s):
        for _ in range(round(duration_s * 1e3)):
            self._way_m = (self._way_m + 1e-3 * self._speed_m_s) % (2.0 * STROKE_M)
            x_m = FROM_M + min(self._way_m, 2.0 * STROKE_M - self._way_m)
            self._daemon.tick(x_m, self._load_n, self._speed_m_s)

    def samples(self, since_tick=0, most=1000):
        newest = self._daemon.shared.ring.newest(most)
        return newest[newest["tick"] > since_tick]

    def set(self, cof, *, nearest=False):
        assert nearest
        self._daemon.play(Uniform(cof))

    def play(self, texture, *, nearest=False):
        assert nearest
        target = load(texture, texture_dirs()).target
        self.played.append(target)
        self._daemon.play(target.started(self.clock()) if isinstance(target, Script) else target)

    def off(self):
        self.switched_off += 1
        self._daemon.play(Uniform(0.0))


@pytest.fixture
def person(rig_config, touch, surface_file):
    with Person(rig_config, touch, surface_file) as person:
        yield person


def guided(person, folder):
    return GuidedSlider(person, person, folder, person.tell, person.clock, person.sleep)


def test_a_pass_is_what_was_asked_for(person, tmp_path):
    samples = guided(person, tmp_path).slide(Pass("high", Uniform(ALWAYS), 0.5, 0.05, 0.6))
    assert np.ptp(samples["time_s"]) >= 0.6
    assert np.median(samples["speed_m_s"]) == pytest.approx(0.05, rel=0.01)
    assert mean_of(cof_in_blocks(samples)).value > 1.0
    assert person.switched_off >= 1


def test_a_script_and_a_profile_go_to_the_daemon_as_files(person, tmp_path):
    slider = guided(person, tmp_path)
    script, pattern = steps(0.55, ALWAYS), edges(0.55, 0.8)
    samples = slider.slide(Pass("steps", script, 0.5, 0.05, 1.2))
    assert responses(samples, rises=False) is not None
    slider.slide(Pass("edges", pattern, 0.5, 0.05, 0.3))
    read = person.played[0]
    assert [step.time_s for step in read.steps] == [step.time_s for step in script.steps]
    assert person.played[1].cof == pytest.approx(pattern.cof)
    assert person.played[1].position_m == pytest.approx(pattern.position_m)


def test_who_slides_otherwise_each_time_is_told_how_and_the_output_is_off(tmp_path):
    offs, tried = [], []
    slider = GuidedSlider(None, SimpleNamespace(off=lambda: offs.append(1)), tmp_path, print)
    slider._once = lambda asked: tried.append(asked) or np.zeros(9, SAMPLE)
    with pytest.raises(HapticError, match="load or speed") as told:
        slider.slide(Pass("low", Uniform(0.01), 0.5, 0.05, 0.5))
    assert told.value.code == "not_as_asked"
    assert (len(tried), len(offs)) == (TRIES, 1)


@pytest.mark.soak  # some ten seconds
def test_a_finger_that_never_does_so_is_told_and_the_output_is_off(
    rig_config, touch, surface_file, tmp_path
):
    with Person(rig_config, touch, surface_file, clumsiness=2.0) as person:
        with pytest.raises(HapticError, match="the finger did not do so") as refused:
            guided(person, tmp_path).slide(Pass("low", Uniform(0.01), 0.5, 0.05, 0.5))
        assert refused.value.code == "finger_missed"
        assert person.switched_off == 2  # at the beginning and at the end
