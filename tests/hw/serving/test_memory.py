from __future__ import annotations

import pytest

from hw.errors import DeviceTimeout
from hw.serving.memory import MemoryTransport


class Slow:
    """Takes the time it is asked to take, on a clock of its own."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def handle(self, data: bytes) -> bytes:
        self.now_s += float(data)
        return b"after " + data


def test_time_is_the_injected_clock():
    slow = Slow()
    transport = MemoryTransport(slow, clock=lambda: slow.now_s)
    transport.open()
    assert transport.query(b"0.9\n", 1.0) == b"after 0.9"
    with pytest.raises(DeviceTimeout):
        transport.query(b"1.1\n", 1.0)
    assert transport.query(b"0.1\n", 1.0) == b"after 0.1"
