"""ATI Net F/T box: forces as UDP records, in ATI's Raw Data Transfer (RDT) protocol.

Request `>HHI`: 0x1234, command, count. Record `>IIIiiiiii`: RDT sequence, F/T sequence, status,
Fx..Tz in counts (CameronDevine/NetFT and netft/pyNetFT). Nothing is acknowledged and nothing is
authenticated.
"""

from __future__ import annotations

import math
import select
import socket
import struct
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from hw.errors import BadReply, DeviceDisconnected, DeviceError, DeviceTimeout
from hw.force.sensor import ForceAxes, ForceReading, Wrench

DEFAULT_PORT = 49152
REQUEST = struct.Struct(">HHI")
RECORD = struct.Struct(">IIIiiiiii")
HEADER = 0x1234

_SEQUENCE_MODULUS = 1 << 32
_TIMESTAMP = 35  # SO_TIMESTAMPNS of Linux
_TIMESPEC = struct.Struct("@ll")
_TOLD_BYTES = 64  # beside a record
_STOP_ATTEMPTS = 3
_QUIET_S = 0.02  # without a record for so long, the stream counts as stopped
_BACKLOG_RECORDS = 4096  # taken per look at most; far more than a socket's buffer holds
_KEPT_RECORDS = 8192  # a second of the fastest box, until somebody takes them


class Command(IntEnum):
    """What may be asked of the box."""

    STOP = 0
    STREAM = 2
    BIAS = 0x42


class NetFtScale(NamedTuple):
    """Counts per newton and per newton metre."""

    counts_per_n: float
    counts_per_n_m: float


@dataclass(frozen=True)
class NetFtSettings:
    """Where the box is and how to read it.

    A reading is at most `timeout_s` old, and no call waits much longer than that. Status bits
    outside `ignored_status` mark a reading as not to be trusted (the bits' meaning is not verified,
    so by default all do). `f_t_sequence_advances` False accepts records whose F/T sequence stands
    still (not verified for every box). `bias_tolerance_n` is what may remain on each axis after a
    software bias; it is averaged over `bias_average_s`, and taken off from then on.
    """

    host: str
    scale: NetFtScale
    axes: ForceAxes
    port: int = DEFAULT_PORT
    timeout_s: float = 0.1
    ignored_status: int = 0
    f_t_sequence_advances: bool = True
    bias_tolerance_n: float = 0.2
    bias_timeout_s: float = 1.0
    bias_average_s: float = 0.1

    def __post_init__(self) -> None:
        """Refuse what cannot be; raises ValueError."""
        positive = (
            *self.scale,
            self.timeout_s,
            self.bias_tolerance_n,
            self.bias_timeout_s,
            self.bias_average_s,
        )
        if not (all(0.0 < value < math.inf for value in positive) and 0 < self.port < 1 << 16):
            raise ValueError(
                "counts, timeouts and tolerance must be > 0 and finite and the port 1..65535:"
                f" {self}"
            )


@dataclass
class RdtCounters:
    """What arrived; `missed` are sequence numbers that were not there when their successors
    came.
    """

    accepted: int = 0
    missed: int = 0
    duplicated: int = 0
    out_of_order: int = 0
    frozen: int = 0
    wrong_source: int = 0
    wrong_length: int = 0

    def __str__(self) -> str:
        """For a person: what there was of it."""
        counted = [
            (field.name.replace("_", " "), getattr(self, field.name)) for field in fields(self)
        ]
        return ", ".join(f"{name} {count}" for name, count in counted if count) or "nothing came"


