"""The Thorlabs APT protocol as bytes: the messages that a one-channel stepper stage needs, counts
as on the wire.

A short message is 6 bytes, `<HBBBB`: id, two parameters, destination, source. With bit 7 of the
destination set it is `<HHBB`: id, data length, destination, source, and then the data. There is no
checksum. Source: Thorlabs APT Communications Protocol; the test compares every message with the
package thorlabs-apt-protocol.
"""

from __future__ import annotations

import enum
import struct
from typing import NamedTuple

HOST = 0x01
USB_UNIT = 0x50
CHANNEL = 1
HEADER_BYTES = 6

_HAS_DATA = 0x80
_MOTION_STATUS = struct.Struct("<HiiI")  # channel, position, encoder, status bits
_VELOCITY = struct.Struct("<Hiii")  # channel, minimum velocity, acceleration, maximum velocity
_CHANNEL_AND_COUNTS = struct.Struct("<Hi")
_CHANNEL_AND_BITS = struct.Struct("<HI")
# serial, model, type, firmware, hardware version, modification, channels
_INFO = struct.Struct("<I8sH4B60xHHH")


class Message(enum.IntEnum):
    """Message ids."""

    REQUEST_INFO = 0x0005
    INFO = 0x0006
    START_UPDATES = 0x0011
    STOP_UPDATES = 0x0012
    NO_FLASH = 0x0018
    SET_CHANNEL_ENABLED = 0x0210
    REQUEST_POSITION = 0x0411
    POSITION = 0x0412
    SET_VELOCITY = 0x0413
    REQUEST_VELOCITY = 0x0414
    VELOCITY = 0x0415
    REQUEST_STATUS_BITS = 0x0429
    STATUS_BITS = 0x042A
    MOVE_HOME = 0x0443
    HOMED = 0x0444
    MOVE_RELATIVE = 0x0448
    MOVE_ABSOLUTE = 0x0453
    MOVE_COMPLETED = 0x0464
    STOP = 0x0465
    STOPPED = 0x0466
    REQUEST_STATUS = 0x0480
    STATUS = 0x0481


_IDS = frozenset(int(message) for message in Message)

DATA_BYTES = {
    Message.INFO: _INFO.size,
    Message.POSITION: _CHANNEL_AND_COUNTS.size,
    Message.SET_VELOCITY: _VELOCITY.size,
    Message.VELOCITY: _VELOCITY.size,
    Message.STATUS_BITS: _CHANNEL_AND_BITS.size,
    Message.MOVE_RELATIVE: _CHANNEL_AND_COUNTS.size,
    Message.MOVE_ABSOLUTE: _CHANNEL_AND_COUNTS.size,
    Message.MOVE_COMPLETED: _MOTION_STATUS.size,
    Message.STOPPED: _MOTION_STATUS.size,
    Message.STATUS: _MOTION_STATUS.size,
}
"""Data bytes of each message that has data; the others are 6 bytes in all."""


class StatusBit(enum.IntFlag):
    """Bits of the status word. Libraries disagree on which of a pair is forward, so none is named
    for a direction.
    """

    MOVING = 0x0030
    JOGGING = 0x00C0
    HOMING = 0x0200
    HOMED = 0x0400
    MOTION_ERROR = 0x4000
    ENABLED = 0x8000_0000


ANY_MOTION = StatusBit.MOVING | StatusBit.JOGGING | StatusBit.HOMING


class StopMode(enum.IntEnum):
    """How to stop: at once, or with the programmed deceleration."""

    IMMEDIATE = 1
    PROFILED = 2


class Frame(NamedTuple):
    """One message; `data` is None for the short form, whose two parameters are `parameter_1` and
    `parameter_2`.
    """

    message: Message
    parameter_1: int = 0
    parameter_2: int = 0
    data: bytes | None = None


class Info(NamedTuple):
    """Answer to REQUEST_INFO; `model` as printed in the instrument, `firmware` as
    major.minor.interim.
    """

    serial_number: int
    model: str
    firmware: str


class MotionStatus(NamedTuple):
    """Data of STATUS, MOVE_COMPLETED and STOPPED (a stepper's layout)."""

    position_raw: int
    bits: StatusBit


class Velocity(NamedTuple):
    """Data of SET_VELOCITY and VELOCITY, without the minimum velocity, which is always 0."""

    acceleration_raw: int
    velocity_raw: int


def encode(frame: Frame, *, destination: int = USB_UNIT, source: int = HOST) -> bytes:
    """Return the bytes of one message; by default from the host to the USB unit."""
    if frame.data is None:
        return struct.pack(
            "<HBBBB", frame.message, frame.parameter_1, frame.parameter_2, destination, source
        )
    return (
        struct.pack("<HHBB", frame.message, len(frame.data), destination | _HAS_DATA, source)
        + frame.data
    )


