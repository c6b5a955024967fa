"""The memory that control and render share: slots swapped as a whole, target and surface, and a
ring of samples.

It is an anonymous file that only those who are handed its descriptor can see. It has no name that
could be guessed or left behind. It is gone with the last process that has it, however that ended.
Nobody ever waits for anybody here.
"""

from __future__ import annotations

import mmap
import os
import pickle
import struct
import zlib
from collections.abc import Sequence
from math import nan
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar, cast, get_type_hints

import numpy as np
from numpy.typing import NDArray

from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.processes.samples import COURSE, SAMPLE
from haptic_driver.signals import Array

if TYPE_CHECKING:  # not every process that has this memory waits for numba
    from haptic_driver.render.controller import ControllerSettings
    from haptic_driver.render.safety import WorstTable
    from haptic_driver.render.texture import Target

SHEET_BYTES = 1 << 17  # of a scene: 512 objects, and 3500 corners of polygons
SHEET_COLUMNS = (17, 2)  # of its objects and of these corners
RING_SAMPLES = 1 << 14  # 16 s at 1 kHz
RING_COURSES = 1 << 6
# for each of two targets, e.g. a map of 2 million pixels; and for each of two surfaces
TARGET_BYTES = 1 << 24
SLOT_BYTES = 256
_HEADER_BYTES = 16  # of a slot
_RING_HEADER_BYTES = 64
ATTEMPTS = 8  # at a copy that a writer keeps disturbing
TEXT_BYTES = 120
_FORMATS = {float: "d", int: "q", bool: "?", str: f"{TEXT_BYTES}s"}
_CELLS = {"f8": "d", "u8": "Q", "u4": "I", "u1": "B"}


class Sensed(NamedTuple):
    """What the sensors said last, each at its own time on CLOCK_MONOTONIC; from control to
    render.

    Without a force sensor the lateral force is what friction is estimated to be, NaN where that
    tells nothing of the finger. NaN is what nobody has read, as `contacts` of a screen that tells
    one touch alone; `palm` is among them. `contact_area_m2` is of the finger alone.
    """

    finger_time_s: float
    position_x_m: float
    position_y_m: float
    touching: bool
    force_time_s: float
    normal_force_n: float
    lateral_force_n: float
    saturated: bool
    estimated_cof: float = nan
    estimated_cof_std: float = nan
    contacts: float = nan
    palm: bool = False
    electrode_time_s: float = nan
    electrode_voltage_v: float = nan
    electrode_voltage_phase_rad: float = nan
    current_a: float = nan
    current_phase_rad: float = nan
    monitor_voltage_v: float = nan
    monitor_current_a: float = nan
    contact_area_m2: float = nan
    contact_area_std_m2: float = nan


class Order(NamedTuple):
    """What control wants of render; `number` counts orders, `arming` counts armings and 0 is none.

    Output is wanted while `rendering`, until `lease_until_s`, and while control goes on beating at
    `beat_s`. `target` and `surface` are the numbers of those in force. Flags and faults are
    forgotten when `arming` changes.
    """

    number: int
    arming: int
    rendering: bool
    lease_until_s: float
    beat_s: float
    target: int
    surface: int


class Output(NamedTuple):
    """What render puts out; `order`, `target` and `surface` are the numbers of those it followed.

    `tick` counts instants, `overruns` those that were missed. `flags` of `samples.Flag`; `time_s`
    when it was written. `in_contact`: a finger is there for which something is rendered, even at 0
    V. `full_scale_v`: see `DriveCommand`.
    """

    order: int
    target: int
    surface: int
    tick: int
    time_s: float
    frequency_hz: float
    voltage_v: float
    output_on: bool
    overruns: int
    flags: int
    target_cof: float
    in_contact: bool
    full_scale_v: float


class Driven(NamedTuple):
    """What may go out and since when it does, from control's pump to render and to the writer of an
    envelope.

    `gate`: the first order whose output may go out, CLOSED while none may. `since_s`: from when on
    outputs reach the electrode, but for the usual latency; inf while they do not. `carrier_hz` is
    the one that is out, NaN for none, and `full_scale_v` its voltage where an envelope is at its
    highest.
    """

    gate: int
    since_s: float
    carrier_hz: float
    full_scale_v: float


class Played(NamedTuple):
    """What the writer of an envelope says: when it said so, gaps so far, and when the last one
    ended.

    `lead_s`: so far ahead it writes. `failure` is what its output could not do, in words; empty
    while all is well.
    """

    time_s: float
    underruns: int
    whole_s: float
    lead_s: float
    failure: str


