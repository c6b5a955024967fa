"""What tests of several drivers ask of the simulated instruments around them."""

from __future__ import annotations

import socket

from hw.generator.contract import GeneratorLatency

IMMEDIATE = GeneratorLatency(0.0, 0.0, 0.0, 0.0)
"""Settings are at the generator's terminals as soon as they are programmed."""


def closed_port() -> int:
    """A port of this machine at which nobody listens."""
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        return int(unused.getsockname()[1])