def on_channel(message: Message, parameter_2: int = 0) -> Frame:
    """A short message about the one channel."""
    return Frame(message, CHANNEL, parameter_2)


def with_counts(message: Message, counts_raw: int) -> Frame:
    """MOVE_ABSOLUTE, MOVE_RELATIVE or POSITION; raises struct.error beyond 32 bits."""
    return Frame(message, data=_CHANNEL_AND_COUNTS.pack(CHANNEL, counts_raw))


def with_velocity(message: Message, velocity: Velocity) -> Frame:
    """SET_VELOCITY or VELOCITY."""
    return Frame(
        message, data=_VELOCITY.pack(CHANNEL, 0, velocity.acceleration_raw, velocity.velocity_raw)
    )


def with_status(message: Message, status: MotionStatus) -> Frame:
    """STATUS, MOVE_COMPLETED or STOPPED; the encoder is said to agree with the position."""
    return Frame(
        message,
        data=_MOTION_STATUS.pack(CHANNEL, status.position_raw, status.position_raw, status.bits),
    )


def with_status_bits(bits: StatusBit) -> Frame:
    """STATUS_BITS."""
    return Frame(Message.STATUS_BITS, data=_CHANNEL_AND_BITS.pack(CHANNEL, bits))


def with_info(info: Info) -> Frame:
    """INFO of an instrument with one channel; the type word 16 says brushless or stepper
    controller.
    """
    major, minor, interim = (int(part) for part in info.firmware.split("."))
    model = info.model.encode("ascii")
    return Frame(
        Message.INFO,
        data=_INFO.pack(info.serial_number, model, 16, interim, minor, major, 0, 1, 0, 1),
    )


def read_counts(frame: Frame) -> int:
    """The counts of a message with counts."""
    counts_raw: int = _CHANNEL_AND_COUNTS.unpack(frame.data or b"")[1]
    return counts_raw


def read_velocity(frame: Frame) -> Velocity:
    """The velocity of a message with a velocity."""
    return Velocity(*_VELOCITY.unpack(frame.data or b"")[2:])


def read_status(frame: Frame) -> MotionStatus:
    """The status of a message with a status."""
    _, position_raw, _, bits = _MOTION_STATUS.unpack(frame.data or b"")
    return MotionStatus(position_raw, StatusBit(bits))


def read_info(frame: Frame) -> Info:
    """The content of INFO."""
    serial_number, model, _, interim, minor, major, *_ = _INFO.unpack(frame.data or b"")
    text = model.split(b"\0")[0].decode("ascii", errors="replace").strip()
    return Info(serial_number, text, f"{major}.{minor}.{interim}")


class Decoder:
    """Finds messages to one address in a stream of bytes that may be split, or hold garbage,
    anywhere.

    A header counts only with a known id, its right length, and the right addresses; whatever else
    comes is skipped byte by byte.
    """

    def __init__(self, *, destination: int = HOST, source: int = USB_UNIT) -> None:
        self._destination = destination
        self._source = source
        self._received = bytearray()

    @property
    def missing_bytes(self) -> int:
        """How many bytes it takes, at least, until another message can be complete; always > 0
        after `feed`.
        """
        if len(self._received) < HEADER_BYTES:
            return HEADER_BYTES - len(self._received)
        return HEADER_BYTES + self._data_bytes(self._received) - len(self._received)

    def feed(self, data: bytes) -> list[Frame]:
        """Return the messages completed by `data`."""
        self._received += data
        frames = []
        while len(self._received) >= HEADER_BYTES:
            if not self._is_header(self._received):
                del self._received[0]
                continue
            end = HEADER_BYTES + self._data_bytes(self._received)
            if len(self._received) < end:
                break
            frames.append(_frame(bytes(self._received[:end])))
            del self._received[:end]
        return frames

    def _is_header(self, data: bytearray) -> bool:
        if int.from_bytes(data[:2], "little") not in _IDS or data[5] != self._source:
            return False
        expected = DATA_BYTES.get(_message(data))
        if expected is None:
            return data[4] == self._destination
        return (
            data[4] == self._destination | _HAS_DATA
            and int.from_bytes(data[2:4], "little") == expected
        )

    @staticmethod
    def _data_bytes(data: bytearray) -> int:
        return DATA_BYTES.get(_message(data), 0)


def _message(data: bytes | bytearray) -> Message:
    return Message(int.from_bytes(data[:2], "little"))


def _frame(data: bytes) -> Frame:
    if len(data) == HEADER_BYTES:
        return Frame(_message(data), data[2], data[3])
    return Frame(_message(data), data=data[HEADER_BYTES:])
