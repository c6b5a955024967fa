"""Our APT messages against the bytes on record and against thorlabs-apt-protocol, which shares no
code with ours.
"""

from __future__ import annotations

import io
import struct
from typing import Any

import pytest
import thorlabs_apt_protocol as reference
from hypothesis import given
from hypothesis import strategies as st

from hw.stage import apt
from hw.stage.apt import Frame, Message, StatusBit, StopMode

# 10 mm, -1 mm; 5 mm/s² and 10 mm/s, in counts (409600 per mm; velocity x 53.68; acceleration x
# 53.68 x 204.94e-6).
SPEED = apt.Velocity(acceleration_raw=22530, velocity_raw=219873280)
COMMANDS = [
    (Frame(Message.REQUEST_INFO), "05 00 00 00 50 01"),
    (Frame(Message.START_UPDATES), "11 00 00 00 50 01"),
    (Frame(Message.STOP_UPDATES), "12 00 00 00 50 01"),
    (Frame(Message.NO_FLASH), "18 00 00 00 50 01"),
    (apt.on_channel(Message.SET_CHANNEL_ENABLED, 1), "10 02 01 01 50 01"),
    (apt.on_channel(Message.MOVE_HOME), "43 04 01 00 50 01"),
    (apt.with_counts(Message.MOVE_ABSOLUTE, 4_096_000), "53 04 06 00 d0 01 01 00 00 80 3e 00"),
    (apt.with_counts(Message.MOVE_RELATIVE, -409_600), "48 04 06 00 d0 01 01 00 00 c0 f9 ff"),
    (
        apt.with_velocity(Message.SET_VELOCITY, SPEED),
        "13 04 0e 00 d0 01 01 00 00 00 00 00 02 58 00 00 00 00 1b 0d",
    ),
    (apt.on_channel(Message.REQUEST_VELOCITY), "14 04 01 00 50 01"),
    (apt.on_channel(Message.STOP, StopMode.PROFILED), "65 04 01 02 50 01"),
    (apt.on_channel(Message.STOP, StopMode.IMMEDIATE), "65 04 01 01 50 01"),
    (apt.on_channel(Message.REQUEST_STATUS), "80 04 01 00 50 01"),
    (apt.on_channel(Message.REQUEST_STATUS_BITS), "29 04 01 00 50 01"),
    (apt.on_channel(Message.REQUEST_POSITION), "11 04 01 00 50 01"),
]
ANSWERS = [
    apt.with_info(apt.Info(45_000_123, "LTS150", "2.1.7")),
    apt.with_counts(Message.POSITION, -123_456),
    apt.with_velocity(Message.VELOCITY, SPEED),
    apt.with_status(Message.STATUS, apt.MotionStatus(7, StatusBit.HOMED | StatusBit.ENABLED)),
    apt.with_status(Message.STOPPED, apt.MotionStatus(-7, StatusBit(0x10))),
    apt.with_status_bits(StatusBit.HOMED),
    apt.on_channel(Message.HOMED),
]


def from_stage(frame: Frame) -> bytes:
    return apt.encode(frame, destination=apt.HOST, source=apt.USB_UNIT)


def parse(frame: Frame) -> Any:
    """What the independent package reads in a message of ours from the stage."""
    return next(reference.Unpacker(io.BytesIO(from_stage(frame)), on_error="raise"))


@pytest.mark.parametrize(("frame", "expected"), COMMANDS)
def test_commands_have_the_bytes_on_record(frame, expected):
    assert apt.encode(frame).hex(" ") == expected


@given(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**31 - 1), st.integers(0, 2**31 - 1))
def test_numbers_are_packed_as_by_the_independent_package(counts, acceleration, velocity):
    for message, independent in (
        (Message.MOVE_ABSOLUTE, reference.mot_move_absolute),
        (Message.MOVE_RELATIVE, reference.mot_move_relative),
    ):
        assert apt.encode(apt.with_counts(message, counts)) == independent(0x50, 1, 1, counts)
    ours = apt.encode(apt.with_velocity(Message.SET_VELOCITY, apt.Velocity(acceleration, velocity)))
    assert ours == reference.mot_set_velparams(0x50, 1, 1, 0, acceleration, velocity)


