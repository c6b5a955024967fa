"""Serves a simulated instrument on a pseudo-terminal, which other programs open like a serial
port.
"""

from __future__ import annotations

import os
import select
import tempfile
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from hw.serving.framing import MessageFramer, MessageTooLong
from hw.serving.responder import Disconnect, Responder
from hw.transport.running import Running

_CHUNK_BYTES = 1 << 16


class SerialServer(Running):
    r"""One instrument on one pseudo-terminal; no baud rate, no modem lines.

    `path` stays while the server lives, also over a simulated unplugging; `terminal` is the device
    behind it at present. Messages end with `\n`; with `framed=False` the instrument gets bytes as
    they come and finds its messages itself. It answers between `start` and `close`, or inside a
    `with` block.
    """

    def __init__(self, core: Responder, *, framed: bool = True) -> None:
        self._core = core
        self._framed = framed
        self._folder = tempfile.TemporaryDirectory(prefix="hw-serial-")
        self.path = str(Path(self._folder.name) / "tty")
        self.resource = f"ASRL{self.path}::INSTR"
        self._wake_read, self._wake_write = os.pipe()
        self._plug_in()
        self._thread = threading.Thread(
            target=self._serve, name=f"serve {self.resource}", daemon=True
        )

    @property
    def terminal(self) -> str:
        """The pseudo-terminal itself, `/dev/pts/N`."""
        return str(Path(self.path).resolve())

    def start(self) -> None:
        self._thread.start()

    def send(self, data: bytes) -> None:
        """Say something unasked, from any thread, while nothing is being answered."""
        self._write(data)

    def close(self) -> None:
        """Unplug for good; returns when the thread has ended."""
        os.write(self._wake_write, b"x")
        if self._thread.is_alive():
            self._thread.join()
        os.close(self._controller)
        os.close(self._terminal)
        os.close(self._wake_read)
        os.close(self._wake_write)
        self._folder.cleanup()

    def _plug_in(self) -> None:
        # The terminal's own end stays open here, so that the controller sees no end of file between
        # two clients.
        import tty  # noqa: PLC0415 - not on Windows

        self._controller, self._terminal = os.openpty()
        tty.setraw(self._terminal)
        os.set_blocking(self._controller, False)
        self._framer = MessageFramer()
        link = Path(self.path)
        fresh = link.with_suffix(".new")
        fresh.symlink_to(os.ttyname(self._terminal))
        fresh.replace(link)

    def _serve(self) -> None:
        with suppress(_Closed):
            while True:
                self._wait([self._controller], [])
                data = os.read(self._controller, _CHUNK_BYTES)
                try:
                    for message in self._messages(data):
                        self._write(self._core.handle(message))
                except (Disconnect, MessageTooLong) as goodbye:
                    self._write(goodbye.sent if isinstance(goodbye, Disconnect) else b"")
                    unplugged = self._controller, self._terminal
                    self._plug_in()  # first, so that `path` always leads somewhere
                    for descriptor in unplugged:
                        os.close(descriptor)

    def _messages(self, data: bytes) -> Iterator[bytes]:
        return self._framer.feed(data) if self._framed else iter([data])

    def _write(self, data: bytes) -> None:
        unsent = memoryview(data)
        while unsent:
            self._wait([], [self._controller])
            unsent = unsent[os.write(self._controller, unsent) :]

    def _wait(self, readable: list[int], writable: list[int]) -> None:
        if self._wake_read in select.select([*readable, self._wake_read], writable, [])[0]:
            raise _Closed


class _Closed(Exception):  # noqa: N818 - an event
    """`close` was called."""
