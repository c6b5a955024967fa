"""What tests of several drivers ask of the simulated instruments around them."""

from __future__ import annotations

import socket
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from hw.generator.contract import GeneratorLatency

IMMEDIATE = GeneratorLatency(0.0, 0.0, 0.0, 0.0)
"""Settings are at the generator's terminals as soon as they are programmed."""


def closed_port() -> int:
    """A port of this machine at which nobody listens."""
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        return int(unused.getsockname()[1])


@contextmanager
def pymeasure_client(module: str, name: str, resource: str) -> Iterator[Any]:
    """pymeasure's own driver of that name, connected."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # pymeasure's own, at class construction
        made = getattr(import_module(f"pymeasure.instruments.{module}"), name)
        client = made(resource, visa_library="@py", write_termination="\n", timeout=3000)
        client.adapter.connection.read_termination = "\n"
        yield client
        client.adapter.close()
