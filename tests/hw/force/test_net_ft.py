"""The Net F/T client against the simulated box and against bytes written by hand."""

from __future__ import annotations

import math
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hw.errors import BadReply, DeviceDisconnected, DeviceError, DeviceTimeout
from hw.force.net_ft import NetFt, NetFtScale, NetFtSettings, RdtCounters
from hw.force.sensor import ForceAxes
from tests.hw.testing.faulty_net_ft import FaultyNetFt, RdtFault
from tests.waiting import HANG_S, until

LOAD = (0.3, -0.1, -0.5, 0.01, 0.02, -0.03)


def client_of(port: int, **kwargs: Any) -> NetFt:
    clock = kwargs.pop("clock", time.monotonic)
    given: dict[str, Any] = {"timeout_s": 2.0, "scale": NetFtScale(1e6, 1e6)}
    return NetFt(
        NetFtSettings(
            host="127.0.0.1",
            port=port,
            axes=ForceAxes(normal="-z", lateral="x"),
            **(given | kwargs),
        ),
        clock=clock,
    )


def read_until(client: NetFt, done: Callable[[], bool]) -> None:
    until(lambda: client.read() and done(), lambda: client.counters)


@pytest.fixture
def box():
    with FaultyNetFt(lambda: LOAD) as server:
        yield server


@pytest.fixture
def client(box):
    device = client_of(box.port)
    device.open()
    yield device
    device.close()


