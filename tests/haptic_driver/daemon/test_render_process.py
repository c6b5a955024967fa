"""What render does by itself when the world around it goes wrong; time is made up."""

import math
import os
import pickle
import subprocess
import sys
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from haptic_driver.daemon import set_up
from haptic_driver.daemon.render_process import Ramp, Renderer
from haptic_driver.processes.child import Child
from haptic_driver.processes.real_time import Due
from haptic_driver.processes.samples import Flag
from haptic_driver.processes.shared_memory import NO_ORDER, Order, Sensed, SharedState
from haptic_driver.render.texture import Grating, Uniform
from haptic_driver.rig.config import load_rig
from haptic_driver.textures.objects import SceneDescription
from haptic_driver.textures.scene import Drawn

PERIOD_S = 0.001
FORBIDDEN = (
    "model",
    "hw",
    "h5py",
    "pydantic",
    "fastapi",
    "matplotlib",
    "haptic_driver.rig.rig",
    "haptic_driver.config",
)


class Bench:
    """A renderer, the control that it believes to have, and a finger that slides at 50 mm/s under
    0.5 N.
    """

    def __init__(self, settings):
        self.settings = settings
        self.shared = SharedState()
        self.now_s = 1000.0
        self.renderer = Renderer(settings, self.shared, clock=lambda: self.now_s)
        self.order = NO_ORDER
        self.number = 0
        self.touching, self.saturated, self.force_n = True, False, 0.5
        self.lateral_n = math.nan  # unknown: nothing is learnt of the finger
        self.sensing = self.beating = True
        self.rehearsals = 0

    def command(self, **changed):
        self.order = self.order._replace(number=self.order.number + 1, **changed)

    def render(self, cof=0.65, lease_s=60.0, texture=None):
        number = self.order.target + 1
        self.shared.targets.write(number, texture or Uniform(cof))
        self.command(arming=1, rendering=True, lease_until_s=self.now_s + lease_s, target=number)

    def run(self, seconds, missed=0):
        """Tick for so long; the outputs."""
        outputs = []
        for _ in range(round(seconds / PERIOD_S)):
            self.number += 1 + missed
            self.now_s += PERIOD_S * (1 + missed)
            if self.sensing:
                x_m = 0.02 + 0.05 * (self.now_s - 1000.0)
                sensed = Sensed(
                    self.now_s,
                    x_m,
                    0.03,
                    self.touching,
                    self.now_s,
                    self.force_n,
                    self.lateral_n,
                    self.saturated,
                )
                self.shared.sensed.write(sensed)
            if self.beating:
                self.order = self.order._replace(beat_s=self.now_s)
            self.shared.order.write(self.order)
            for _ in range(self.rehearsals):
                self.renderer.rehearse(
                    Due(self.number - missed, self.now_s - PERIOD_S * missed, 0.0, 0)
                )
            outputs.append(self.renderer.step(Due(self.number, self.now_s, 0.0, missed)))
        return outputs

    def flags(self):
        return Flag(self.shared.output.read().flags)


@pytest.fixture(scope="session")
def render_settings(rig_config, surface_file):
    return set_up.render_settings(rig_config, surface_file)


@pytest.fixture
def bench(render_settings):
    bench = Bench(render_settings)
    yield bench
    bench.shared.close()


def a_scene(cof=0.65):
    """One friction everywhere, and a circle that nobody touches."""
    circle = {"kind": "circle", "radius_mm": 1.0}
    far = {"id": "far", "shape": circle, "origin_mm": [500.0, 300.0], "cof": 0.6}
    described = SceneDescription.model_validate({"background": {"cof": cof}, "object": [far]})
    return Drawn(described, {}).scene()


def test_objects_of_the_present_scene_alone_are_taken_up_between_two_ticks(bench):
    bench.render(texture=a_scene())
    assert bench.run(0.05)[-1].target_cof == 0.65
    bench.shared.scene.write(bench.order.target, a_scene(0.7).objects)
    assert {output.target_cof for output in bench.run(0.02)} == {0.7}
    bench.shared.scene.write(bench.order.target - 1, a_scene(0.75).objects)  # of the one before
    assert bench.run(0.01)[-1].target_cof == 0.7
    bench.render(cof=0.6)
    assert bench.run(0.01)[-1].target_cof == 0.6


