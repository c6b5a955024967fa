from __future__ import annotations

import math

import pytest

from hw.serving.responder import Disconnect
from tests.hw.testing.faulty_instrument import Fault, FaultyInstrument


class Counter:
    def __init__(self) -> None:
        self.heard: list[bytes] = []

    def handle(self, data: bytes) -> bytes:
        self.heard.append(data)
        return b"answer\n"


@pytest.mark.parametrize(
    ("fault", "answer"),
    [(Fault.SILENCE, b""), (Fault.TRUNCATED, b"ans"), (Fault.LATE, b"answer\n"), (Fault.HANG, b"")],
)
def test_one_answer_is_spoilt_and_the_next_is_not(fault, answer):
    slept: list[float] = []
    core = Counter()
    faulty = FaultyInstrument(core, sleep=slept.append)
    faulty.inject(fault, delay_s=0.7)
    faulty.handle(b"SET 1\n")  # asks for nothing: the fault waits, but a hang swallows it too
    assert faulty.handle(b"GET?\n") == answer
    assert faulty.handle(b"GET?\n") == b"answer\n"
    assert slept == ([0.7] if fault is Fault.LATE else [])
    assert len(core.heard) == (1 if fault is Fault.HANG else 3)


def test_garbage_is_a_line_that_is_no_answer():
    faulty = FaultyInstrument(Counter())
    faulty.inject(Fault.GARBAGE)
    garbage = faulty.handle(b"GET?\n")
    assert garbage.endswith(b"\n")
    assert garbage != b"answer\n"


def test_a_disconnect_sends_half_the_answer():
    faulty = FaultyInstrument(Counter())
    faulty.inject(Fault.DISCONNECT)
    with pytest.raises(Disconnect) as caught:
        faulty.handle(b"GET?\n")
    assert caught.value.sent == b"ans"


def test_a_lasting_fault_lasts_until_healed():
    faulty = FaultyInstrument(Counter())
    faulty.inject(Fault.SILENCE, count=math.inf)
    assert [faulty.handle(b"GET?\n") for _ in range(3)] == [b""] * 3
    faulty.heal()
    assert faulty.handle(b"GET?\n") == b"answer\n"