NOTHING_SENSED = Sensed(-np.inf, np.nan, np.nan, False, -np.inf, 0.0, 0.0, False)
NO_ORDER = Order(0, 0, False, -np.inf, -np.inf, 0, 0)
NO_OUTPUT = Output(0, 0, 0, 0, -np.inf, 0.0, 0.0, False, 0, 0, np.nan, False, 0.0)
CLOSED = -1
NOT_DRIVEN = Driven(CLOSED, np.inf, np.nan, 0.0)
NOT_PLAYED = Played(-np.inf, 0, -np.inf, 0.0, "")

Values = TypeVar("Values", bound=tuple[Any, ...])
Kept = TypeVar("Kept")


class Slot(Generic[Values]):
    """One record with one writer and any number of readers, who see the newest whole record and
    never half of one.

    A sequence number before the content is odd while a writer is at it. The checksum, which counts
    that number in, makes a torn copy show: no copy needs to read memory in order, on any processor.
    """

    def __init__(self, memory: memoryview, initial: Values) -> None:
        fields = list(get_type_hints(type(initial)).values())
        kinds = "".join(_FORMATS[kind] for kind in fields)
        self._text = fields.index(str) if str in fields else None
        self._content = struct.Struct("=" + kinds)
        self._whole = struct.Struct("=QI4x" + kinds)  # sequence number, checksum, content
        assert self._whole.size <= len(memory)
        self._memory = memory[: self._whole.size]
        self._sequence = memory[:8].cast("Q")
        self._check = memory[8:12].cast("I")
        self._body = self._memory[_HEADER_BYTES:]
        self._make = cast(Any, type(initial))._make
        self._newest = initial
        self._newest_sequence = 0

    def write(self, values: Values) -> None:
        sequence = self._sequence[0] | 1  # a writer that was killed left it odd
        content = self._content.pack(*(values if self._text is None else self._encoded(values)))
        self._sequence[0] = sequence
        self._body[:] = content
        self._check[0] = zlib.crc32(content, (sequence + 1) & 0xFFFFFFFF)
        self._sequence[0] = sequence + 1

    def read(self) -> Values:
        """The newest record; the one read before when a writer is at it for too long or was killed
        there.
        """
        if self._sequence[0] != self._newest_sequence:
            self._take_over()
        return self._newest

    def _take_over(self) -> None:
        for _ in range(ATTEMPTS):
            copy = self._memory.tobytes()
            sequence, check, *values = self._whole.unpack(copy)
            whole = zlib.crc32(copy[_HEADER_BYTES:], sequence & 0xFFFFFFFF) == check
            if whole and not sequence & 1:
                self._newest = self._make(values if self._text is None else self._decoded(values))
                self._newest_sequence = sequence
                return

    def _encoded(self, values: Values) -> Sequence[Any]:
        """A record may have one text, which is cut where it is too long."""
        assert self._text is not None
        text: str = values[self._text]
        encoded = text.encode(errors="replace")[:TEXT_BYTES]
        return *values[: self._text], encoded, *values[self._text + 1 :]

    def _decoded(self, values: list[Any]) -> list[Any]:
        assert self._text is not None
        values[self._text] = values[self._text].rstrip(b"\0").decode(errors="replace")
        return values


