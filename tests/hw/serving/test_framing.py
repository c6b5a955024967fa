import pytest

from hw.serving.framing import MAX_MESSAGE_BYTES, MessageFramer, MessageTooLong


@pytest.mark.parametrize(
    ("stream", "messages"),
    [
        (b"*IDN?\nFREQ?\n", [b"*IDN?\n", b"FREQ?\n"]),
        (b"FREQ 1\r\n", [b"FREQ 1\r\n"]),
        (b"unfinished", []),
    ],
)
def test_messages_end_at_line_ends(stream, messages):
    assert list(MessageFramer().feed(stream)) == messages
    framer = MessageFramer()
    assert [
        message for i in range(len(stream)) for message in framer.feed(stream[i : i + 1])
    ] == messages


def test_endless_messages_are_given_up():
    with pytest.raises(MessageTooLong):
        list(MessageFramer().feed(b"x" * (MAX_MESSAGE_BYTES + 1)))
