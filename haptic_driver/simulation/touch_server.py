"""A simulated touch screen over TCP: what its event device would give."""

from __future__ import annotations

import os
import socket
from contextlib import suppress

from hw.finger.simulated_touch_screen import SimulatedTouchScreen


class TouchServer:
    """Hands the touch screen's events, as bytes of `struct input_event`, to the latest client."""

    def __init__(self, screen: SimulatedTouchScreen) -> None:
        self._screen = screen
        os.set_blocking(screen.descriptor, False)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)
        self.address = f"127.0.0.1:{self._listener.getsockname()[1]}"
        self._client: socket.socket | None = None

    def pump(self) -> None:
        """Pass on what there is; without a client it is thrown away."""
        with suppress(BlockingIOError):
            client, _ = self._listener.accept()
            self._hang_up()
            self._client = client
            client.setblocking(False)
            self._screen.repeat()  # it missed where the finger is, and only changes are reported
        try:
            events = os.read(self._screen.descriptor, 1 << 16)
            if self._client is not None:
                self._client.sendall(events)
        except BlockingIOError:
            pass
        except OSError:
            self._hang_up()

    def close(self) -> None:
        """Hang up, and free the port."""
        self._listener.close()
        self._hang_up()

    def _hang_up(self) -> None:
        if self._client is not None:
            self._client.close()
        self._client = None
