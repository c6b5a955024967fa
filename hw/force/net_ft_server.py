"""A Net F/T box on a loopback UDP port: the real request and record bytes."""

from __future__ import annotations

import math
import socket
import struct
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from hw.force.net_ft import NetFtScale
from hw.transport.running import Running

SCALE = NetFtScale(counts_per_n=1e6, counts_per_n_m=1e6)
WrenchSource = Callable[[], tuple[float, float, float, float, float, float]]
"""-> (Fx, Fy, Fz, Tx, Ty, Tz) on the transducer now, N and N m."""

_REQUEST = struct.Struct(">HHI")
_RECORD = struct.Struct(">IIIiiiiii")
_COUNT_END = (1 << 31) - 1
_COUNTER_MODULUS = 1 << 32
_POLL_S = 0.02
BAD_STATUS_RAW = 0x80020000
# who connects takes a bias until then if ever, and sees by then that it is right
UNTIL_BIAS_S, BIAS_SEEN_S = 5.0, 1.0


class NetFtServer(Running):
    """One box on 127.0.0.1, serving the latest client that asked for a stream.

    Requests: 0 stop, 2 stream (count 0: endless), 0x41 reset latch, 0x42 software bias; others and
    malformed ones are ignored, as nothing is ever acknowledged. Streams at `rate_hz`, or, when that
    is None, one record at the request and then by `emit`. Forces end at `range_n`, with the bad
    status. Answers from `start` to `close`, or in a `with` block.
    """

    def __init__(
        self,
        wrench: WrenchSource,
        *,
        counts_per_n: float = SCALE.counts_per_n,
        counts_per_n_m: float = SCALE.counts_per_n_m,
        rate_hz: float | None = 1000.0,
        range_n: float = math.inf,
    ) -> None:
        self.status_raw = 0
        self._wrench = wrench
        self._scale = (counts_per_n,) * 3 + (counts_per_n_m,) * 3
        self._range_n = range_n
        self._period_s = None if rate_hz is None else 1.0 / rate_hz
        self._bias = (0.0,) * 6
        self._rdt_sequence = 0
        self._f_t_sequence = 0
        self._remaining = 0.0
        self._client: tuple[str, int] | None = None
        self._finger_from_s = -math.inf
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self.host, self.port = "127.0.0.1", int(self._socket.getsockname()[1])
        self._thread = threading.Thread(
            target=self._serve, name=f"serve Net F/T {self.port}", daemon=True
        )

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """Fall silent and free the port."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join()
        self._socket.close()

    @property
    def may_be_pressed(self) -> bool:
        """Whether somebody listens, and has taken the bias, or has had the time to."""
        return self._client is not None and time.monotonic() > self._finger_from_s

    def emit(self, count: int) -> None:
        """Send `count` records now, if a client has asked for any."""
        for _ in range(count):
            with self._lock:
                self._emit()

    def _serve(self) -> None:
        due_s = time.monotonic()
        while not self._closing.is_set():
            pause_s = (
                _POLL_S
                if self._period_s is None
                else min(max(due_s - time.monotonic(), 1e-4), _POLL_S)
            )
            self._socket.settimeout(pause_s)
            with suppress(TimeoutError, ConnectionError):
                request, client = self._socket.recvfrom(64)
                self._handle(request, client)
            if self._period_s is not None and time.monotonic() >= due_s:
                due_s = max(due_s + self._period_s, time.monotonic() - self._period_s)
                self.emit(1)

    def _handle(self, request: bytes, client: tuple[str, int]) -> None:
        if len(request) != _REQUEST.size:
            return
        header, command, count = _REQUEST.unpack(request)
        if header != 0x1234:
            return
        with self._lock:
            match command:
                case 0:
                    self._client = None
                case 2:
                    self._finger_from_s = time.monotonic() + UNTIL_BIAS_S
                    self._client, self._remaining = client, count or math.inf
                    self._emit()
                case 0x41:
                    self.status_raw = 0
                case 0x42:
                    self._finger_from_s = time.monotonic() + BIAS_SEEN_S
                    self._bias = self._wrench()

    def _emit(self) -> None:
        if self._client is None:
            return
        self._send(self._next_record())
        self._remaining -= 1
        if self._remaining == 0:
            self._client = None

    def _next_record(self) -> bytes:
        self._rdt_sequence = (self._rdt_sequence + 1) % _COUNTER_MODULUS
        self._f_t_sequence = (self._f_t_sequence + 1) % _COUNTER_MODULUS
        wrench = self._wrench()
        saturated = max(map(abs, wrench[:3])) >= self._range_n
        status = BAD_STATUS_RAW if saturated else self.status_raw
        forces = (max(-self._range_n, min(value, self._range_n)) for value in wrench[:3])
        counts = (
            max(-_COUNT_END, min(round((value - bias) * scale), _COUNT_END))
            for value, bias, scale in zip(
                (*forces, *wrench[3:]), self._bias, self._scale, strict=True
            )
        )
        return _RECORD.pack(self._rdt_sequence, self._f_t_sequence, status, *counts)

    def _send(self, record: bytes) -> None:
        if self._client is not None:
            with suppress(OSError):  # the client is gone
                self._socket.sendto(record, self._client)
