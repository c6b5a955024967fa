from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.errors import BadReply, DeviceDisconnected, DeviceError, DeviceTimeout, LimitExceeded
from hw.serving.memory import MemoryTransport
from hw.serving.serial import SerialServer
from hw.stage.lts150 import Lts150, StageSettings
from hw.transport.serial import SerialTransport
from tests.clock import ManualClock
from tests.hw.testing.faulty_stage import FaultyLts150

SETTINGS = StageSettings(
    travel_low_m=0.0,
    travel_high_m=0.150,
    velocity_m_s=0.020,
    acceleration_m_s2=0.020,
    velocity_limit_m_s=0.050,
    acceleration_limit_m_s2=0.050,
)


class Wire:
    """Records what the host writes, on its way to the instrument; `spoil` may change what comes
    back.
    """

    def __init__(self, core: FaultyLts150) -> None:
        self._core = core
        self.written: list[str] = []
        self.spoil: Callable[[bytes], bytes] = lambda data: data

    def handle(self, data: bytes) -> bytes:
        self.written.append(data.hex(" "))
        return self.spoil(self._core.handle(data))


class Bench:
    """A driver and a simulated stage that share a clock, connected in memory."""

    def __init__(self, settings: StageSettings = SETTINGS) -> None:
        self.clock = ManualClock(100.0)
        self.instrument = FaultyLts150(self.clock)
        self.wire = Wire(self.instrument)
        transport = MemoryTransport(self.wire, clock=self.clock)
        self.stage = Lts150(transport, settings, clock=self.clock, sleep=self.clock.sleep)

    def homed(self) -> Lts150:
        self.stage.connect()
        self.stage.home()
        self.stage.wait(60.0)
        return self.stage


@pytest.fixture
def bench():
    return Bench()


def test_connecting_identifies_silences_enables_and_moves_nothing(bench):
    info = bench.stage.connect()
    assert (info.model, info.serial_number) == ("LTS150", 45_000_001)
    assert bench.wire.written == [
        "18 00 00 00 50 01",
        "12 00 00 00 50 01",
        "05 00 00 00 50 01",
        "10 02 01 01 50 01",
        # 20 mm/s² is 20 * 4506.08 = 90122 counts, 20 mm/s is 20 * 21987328 = 439746560 counts
        "13 04 0e 00 d0 01 01 00 00 00 00 00 0a 60 01 00 00 00 36 1a",
        "14 04 01 00 50 01",
    ]
    bench.clock.sleep(5.0)
    assert bench.instrument.position_mm == 40.0
    assert bench.stage.read_status().homed is False


def test_homing_then_moving(bench):
    stage = bench.homed()
    assert bench.instrument.position_mm == 0.0
    stage.move_to(0.010)
    assert bench.wire.written[-1] == "53 04 06 00 d0 01 01 00 00 80 3e 00"
    started_s = bench.clock()
    assert stage.wait(10.0).position_m == pytest.approx(0.010, abs=1e-8)
    # 10 mm at 20 mm/s² never reach 20 mm/s: a triangle of 2 sqrt(10/20) s; polled every 20 ms
    assert bench.clock() - started_s == pytest.approx(2.0 * math.sqrt(0.5), abs=0.05)
    stage.move_to(0.006)
    assert stage.wait(10.0).position_m == pytest.approx(0.006, abs=1e-8)
    assert bench.instrument.position_mm == pytest.approx(6.0, abs=1e-5)


def test_a_move_is_refused_before_homing(bench):
    bench.stage.connect()
    with pytest.raises(DeviceError, match="not homed"):
        bench.stage.move_to(0.001)
    bench.clock.sleep(5.0)
    assert bench.instrument.position_mm == 40.0


@pytest.mark.parametrize("position_m", [-1e-6, 0.1500001, 1.0, math.nan, math.inf])
def test_a_move_beyond_the_travel_is_refused_and_names_the_nearest(bench, position_m):
    stage = bench.homed()
    sent = len(bench.wire.written)
    with pytest.raises(LimitExceeded, match=r"outside 0\.\.0\.15;") as refusal:
        stage.move_to(position_m)
    assert len(bench.wire.written) == sent
    assert refusal.value.hint == f"the nearest is {0.15 if position_m > 0.1 else 0:g} m"
    assert not bench.instrument.moving


