from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.analog.output import AnalogOutputSettings, OutputUnderrun
from hw.errors import DeviceDisconnected, DeviceError, LimitExceeded
from tests.hw.analog.simulated_analog_output import SteppedAnalogOutput

SETTINGS = AnalogOutputSettings(
    low_v=0.0,
    high_v=5.0,
    zero_level_v=0.5,
    sample_rate_limit_hz=100e3,
    buffer_s=0.1,
    lease_s=0.2,
    timeout_s=0.2,
    gap_s=0.02,
)


@pytest.mark.parametrize(
    "bad", [{"zero_level_v": 6.0}, {"low_v": 5.0, "zero_level_v": 5.0}, {"low_v": float("nan")}]
)
def test_impossible_settings_are_refused(bad):
    with pytest.raises(ValueError, match="analog output"):
        AnalogOutputSettings(**(vars(SETTINGS) | bad))


def test_a_held_level_ends_with_its_lease_and_zero_never_does():
    with SteppedAnalogOutput(SETTINGS) as output:
        output.hold(3.0)
        assert output.advance(0.15) == 3.0
        output.hold(3.0)
        assert output.advance(0.15) == 3.0
        assert output.advance(0.1) == 0.5
        assert output.level_v == 0.5
        with pytest.raises(OutputUnderrun, match="held 3 V"):
            output.check()
        output.zero()
        assert output.advance(100.0) == 0.5
        output.check()


def test_a_stream_may_end_at_zero_but_not_above():
    with SteppedAnalogOutput(SETTINGS) as output:
        output.write([1.0, 2.0, 0.5], 1e3)
        assert output.advance(0.01) == 0.5
        output.check()
        assert output.played_v == [1.0, 2.0, 0.5]
        output.write([1.0, 2.0], 1e3)
        assert output.advance(0.01) == 2.0
        assert output.advance(0.02) == 0.5
        with pytest.raises(OutputUnderrun, match="ran out of samples"):
            output.hold(1.0)
        output.hold(1.0)
        assert output.terminal_v == 1.0


def test_a_stream_goes_on_from_its_last_sample_after_a_short_gap():
    with SteppedAnalogOutput(SETTINGS) as output:
        output.write([1.0, 2.0], 1e3)
        assert output.advance(0.015) == 2.0
        output.write([3.0, 4.0], 1e3)
        assert output.gaps == 1
        assert output.advance(0.0) == 3.0
        assert output.advance(0.001) == 4.0
        assert output.played_v == [1.0, 2.0, 3.0]
        output.check()


def test_a_stream_that_has_ended_leaves_the_rate_free():
    """Its end is noticed by the next call, whatever that asks; no thread looks in between here."""
    with SteppedAnalogOutput(SETTINGS) as output:
        output.write([1.0, 0.5], 1e3)
        output.play(0.01)
        output.write([1.0, 2.0, 0.5], 500.0)
        assert output.buffered_s == pytest.approx(0.006)


def test_a_block_is_copied():
    block_v = np.full(10, 2.0)
    with SteppedAnalogOutput(SETTINGS) as output:
        output.write(block_v, 1e3)
        block_v[:] = 4.0
        assert output.advance(0.005) == 2.0


def test_no_more_than_the_buffer_waits():
    with SteppedAnalogOutput(SETTINGS) as output:
        output.write(np.full(100, 1.0), 1e3)
        with pytest.raises(LimitExceeded, match="do not fit"):
            output.write([1.0], 1e3)
        output.advance(0.01)
        output.write(np.full(10, 1.0), 1e3)
        assert output.buffered_s == pytest.approx(0.1)


def test_a_failed_write_is_zeroed_or_reported_as_unknown():
    output = SteppedAnalogOutput(SETTINGS)
    output.open()
    output.hold(3.0)
    output.broken = True
    with pytest.raises(DeviceDisconnected, match="NOT known to be at zero"):
        output.write([1.0], 1e3)
    assert output.level_v is None
    with pytest.raises(DeviceDisconnected):
        output.zero()
    with pytest.raises(DeviceDisconnected):
        output.check()
    output.broken = False
    output.advance(0.0)
    assert output.level_v == output.terminal_v == 0.5
    output.close()


@pytest.mark.parametrize("step", ["start", "set_level"])
def test_an_interrupt_leaves_no_output_that_nobody_watches(monkeypatch, step):
    """The card has begun when Ctrl-C comes; it would keep its last sample."""
    with SteppedAnalogOutput(SETTINGS) as output:
        begin = getattr(output.card, step)

        def interrupted(*arguments: Any) -> None:
            begin(*arguments)
            monkeypatch.undo()
            raise KeyboardInterrupt

        monkeypatch.setattr(output.card, step, interrupted)
        with pytest.raises(KeyboardInterrupt):
            _ = output.write([4.0, 4.0], 1e3) if step == "start" else output.hold(4.0)
        assert output.advance(0.01) == 0.5


def test_it_must_be_open():
    output = SteppedAnalogOutput(SETTINGS)
    for use in (lambda: output.write([1.0], 1e3), lambda: output.hold(1.0), output.zero):
        with pytest.raises(DeviceDisconnected, match="not open"):
            use()
    output.close()


def test_zero_does_not_wait_for_a_thread_that_is_stuck_in_the_device():
    output = SteppedAnalogOutput(SETTINGS)
    output.open()
    stuck, release = threading.Event(), threading.Event()

    def never_starts(block_v: Any, rate_hz: float) -> None:
        stuck.set()
        release.wait(20.0)

    output._start = never_starts  # type: ignore[method-assign]
    writer = threading.Thread(target=output.write, args=([1.0], 1e3))
    writer.start()
    assert stuck.wait(20.0)
    begun_s = time.monotonic()
    with pytest.raises(DeviceError, match="busy"):
        output.zero()
    assert time.monotonic() - begun_s < 10.0  # a hang, not a speed
    release.set()
    writer.join(20.0)
    output.close()


ACTIONS = st.lists(
    st.one_of(
        st.tuples(st.just("write"), st.lists(st.floats(-1.0, 6.0), min_size=1, max_size=40)),
        st.tuples(st.just("hold"), st.floats(-1.0, 6.0)),
        st.tuples(st.just("advance"), st.floats(0.0, 0.3)),
        st.tuples(st.just("broken"), st.booleans()),
        st.tuples(st.just("zero"), st.none()),
        st.tuples(st.just("check"), st.none()),
    ),
    max_size=25,
)


@settings(max_examples=150)
@given(ACTIONS)
def test_whatever_happens_the_output_stays_within_limits_and_ends_at_zero_or_unknown(actions):
    output = SteppedAnalogOutput(SETTINGS)
    output.open()
    for name, argument in actions:
        try:
            match name:
                case "write":
                    output.write(argument, 1e3)
                case "hold":
                    output.hold(argument)
                case "advance":
                    output.advance(argument)
                case "broken":
                    output.broken = argument
                case "zero":
                    output.zero()
                case "check":
                    output.check()
        except DeviceError:
            pass
        assert 0.0 <= output.terminal_v <= 5.0
        if output.level_v is not None:
            assert output.terminal_v == output.level_v
    assert all(0.0 <= sample_v <= 5.0 for sample_v in output.played_v)
    output.advance(1.0)  # longer than any lease or buffer
    if output.level_v is None:
        with pytest.raises(DeviceError):  # unknown is reported
            output.zero()
    else:
        assert output.terminal_v == 0.5
