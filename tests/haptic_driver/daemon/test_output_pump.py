"""The output pump in its loop, from render through the instruments to the finger, in made-up
time.
"""

import numpy as np
import pytest

from haptic_driver.daemon.output_pump import OUTPUT_STALE_S, START_S
from haptic_driver.daemon.render_process import Nothing
from haptic_driver.daemon.set_up import render_settings
from haptic_driver.daemon.stepped import SteppedDaemon
from haptic_driver.errors import HapticError
from haptic_driver.processes.shared_memory import NOT_PLAYED
from haptic_driver.render.texture import Uniform
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.states import RigState
from haptic_driver.simulation.finger_model import surface_friction
from haptic_driver.simulation.rig import SimulatedRig

TICK_S = 0.001
FORCE_N, SPEED_M_S = 0.5, 0.04
STARTED_S = START_S + 0.1  # the latency included


class Loop:
    """A finger that slides steadily, with friction `gain` times the surface's, on a rig; nothing is
    let out until somebody asks.
    """

    def __init__(self, bench, surface_file):
        self.bench, self.x_m = bench, 0.01
        settings = render_settings(bench.config, surface_file)
        self.daemon = SteppedDaemon(settings, bench, Nothing())
        self.shared, self.pump = self.daemon.shared, self.daemon._pump
        self.daemon.connect()
        self.pump.close()

    @property
    def voltage_v(self):
        return self.bench.instruments.voltage_v

    @property
    def state(self):
        return self.bench.rig.events[-1].state

    def set(self, cof):
        """What control does when somebody asks for a friction."""
        self.daemon.play(Uniform(cof))
        self.pump.open(self.daemon._order.number)

    def run(self, seconds):
        """Let so much time pass; the samples."""
        position = self.shared.ring.position
        for _ in range(round(seconds / TICK_S)):
            self.x_m += SPEED_M_S * TICK_S
            self.daemon.tick(self.x_m, FORCE_N, SPEED_M_S)
        return self.shared.ring.read(position).samples


@pytest.fixture
def sliding(touch, surface_file, limits):
    """Makes a loop whose finger slides already, for 0.3 s, when output is asked for."""
    law, started = surface_friction(surface_file, limits), []

    def begin(name, gain=1.0):
        rig = load_rig(name)
        bench = SimulatedRig(rig, touch, friction=lambda *at: gain * law(*at), envelope=True)
        loop = Loop(bench.__enter__(), surface_file)
        started.append(loop)
        loop.run(0.3)
        return loop

    yield begin
    for loop in started:
        assert loop.bench.rig.off().on is False
        loop.daemon.close()
        loop.bench.__exit__()


@pytest.fixture(params=["simulated", "simulated-envelope"])
def start(request, sliding):
    return lambda gain=1.0: sliding(request.param, gain)


@pytest.mark.parametrize(("gain", "cof"), [(1.0, 0.7), (1.4, 0.95)])
def test_a_start_under_a_sliding_finger_teaches_nothing_wrong(start, gain, cof):
    loop = start(gain)
    loop.set(cof)
    samples = loop.run(0.6)
    assert samples["voltage_v"].max() > 50.0
    learnt = samples["feedback_gain"]
    assert learnt.min() > 1.0 - 0.03
    assert learnt.max() < gain * 1.03
    assert learnt[-1] == pytest.approx(gain, rel=0.02)
    felt = samples["measured_cof"][round(STARTED_S / TICK_S) + 100 :]
    assert np.convolve(felt, np.full(20, 0.05), "valid") == pytest.approx(cof, rel=0.05)


def test_another_target_goes_on_without_a_gap(start):
    loop = start()
    loop.set(0.65)
    loop.run(0.5)
    for cof in (0.7, 0.68):
        loop.set(cof)
        loop.run(0.05)
        assert loop.voltage_v > 50.0
    assert [event.state.name for event in loop.bench.rig.events] == ["OFF", "ON"]


def test_nothing_goes_out_through_a_closed_gate(start):
    loop = start()
    loop.set(0.65)
    loop.run(0.5)
    assert loop.voltage_v > 50.0
    assert loop.pump.output.on is True
    loop.pump.close()
    assert loop.pump.output.on is None  # a fault and what it leaves unknown are told in one step
    loop.run(0.05)
    assert loop.pump.output.on is False
    assert loop.voltage_v == 0.0
    assert loop.state is RigState.OFF


def test_what_render_said_long_ago_goes_out_no_more(start, monkeypatch):
    loop = start()
    loop.set(0.65)
    loop.run(0.5)
    monkeypatch.setattr(loop.daemon._renderer, "step", lambda due: None)
    loop.run(0.9 * OUTPUT_STALE_S)
    assert loop.state is RigState.ON
    loop.run(0.2 * OUTPUT_STALE_S)
    assert loop.voltage_v == 0.0
    assert loop.state is RigState.OFF


def test_gaps_of_an_envelope_are_counted_and_teach_nothing(sliding):
    loop = sliding("simulated-envelope")
    loop.set(0.7)
    loop.run(0.6)
    for _ in range(10):  # nobody plays meanwhile
        loop.bench.step(TICK_S, FORCE_N, SPEED_M_S)
    after = loop.run(0.3)
    assert loop.shared.played.read().underruns == 1
    assert np.abs(after["feedback_gain"] - 1.0).max() < 0.03
    # what was commanded there is no row's
    assert 2 <= np.count_nonzero(after["output_on"] == 0) <= 5


def test_an_envelope_that_cannot_be_played_is_a_failure(sliding):
    loop = sliding("simulated-envelope")
    loop.daemon._envelope = None
    loop.shared.played.write(NOT_PLAYED._replace(failure="the card is gone"))
    with pytest.raises(HapticError) as failed:
        loop.run(0.01)
    assert (failed.value.code, failed.value.message) == ("envelope_failed", "the card is gone")