@given(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1))
def test_answers_are_read_as_by_the_independent_package(counts, bits):
    position = parse(apt.with_counts(Message.POSITION, counts))
    assert (position.msg, position.position) == ("mot_get_poscounter", counts)
    status = parse(apt.with_status(Message.STATUS, apt.MotionStatus(counts, StatusBit(bits))))
    assert (status.position, status.enc_count) == (counts, counts)
    assert status.homed == bool(bits & StatusBit.HOMED)
    assert status.homing == bool(bits & StatusBit.HOMING)
    assert status.motion_error == bool(bits & StatusBit.MOTION_ERROR)
    assert status.channel_enabled == bool(bits & StatusBit.ENABLED)
    moving = status.moving_forward or status.moving_reverse
    jogging = status.jogging_forward or status.jogging_reverse
    assert (moving, jogging) == (bool(bits & StatusBit.MOVING), bool(bits & StatusBit.JOGGING))


def test_identity_and_velocity_are_read_as_by_the_independent_package():
    info = parse(ANSWERS[0])
    assert (info.serial_number, info.model_number) == (45_000_123, b"LTS150\0\0")
    assert info.firmware_version == [2, 1, 7]
    velocity = parse(ANSWERS[2])
    assert (velocity.acceleration, velocity.max_velocity, velocity.min_velocity) == (
        22530,
        219873280,
        0,
    )


def test_answers_built_by_hand_are_read():
    (info,) = apt.Decoder().feed(
        struct.pack("<HHBB", 0x0006, 84, 0x81, 0x50)
        + struct.pack("<I8sH4B", 45_000_123, b"LTS150", 16, 7, 1, 2, 0)
        + bytes(60)
        + struct.pack("<HHH", 3, 4, 1)
    )
    assert apt.read_info(info) == apt.Info(45_000_123, "LTS150", "2.1.7")
    (status,) = apt.Decoder().feed(
        bytes.fromhex("81 04 0e 00 81 50 01 00 c0 bd f0 ff 00 00 00 00 10 04 00 80")
    )
    assert apt.read_status(status).position_raw == -1_000_000
    assert apt.read_status(status).bits == 0x8000_0410
    (bits,) = apt.Decoder().feed(bytes.fromhex("2a 04 06 00 81 50 01 00 00 04 00 80"))
    assert bits.message is apt.Message.STATUS_BITS
    (position,) = apt.Decoder().feed(bytes.fromhex("12 04 06 00 81 50 01 00 00 80 3e 00"))
    assert apt.read_counts(position) == 4_096_000
    (velocity,) = apt.Decoder().feed(
        bytes.fromhex("15 04 0e 00 81 50 01 00 00 00 00 00 02 58 00 00 00 00 1b 0d")
    )
    assert apt.read_velocity(velocity) == SPEED


# Garbage free of the stage's address 0x50 can hold no header, so every message around it must be
# found.
GARBAGE = st.binary(max_size=20).map(lambda data: data.replace(b"\x50", b"\x51"))


@given(
    st.lists(st.tuples(GARBAGE, st.sampled_from(ANSWERS)), max_size=6),
    st.lists(st.integers(1, 40), max_size=30),
)
def test_messages_are_found_between_garbage_however_the_stream_is_cut(parts, cuts):
    stream = b"".join(garbage + from_stage(frame) for garbage, frame in parts)
    decoder, found = apt.Decoder(), []
    for cut in cuts:
        found += decoder.feed(stream[:cut])
        stream = stream[cut:]
    found += decoder.feed(stream)
    assert found == [frame for _, frame in parts]


@given(st.binary(max_size=300))
def test_noise_breaks_nothing_and_the_next_messages_are_found(noise):
    decoder = apt.Decoder()
    decoder.feed(noise)
    assert 0 < decoder.missing_bytes <= 90
    homed = from_stage(apt.on_channel(Message.HOMED))
    assert apt.on_channel(Message.HOMED) in decoder.feed(
        homed * 16
    )  # more than the longest message can swallow


def test_a_reader_may_ask_for_just_the_missing_bytes():
    stream = io.BytesIO(b"\xff\xff" + from_stage(ANSWERS[0]) + from_stage(ANSWERS[1]))
    decoder, found = apt.Decoder(), []
    while not found:
        found += decoder.feed(stream.read(decoder.missing_bytes))
    assert found == [ANSWERS[0]]
    assert stream.tell() == 2 + 90  # nothing of the next message was taken


@pytest.mark.parametrize(
    "header",
    [
        "81 04 0d 00 81 50",  # a status of 13 bytes
        "81 04 0e 00 01 50",  # without the data bit
        "81 04 0e 00 82 50",  # to somebody else
        "81 04 0e 00 81 51",  # from somebody else
        "99 99 0e 00 81 50",  # unknown
    ],
)
def test_a_header_that_cannot_be_is_skipped(header):
    homed = from_stage(apt.on_channel(Message.HOMED))
    assert apt.Decoder().feed(bytes.fromhex(header) + homed) == [apt.on_channel(Message.HOMED)]