def test_a_second_move_is_refused_while_one_is_under_way(bench):
    stage = bench.homed()
    stage.move_to(0.1)
    for again in (lambda: stage.move_to(0.0), stage.home):
        with pytest.raises(DeviceError, match="moves already"):
            again()
    assert stage.wait(60.0).position_m == pytest.approx(0.1, abs=1e-8)


def test_velocity_is_limited_and_read_back(bench):
    stage = bench.homed()
    for velocity_m_s, acceleration_m_s2 in (
        (0.051, 0.02),
        (0.02, 0.051),
        (-0.01, 0.02),
        (math.nan, 0.02),
        (0, 0.02),
    ):
        with pytest.raises(LimitExceeded):
            stage.set_velocity(velocity_m_s, acceleration_m_s2)
    stage.set_velocity(0.010, 0.050)
    stage.move_to(0.050)
    started_s = bench.clock()
    stage.wait(60.0)
    assert bench.clock() - started_s == pytest.approx(
        5.0 + 0.2, abs=0.05
    )  # way/velocity + velocity/acceleration


def test_a_velocity_that_the_stage_clips_is_an_error():
    bench = Bench(replace(SETTINGS, velocity_limit_m_s=0.080))
    bench.stage.connect()
    with pytest.raises(BadReply, match="holds"):
        bench.stage.set_velocity(0.080, 0.020)  # the instrument's own table ends at 50 mm/s


def test_stopping_slows_down_and_the_stage_then_rests(bench):
    stage = bench.homed()
    stage.move_to(0.150)
    bench.clock.sleep(3.0)
    before_mm = bench.instrument.position_mm
    status = stage.stop()
    assert not status.moving
    # 20 mm/s at 20 mm/s² need 10 mm; the 3 ms between messages add their way
    assert bench.instrument.position_mm - before_mm == pytest.approx(10.0, abs=0.2)
    assert "65 04 01 02 50 01" in bench.wire.written
    assert stage.stop().position_m == status.position_m


def test_a_stage_that_ignores_the_gentle_stop_is_stopped_at_once(bench):
    bench.instrument.faults.ignores_profiled_stop = True
    stage = bench.homed()
    stage.move_to(0.150)
    bench.clock.sleep(2.0)
    assert not stage.stop().moving
    assert bench.instrument.position_mm < 149.0
    assert bench.wire.written.count("65 04 01 01 50 01") == 1


def test_waiting_too_short_stops_the_stage(bench):
    stage = bench.homed()
    stage.move_to(0.150)
    with pytest.raises(DeviceTimeout, match="has not arrived after 1 s"):
        stage.wait(1.0)
    assert not bench.instrument.moving
    assert bench.instrument.position_mm < 149.0


def test_an_interrupt_while_waiting_stops_the_stage(bench):
    stage = bench.homed()
    stage.move_to(0.150)
    interrupted = iter([False] * 10 + [True])

    def interrupt(data: bytes) -> bytes:
        if next(interrupted, False):
            raise KeyboardInterrupt
        return data

    bench.wire.spoil = interrupt
    with pytest.raises(KeyboardInterrupt):
        stage.wait(60.0)
    assert not bench.instrument.moving
    assert bench.instrument.position_mm < 149.0


def test_a_blocked_stage_is_an_error(bench):
    stage = bench.homed()
    bench.instrument.faults.blocked_at_mm = 30.0
    stage.move_to(0.100)
    with pytest.raises(DeviceError, match=r"motion error; it is at 30\.000 mm"):
        stage.wait(60.0)
    bench.instrument.faults.blocked_at_mm = None
    stage.home()
    assert stage.wait(60.0).position_m == 0.0


def test_another_instrument_is_refused(bench):
    bench.instrument.model = "KDC101"
    with pytest.raises(BadReply, match="'KDC101'"):
        bench.stage.connect()


def test_silence_is_a_timeout_and_the_next_answer_is_right(bench):
    stage = bench.homed()
    bench.instrument.faults.silent = True
    with pytest.raises(DeviceTimeout):
        stage.read_status()
    bench.instrument.faults.silent = False
    assert stage.read_status().position_m == 0.0
    bench.instrument.faults.silent = True
    assert stage.close() is False


def test_endless_noise_ends_with_the_reply_timeout(bench):
    """Noise with a clock that runs: the answer never comes although bytes do."""
    bench.stage.connect()
    bench.wire.spoil = lambda _: b"\x55" * 1000
    ticking = bench.clock
    bench.stage = Lts150(
        MemoryTransport(bench.wire, clock=ticking),
        SETTINGS,
        clock=lambda: _advance(ticking),
        sleep=ticking.sleep,
    )
    with pytest.raises(DeviceTimeout):
        bench.stage.connect()


