"""The writer of envelopes: which output it takes, how far ahead it writes, and what it says of
itself.
"""

import itertools
import math

import numpy as np
import pytest

from haptic_driver.daemon.envelope_process import EnvelopeLoop, EnvelopeSettings
from haptic_driver.daemon.set_up import latency_budget_s
from haptic_driver.processes.shared_memory import NO_OUTPUT, Driven
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.devices import modulation_input
from haptic_driver.rig.envelope_writer import LEAST_LEAD_S, MOST_LEAD_S, EnvelopeWriter, Lead
from haptic_driver.rig.parts.analog_outputs import NiAnalogOutputConfig
from haptic_driver.signals import COURSE_POINTS
from hw.analog.output import AnalogOutputSettings
from hw.errors import DeviceDisconnected
from tests.hw.analog.simulated_analog_output import SteppedAnalogOutput

RATE_HZ = 50e3


@pytest.fixture
def config():
    return load_rig("simulated-envelope")


class Bench:
    """A loop on a stepped output; render asks for `voltage_v` at every tick, in one order."""

    def __init__(self, shared, config):
        self.shared = shared
        self.output = SteppedAnalogOutput(AnalogOutputSettings(-5.0, 5.0, -5.0, RATE_HZ))
        self.output.open()
        writer = EnvelopeWriter(self.output, modulation_input(config), RATE_HZ, 10e3)
        self.lead = Lead(None, 0.1)
        self.loop = EnvelopeLoop(shared, writer, self.lead)
        self.gate = 1

    def run(self, ticks, voltage_v=80.0, order=1, writes=True, late_s=0.0, missed=0, after_s=0.001):
        for _ in range(ticks):
            self.output.advance(after_s)
            now_s = self.output.time_s
            self.shared.driven.write(Driven(self.gate, 0.0, 250.0, 150.0))
            said = NO_OUTPUT._replace(
                order=order, time_s=now_s, frequency_hz=250.0, voltage_v=voltage_v
            )
            said = said._replace(full_scale_v=150.0)
            self.shared.output.write(said)
            self.shared.courses.write((order, np.full(COURSE_POINTS, voltage_v**2).tobytes()))
            if writes:
                self.loop.turn(now_s, late_s, missed)

    @property
    def voltage_v(self):
        return (self.output.terminal_v + 5.0) / 10.0 * 150.0


@pytest.fixture
def bench(shared, config):
    return Bench(shared, config)


def test_the_section_of_a_rigs_file_says_which_output(config, monkeypatch):
    made = []

    class Card(SteppedAnalogOutput):
        def __init__(self, channel, settings):
            super().__init__(settings)
            self.resource = channel
            made.append(self)

    monkeypatch.setattr("hw.analog.ni_daq.NiAnalogOutput", Card)
    section = NiAnalogOutputConfig(
        **(config.analog_output.model_dump() | {"kind": "ni", "channel": "Dev2/ao0"})
    )
    output, open_output = EnvelopeSettings(section, modulation_input(config), 1e4).output()
    open_output()
    assert made == [output]
    assert (output.resource, output.level_v, output.watched) == ("Dev2/ao0", -5.0, False)


def test_nothing_is_written_for_an_order_that_may_not_go_out(bench):
    bench.run(50, order=1)
    assert bench.voltage_v == pytest.approx(80.0)
    bench.gate = 2
    bench.run(1, order=1)
    assert bench.voltage_v == 0.0
    bench.run(20, order=1)
    assert bench.voltage_v == 0.0
    bench.run(50, order=2)
    assert bench.voltage_v == pytest.approx(80.0)


def test_what_render_said_long_ago_is_not_written(bench):
    bench.run(50)
    for _ in range(300):  # render hangs
        bench.output.advance(0.001)
        bench.loop.turn(bench.output.time_s)
    assert bench.voltage_v == 0.0