def test_the_bytes_on_the_wire_are_those_of_the_protocol():
    """A box of eight lines, packed by hand: what is asked, and what its answer means."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as box:
        box.bind(("127.0.0.1", 0))
        box.settimeout(HANG_S)
        asked: list[bytes] = []

        def answer() -> None:
            request, source = box.recvfrom(100)
            asked.append(request)
            counts = (
                b"\x00\x00\x03\xe8"
                + b"\xff\xff\xff\xff"
                + b"\xff\xff\xf6\x3c"
                + b"\x00\x00\x00\x0a" * 3
            )
            box.sendto(b"\x00\x00\x00\x07" + b"\x00\x00\x00\x09" + bytes(4) + counts, source)
            asked.append(box.recvfrom(100)[0])

        thread = threading.Thread(target=answer)
        thread.start()
        device = client_of(box.getsockname()[1], scale=NetFtScale(1e3, 1e2))
        device.open()
        wrench = device.read_wrench()
        device.close()
        thread.join(HANG_S)
    assert asked == [bytes.fromhex("1234000200000000"), bytes.fromhex("1234000000000000")]
    assert wrench.force_n == (1.0, -0.001, -2.5)
    assert wrench.torque_n_m == (0.1, 0.1, 0.1)


def test_the_simulated_box_answers_a_client_written_by_hand(box):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plain:
        plain.settimeout(HANG_S)
        for wrong in (
            b"",
            b"\x12\x34",
            bytes.fromhex("4321000200000000"),
            bytes.fromhex("1234000200000000ff"),
        ):
            plain.sendto(wrong, (box.host, box.port))
        plain.sendto(bytes.fromhex("1234000200000003"), (box.host, box.port))
        records = [struct.unpack(">3I6i", plain.recv(100)) for _ in range(3)]
        plain.settimeout(0.1)
        with pytest.raises(TimeoutError):
            plain.recv(100)  # three were asked for
    assert [record[0] for record in records] == [1, 2, 3]
    assert records[0][2:] == (0, 300000, -100000, -500000, 10000, 20000, -30000)


def test_closing_stops_the_stream_even_when_the_first_request_is_lost(box):
    device = client_of(box.port)
    device.open()
    assert box.streaming
    real, lost = device._send, []

    def lossy(command: Any) -> None:
        if lost:
            real(command)
        lost.append(command)

    device._send = lossy  # type: ignore[method-assign]
    device.close()
    device.close()
    until(lambda: not box.streaming)
    with pytest.raises(DeviceDisconnected, match="not open"):
        device.read()


@pytest.mark.parametrize(
    ("fault", "counter", "also_missed"),
    [
        (RdtFault.DROP, "missed", 0),
        (RdtFault.DUPLICATE, "duplicated", 0),
        (RdtFault.FROZEN, "frozen", 0),
        (RdtFault.WRONG_SOURCE, "wrong_source", 3),
        (RdtFault.WRONG_LENGTH, "wrong_length", 3),
    ],
)
def test_each_fault_is_counted_and_its_record_is_not_taken(
    box, client, fault, counter, also_missed
):
    box.inject(fault, count=3)
    read_until(client, lambda: getattr(client.counters, counter) >= 3)
    accepted = client.counters.accepted
    read_until(client, lambda: client.counters.accepted > accepted)
    assert getattr(client.counters, counter) == 3
    if also_missed:
        assert client.counters.missed == also_missed
    assert client.read()[1:] == (pytest.approx(0.5), pytest.approx(0.3), False)


def test_what_did_not_happen_is_not_said():
    """Seven counters, all zero, once stood in every event of a box without data."""
    assert str(RdtCounters()) == "nothing came"
    assert str(RdtCounters(accepted=3, wrong_source=1)) == "accepted 3, wrong source 1"


def test_a_late_record_is_not_taken(box, client):
    box.inject(RdtFault.REORDER)
    read_until(client, lambda: client.counters.out_of_order >= 1)
    assert (client.counters.out_of_order, client.counters.missed) == (1, 1)


def test_the_sequence_may_wrap(box):
    box.set_sequence((1 << 32) - 20)
    device = client_of(box.port)
    device.open()
    read_until(device, lambda: device.counters.accepted > 60)
    assert (device.counters.missed, device.counters.out_of_order) == (0, 0)
    device.close()


def test_a_bad_status_marks_the_reading(box, client):
    box.inject(RdtFault.BAD_STATUS, count=math.inf)
    read_until(client, lambda: client.status_raw != 0)
    assert client.read().saturated
    assert client.status_raw == 0x80020000
    box.heal()
    read_until(client, lambda: client.status_raw == 0)
    assert not client.read().saturated


def test_ignored_status_bits_do_not_mark_the_reading(box):
    box.status_raw = 0x00010000
    device = client_of(box.port, ignored_status=0x00010000)
    device.open()
    assert not device.read().saturated
    assert device.status_raw == 0x00010000
    device.close()


@pytest.mark.parametrize("fault", [RdtFault.SILENCE, RdtFault.FROZEN, RdtFault.WRONG_SOURCE])
def test_without_news_the_old_reading_keeps_its_time_and_then_is_an_error(box, fault):
    offset_s = [0.0]
    device = client_of(box.port, clock=lambda: time.monotonic() + offset_s[0], timeout_s=0.5)
    device.open()
    box.inject(fault, count=math.inf)
    time.sleep(0.05)  # what was under way arrives
    old = device.read()
    assert device.read() == old  # the same time
    offset_s[0] = 0.6
    with pytest.raises(DeviceTimeout, match="no usable record"):
        device.read()
    box.heal()
    assert device.read().time_s > old.time_s
    device.close()


def test_forces_end_at_the_range_of_the_sensor_and_are_then_not_to_be_trusted():
    force_n = [19.9]
    with FaultyNetFt(
        lambda: (-force_n[0], 0.0, 0.0, 0.0, 0.0, 0.0), rate_hz=None, range_n=20.0
    ) as box:
        device = client_of(box.port)
        device.open()
        reading = device.read()
        assert (reading.lateral_force_n, reading.saturated) == (pytest.approx(-19.9), False)
        force_n[0] = 25.0
        box.emit(1)
        until(lambda: device.read().saturated)
        assert device.read().lateral_force_n == pytest.approx(-20.0)
        device.close()


def test_what_piled_up_while_nobody_looked_is_not_taken_for_new():
    force_n, offset_s = [1.0], [0.0]
    with FaultyNetFt(lambda: (0.0, 0.0, -force_n[0], 0.0, 0.0, 0.0), rate_hz=None) as box:
        device = client_of(box.port, clock=lambda: time.monotonic() + offset_s[0], timeout_s=0.3)
        device.open()
        box.emit(50)
        time.sleep(0.02)
        offset_s[0] = 10.0
        with pytest.raises(DeviceTimeout):
            device.read()
        assert device.counters.accepted == 51
        force_n[0] = 2.0
        box.emit(1)
        assert device.read().normal_force_n == pytest.approx(2.0)
        device.close()


def test_every_record_is_kept_until_it_is_taken():
    loads = iter(range(1, 1000))
    with FaultyNetFt(lambda: (0.0, 0.0, -float(next(loads)), 0.0, 0.0, 0.0), rate_hz=None) as box:
        device = client_of(box.port)
        device.open()
        assert len(device.take_readings()) == 1
        box.emit(3)
        read_until(device, lambda: device.counters.accepted == 4)
        taken = device.take_readings()
        forces_n = [reading.normal_force_n for reading in taken]
        assert np.diff(forces_n) == pytest.approx([1.0, 1.0])
        assert taken[-1] == device.read()
        assert device.take_readings() == []
        device.close()
    with pytest.raises(DeviceDisconnected):
        device.take_readings()


def test_a_software_bias_is_confirmed_by_the_stream(box, client):
    client.take_bias()
    assert client.read_wrench().force_n == pytest.approx((0.0, 0.0, 0.0))


def test_a_bias_that_a_box_has_not_heard_or_took_of_a_noisy_moment_is_no_wrong_zero(monkeypatch):
    chance = np.random.default_rng(1)
    load = [0.0, 0.0, 0.1, 0.0, 0.0, 0.01]  # an offset within the tolerance

    def felt() -> Any:
        return tuple(np.array(load) + chance.normal(0.0, 0.02, 6))

    with FaultyNetFt(felt) as box:
        for deaf in (False, True):
            device = client_of(box.port)
            device.open()
            if deaf:
                box._bias = (0.0,) * 6
                monkeypatch.setattr(box, "_handle", lambda request, client: None)
            device.take_bias()
            read = [device.read_wrench() for _ in range(300) if not time.sleep(0.001)]
            mean = np.mean([(*wrench.force_n, *wrench.torque_n_m) for wrench in read], axis=0)
            assert np.abs(mean).max() < 0.01, deaf
            device.close()


def test_a_bias_under_a_finger_that_comes_meanwhile_is_an_error():
    left = [math.inf]

    def felt() -> Any:
        left[0] -= 1
        return (0.0, 0.0, 0.0 if left[0] > 0 else -0.5, 0.0, 0.0, 0.0)

    with FaultyNetFt(felt) as box:
        device = client_of(box.port, bias_average_s=0.5)
        device.open()
        left[0] = 50  # records until the finger is there
        with pytest.raises(BadReply, match="still reads"):
            device.take_bias()
        device.close()


def test_records_of_a_bad_status_are_no_bias(box):
    device = client_of(box.port)
    device.open()
    box.status_raw = 0x80020000
    with pytest.raises(BadReply, match="its status was not good while its bias was taken"):
        device.take_bias()
    box.status_raw = 0
    device.take_bias()
    device.close()


def test_a_bias_that_was_not_taken_is_an_error():
    loads = iter([LOAD, LOAD])  # the bias is another load than what follows
    with FaultyNetFt(lambda: next(loads, (5.0, 0.0, 0.0, 0.0, 0.0, 0.0)), rate_hz=500.0) as box:
        device = client_of(box.port, bias_timeout_s=0.2)
        device.open()
        box._handle = lambda request, client: None  # type: ignore[method-assign]  # from now on it is deaf
        with pytest.raises(BadReply, match="still reads"):
            device.take_bias()
        device.close()


def test_a_box_that_kept_its_power_keeps_its_bias_and_another_has_lost_it():
    force_n = [0.0]
    with FaultyNetFt(lambda: (0.0, 0.0, -force_n[0], 0.0, 0.0, 0.0)) as box:
        before, again = client_of(box.port), client_of(box.port)
        box._f_t_sequence = 1 << 20  # it has had power for long
        before.open()
        before.take_bias()
        before.close()
        force_n[0] = 0.5  # the finger presses
        again.open()
        again.keep_bias(before)
        assert again.read().normal_force_n == pytest.approx(0.5)
        again.close()
        box._f_t_sequence = 0
        again.open()
        with pytest.raises(DeviceError, match="has lost its bias"):
            again.keep_bias(before)
        again.close()


def test_a_box_that_is_not_there_is_a_timeout():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
        silent.bind(("127.0.0.1", 0))
        device = client_of(silent.getsockname()[1], timeout_s=0.05)
        with pytest.raises(DeviceTimeout):
            device.open()
    with pytest.raises(DeviceDisconnected, match="not open"):
        device.read()


def test_an_impossible_host_is_refused():
    device = NetFt(
        NetFtSettings(host="x" * 300, scale=NetFtScale(1.0, 1.0), axes=ForceAxes("z", "x"))
    )
    with pytest.raises(DeviceDisconnected, match="no such host"):
        device.open()


@pytest.mark.parametrize("bad", [{"scale": NetFtScale(0.0, 1.0)}, {"timeout_s": float("inf")}])
def test_impossible_settings_are_refused(bad):
    good = {"host": "127.0.0.1", "scale": NetFtScale(1.0, 1.0), "axes": ForceAxes("z", "x")}
    with pytest.raises(ValueError, match="must be > 0"):
        NetFtSettings(**(good | bad))


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel's times of arrival are Linux's")
def test_a_record_has_the_time_at_which_it_came_and_not_at_which_somebody_looked():
    """A busy computer looks late; what it then takes for now would be felt later than it was."""
    with FaultyNetFt(lambda: LOAD, rate_hz=None) as box:
        device = client_of(box.port)
        device.open()

        def is_that_of_arrival() -> bool:
            before_s = time.monotonic()
            box.emit(1)
            after_s = time.monotonic()
            time.sleep(0.1)
            return before_s - 0.01 <= device.read().time_s <= after_s + 0.05

        # Linux begins to stamp arrivals a moment after the first socket has asked for it.
        until(is_that_of_arrival)
        device.close()


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel's times of arrival are Linux's")
def test_times_do_not_go_back_when_the_clock_of_the_day_is_set(monkeypatch):
    """The kernel tells arrivals by that clock: one set forward between arrival and look makes a
    record look older.
    """
    with FaultyNetFt(lambda: LOAD, rate_hz=None) as box:
        device = client_of(box.port)
        device.open()
        box.emit(1)
        before_s = device.read().time_s
        own = time.time_ns
        monkeypatch.setattr(time, "time_ns", lambda: own() + 50_000_000)
        heard = device.counters.accepted
        box.emit(1)
        while device.counters.accepted == heard:
            after_s = device.read().time_s
        assert after_s >= before_s
        device.close()
