from __future__ import annotations

import json
import os
import re
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hw.errors import BadReply, DeviceDisconnected, DeviceError, DeviceTimeout
from hw.generator.agilent_33220a.driver import Agilent33220A
from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.generator.settings import GeneratorSettings
from hw.serving.memory import MemoryTransport
from hw.serving.responder import Disconnect
from hw.transport.contract import Transport
from tests.hw.generator.asking import read_output
from tests.hw.instruments import IMMEDIATE
from tests.hw.testing.faulty_instrument import Fault, FaultyInstrument
from tests.hw.testing.recording import Recording, Replay, ReplayMismatch

SETTINGS = GeneratorSettings(100.0, 150.0, 100.0, 1000.0)


class Upper:
    """Answers in capitals; hangs up at `bye`, says nothing to `.`."""

    def handle(self, data: bytes) -> bytes:
        if data == b"bye\n":
            raise Disconnect(b"")
        return b"" if data == b".\n" else data.upper()


def record(path: Path) -> Recording:
    return Recording(MemoryTransport(Upper(), resource="UPPER"), path)


def every_kind_of_step(transport: Transport) -> list[object]:
    """A dialogue with everything that can happen, and what came of it."""
    outcomes: list[object] = []
    transport.open()
    outcomes.append(transport.query(b"hello\n", 1.0))
    outcomes.append(transport.query(b"\x00\xff\x80\n", 1.0))
    for command in (b".\n", b"again\n", b"bye\n", b"back\n"):
        try:
            outcomes.append(transport.query(command, 1.0))
        except DeviceError as error:
            outcomes.append((type(error), error.message, error.hint))
    transport.clear()
    transport.write(b"unread\n")
    transport.write(b"four\n")
    outcomes.append(transport.read_exactly(4, 1.0))
    transport.close()
    return outcomes


def test_a_log_replays_to_the_same_outcomes(tmp_path):
    path = tmp_path / "wire.jsonl"
    outcomes = every_kind_of_step(record(path))
    assert outcomes[:2] == [b"HELLO", b"\x00\xff\x80"]
    assert [outcome[0] for outcome in outcomes if isinstance(outcome, tuple)] == [
        DeviceTimeout,
        DeviceDisconnected,
    ]
    replay = Replay(path)
    assert replay.resource == "UPPER"
    assert every_kind_of_step(replay) == outcomes
    replay.check_finished()


def test_a_driver_replays_byte_for_byte(tmp_path):
    def session(transport: Transport) -> list[object]:
        driver = Agilent33220A(transport, SETTINGS)
        driver.connect()
        driver.set_point(250.0, 75.0)
        driver.set_output(True)
        driver.set_point(300.0, 100.0)
        return [read_output(driver), driver.off(), driver.close()]

    path = tmp_path / "wire.jsonl"
    generator = Simulated33220A(IMMEDIATE)
    outcomes = session(Recording(MemoryTransport(generator), path))
    assert outcomes == [True, True, True]
    replay = Replay(path)
    assert session(replay) == outcomes
    replay.check_finished()


def test_the_log_is_readable_private_and_in_order(tmp_path):
    path = tmp_path / "wire.jsonl"
    old = os.umask(0)
    try:
        every_kind_of_step(record(path))
    finally:
        os.umask(old)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    header, *events = [json.loads(line) for line in path.read_text().splitlines()]
    assert header == {"wire_log": 1, "resource": "UPPER"}
    assert [event["event"] for event in events[:4]] == ["connect", "sent", "received", "sent"]
    assert events[1]["data"] == "hello\n"
    assert events[2]["data"] == "HELLO\n"
    assert events[3]["data"] == "\x00\xff\x80\n"
    times = [event["t_s"] for event in events]
    assert times == sorted(times)
    assert times[0] >= 0.0


def test_a_log_is_never_written_over(tmp_path):
    path = tmp_path / "wire.jsonl"
    path.write_text("precious")
    with pytest.raises(FileExistsError):
        record(path)
    assert path.read_text() == "precious"


@pytest.mark.process
def test_a_crash_loses_nothing(tmp_path):
    path = tmp_path / "wire.jsonl"
    program = (
        "import os, sys; from pathlib import Path\nfrom hw.serving.memory import"
        " MemoryTransport; from tests.hw.testing.recording import Recording\nclass Echo:\n    def"
        " handle(self, data): return data\nt = Recording(MemoryTransport(Echo()),"
        " Path(sys.argv[1])); t.open(); t.query(b'last words\\n', 1.0)\nos.kill(os.getpid(), 9)\n"
    )
    root = Path(__file__).parents[3]
    result = subprocess.run([sys.executable, "-c", program, str(path)], cwd=root, check=False)
    assert result.returncode == -9
    events = [json.loads(line) for line in path.read_text().splitlines()]
    assert events[-1]["event"] == "received"
    assert events[-1]["data"] == "last words\n"


def test_a_full_disk_ends_the_log_and_not_the_dialogue(tmp_path):
    recording = record(tmp_path / "wire.jsonl")
    recording.open()
    full = os.open("/dev/full", os.O_WRONLY)
    os.dup2(full, recording._file)
    os.close(full)
    assert recording.query(b"a\n", 1.0) == b"A"
    assert isinstance(recording.log_error, OSError)
    assert recording.query(b"b\n", 1.0) == b"B"
    recording.close()
    recording.finish()
    recording.finish()


