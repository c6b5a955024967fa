"""A simulated card in memory: what its terminal has follows from what was written and from the
time.
"""

import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.analog.output import AnalogOutputSettings, CardReserved, OutputUnderrun
from hw.analog.simulated_output import (
    BUFFER_SAMPLES,
    CardMemory,
    SimulatedAnalogOutput,
    make_output,
)
from hw.errors import DeviceDisconnected, LimitExceeded
from tests.clock import ManualClock

SETTINGS = AnalogOutputSettings(-5.0, 5.0, -5.0, 50e3, buffer_s=0.05, gap_s=0.01)


@pytest.fixture
def clock():
    return ManualClock(10.0)


@pytest.fixture
def card():
    card = CardMemory()
    card.set_level(1.0)  # wherever the last program left it
    return card


def test_it_opens_at_zero_plays_what_it_is_given_and_stays_at_the_last_sample(card, clock):
    with SimulatedAnalogOutput(lambda: card, SETTINGS, clock=clock, watch=False) as output:
        assert card.terminal_v(10.0, 10.0) == -5.0
        samples_v = np.linspace(-5.0, 4.9, 100)
        output.write(samples_v[:60], 50e3)
        output.write(samples_v[60:], 50e3)
        assert output.buffered_s == pytest.approx(100 / 50e3)
        seen_v = [card.terminal_v(at_s, at_s) for at_s in 10.0 + np.arange(120) / 50e3]
        np.testing.assert_allclose(seen_v[:100], samples_v)
        assert seen_v[100:] == [4.9] * 20
        clock.now_s += 50.5 / 50e3
        assert output.buffered_s == pytest.approx(50 / 50e3)
        clock.now_s += 1.0
        with pytest.raises(OutputUnderrun, match="ran out of samples"):
            output.write([0.0], 50e3)
        assert card.terminal_v(clock.now_s, clock.now_s) == -5.0


def test_what_is_told_of_an_interval_is_its_mean(card):
    card.start(np.array([0.0, 1.0, 2.0, 3.0, 4.0]), 1e3, 10.0)
    assert card.terminal_v(10.001, 10.004) == pytest.approx(2.0)
    assert card.terminal_v(10.004, 10.010) == pytest.approx(4.0)


def test_what_the_settings_refuse_never_reaches_the_card(card, clock):
    with SimulatedAnalogOutput(lambda: card, SETTINGS, clock=clock, watch=False) as output:
        for refused, rate_hz in (([5.1], 50e3), ([0.0], 60e3), (np.zeros(2501), 50e3)):
            with pytest.raises(LimitExceeded):
                output.write(refused, rate_hz)
        assert (card.terminal_v(10.0, 10.0), card.waiting(10.0)) == (-5.0, 0)


@given(st.lists(st.integers(1, 3000), min_size=1, max_size=30), st.integers(1, 30))
def test_no_sample_is_lost_where_the_buffer_wraps(blocks, reader_samples):
    """Written block by block at the rate at which it plays, and read in other steps than it was
    written in.
    """
    card, rate_hz = CardMemory(), 50e3
    values = np.arange(sum(blocks), dtype=float)
    card.start(values[: blocks[0]], rate_hz, 0.0)
    written = blocks[0]
    for size in blocks[1:]:
        card.append(values[written : written + size])
        oldest = max(written + size - BUFFER_SAMPLES, 0)
        for place in range(max(oldest, written - 10), written + size, reader_samples * 100):
            assert card.terminal_v(place / rate_hz, place / rate_hz) == values[place]
        written += size
    assert card.waiting(0.0) == written


def test_another_process_sees_the_same_card():
    card, descriptor = CardMemory.create()
    card.start(np.array([1.0, 2.0]), 1e3, 5.0)
    other = CardMemory.at(f"/proc/{os.getpid()}/fd/{descriptor}")
    assert [other.terminal_v(t, t) for t in (5.0, 5.001)] == [1.0, 2.0]
    other.append(np.array([3.0]))
    assert card.terminal_v(5.002, 5.002) == 3.0
    os.close(descriptor)


def test_a_card_that_is_gone_is_told():
    with pytest.raises(DeviceDisconnected, match="gone"):
        CardMemory.at("/proc/self/fd/9999")


def test_a_writer_that_was_killed_while_it_told_leaves_what_was_told_before(card):
    before_v = card.terminal_v(0.0, 0.0)
    card._sequence[0] |= 1
    card._header[:8] = b"\xff" * 8
    assert card.terminal_v(0.0, 0.0) == before_v


def test_a_card_is_one_programs_at_a_time_and_one_that_hangs_is_taken_from_it():
    memory, descriptor = CardMemory.create()
    where = f"/proc/{os.getpid()}/fd/{descriptor}"
    kept, other = (make_output(where, SETTINGS) for _ in range(2))
    kept.open()
    kept.hold(2.0)
    with pytest.raises(CardReserved) as refused:
        other.open()
    assert refused.value.code == "card_reserved"
    other.reset()
    assert memory.terminal_v(0.0, 0.0) == 0.0
    kept.close()
    with other:
        assert other.level_v == SETTINGS.zero_level_v
    os.close(descriptor)
