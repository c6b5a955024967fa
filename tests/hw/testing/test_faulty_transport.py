from __future__ import annotations

from collections.abc import Iterable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.errors import DeviceDisconnected, DeviceError, DeviceTimeout
from hw.serving.memory import MemoryTransport
from tests.hw.testing.faulty_transport import Faulty, LinkFault, LinkFaultKind

GARBAGE = b"\x00garbage\n"
NONE = LinkFault(LinkFaultKind.NONE)


class Bench:
    """An instrument that answers `got <command>`, on a clock that only sleeping moves."""

    def __init__(self, script: Iterable[LinkFault]) -> None:
        self.now_s = 0.0
        self.heard: list[bytes] = []
        inner = MemoryTransport(self, resource="BENCH", clock=lambda: self.now_s)
        self.faulty = Faulty(inner, script, sleep=self.sleep)
        self.faulty.open()

    def handle(self, data: bytes) -> bytes:
        self.heard.append(data)
        return b"got " + data

    def sleep(self, seconds: float) -> None:
        assert seconds >= 0.0
        self.now_s += seconds


def test_the_nth_command_gets_the_nth_fault_and_then_all_is_well():
    bench = Bench(
        [NONE, LinkFault(LinkFaultKind.DROP_ANSWER), LinkFault(LinkFaultKind.GARBAGE, data=GARBAGE)]
    )
    assert bench.faulty.query(b"1\n", 1.0) == b"got 1"
    with pytest.raises(DeviceTimeout):
        bench.faulty.query(b"2\n", 1.0)
    assert bench.faulty.query(b"3\n", 1.0) == GARBAGE[:-1]
    assert bench.faulty.query(b"4\n", 1.0) == b"got 4"
    assert bench.heard == [b"1\n", b"2\n", b"3\n", b"4\n"]


def test_a_delay_beyond_the_deadline_is_a_timeout_at_the_deadline_and_the_answer_is_dropped():
    bench = Bench([LinkFault(LinkFaultKind.DELAY, delay_s=1.5)])
    with pytest.raises(DeviceTimeout, match="BENCH"):
        bench.faulty.query(b"1\n", 1.0)
    assert bench.now_s == pytest.approx(1.0)
    assert bench.faulty.query(b"2\n", 1.0) == b"got 2"


def test_a_copy_that_comes_after_the_next_question_takes_its_place():
    # No link can tell; that is why drivers read back. A marked-dirty transport is safe again.
    bench = Bench([LinkFault(LinkFaultKind.DUPLICATE, delay_s=0.2)])
    assert bench.faulty.query(b"1\n", 1.0) == b"got 1"
    bench.faulty.write(b"2\n")
    bench.sleep(0.3)
    assert bench.faulty.read_until(b"\n", 1.0) == b"got 1"
    bench.faulty.mark_dirty()
    assert bench.faulty.query(b"3\n", 1.0) == b"got 3"


def test_a_dead_instrument_refuses_so_many_connections():
    bench = Bench([LinkFault(LinkFaultKind.REFUSE, count=2)])
    for command in (b"1\n", b"2\n", b"3\n"):
        with pytest.raises(DeviceDisconnected):
            bench.faulty.query(command, 1.0)
    assert bench.faulty.query(b"4\n", 1.0) == b"got 4"
    assert bench.heard == [b"4\n"]


FAULTS = st.builds(
    LinkFault,
    kind=st.sampled_from(LinkFaultKind),
    delay_s=st.floats(0.0, 3.0),
    data=st.sampled_from([b"", b"\n", GARBAGE, b"got 1"]),
    count=st.integers(0, 8),
)


@settings(max_examples=200)
@given(script=st.lists(FAULTS, max_size=12))
def test_no_script_hangs_mixes_up_answers_or_stays_broken(script):
    """Each query ends within its timeout, in its own answer, a device error, or what garbage and
    copies explain.
    """
    bench = Bench(script)
    believable = all(
        fault.kind not in (LinkFaultKind.GARBAGE, LinkFaultKind.DUPLICATE) for fault in script
    )
    for i in range(130):  # 12 faults, and at most 8 refused connections for each
        before_s = bench.now_s
        try:
            answer = bench.faulty.query(b"%d\n" % i, 1.0)
        except DeviceError:
            assert bench.faulty.dirty
        else:
            assert answer == b"got %d" % i or not believable
        assert bench.now_s - before_s <= 1.0 + 1e-9
        bench.sleep(0.05)
    bench.sleep(10.0)
    assert bench.faulty.query(b"last\n", 1.0) == b"got last"