def _advance(clock: ManualClock) -> float:
    clock.sleep(0.01)
    return clock.now_s


def test_a_cable_out_in_mid_move_is_reported_and_never_called_at_rest(bench):
    stage = bench.homed()
    stage.move_to(0.150)
    bench.instrument.faults.hung_up = True
    with pytest.raises(DeviceDisconnected):
        stage.wait(60.0)
    assert bench.instrument.moving
    assert stage.close() is False


def test_closing_stops_and_says_so(bench):
    stage = bench.homed()
    stage.move_to(0.150)
    bench.clock.sleep(2.0)
    assert stage.close() is True
    assert not bench.instrument.moving
    with pytest.raises(DeviceDisconnected):
        stage.read_status()


@settings(max_examples=40)
@given(
    st.lists(
        st.one_of(
            st.floats(-0.05, 0.2),
            st.sampled_from(["home", "stop", "silent", "cut", "hung_up", "heal"]),
        ),
        max_size=12,
    )
)
def test_whatever_happens_the_stage_stays_within_its_travel_and_nothing_hangs(script):
    bench = Bench(replace(SETTINGS, travel_low_m=0.010, travel_high_m=0.100))
    bench.homed()
    furthest_mm, hints = 0.0, []
    for step in script:
        faults = bench.instrument.faults
        faults.silent = step == "silent" or (faults.silent and step != "heal")
        faults.hung_up = step == "hung_up" or (faults.hung_up and step != "heal")
        faults.delivered_bytes = 7 if step == "cut" else math.inf
        started_s = bench.clock()
        try:
            if isinstance(step, float):
                bench.stage.move_to(step)
                bench.stage.wait(5.0)
            elif step == "home":
                bench.stage.home()
                bench.stage.wait(30.0)
            elif step == "stop":
                assert not bench.stage.stop().moving
        except DeviceError as error:
            hints.append(error.hint)
        assert all(hints)
        assert bench.clock() - started_s < 45.0
        furthest_mm = max(furthest_mm, bench.instrument.position_mm)
    bench.clock.sleep(60.0)
    assert max(furthest_mm, bench.instrument.position_mm) <= 100.0 + 1e-3


@pytest.fixture
def real_time():
    """Over a pseudo-terminal, which has no RTS line."""
    instrument = FaultyLts150(time.monotonic, start_mm=1.0)
    had_line: list[bool] = []
    with SerialServer(instrument, framed=False) as server:
        transport = SerialTransport(server.path, rtscts=True)

        def set_rts(high: bool) -> bool:
            had_line.append(transport.set_rts(high))
            return had_line[-1]

        stage = Lts150(transport, SETTINGS, set_rts=set_rts)
        stage.connect()
        yield instrument, stage, had_line
        stage.close()


def test_another_thread_can_stop_a_wait(real_time):
    instrument, stage, _ = real_time
    stage.home()
    stage.wait(10.0)
    stage.move_to(0.150)
    outcome: list[str] = []

    def wait() -> None:
        try:
            stage.wait(30.0)
        except DeviceError as error:
            outcome.append(error.message)

    thread = threading.Thread(target=wait)
    thread.start()
    time.sleep(0.1)
    assert not stage.stop().moving
    thread.join(timeout=20.0)
    assert not thread.is_alive()
    assert len(outcome) == 1
    assert "without having arrived" in outcome[0]
    assert not instrument.moving


def test_the_rts_pulse_comes_before_the_first_message():
    bench = Bench()
    levels: list[tuple[bool, float, int]] = []

    def set_rts(high: bool) -> bool:
        levels.append((high, bench.clock(), len(bench.wire.written)))
        return True

    transport = MemoryTransport(bench.wire, clock=bench.clock)
    Lts150(
        transport, SETTINGS, set_rts=set_rts, clock=bench.clock, sleep=bench.clock.sleep
    ).connect()
    assert levels == [(True, 100.0, 0), (False, 100.05, 0)]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("travel_low_m", 0.2),
        ("travel_high_m", 150.0),  # millimetres where metres belong
        ("velocity_m_s", 0.06),
    ],
)
def test_senseless_settings_are_refused(name, value):
    with pytest.raises(ValueError, match="stage"):
        replace(SETTINGS, **{name: value})
