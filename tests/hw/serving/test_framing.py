from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.serving.framing import MAX_MESSAGE_BYTES, MessageFramer, MessageTooLong


@pytest.mark.parametrize(
    ("stream", "messages"),
    [
        (b"*IDN?\nFREQ?\n", [b"*IDN?\n", b"FREQ?\n"]),
        (b"FREQ 1\r\n", [b"FREQ 1\r\n"]),
        (b"unfinished", []),
        (b"DATA #15a\nb\nc;FREQ?\nnext\n", [b"DATA #15a\nb\nc;FREQ?\n", b"next\n"]),
        (b"DATA #210" + b"\n" * 10 + b"\nnext\n", [b"DATA #210" + b"\n" * 11, b"next\n"]),
        (b'DISP "#19"\nnext\n', [b'DISP "#19"\n', b"next\n"]),
        (b'a "quote that never ends\nnext\n', [b'a "quote that never ends\n', b"next\n"]),
        (b"*ESE #H20\n*ESE #B1\n", [b"*ESE #H20\n", b"*ESE #B1\n"]),
        (b"CHANNEL #1 x\nnext\n", [b"CHANNEL #1 x\n", b"next\n"]),
        (b"DATA #15abc\n", []),  # two bytes of the block are missing
        (b"DATA #1\n", [b"DATA #1\n"]),
        (b"DATA #3", []),
        (b"\n\n", [b"\n", b"\n"]),
    ],
)
def test_messages_end_at_line_ends_outside_blocks(stream: bytes, messages: list[bytes]) -> None:
    assert list(MessageFramer().feed(stream)) == messages
    framer = MessageFramer()
    assert [message for i in range(len(stream)) for message in framer.feed(stream[i : i + 1])] == messages


@given(
    blocks=st.lists(st.binary(max_size=300), max_size=5),
    cuts=st.lists(st.integers(1, 40), min_size=1, max_size=20),
)
def test_blocks_of_any_bytes_arrive_whole_however_they_are_cut(blocks: list[bytes], cuts: list[int]) -> None:
    messages = [b"DATA #3%03d" % len(block) + block + b"\n" for block in blocks]
    stream = b"".join(messages)
    framer, got, at = MessageFramer(), [], 0
    while at < len(stream):
        cut = cuts[at % len(cuts)]
        got += list(framer.feed(stream[at : at + cut]))
        at += cut
    assert got == messages


def test_endless_messages_are_given_up() -> None:
    with pytest.raises(MessageTooLong):
        list(MessageFramer().feed(b"x" * (MAX_MESSAGE_BYTES + 1)))
