"""The heartbeat interlock: only a live program keeps the contact closed, whatever the wire between
them.
"""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.amplifier.analog import AmplifierSettings, AmplifierState, AnalogAmplifier
from hw.errors import BadReply, DeviceDisconnected, DeviceError
from hw.safety.interlock import HeartbeatInterlock, ModemLine
from hw.safety.simulated_interlock import SimulatedInterlock
from hw.serving.memory import MemoryTransport
from hw.transport.contract import Transport
from tests.clock import ManualClock
from tests.hw.testing.faulty_instrument import Fault, FaultyInstrument

pytestmark = pytest.mark.timeout(60)


class Bench:
    def __init__(self, transport: Transport | None = None) -> None:
        self.clock = ManualClock()
        self.box = SimulatedInterlock(self.clock)
        late = ManualClock()  # of the wire: only a fault makes an answer late
        self.wire = FaultyInstrument(self.box, sleep=late.sleep)
        self.interlock = HeartbeatInterlock(MemoryTransport(self.wire, clock=late))
        self.interlock.connect()

    def beat_for(self, duration_s: float, period_s: float = 0.05) -> None:
        for _ in range(round(duration_s / period_s)):
            self.clock.now_s += period_s
            self.interlock.beat()


@pytest.fixture
def bench():
    return Bench()


# --- the box by its protocol, byte for byte as the docstring of hw.safety.interlock says
# ----------------------------


@pytest.mark.parametrize(
    ("dialogue", "closed"),
    [
        ([("ID?", "HAPTIC-INTERLOCK 1"), ("STATUS?", "OFF DISABLED 0")], False),
        ([("BEAT 7", "OFF DISABLED 7"), ("ENABLE", "ON OK 7"), ("BEAT 8", "ON OK 8")], True),
        ([("BEAT 255", "OFF DISABLED 255"), ("ENABLE", "ON OK 255"), ("BEAT 0", "ON OK 0")], True),
        (
            [("BEAT 1", "OFF DISABLED 1"), ("ENABLE", "ON OK 1"), ("DISABLE", "OFF DISABLED 1")],
            False,
        ),
        (
            [("BEAT 1", "OFF DISABLED 1"), ("ENABLE", "ON OK 1"), ("BEAT 1", "OFF SEQUENCE 1")],
            False,
        ),
        (
            [("BEAT 1", "OFF DISABLED 1"), ("ENABLE", "ON OK 1"), ("BEAT 3", "OFF SEQUENCE 3")],
            False,
        ),
        ([("ENABLE", "OFF SILENT 0")], False),
        ([("BEAT 256", "ERROR"), ("BEAT -1", "ERROR"), ("beat 1", "ERROR"), ("", "ERROR")], False),
    ],
)
def test_the_box_keeps_its_protocol(dialogue, closed):
    box = SimulatedInterlock(ManualClock())
    for asked, answered in dialogue:
        assert box.handle(asked.encode() + b"\r\n") == answered.encode() + b"\n"
    assert box.closed is closed


def test_the_box_takes_bytes_as_they_come():
    box = SimulatedInterlock(ManualClock())
    assert [box.handle(bytes([byte])) for byte in b"BEAT 4\n"] == [b""] * 6 + [b"OFF DISABLED 4\n"]


@pytest.mark.parametrize(("silence_s", "closed"), [(0.199, True), (0.201, False)])
def test_silence_opens_the_contact_by_the_boxs_own_clock(silence_s, closed):
    clock = ManualClock()
    box = SimulatedInterlock(clock)
    box.handle(b"BEAT 1\nENABLE\n")
    clock.now_s = silence_s
    assert box.closed is closed
    clock.now_s = 0.3
    assert box.handle(b"BEAT 2\n") == b"OFF SILENT 2\n"  # beats alone never close it again
    assert box.closed is False


@given(
    st.lists(
        st.one_of(st.binary(max_size=20), st.sampled_from([b"BEAT 1\n", b"STATUS?\n", b"ID?\n"])),
        max_size=20,
    )
)
@settings(max_examples=100)
def test_noise_never_closes_the_contact(chunks):
    box = SimulatedInterlock(ManualClock())
    for chunk in chunks:
        box.handle(chunk.replace(b"ENABLE", b"enable"))
    assert box.closed is False


# --- the driver
# ------------------------------------------------------------------------------------------------