class Sheet:
    """Tables of floats of one target, written as a whole by one writer and read by any number.

    As `Slot`, of which it is the large form: readers see the newest whole tables and never half of
    them. `columns`: of each table; all of them together have `SHEET_BYTES`.
    """

    _HEADER = struct.Struct("=QI4xQ")  # sequence number, checksum, the target's number
    _ROWS_AT = _HEADER.size

    def __init__(self, memory: memoryview, columns: Sequence[int]) -> None:
        self._memory = memory[:SHEET_BYTES]
        self._sequence = memory[:8].cast("Q")
        self._check = memory[8:12].cast("I")
        self._columns = tuple(columns)
        self._rows = struct.Struct(f"={len(self._columns)}Q")
        self._content_at = self._ROWS_AT + self._rows.size
        self._most = SHEET_BYTES - self._content_at
        self._newest: tuple[int, tuple[Array, ...]] = (0, ())
        self._newest_sequence = 0

    def write(self, number: int, tables: Sequence[Array]) -> None:
        """BadInputError where they are too large."""
        content = b"".join(np.ascontiguousarray(table, np.float64).tobytes() for table in tables)
        if len(content) > self._most:
            raise BadInputError("scene_too_large", "a scene has too many corners", "leave some out")
        sequence = self._sequence[0] | 1  # a writer that was killed left it odd
        body = struct.pack("=Q", number) + self._rows.pack(*(len(t) for t in tables)) + content
        self._sequence[0] = sequence
        self._memory[_HEADER_BYTES : _HEADER_BYTES + len(body)] = body
        self._check[0] = zlib.crc32(body, (sequence + 1) & 0xFFFFFFFF)
        self._sequence[0] = sequence + 1

    def read(self) -> tuple[int, tuple[Array, ...]]:
        """The number of a target and the newest tables of it; those read before where a writer is
        at it.
        """
        if self._sequence[0] != self._newest_sequence:
            self._take_over()
        return self._newest

    def _take_over(self) -> None:
        """One attempt: at the next tick there is another."""
        rows = self._rows.unpack_from(self._memory, self._ROWS_AT)
        cells = [n * width for n, width in zip(rows, self._columns, strict=True)]
        length = self._content_at + 8 * sum(cells)
        if length > SHEET_BYTES:
            return
        copy = self._memory[:length].tobytes()
        sequence, check, number = self._HEADER.unpack_from(copy)
        whole = zlib.crc32(memoryview(copy)[_HEADER_BYTES:], sequence & 0xFFFFFFFF) == check
        if sequence & 1 or not whole or self._rows.unpack_from(copy, self._ROWS_AT) != rows:
            return
        ends = np.cumsum(cells).tolist()
        values = np.frombuffer(copy, np.float64, offset=self._content_at)
        parts = [values[end - n : end] for n, end in zip(cells, ends, strict=True)]
        shaped = zip(parts, self._columns, strict=True)
        self._newest = number, tuple(part.reshape(-1, width) for part, width in shaped)
        self._newest_sequence = sequence


class Taken(NamedTuple):
    """Samples read from the ring, how many had been overwritten before, and where to go on."""

    samples: NDArray[np.void]
    lost: int
    position: int


class Ring:
    """The last `length` samples of one kind. One writer, who never waits; every reader keeps a
    position of its own.

    A reader that is too late loses the oldest, and gets their number.
    """

    def __init__(self, memory: memoryview, kind: np.dtype[np.void], length: int) -> None:
        self._count = memory[:8].cast("Q")
        self._cells = memory[_RING_HEADER_BYTES:]
        self._length = length
        self._samples = np.frombuffer(self._cells, kind, length)
        fields = [kind[name] for name in kind.names or ()]
        cells = [f"{f.itemsize}s" if f.shape else _CELLS[f.str[1:]] for f in fields]
        self._pack = struct.Struct("=" + "".join(cells))
        assert self._pack.size == kind.itemsize

    @property
    def position(self) -> int:
        """How many samples were ever written."""
        return self._count[0]

    def put(self, sample: tuple[float | bytes, ...]) -> None:
        """Put one sample where the next one goes, its fields in order; it does not count yet.

        Arrays are given as bytes.
        """
        self._pack.pack_into(
            self._cells, (self._count[0] % self._length) * self._pack.size, *sample
        )

    def write(self, sample: tuple[float | bytes, ...]) -> None:
        self.put(sample)
        self._count[0] += 1

    def read(self, position: int) -> Taken:
        """What was written since `position`."""
        end = self.position
        start = max(position, end - self._length + 1)
        copy = self._samples.take(np.arange(start, end), mode="wrap")
        # while we copied; one more is being written
        overwritten = max(self.position - self._length + 1 - start, 0)
        kept = copy[overwritten:]
        return Taken(kept, end - position - len(kept), end)

    def newest(self, most: int) -> NDArray[np.void]:
        """The last samples, at most so many."""
        return self.read(max(self.position - most, 0)).samples