def test_no_output_before_anything_is_asked_for(bench):
    assert not any(output.output_on for output in bench.run(0.05))
    assert bench.flags() == Flag(0)


@pytest.mark.parametrize("wrong_s", [math.nan, math.inf, -math.inf, 1.7e9, 1000.0 + 1e3])
@pytest.mark.parametrize("which", ["finger_time_s", "force_time_s"])
def test_a_reading_without_a_time_or_from_the_future_is_stale(bench, which, wrong_s):
    """Control refuses it first; here is the last place where it could count as fresh."""
    bench.render(0.65)
    assert bench.run(0.1)[-1].output_on
    bench.sensing = False
    bench.shared.sensed.write(bench.shared.sensed.read()._replace(**{which: wrong_s}))
    assert bench.run(0.08)[-1].voltage_v == 0.0
    assert bench.flags() == Flag.STALE_SENSOR


def test_a_target_is_rendered_while_the_finger_touches(bench):
    bench.render(0.65)
    outputs = bench.run(0.1)
    assert outputs[-1].output_on
    assert outputs[-1].target_cof == 0.65
    assert bench.flags() == Flag(0)
    bench.touching = False
    assert bench.run(PERIOD_S)[-1].voltage_v == 0.0
    assert bench.flags() == Flag(0)


def test_the_output_says_which_order_and_target_it_follows(bench):
    bench.render()
    assert (bench.run(PERIOD_S)[-1].order, bench.shared.output.read().target) == (1, 1)
    bench.render(0.6)
    assert (bench.run(PERIOD_S)[-1].order, bench.shared.output.read().target) == (2, 2)


def other_surface(settings, off, rise):
    """The same look-up with other friction without voltage and another rise; as a number of orders
    has it.
    """
    told = settings.tick.controller.settings
    low = told.surface.cof[:, :, :1]
    return replace(
        told, surface=told.surface._replace(cof=off * low + rise * (told.surface.cof - low))
    )


@pytest.mark.parametrize("known", [False, True])
def test_another_surface_between_two_ticks_moves_no_voltage(bench, render_settings, known):
    """Friction without voltage 10 % less and 40 % more rise; with a finger that nobody knows and
    with a known one.
    """

    def slide(seconds):
        outputs = []
        for i in range(round(seconds / PERIOD_S)):
            outputs += bench.run(PERIOD_S)
            noise = 1e-6 * (i % 2)  # or no reading would be a new one
            bench.lateral_n = (
                0.5 * (0.5 + 2.5e-5 * outputs[-1].voltage_v ** 2) + noise if known else math.nan
            )
        return outputs

    bench.render(0.65)
    before = slide(0.4)[-1]
    expected = bench.shared.ring.newest(1)["expected_cof"][0]
    bench.shared.surfaces.write(
        1, (other_surface(render_settings, 0.9, 1.4), render_settings.tick.worst_case)
    )
    bench.command(surface=1)
    after = slide(0.2)
    moved_v = np.diff([before.voltage_v, *(output.voltage_v for output in after)])
    assert before.voltage_v > 50.0
    assert (before.surface, after[0].surface) == (0, 1)
    assert np.abs(moved_v).max() < 0.5
    assert bench.shared.ring.newest(1)["expected_cof"][0] == pytest.approx(expected, rel=0.01)


def test_a_new_arming_knows_nothing_of_the_finger_but_keeps_the_surface(bench, render_settings):
    bench.shared.surfaces.write(
        1, (other_surface(render_settings, 1.0, 1.4), render_settings.tick.worst_case)
    )
    bench.command(surface=1)
    bench.render(0.65)
    with_it = bench.run(0.3)[-1].voltage_v
    bench.command(arming=2)
    assert bench.run(0.3)[-1].voltage_v == pytest.approx(with_it)
    bench.shared.surfaces.write(
        2, (render_settings.tick.controller.settings, render_settings.tick.worst_case)
    )
    bench.command(surface=2, arming=3)
    assert bench.run(0.3)[-1].voltage_v == pytest.approx(
        math.sqrt(1.4) * with_it, rel=0.04
    )  # goes a little faster than V^2


def test_an_order_to_stop_acts_with_the_next_tick(bench):
    bench.render()
    bench.run(0.1)
    bench.command(rendering=False)
    assert bench.run(PERIOD_S)[-1].voltage_v == 0.0


