from __future__ import annotations

from collections.abc import Iterable

from hypothesis import given, settings
from hypothesis import strategies as st

from hw.errors import DeviceError
from hw.serving.memory import MemoryTransport
from tests.hw.testing.faulty_transport import Faulty, LinkFault, LinkFaultKind

GARBAGE = b"\x00garbage\n"


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