class NetFt:
    """A force sensor behind a Net F/T box, streaming between `open` and `close`. Thread-safe."""

    def __init__(
        self, settings: NetFtSettings, *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.resource = f"Net F/T {settings.host}:{settings.port}"
        self.counters = RdtCounters()
        self.status_raw = 0
        self._settings = settings
        self._clock = clock
        self._lock = threading.Lock()
        self._socket: socket.socket | None = None
        self._address = ("", 0)
        self._newest: Wrench | None = None
        self._kept: deque[Wrench] = deque(maxlen=_KEPT_RECORDS)
        self._rest = [0.0] * 6  # force and torque that the box's own bias has left
        self._sequences: tuple[int, int] | None = None
        self._looked_s = 0.0
        self._arrived_s = -math.inf  # of the newest record

    def open(self) -> None:
        """Start the stream and wait for its first record; does nothing when open.

        Raises DeviceDisconnected when the host is unknown, DeviceTimeout when no record comes.
        """
        with self._lock:
            if self._socket is not None:
                return
            self._address = self._resolve()
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._socket.setblocking(False)
            with suppress(OSError):  # not everywhere
                self._socket.setsockopt(socket.SOL_SOCKET, _TIMESTAMP, 1)
            self.counters, self._newest, self._sequences = RdtCounters(), None, None
            self._kept.clear()
            self._arrived_s = -math.inf
            self._looked_s = self._clock()
            try:
                self._send(Command.STREAM)
                self._await(lambda wrench: True, self._settings.timeout_s)
            except BaseException:
                self._stop()
                raise

    def read(self) -> ForceReading:
        """Return the newest reading, seen from the screen. Raises as `read_wrench` does."""
        return self._settings.axes.reading(self.read_wrench())

    def read_wrench(self) -> Wrench:
        """Return the newest record, at most `timeout_s` old; the same one, with its own time, until
        the next comes.

        Raises DeviceTimeout when there is none, DeviceDisconnected when not open.
        """
        with self._lock:
            self._look()
            if (
                self._newest is None
                or self._clock() - self._newest.time_s > self._settings.timeout_s
            ):
                self._newest = None
                return self._await(lambda wrench: True, self._settings.timeout_s)
            return self._newest

    def take_readings(self) -> list[ForceReading]:
        """Return every record that came since the last call, seen from the screen, the latest 8192
        at most. Raises DeviceDisconnected when not open.
        """
        with self._lock:
            self._look()
            kept = [self._settings.axes.reading(wrench) for wrench in self._kept]
            self._kept.clear()
            return kept

    def take_bias(self) -> None:
        """Make the present load the zero.

        The box acknowledges nothing, may not have heard, and takes a single noisy sample: what the
        stream shows afterwards counts. Raises DeviceTimeout, or BadReply when a force beyond
        `bias_tolerance_n` remains or a record has a bad status.
        """
        with self._lock:
            self._look()
            self._newest, self._rest = None, [0.0] * 6
            self._send(Command.BIAS)
            settings = self._settings
            try:
                near = self._await(self._is_near_zero, settings.bias_timeout_s)
                # what was under way, and the box's answer to the request
                settled_s = near.time_s + settings.bias_average_s
                self._await(lambda wrench: wrench.time_s >= settled_s, settings.bias_timeout_s)
                self._kept.clear()
                done_s = settled_s + settings.bias_average_s
                self._await(lambda wrench: wrench.time_s >= done_s, settings.bias_timeout_s)
            except DeviceTimeout:
                if self._newest is None:
                    raise
                raise self._still_reads(self._newest) from None
            for wrench in self._kept:
                if wrench.saturated:
                    raise BadReply(
                        f"{self.resource}: its status was not good while its bias was taken",
                        "see the box's own page; then take the bias again",
                    )
                if not self._is_near_zero(wrench):
                    raise self._still_reads(wrench)
            felt = [(*wrench.force_n, *wrench.torque_n_m) for wrench in self._kept]
            self._rest = np.mean(felt, axis=0).tolist()
            self._newest = None
            self._kept.clear()

    def _is_near_zero(self, wrench: Wrench) -> bool:
        return max(map(abs, wrench.force_n)) <= self._settings.bias_tolerance_n

    def _still_reads(self, wrench: Wrench) -> BadReply:
        return BadReply(
            f"{self.resource} still reads {wrench.force_n} N after its bias was taken",
            "leave the sensor unloaded and still; then take the bias again",
        )

    def keep_bias(self, before: NetFt) -> None:
        """Go on with the bias that the box itself keeps as long as it has power: somebody may press
        it now.

        Raises DeviceError where its F/T sequence began anew since `before` was read: it was off,
        and its bias is lost.
        """
        with self._lock:
            assert self._sequences is not None  # both have been open
            assert before._sequences is not None
            step = (self._sequences[1] - before._sequences[1]) % _SEQUENCE_MODULUS
            if step >= _SEQUENCE_MODULUS // 2:
                raise DeviceError(
                    f"{self.resource} was off meanwhile and has lost its bias",
                    "take everything off the sensor, then start the daemon again",
                )
            self._rest = before._rest

    def close(self) -> None:
        """Stop the stream and hang up; never fails, does nothing when closed."""
        with self._lock:
            self._stop()

    def _resolve(self) -> tuple[str, int]:
        try:
            found = socket.getaddrinfo(
                self._settings.host, self._settings.port, socket.AF_INET, socket.SOCK_DGRAM
            )
        except (OSError, UnicodeError) as error:
            raise DeviceDisconnected(
                f"{self.resource}: no such host ({error})", "check the address"
            ) from error
        host, port = found[0][4][:2]
        return str(host), int(port)

    def _send(self, command: Command) -> None:
        try:
            self._opened().sendto(REQUEST.pack(HEADER, command, 0), self._address)
        except OSError as error:
            raise DeviceDisconnected(
                f"{self.resource} cannot be reached ({error})", "check network and address"
            ) from error

    def _opened(self) -> socket.socket:
        if self._socket is None:
            raise DeviceDisconnected(f"{self.resource} is not open", "call open() first")
        return self._socket

    def _await(self, wanted: Callable[[Wrench], bool], timeout_s: float) -> Wrench:
        """Wait for a record from now on that is `wanted`."""
        connection = self._opened()
        deadline_s = self._clock() + timeout_s
        while (remaining_s := deadline_s - self._clock()) > 0.0:
            if select.select([connection], [], [], remaining_s)[0]:
                self._look()
                if self._newest is not None and wanted(self._newest):
                    return self._newest
            else:
                self._looked_s = self._clock()  # nothing piled up meanwhile
        raise DeviceTimeout(
            f"{self.resource} sent no usable record for {timeout_s:g} s ({self.counters})",
            "check power and network, that no one else has taken the stream, and reconnect",
        )

    def _look(self) -> None:
        """Take in what has arrived.

        A full buffer drops the newest records and keeps the oldest. When nobody has read for longer
        than `timeout_s`, a record may be that old, and is counted but not believed.
        """
        connection = self._opened()
        believed = self._clock() - self._looked_s <= self._settings.timeout_s
        for _ in range(_BACKLOG_RECORDS):
            try:
                data, told, _, source = connection.recvmsg(RECORD.size + 1, _TOLD_BYTES)
            except BlockingIOError:
                break
            except OSError:  # a port unreachable from an earlier request; silence will tell
                continue
            if source != self._address:
                self.counters.wrong_source += 1
            elif len(data) != RECORD.size:
                self.counters.wrong_length += 1
            else:
                self._take(data, believed, self._time_s(told))
        self._looked_s = self._clock()

    def _time_s(self, told: list[tuple[int, int, bytes]]) -> float:
        """When the kernel took a record in, which may be long before anybody looks; now where it
        does not say.

        The kernel stamps it by the wall clock, which may be set meanwhile. Times never go back for
        that.
        """
        now_s = self._clock()
        for level, kind, content in told:
            if (level, kind) == (socket.SOL_SOCKET, _TIMESTAMP) and len(content) >= _TIMESPEC.size:
                seconds, nanoseconds = _TIMESPEC.unpack_from(content)
                age_s = 1e-9 * (time.time_ns() - (seconds * 1_000_000_000 + nanoseconds))
                return now_s - age_s if 0.0 <= age_s <= self._settings.timeout_s else now_s
        return now_s

    def _take(self, data: bytes, believed: bool, arrived_s: float) -> None:
        rdt_sequence, f_t_sequence, status, *counts = RECORD.unpack(data)
        if not self._advances(rdt_sequence, f_t_sequence):
            return
        self._sequences = (rdt_sequence, f_t_sequence)
        self.counters.accepted += 1
        self.status_raw = status
        scale = self._settings.scale
        per_unit = (scale.counts_per_n,) * 3 + (scale.counts_per_n_m,) * 3
        fx, fy, fz, tx, ty, tz = (
            count / one - rest
            for count, one, rest in zip(counts, per_unit, self._rest, strict=True)
        )
        faulty = status & ~self._settings.ignored_status != 0
        self._arrived_s = max(self._arrived_s, arrived_s)
        wrench = Wrench(self._arrived_s, (fx, fy, fz), (tx, ty, tz), faulty)
        self._newest = wrench if believed else None
        if believed:
            self._kept.append(wrench)

    def _advances(self, rdt_sequence: int, f_t_sequence: int) -> bool:
        """Count what is wrong with the record's place in the stream; False when it is no news."""
        if self._sequences is None:
            return True
        step = (rdt_sequence - self._sequences[0]) % _SEQUENCE_MODULUS
        if step == 0:
            self.counters.duplicated += 1
            return False
        if step >= _SEQUENCE_MODULUS // 2:
            self.counters.out_of_order += 1
            return False
        self.counters.missed += step - 1
        if f_t_sequence == self._sequences[1] and self._settings.f_t_sequence_advances:
            self._sequences = (rdt_sequence, f_t_sequence)
            self.counters.frozen += 1
            return False
        return True

    def _stop(self) -> None:
        """Ask for the end of the stream, again while records keep coming, since a request may be
        lost.
        """
        if self._socket is None:
            return
        with suppress(DeviceDisconnected):
            for _ in range(_STOP_ATTEMPTS):
                self._send(Command.STOP)
                self._look()
                if not select.select([self._socket], [], [], _QUIET_S)[0]:
                    break
        self._socket.close()
        self._socket, self._newest = None, None