@pytest.mark.parametrize(("force_n", "is_up"), [(1.9, False), (2.1, True)])
def test_a_load_beyond_the_surface_is_flagged(bench, force_n, is_up):
    bench.force_n = force_n
    bench.render()
    assert (Flag.OUTSIDE_SURFACE in Flag(bench.run(0.05)[-1].flags)) is is_up


def assert_ramps_to_zero(voltages_v, before_v, ramp_s):
    assert all(later <= earlier for earlier, later in pairwise(voltages_v))
    half = voltages_v[round(0.5 * ramp_s / PERIOD_S)]
    assert 0.4 * before_v < half < 0.6 * before_v
    assert voltages_v[round(ramp_s / PERIOD_S) + 1] == 0.0


@pytest.mark.parametrize(
    ("what", "after_s", "flag"),
    [
        ("lease", 0.0, Flag.LEASE_LOST),
        ("beating", 0.25, Flag.CONTROL_SILENT),
        ("sensing", 0.1, Flag.STALE_SENSOR),
        ("saturated", 0.0, Flag.SATURATED_SENSOR),
    ],
)
def test_the_output_ramps_to_zero_when_it_may_not_be_trusted(
    bench, render_settings, what, after_s, flag
):
    bench.render()
    before_v = bench.run(0.2)[-1].voltage_v
    assert before_v > 10.0
    if what == "lease":
        bench.command(lease_until_s=bench.now_s)
    else:
        setattr(bench, what, what == "saturated")
    still = bench.run(after_s)
    assert all(output.output_on for output in still)
    assert flag not in Flag(still[-1].flags) if still else True
    outputs = bench.run(0.1)
    assert_ramps_to_zero([output.voltage_v for output in outputs], before_v, render_settings.ramp_s)
    assert bench.flags() == flag


def test_a_finger_that_may_be_beyond_the_textures_finest_detail_has_no_output(
    bench, render_settings
):
    """At 50 mm/s it goes from ridge to groove in 20 ms: so much longer than usual its place may be
    unknown.
    """
    bench.render(texture=Grating(0.65, 0.01, period_m=2e-3))
    bench.run(0.2)
    bench.sensing = False
    outputs = bench.run(render_settings.usual_s + 0.020 - PERIOD_S)
    assert all(output.output_on for output in outputs)
    assert bench.flags() == Flag(0)
    outputs = bench.run(render_settings.ramp_s + 0.005)
    assert (outputs[-1].output_on, bench.flags()) == (False, Flag.STALE_SENSOR)
    bench.sensing = True
    assert bench.run(0.1)[-1].output_on, "nothing trips"


WAVES = Grating(0.65, 0.05, 0.002)


@pytest.mark.parametrize(
    ("wave_m", "by_time"), [(0.002, True), (0.004, False), (math.inf, False), (0.0, True)]
)
def test_waves_finer_than_places_are_known_are_rendered_by_time_and_flagged(
    render_settings, wave_m, by_time
):
    """A place is off by 1.5 mm half of the time."""
    bench = Bench(replace(render_settings, off_m=0.0015))
    try:
        bench.render(texture=WAVES.of_waves(wave_m))
        asked = [output.target_cof for output in bench.run(0.05)]
        assert (Flag.BY_TIME in bench.flags()) is by_time
        ahead_s = 0.0 if by_time else render_settings.tick.finger.output_latency_s
        # its reports come with each tick, so by time a place is one tick old
        place_m = 0.02 + 0.05 * (bench.now_s - 1000.0 + ahead_s - PERIOD_S * by_time)
        assert asked[-1] == pytest.approx(WAVES.cof_at(place_m, 0.03), abs=2e-3)
        bench.render(cof=0.6)
        assert bench.run(0.01)[-1].target_cof == 0.6
    finally:
        bench.shared.close()


def test_flags_stay_up_until_the_next_arming(bench):
    bench.render()
    bench.run(0.1)
    bench.saturated = True
    bench.run(0.1)
    bench.saturated = False
    assert bench.run(0.1)[-1].output_on
    assert bench.flags() == Flag.SATURATED_SENSOR
    bench.command(arming=2)
    bench.run(PERIOD_S)
    assert bench.flags() == Flag(0)


