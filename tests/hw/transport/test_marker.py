from __future__ import annotations

import itertools

import pytest

from hw.transport.marker import Resynchroniser, scpi_marker


def test_consecutive_scpi_markers_differ_and_change_nothing():
    pairs = [scpi_marker(number) for number in range(1, 30)]
    assert pairs[0] == (b"*OPC?;*OPC?;*OPC?;*OPC?\n", b"1;1;1;1")
    assert all(one[1] != other[1] for one, other in itertools.pairwise(pairs))
    for question, answer in pairs:
        assert question.count(b"*OPC?") == answer.count(b"1")


def numbered(number: int) -> tuple[bytes, bytes]:
    return b"n %d\n" % number, b"%d" % number


@pytest.mark.parametrize("before", [b"", b"late\n", b"half", b"2\n2\n", b"+1.0\r\nx", b"12"])
def test_everything_before_the_second_answer_is_dropped(before):
    line = iter([before, b"1\n", b"2", b"\n", b"never read"])
    sent: list[bytes] = []
    Resynchroniser(numbered, "BOX")(sent.append, lambda: next(line), 1000)
    assert sent == [b"n 1\nn 2\n"]
    # An old "2" among what is owed is believed; markers of consecutive numbers differ, so it cannot
    # be the last one.
    assert next(line) in ((b"never read",) if before != b"2\n2\n" else (b"1\n", b"2"))


def test_bytes_are_counted_once_however_few_come_at_a_time():
    owed = b"an old answer of some length\n" * 30
    line = iter([bytes([byte]) for byte in owed + b"1\n2\n"])
    Resynchroniser(numbered, "BOX")(lambda data: None, lambda: next(line), len(owed) + 4)
    assert next(line, None) is None