def test_it_is_an_enable_line(bench):
    assert bench.interlock.read() is False
    bench.interlock.write(True)
    assert bench.interlock.read() is bench.box.closed is True
    bench.beat_for(60.0)  # the number starts again several times
    assert bench.box.closed is True
    bench.interlock.write(False)
    assert bench.interlock.read() is bench.box.closed is False
    bench.beat_for(1.0)
    bench.interlock.rest()
    assert bench.box.closed is False


def test_a_late_beat_opens_the_contact_and_says_so(bench):
    bench.interlock.write(True)
    bench.beat_for(1.0)
    bench.clock.now_s += 0.25
    assert bench.box.closed is False
    with pytest.raises(BadReply, match="has opened its contact"):
        bench.interlock.beat()
    bench.interlock.write(True)
    assert bench.box.closed is True


@pytest.mark.parametrize("fault", list(Fault))
def test_a_bad_wire_is_a_clear_error_and_the_box_opens_by_itself(bench, fault):
    bench.interlock.write(True)
    bench.wire.inject(fault, count=float("inf"), delay_s=0.0)
    bench.wire._due = lambda data: (fault, 0.1)  # type: ignore[method-assign] # beats ask no question
    with pytest.raises(DeviceError):
        bench.interlock.beat()
    amplifier = AnalogAmplifier(
        AmplifierSettings(100.0, 300.0, 0.01, 10e6, 0.01), bench.interlock, None
    )
    assert amplifier.disable() is AmplifierState.UNKNOWN
    bench.clock.now_s += 0.201
    assert bench.box.closed is False


def test_something_else_is_refused():
    class Other:
        def handle(self, data: bytes) -> bytes:
            return b"Agilent Technologies,33220A,0,0\n"

    with pytest.raises(BadReply, match="not 'HAPTIC-INTERLOCK 1'"):
        HeartbeatInterlock(MemoryTransport(Other())).connect()


# --- modem lines
# ------------------------------------------------------------------------------------------------


class Port:
    """What pyserial's Serial is to ModemLine, with RTS wired to CTS and DTR to DSR."""

    def __init__(self) -> None:
        self.port, self.rts, self.dtr, self.broken, self.is_open = "", True, True, False, False
        self.levels_at_open: tuple[bool, bool] | None = None

    def open(self) -> None:
        self.levels_at_open, self.is_open = (self.rts, self.dtr), True

    def close(self) -> None:
        self.is_open = False

    def __setattr__(self, name: str, value: object) -> None:
        if getattr(self, "broken", False) and name in ("rts", "dtr"):
            raise OSError(5, "Input/output error")
        object.__setattr__(self, name, value)

    @property
    def cts(self) -> bool:
        return self.rts

    @property
    def dsr(self) -> bool:
        return self.dtr


@pytest.fixture
def port(monkeypatch):
    made = Port()
    monkeypatch.setattr("serial.Serial", lambda: made)
    return made


@pytest.mark.parametrize("name", ["rts", "dtr"])
def test_a_modem_line_is_low_from_the_start_set_and_read_back(port, name):
    line = ModemLine("/dev/ttyUSB0", name, looped_back=True)  # type: ignore[arg-type]
    line.connect()
    assert port.levels_at_open == (False, False)
    line.write(True)
    assert line.read() is getattr(port, name) is True
    line.close()
    assert getattr(port, name) is False
    assert port.is_open is False


def test_without_the_wire_back_the_level_is_unknown_never_off(port):
    line = ModemLine("/dev/ttyUSB0", "rts", looped_back=False)
    line.connect()
    line.write(False)
    with pytest.raises(DeviceError, match="cannot be read back") as unknown:
        line.read()
    assert "wire RTS to CTS" in unknown.value.hint
    amplifier = AnalogAmplifier(AmplifierSettings(100.0, 300.0, 0.01, 10e6, 0.01), line, None)
    assert amplifier.disable() is AmplifierState.UNKNOWN


def test_a_modem_line_that_breaks_or_was_never_there(port):
    line = ModemLine("/dev/ttyUSB0", "dtr", looped_back=True)
    with pytest.raises(DeviceDisconnected, match="DTR of /dev/ttyUSB0 is not open"):
        line.write(True)
    line.connect()
    port.broken = True
    with pytest.raises(DeviceDisconnected, match="was lost"):
        line.write(True)
    line.close()


def test_a_port_that_does_not_exist():
    with pytest.raises(DeviceDisconnected, match="cannot be opened"):
        ModemLine("/dev/no-such-port", "rts", looped_back=True).connect()