@pytest.mark.parametrize("missed", [5, 150])
def test_missed_ticks_are_counted_and_flagged_and_rendering_goes_on(bench, missed):
    """150 in a row were a fault once: a machine that stood still for so long had to be armed
    again.
    """
    bench.render()
    bench.run(0.1)
    for n in (1, 2, 3):
        output = bench.run(PERIOD_S, missed=missed)[-1]
        assert (output.overruns, bench.flags() & ~Flag.STALE_SENSOR) == (n * missed, Flag.OVERRUN)
    assert bench.run(0.2)[-1].output_on
    bench.command(arming=2)
    assert bench.run(0.1)[-1].output_on
    assert bench.flags() == Flag(0)


def test_an_unreachable_target_is_flagged_and_the_nearest_friction_rendered(bench):
    bench.render(5.0)
    assert bench.run(0.1)[-1].output_on
    assert bench.flags() == Flag.UNREACHABLE


def test_a_point_beyond_the_limits_is_refused_and_flagged(render_settings):
    limits = replace(render_settings.tick.limits, voltage_v=1.0)
    bench = Bench(replace(render_settings, tick=replace(render_settings.tick, limits=limits)))
    bench.render()
    assert not any(output.output_on for output in bench.run(0.1))
    assert bench.flags() == Flag.REJECTED


def test_every_tick_leaves_one_sample(bench):
    bench.lateral_n = 0.3
    bench.render(0.65)
    outputs = bench.run(0.3)
    samples = bench.shared.ring.read(0).samples
    assert samples["tick"].tolist() == [output.tick for output in outputs]
    assert samples["voltage_v"].tolist() == [output.voltage_v for output in outputs]
    last = samples[-1]
    assert last["speed_m_s"] == pytest.approx(0.05, rel=1e-3)
    assert last["measured_cof"] == pytest.approx(0.3 / 0.5)
    latency_s = bench.settings.tick.finger.output_latency_s
    assert last["output_x_m"] - last["position_x_m"] == pytest.approx(0.05 * latency_s, rel=1e-2)


def story(settings, rehearsals):
    """What is put out and recorded through touch, a new target, missed ticks, a lost lease and a
    new arming.
    """
    bench = Bench(settings)
    bench.rehearsals, bench.lateral_n = rehearsals, 0.3
    bench.render(0.7)
    outputs = bench.run(0.1)
    bench.render(0.75)
    outputs += bench.run(0.05) + bench.run(PERIOD_S, missed=5)
    bench.command(lease_until_s=bench.now_s)
    outputs += bench.run(0.03)
    bench.command(arming=2, lease_until_s=math.inf)
    outputs += bench.run(0.05)
    bench.touching = False
    outputs += bench.run(0.01)
    samples = bench.shared.ring.read(0).samples
    bench.shared.close()
    return outputs, samples


def test_rehearsals_change_nothing(render_settings):
    outputs, samples = story(render_settings, rehearsals=0)
    rehearsed_outputs, rehearsed_samples = story(render_settings, rehearsals=2)
    assert {output.flags for output in outputs} == {0, Flag.OVERRUN, Flag.OVERRUN | Flag.LEASE_LOST}
    assert any(output.voltage_v > 10.0 for output in outputs)
    assert rehearsed_outputs == outputs
    assert rehearsed_samples.tobytes() == samples.tobytes()


def test_measured_friction_is_told_of_a_sliding_finger_only(bench):
    bench.lateral_n = 0.3
    bench.render()
    bench.touching = False
    bench.run(0.05)
    assert math.isnan(bench.shared.ring.read(0).samples[-1]["measured_cof"])


def test_friction_is_not_measured_by_sensors_that_are_silent(bench):
    """Found on the page: after a fault the last friction stood there as a straight line."""
    bench.lateral_n = 0.3
    bench.render()
    bench.run(0.05)
    assert bench.shared.ring.read(0).samples[-1]["measured_cof"] == pytest.approx(0.6)
    bench.sensing = False
    bench.run(0.2)
    measured = bench.shared.ring.read(0).samples["measured_cof"]
    assert np.isfinite(measured[-110])
    assert np.isnan(measured[-90:]).all()


