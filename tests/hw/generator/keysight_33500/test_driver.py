"""The 33500's own voltage limit: set, read back, and missed when it is gone."""

from __future__ import annotations

import pytest

from hw.errors import BadReply
from hw.generator.settings import RangePolicy
from tests.hw.generator.kinds import SETTINGS, Bench


@pytest.fixture
def bench():
    bench = Bench("keysight_33500")
    bench.connect()
    return bench


def test_the_limit_stands_at_the_terminals_after_connecting(bench):
    """300 V at a gain of 100."""
    answer = b"+3.0000000000000E+00;-3.0000000000000E+00;1\n"
    assert bench.say("VOLT:LIM:HIGH?;:VOLT:LIM:LOW?;:VOLT:LIM:STAT?") == answer


@pytest.mark.parametrize("change", ["VOLT:LIM:STAT 0", "VOLT:LIM:HIGH 9", "VOLT:LIM:LOW -9"])
def test_a_limit_taken_away_is_noticed_switched_off_and_set_again(bench, change):
    bench.driver.set_point(250.0, 120.0)
    bench.driver.set_output(True)
    bench.say(change)
    with pytest.raises(BadReply, match="VOLT:LIM"):
        bench.driver.set_point(260.0, 120.0)
    assert bench.voltage_v == 0.0
    bench.driver.set_point(250.0, 60.0)
    assert bench.say("VOLT:LIM:STAT?") == b"1\n"


def test_an_instrument_that_does_not_take_the_limit_is_refused():
    bench = Bench("keysight_33500")
    handle = bench.generator.handle

    class Deaf:
        def handle(self, data: bytes) -> bytes:
            return handle(data.replace(b"VOLT:LIM:STAT 1", b"VOLT:LIM:STAT 0"))

    bench.driver._line._transport._responder = Deaf()
    with pytest.raises(BadReply, match="VOLT:LIM:STAT"):
        bench.driver.connect()
    assert not bench.generator.output().on


def test_the_limit_of_an_earlier_session_gives_way(bench):
    bench.say("VOLT MIN;:VOLT:LIM:HIGH 0.5;:VOLT:LIM:LOW -0.5")
    bench.driver.off()  # nothing is believed any more, and nothing is reset
    bench.driver.set_point(250.0, 300.0)
    bench.driver.set_output(True)
    assert bench.voltage_v == pytest.approx(300.0)


def test_the_range_is_visited_within_the_limit():
    bench = Bench("keysight_33500", SETTINGS)
    assert bench.driver.settings.range_policy is RangePolicy.FIXED
    bench.driver.connect()
    assert bench.say("SYST:ERR?") == b'+0,"No error"\n'
    assert bench.say("VOLT:RANG:AUTO?") == b"0\n"