class Store(Generic[Kept]):
    """What render is to use next, for a reader who takes it between two ticks, at once and without
    copying its arrays.

    Two places are used in turn: one that is in use is never written to. What is kept is numbered
    from 1.
    """

    _HEADER = struct.Struct("=QQ")  # bytes of the record, how many arrays come after it

    def __init__(self, memory: memoryview) -> None:
        self._places = [memory[i * TARGET_BYTES : (i + 1) * TARGET_BYTES] for i in range(2)]

    def write(self, number: int, kept: Kept) -> None:
        """Put one where no reader is as long as `number - 1` is in use. BadInputError when too
        large.
        """
        buffers: list[pickle.PickleBuffer] = []
        record = pickle.dumps(kept, protocol=5, buffer_callback=buffers.append)
        maps = [buffer.raw() for buffer in buffers]
        sizes = struct.pack(f"={len(maps)}Q", *(m.nbytes for m in maps))
        starts = len(record) + self._HEADER.size + len(sizes)
        total = starts + sum(m.nbytes + 64 for m in maps)
        if total > TARGET_BYTES:
            said = (
                f"the texture takes {total / 1e6:.1f} MB, the most is {TARGET_BYTES / 1e6:.1f} MB"
            )
            raise BadInputError("texture_too_large", said, "give it a coarser pitch")
        place = self._places[number % 2]
        self._HEADER.pack_into(place, 0, len(record), len(maps))
        place[self._HEADER.size : self._HEADER.size + len(sizes)] = sizes
        place[starts - len(record) : starts] = record
        at = starts
        for part in maps:
            at = _aligned(at)
            place[at : at + part.nbytes] = part
            at += part.nbytes

    def read(self, number: int) -> Kept:
        """That of the number; its arrays stay in this memory."""
        place = self._places[number % 2]
        length, count = self._HEADER.unpack_from(place)
        sizes = struct.unpack_from(f"={count}Q", place, self._HEADER.size)
        record_at = self._HEADER.size + 8 * count
        at, maps = record_at + length, []
        for size in sizes:
            at = _aligned(at)
            maps.append(place[at : at + size])
            at += size
        return cast(Kept, pickle.loads(place[record_at : record_at + length], buffers=maps))


def _aligned(offset: int) -> int:
    return -(-offset // 64) * 64


_SLOTS = 5
_RING_AT = _SLOTS * SLOT_BYTES
_COURSES_AT = _RING_AT + _RING_HEADER_BYTES + RING_SAMPLES * SAMPLE.itemsize
_TARGETS_AT = -(-(_COURSES_AT + _RING_HEADER_BYTES + RING_COURSES * COURSE.itemsize) // 4096) * 4096
_SURFACES_AT = _TARGETS_AT + 2 * TARGET_BYTES
_SCENE_AT = _SURFACES_AT + 2 * TARGET_BYTES
_TOTAL_BYTES = _SCENE_AT + SHEET_BYTES


class SharedState:
    """The memory and what lies in it; `descriptor` is what another process needs to see the
    same.
    """

    def __init__(self, descriptor: int | None = None) -> None:
        # an anonymous file, not inherited by any process that is not given it
        if descriptor is None:
            descriptor = os.memfd_create("haptic-driver", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
            os.ftruncate(descriptor, _TOTAL_BYTES)
        if os.fstat(descriptor).st_size != _TOTAL_BYTES:
            raise HapticError(
                "bad_memory", "the shared memory is of another version", "restart the daemon"
            )
        self.descriptor = descriptor
        self._map = mmap.mmap(descriptor, _TOTAL_BYTES)
        memory = memoryview(self._map)
        slots = [memory[i * SLOT_BYTES : (i + 1) * SLOT_BYTES] for i in range(_SLOTS)]
        self.sensed = Slot(slots[0], NOTHING_SENSED)
        self.order = Slot(slots[1], NO_ORDER)
        self.output = Slot(slots[2], NO_OUTPUT)
        self.driven = Slot(slots[3], NOT_DRIVEN)
        self.played = Slot(slots[4], NOT_PLAYED)
        self.ring = Ring(memory[_RING_AT:_COURSES_AT], SAMPLE, RING_SAMPLES)
        self.courses = Ring(memory[_COURSES_AT:_TARGETS_AT], COURSE, RING_COURSES)
        self.targets: Store[Target] = Store(memory[_TARGETS_AT:_SURFACES_AT])
        self.surfaces: Store[tuple[ControllerSettings, WorstTable]] = Store(
            memory[_SURFACES_AT:_SCENE_AT]
        )
        self.scene = Sheet(memory[_SCENE_AT:], SHEET_COLUMNS)

    def close(self) -> None:
        """Give the descriptor back; the memory itself goes when nobody uses it any more."""
        os.close(self.descriptor)


def practice_slot() -> Slot[Output]:
    """A slot for outputs that nobody reads."""
    return Slot(memoryview(bytearray(SLOT_BYTES)), NO_OUTPUT)