def test_a_ramp_begins_again_after_trust_has_returned():
    asked = [(0.0, True), (1.0, False), (1.5, False), (2.5, False), (3.0, True), (3.5, False)]
    ramp, given_v = Ramp(), []
    for time_s, trusted in [*asked, (4.0, False)]:
        ramp, limited_v = ramp.limit(1.0, time_s, 80.0, trusted)
        given_v.append(limited_v)
    assert given_v == [80.0, 80.0, 40.0, 0.0, 80.0, 80.0, 40.0]


@pytest.mark.process
def test_the_process_loads_neither_physics_nor_devices_nor_the_api():
    code = "import sys, haptic_driver.daemon.render_process; print('\\n'.join(sys.modules))"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert "haptic_driver.render.tick" in loaded
    assert not [
        name for name in loaded if any(name == f or name.startswith(f + ".") for f in FORBIDDEN)
    ]


@pytest.fixture(scope="module")
def envelope_settings(surface_file):
    return set_up.render_settings(load_rig("simulated-envelope"), surface_file)


AFTER_WARMING_UP = """
import pickle, sys
import numpy as np
from haptic_driver.daemon.render_process import Renderer
from haptic_driver.processes.shared_memory import SharedState
from haptic_driver.render import compiled
from haptic_driver.render.texture import FrictionMap, Placed, Profile, Waves
from tests.haptic_driver.daemon.test_render_process import Bench, a_scene, story

def forms():
    return [len(kernel.signatures) for kernel in compiled.KERNELS]

settings = pickle.load(sys.stdin.buffer)
Renderer(settings, SharedState()).warm_up()
compiled.refuse_to_compile()
before = forms()
story(settings, 1)
cof = np.full((2, 3, 50), 0.65)
bench = Bench(settings)
for texture in (
    FrictionMap(cof[0], 1e-3, 1e-3, "clamp"),
    Placed(FrictionMap(cof[0], 1e-3, 1e-3, "tile"), 0.01, 0.0, 0.3),
    Profile((0.0, 0.01, 0.02), (0.65, 0.7, 0.65), "tile"),
    Waves(cof, np.array([0.01, 0.1]), np.array([0.2, 0.5, 1.0]), 0.02, 0.1, (0.05, 0.5)),
    a_scene(),
):
    bench.render(texture=texture)
    assert bench.run(0.05)[-1].output_on
bench.shared.scene.write(bench.order.target, a_scene(0.7).objects)
assert bench.run(0.05)[-1].target_cof == 0.7
assert forms() == before, "a kernel that warming up did not call"
"""


@pytest.mark.process
@pytest.mark.parametrize("rig", ["render_settings", "envelope_settings"])
def test_warming_up_compiles_all_that_ticks_need(request, rig):
    """In a process that refuses to compile more: a tick that had to would raise."""
    given = pickle.dumps(request.getfixturevalue(rig))
    done = subprocess.run(
        [sys.executable, "-c", AFTER_WARMING_UP], input=given, capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr.decode()


class Single(Uniform):
    """Friction in single precision, which no kernel was compiled for."""

    def cof_along(self, finger, ahead_s):
        return super().cof_along(finger, ahead_s).astype(np.float32)


@pytest.mark.process
def test_a_tick_that_fails_leaves_zero_and_a_fault_behind(envelope_settings, shared):
    """Here because it would have to compile: seconds of silence while output is on."""
    child = Child(
        "render",
        "haptic_driver.daemon.render_process",
        [shared.descriptor, os.getpid()],
        given=pickle.dumps(envelope_settings),
        descriptors=[shared.descriptor],
    )
    child.ready(240.0)
    assert (
        len(list(Path(f"/proc/{child.pid}/task").iterdir())) == 1
    )  # a killed one is there until each had a turn
    shared.targets.write(1, Uniform(0.6))
    shared.targets.write(2, Single(0.6))
    was_on, until_s = False, time.monotonic() + 60.0
    while child.ended is None and time.monotonic() < until_s:
        now_s = time.monotonic()
        was_on = was_on or shared.output.read().output_on
        shared.sensed.write(Sensed(now_s, 0.03, 0.03, True, now_s, 0.5, 0.3, False))
        shared.order.write(Order(1, 1, True, math.inf, now_s, 2 if was_on else 1, 0))
        time.sleep(0.005)
    ended, output = child.ended, shared.output.read()
    child.stop()
    assert was_on
    assert ended == "the render process ended with status 1"
    assert (output.voltage_v, output.output_on) == (0.0, False)
    assert Flag.FAULT in Flag(output.flags)
