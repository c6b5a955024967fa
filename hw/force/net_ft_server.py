"""A Net F/T box on a loopback UDP port: the real request and record bytes, with faults on demand."""

from __future__ import annotations

import enum
import math
import socket
import struct
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from hw.transport.running import Running

WrenchSource = Callable[[], tuple[float, float, float, float, float, float]]
"""-> (Fx, Fy, Fz, Tx, Ty, Tz) on the transducer now, N and N m."""

_REQUEST = struct.Struct(">HHI")
_RECORD = struct.Struct(">IIIiiiiii")
_COUNT_END = (1 << 31) - 1
_COUNTER_MODULUS = 1 << 32
_POLL_S = 0.02


class RdtFault(enum.Enum):
    """What happens to a record instead of being sent."""

    DROP = "drop"
    REORDER = "reorder"  # sent after its successor
    DUPLICATE = "duplicate"  # sent twice
    FROZEN = "frozen"  # the box repeats its last measurement under a new RDT sequence
    BAD_STATUS = "bad status"
    WRONG_SOURCE = "wrong source"  # sent from another port
    WRONG_LENGTH = "wrong length"  # cut short
    SILENCE = "silence"  # as DROP, and the sequence stands still


class NetFtServer(Running):
    """One box on 127.0.0.1, serving the latest client that asked for a stream.

    Requests: 0 stop, 2 stream (count 0: endless), 0x41 reset latch, 0x42 software bias; others and malformed ones are
    ignored, as nothing is ever acknowledged. Streams at `rate_hz`, or, when that is None, one record at the request and
    then by `emit`. Forces end at `range_n`, with the bad status. Answers from `start` to `close`, or in a `with` block.
    """

    def __init__(
        self,
        wrench: WrenchSource,
        *,
        counts_per_n: float = 1e6,
        counts_per_n_m: float = 1e6,
        rate_hz: float | None = 1000.0,
        range_n: float = math.inf,
        bad_status_raw: int = 0x80020000,
        port: int = 0,
    ) -> None:
        self.status_raw = 0
        self.requests: list[int] = []
        self._wrench = wrench
        self._scale = (counts_per_n,) * 3 + (counts_per_n_m,) * 3
        self._range_n = range_n
        self._period_s = None if rate_hz is None else 1.0 / rate_hz
        self._bad_status_raw = bad_status_raw
        self._bias = (0.0,) * 6
        self._rdt_sequence = 0
        self._f_t_sequence = 0
        self._held_back: bytes | None = None
        self._remaining = 0
        self._endless = False
        self._client: tuple[str, int] | None = None
        self._fault: RdtFault | None = None
        self._fault_count = 0.0
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", port))
        self._stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._stranger.bind(("127.0.0.1", 0))
        self.host, self.port = "127.0.0.1", int(self._socket.getsockname()[1])
        self._thread = threading.Thread(target=self._serve, name=f"serve Net F/T {self.port}", daemon=True)

    @property
    def streaming(self) -> bool:
        """Whether a client is being served."""
        with self._lock:
            return self._client is not None

    def start(self) -> None:
        """Begin to answer."""
        self._thread.start()

    def close(self) -> None:
        """Fall silent and free the port."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join()
        self._socket.close()
        self._stranger.close()

    def inject(self, fault: RdtFault, *, count: float = 1) -> None:
        """Spoil the next `count` records (`math.inf`: all until `heal`)."""
        with self._lock:
            self._fault, self._fault_count = fault, count

    def heal(self) -> None:
        """Send records properly again."""
        with self._lock:
            self._fault_count = 0.0

    def set_sequence(self, rdt_sequence: int) -> None:
        """Number the next record `rdt_sequence` + 1, e.g. to see the counter wrap."""
        with self._lock:
            self._rdt_sequence = rdt_sequence

    def emit(self, count: int) -> None:
        """Send `count` records now, if a client has asked for any."""
        for _ in range(count):
            with self._lock:
                self._emit()

    def _serve(self) -> None:
        due_s = time.monotonic()
        while not self._closing.is_set():
            pause_s = _POLL_S if self._period_s is None else min(max(due_s - time.monotonic(), 1e-4), _POLL_S)
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
            self.requests.append(command)
            match command:
                case 0:
                    self._client = None
                case 2:
                    self._client, self._remaining, self._endless = client, count, count == 0
                    self._emit()
                case 0x41:
                    self.status_raw = 0
                case 0x42:
                    self._bias = self._wrench()

    def _emit(self) -> None:
        if self._client is None:
            return
        fault = None
        if self._fault_count >= 1:
            self._fault_count -= 1
            fault = self._fault
        if fault is RdtFault.SILENCE:
            return
        record = self._next_record(fault)
        match fault:
            case RdtFault.DROP:
                return
            case RdtFault.REORDER:
                self._held_back = record
                return
            case RdtFault.DUPLICATE:
                self._send(record)
            case RdtFault.WRONG_SOURCE:
                self._stranger.sendto(record, self._client)
                return
            case RdtFault.WRONG_LENGTH:
                record = record[:-4]
        self._send(record)
        if self._held_back is not None:
            self._send(self._held_back)
            self._held_back = None
        self._remaining -= 1
        if self._remaining == 0 and not self._endless:
            self._client = None

    def _next_record(self, fault: RdtFault | None) -> bytes:
        self._rdt_sequence = (self._rdt_sequence + 1) % _COUNTER_MODULUS
        if fault is not RdtFault.FROZEN:
            self._f_t_sequence = (self._f_t_sequence + 1) % _COUNTER_MODULUS
        wrench = self._wrench()
        saturated = max(map(abs, wrench[:3])) >= self._range_n
        status = self._bad_status_raw if saturated or fault is RdtFault.BAD_STATUS else self.status_raw
        forces = (max(-self._range_n, min(value, self._range_n)) for value in wrench[:3])
        counts = (
            max(-_COUNT_END, min(round((value - bias) * scale), _COUNT_END))
            for value, bias, scale in zip((*forces, *wrench[3:]), self._bias, self._scale, strict=True)
        )
        return _RECORD.pack(self._rdt_sequence, self._f_t_sequence, status, *counts)

    def _send(self, record: bytes) -> None:
        if self._client is not None:
            with suppress(OSError):  # the client is gone
                self._socket.sendto(record, self._client)
