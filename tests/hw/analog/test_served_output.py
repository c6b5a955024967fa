"""The analog output of a simulated card over TCP: its driver's checks are those of every analog output."""

from __future__ import annotations

import numpy as np
import pytest

from hw.analog.output import AnalogOutputSettings, OutputUnderrun
from hw.analog.served_output import AnalogOutputServer, ServedAnalogOutput
from hw.analog.simulated_output import SimulatedCard
from hw.errors import BadReply, DeviceDisconnected, LimitExceeded
from hw.serving.tcp import TcpServer
from hw.transport.tcp import TcpTransport
from tests.clock import ManualClock
from tests.hw.testing.memory import MemoryTransport

SETTINGS = AnalogOutputSettings(-5.0, 5.0, -5.0, 50e3, buffer_s=0.05, timeout_s=5.0)


@pytest.fixture
def clock():
    return ManualClock(10.0)


@pytest.fixture
def card():
    return SimulatedCard(1.0)  # wherever the last program left it


@pytest.fixture
def output(card, clock):
    with TcpServer(AnalogOutputServer(card)) as server:
        served = ServedAnalogOutput(TcpTransport.from_resource(server.resource), SETTINGS, clock=clock)
        with served:
            yield served


def test_it_opens_at_zero_plays_what_it_is_given_and_runs_dry_to_zero(output, card, clock):
    assert card.terminal_v == -5.0
    samples_v = np.linspace(-5.0, 4.9, 100)
    output.write(samples_v[:60], 50e3)
    output.write(samples_v[60:], 50e3)
    assert output.buffered_s == pytest.approx(100 / 50e3)
    np.testing.assert_allclose(card.advance(50.5 / 50e3), samples_v[:50], rtol=1e-6)
    clock.now_s += 50 / 50e3
    assert output.buffered_s == pytest.approx(50 / 50e3, abs=1.01 / 50e3)
    np.testing.assert_allclose(card.advance(1.0), samples_v[50:], rtol=1e-6)
    assert card.terminal_v == pytest.approx(4.9)  # a card keeps its last sample; the driver sees to the rest
    clock.now_s += 1.0
    with pytest.raises(OutputUnderrun, match="ran out of samples"):
        output.write([0.0], 50e3)
    assert card.terminal_v == -5.0


def test_a_card_that_is_slower_than_the_clock_is_asked_before_it_is_called_dry(output, card, clock):
    output.write(np.zeros(100), 50e3)
    clock.now_s += 100 / 50e3
    card.advance(60 / 50e3)
    assert output.buffered_s == pytest.approx(40 / 50e3)


def test_what_the_settings_refuse_never_reaches_the_card(output, card):
    for refused, rate_hz in (([5.1], 50e3), ([0.0], 60e3), (np.zeros(2501), 50e3)):
        with pytest.raises(LimitExceeded):
            output.write(refused, rate_hz)
    assert (card.terminal_v, card.waiting) == (-5.0, 0)


def test_a_card_that_was_starved_does_not_make_up_for_it(card):
    card.start(np.zeros(10), 1000.0)
    card.advance(1.0)
    card.append(np.full(10, 2.0))
    assert card.advance(0.004).size == 4


def test_who_answers_something_else_is_not_believed():
    class Other:
        def handle(self, data):
            return b"ERROR\n"

    with pytest.raises(BadReply, match="LEVEL"):
        ServedAnalogOutput(MemoryTransport(Other()), SETTINGS).open()


@pytest.mark.parametrize("line", [b"PLAY", b"", b"LEVEL", b"LEVEL x", b"START 1e3 zz", b"START 1e3 00", b"APPEND \xff"])
def test_a_line_that_makes_no_sense_is_answered_and_changes_nothing(card, line):
    before_v = card.terminal_v
    assert AnalogOutputServer(card).handle(line + b"\n") == b"ERROR\n"
    assert (card.terminal_v, card.waiting) == (before_v, 0)


def test_a_card_that_is_gone_is_told(card, clock):
    with TcpServer(AnalogOutputServer(card)) as server:
        output = ServedAnalogOutput(TcpTransport.from_resource(server.resource), SETTINGS, clock=clock)
        output.open()
    with pytest.raises(DeviceDisconnected, match="NOT known to be at zero"):
        output.write([0.0], 50e3)
    with pytest.raises(DeviceDisconnected):
        output.close()