def test_it_writes_farther_ahead_where_turns_come_late(bench, shared):
    bench.run(50)
    assert shared.played.read().lead_s == LEAST_LEAD_S
    bench.run(1, missed=8)
    assert shared.played.read().lead_s == pytest.approx(0.013)
    bench.run(100)
    assert bench.output.buffered_s == pytest.approx(0.013, abs=2.0 / RATE_HZ)
    played = shared.played.read()
    assert (played.underruns, played.failure) == (0, "")


def test_a_course_ends_as_long_after_its_tick_as_render_reckons_with(bench, shared):
    """However late the turns are: what is off by a millisecond comes 80 um beside its place under a
    finger of 80 mm/s.
    """
    bench.run(50)
    bench.run(1, missed=3)  # it writes farther ahead from here on
    lead_s, off_s = shared.played.read().lead_s, []
    lateness_s = np.append(0.0, np.random.default_rng(1).uniform(0.0, 0.0009, 300))
    for before_s, late_s in itertools.pairwise(lateness_s.tolist()):
        bench.run(1, late_s=late_s, after_s=0.001 + late_s - before_s)
        off_s.append(bench.output.buffered_s - (lead_s - late_s))
    assert np.abs(off_s[100:]).max() <= 2.0 / RATE_HZ


def test_lateness_of_long_ago_counts_no_more_once_nothing_is_rendered():
    lead = Lead(None, 0.1)
    lead.notice(100.0, 0.02)
    assert lead.lead_s == pytest.approx(0.028)
    lead.notice(800.0, 0.0)
    assert lead.lead_s == pytest.approx(0.028)  # something is rendered
    lead.choose()
    assert lead.lead_s == LEAST_LEAD_S


@pytest.mark.parametrize(
    ("fixed_s", "most_s", "expected_s"),
    [(0.02, 0.1, 0.02), (None, 0.02, 0.02), (None, 0.1, MOST_LEAD_S)],
)
def test_a_rigs_file_and_the_outputs_buffer_bound_the_lead(fixed_s, most_s, expected_s):
    lead = Lead(fixed_s, most_s)
    lead.notice(1.0, late_s=0.5)
    assert lead.lead_s == expected_s


def test_a_device_that_plays_in_blocks_gets_a_lead_of_more_than_one(bench, shared):
    """Its buffer is unchanged for 5 ms, then 5 ms less are waiting; every turn comes in time."""
    bench.run(50)
    waiting = type(bench.output)._buffered_samples
    block = round(0.005 * RATE_HZ)
    bench.output._buffered_samples = lambda: -(-waiting(bench.output) // block) * block
    bench.run(200)
    assert shared.played.read().lead_s >= 0.007


def test_what_the_output_cannot_do_is_said(bench, shared):
    bench.run(50)
    bench.output.broken = True
    with pytest.raises(DeviceDisconnected):
        bench.run(1)
    assert "does not answer" in shared.played.read().failure


def test_the_budget_has_the_lead_less_the_tick_that_writes_it(config):
    short, long = (latency_budget_s(config, 0.001, lead_s) for lead_s in (0.003, 0.013))
    assert long["total"] - short["total"] == pytest.approx(0.010)
    assert 0.002 <= short["envelope"] <= 0.003
    assert math.isclose(sum(v for k, v in long.items() if k != "total"), long["total"])
    slow = load_rig("simulated")
    slow = slow.model_copy(update={"output": slow.output.model_copy(update={"latency_s": 0.1})})
    budget = latency_budget_s(slow, 0.001, 0.0)
    assert (budget["set_point"], budget["instrument"]) == pytest.approx((0.005, 0.095))


def test_gaps_are_counted_on_from_those_before_a_restart(shared, config):
    first = Bench(shared, config)
    first.run(50)
    first.run(20, writes=False)
    first.run(2)
    assert shared.played.read().underruns == 1
    again = EnvelopeLoop(shared, first.loop._writer, first.lead, shared.played.read().underruns)
    assert np.isfinite(shared.played.read().whole_s)
    again.turn(first.output.time_s)
    assert shared.played.read().underruns >= 1
