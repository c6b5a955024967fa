"""Samples and events to other programs: Lab Streaming Layer (extra `lsl`) and Open Sound Control
(extra `osc`).

Both are for looking on, not for control, and leave this machine only on request. LSL announces its
streams on the local network and serves who asks. OSC sends to the one address that it is given.
"""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

import numpy as np
from numpy.lib.recfunctions import structured_to_unstructured
from numpy.typing import NDArray

from haptic_driver.errors import BadInputError, optional
from haptic_driver.processes.samples import SAMPLE
from haptic_driver.processes.shared_memory import Ring
from haptic_driver.processes.started import start_thread
from haptic_driver.recording.clock import lsl_offset_s
from haptic_driver.recording.event import Event

PERIOD_S = 0.02  # between looks at the ring; OSC sends the newest sample so often
OSC_FIELDS = (
    "position_x_m",
    "position_y_m",
    "target_cof",
    "measured_cof",
    "frequency_hz",
    "voltage_v",
    "normal_force_n",
)


class Outlet(Protocol):
    """Takes what is new; never waits for a receiver."""

    def send(self, samples: NDArray[np.void], events: Sequence[Event]) -> None:
        """Samples of dtype SAMPLE [n] and events since the last call."""


class LslOutlet:
    """Stream `haptic-samples`: every field of every SAMPLE as a double; stream `haptic-events`:
    JSON as markers.

    Time stamps are of LSL's own clock, whose offset from CLOCK_MONOTONIC is measured at each call.
    LSL cannot know the delays of the devices.
    """

    def __init__(self, rate_hz: float, source: str) -> None:
        self._lsl = optional("pylsl", "lsl", "LSL")
        names = SAMPLE.names or ()
        info = self._lsl.StreamInfo(
            "haptic-samples", "Haptics", len(names), rate_hz, "double64", f"{source}-samples"
        )
        channels = info.desc().append_child("channels")
        for name in names:
            channels.append_child("channel").append_child_value("label", name)
        self._samples = self._lsl.StreamOutlet(info)
        marker = self._lsl.StreamInfo(
            "haptic-events", "Markers", 1, 0.0, "string", f"{source}-events"
        )
        self._events = self._lsl.StreamOutlet(marker)

    def send(self, samples: NDArray[np.void], events: Sequence[Event]) -> None:
        """Push all of them with the times at which they happened."""
        offset_s = lsl_offset_s(self._lsl)
        if samples.size:
            rows = structured_to_unstructured(samples, np.float64)
            self._samples.push_chunk(rows, (samples["time_s"] + offset_s).tolist())
        for event in events:
            self._events.push_sample([event.model_dump_json()], event.time_s + offset_s)


class OscOutlet:
    """`/haptic/sample` has `OSC_FIELDS` as floats (NaN where there is none), the newest only.
    `/haptic/event` has number, kind, message and data as JSON. Both go by UDP to `address`,
    HOST:PORT.
    """

    def __init__(self, address: str) -> None:
        host, _, port = address.rpartition(":")
        if not host or not port.isdecimal() or not 0 < int(port) < 1 << 16:
            raise BadInputError(
                "bad_address", f"{address!r} is no HOST:PORT", "Give for example 127.0.0.1:9000"
            )
        osc = optional("pythonosc.udp_client", "osc", "OSC")
        try:
            self._client = osc.SimpleUDPClient(host, int(port))
        except (socket.gaierror, UnicodeError) as error:  # UnicodeError: no host can have that name
            said = f"OSC to {address}: no host {host!r} is known ({error})"
            raise BadInputError(
                "unknown_host", said, "Check the name, or give its number: 192.168.0.7:9000"
            ) from error

    def send(self, samples: NDArray[np.void], events: Sequence[Event]) -> None:
        """Send them; what nobody takes is lost."""
        if samples.size:
            self._client.send_message(
                "/haptic/sample", [float(samples[-1][name]) for name in OSC_FIELDS]
            )
        for event in events:
            said = [event.number, event.kind, event.message, json.dumps(event.data)]
            self._client.send_message("/haptic/event", said)


@contextmanager
def feeding(
    outlets: Sequence[Outlet],
    ring: Ring,
    events_since: Callable[[int], Sequence[Event]],
    failed: Callable[[str], object],
) -> Iterator[None]:
    """Feed them from a thread of its own inside the `with` block, with what is new from now on.

    The first error of an outlet goes to `failed` and ends that outlet alone.
    """
    ending, running = threading.Event(), list(outlets)

    def feed() -> None:
        position = ring.position
        number = max((event.number for event in events_since(0)), default=0)
        while not ending.wait(PERIOD_S) and running:
            samples, _, position = ring.read(position)
            events = events_since(number)
            number = events[-1].number if events else number
            for outlet in list(running):
                try:
                    outlet.send(samples, events)
                except (OSError, RuntimeError, ValueError) as error:
                    running.remove(outlet)
                    failed(f"{type(outlet).__name__} ended: {error}")

    thread = start_thread("outlets", feed)
    try:
        yield
    finally:
        ending.set()
        thread.join()