# --- differences
# ---------------------------------------------------------------------------------------------


@pytest.fixture
def replay(tmp_path: Path) -> Replay:
    path = tmp_path / "wire.jsonl"
    recording = record(path)
    recording.open()
    recording.query(b"FREQ 250.0;:FREQ?\n", 1.0)
    recording.query(b"second\n", 1.0)
    recording.close()
    replay = Replay(path)
    replay.open()
    return replay


def test_the_first_byte_that_differs_is_shown(replay):
    message = (
        r"line 3: expected b'FREQ 250\.0;:FREQ\?\\n', got b'FREQ 240\.0;:FREQ\?\\n' at byte 6 of"
        r" the command"
    )
    with pytest.raises(ReplayMismatch, match=message):
        replay.query(b"FREQ 240.0;:FREQ?\n", 1.0)


def test_a_command_cut_short_or_longer_differs_at_its_end(replay):
    with pytest.raises(ReplayMismatch, match="at byte 10 of the command"):
        replay.write(b"FREQ 250.0")


def test_a_program_that_swallows_the_refusal_cannot_go_on(replay):
    with pytest.raises(ReplayMismatch):
        replay.query(b"wrong\n", 1.0)
    with pytest.raises(ReplayMismatch, match="wrong"):
        replay.query(b"FREQ 250.0;:FREQ?\n", 1.0)
    with pytest.raises(ReplayMismatch, match="wrong"):
        replay.check_finished()


def test_after_a_difference_no_recorded_failure_is_played(tmp_path):
    path = tmp_path / "wire.jsonl"
    events: list[dict[str, str]] = [{"event": "connect"}]
    events.append(
        {
            "event": "failed",
            "during": "discard",
            "code": "device_disconnected",
            "message": "m",
            "hint": "h",
        }
    )
    path.write_text("\n".join(map(json.dumps, [{"wire_log": 1, "resource": "X"}, *events])))
    replay = Replay(path)
    replay.open()
    replay.close()  # where the log goes on with a command
    with pytest.raises(ReplayMismatch, match="got a disconnect"):
        replay.open()
    with pytest.raises(ReplayMismatch, match="got a disconnect"):
        replay._discard_input()


def test_another_step_than_the_recorded_one_is_refused(replay):
    with pytest.raises(
        ReplayMismatch, match=r"expected sent b'FREQ 250.0;:FREQ\?\\n', got waiting for an answer"
    ):
        replay.read_until(b"\n", 1.0)


def test_a_command_after_the_end_is_refused(replay):
    replay.query(b"FREQ 250.0;:FREQ?\n", 1.0)
    replay.query(b"second\n", 1.0)
    with pytest.raises(ReplayMismatch, match="expected a disconnect, got sending b'third"):
        replay.query(b"third\n", 1.0)


def test_a_program_that_stops_early_has_not_finished(replay):
    replay.query(b"FREQ 250.0;:FREQ?\n", 1.0)
    with pytest.raises(ReplayMismatch, match="expected 3 more events, got the end"):
        replay.check_finished()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not a wire log"),
        ('{"wire_log": 9, "resource": "X"}\n', "version 1"),
        ("not json\n", "line 1"),
        ('{"wire_log": 1, "resource": "X"}\n{"t_s": 0.1, "event": "se', "line 2"),
        ('{"wire_log": 1, "resource": "X"}\n[]\n', "line 2"),
        ('{"wire_log": 1}\n', "line 1"),
        ('{"wire_log": 1, "resource": "X"}\n{"event": "sent"}\n', "line 2"),
        ('{"wire_log": 1, "resource": "X"}\n{"event": "failed", "during": "send"}\n', "line 2"),
        ('{"wire_log": 1, "resource": "X"}\n{"event": "waved"}\n', "line 2"),
    ],
)
def test_a_file_that_is_no_log_is_refused(tmp_path, text, message):
    path = tmp_path / "wire.jsonl"
    path.write_text(text)
    with pytest.raises(ValueError, match=re.escape(str(path))) as caught:
        Replay(path)
    assert message in str(caught.value)


@settings(
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
@given(
    steps=st.lists(st.tuples(st.binary(max_size=40), st.sampled_from([None, *Fault])), max_size=8)
)
def test_any_dialogue_with_any_faults_replays_alike(tmp_path, steps):
    def session(transport: Transport, line: FaultyInstrument | None) -> list[object]:
        outcomes: list[object] = []
        transport.open()
        for data, fault in steps:
            if line is not None:
                line.heal()
                if fault is not None:
                    line.inject(fault)
            try:
                outcomes.append(transport.query(b"?" + data + b"\n", 1.0))
            except (DeviceTimeout, DeviceDisconnected, BadReply) as error:
                outcomes.append((type(error), error.message))
        transport.close()
        return outcomes

    path = tmp_path / "wire.jsonl"
    path.unlink(missing_ok=True)
    line = FaultyInstrument(Upper(), sleep=lambda s: None)
    recording = Recording(MemoryTransport(line), path)
    outcomes = session(recording, line)
    recording.finish()
    replay = Replay(path)
    assert session(replay, None) == outcomes
    replay.check_finished()
