"""The watchdog process: real processes, killed for real; the simulated generator's own record says
what happened.
"""

from __future__ import annotations

import os
import queue
import signal
import subprocess
import sys
import textwrap
import threading
import time
from contextlib import suppress
from dataclasses import replace
from math import inf

import pytest

import hw.safety.watchdog
from haptic_driver.base.interpreter import PYTHON
from hw.errors import DeviceDisconnected, DeviceError, DeviceTimeout, SwitchedOff
from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.safety.simulated_interlock import SimulatedInterlock
from hw.safety.watchdog import (
    BEAT,
    FEWEST_UNANSWERED,
    REST,
    Outcome,
    Watchdog,
    WatchdogSettings,
    wait_for_silence,
)
from hw.serving.tcp import TcpServer
from tests.clock import ManualClock
from tests.hw.instruments import IMMEDIATE, closed_port
from tests.hw.testing.faulty_instrument import Fault, FaultyInstrument
from tests.traps import set_traps, sprung
from tests.waiting import HANG_S, exists, until

pytestmark = [pytest.mark.timeout(2 * HANG_S), pytest.mark.process]


DRIVER = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background shell would have it ignored
from hw.safety.watchdog import Watchdog, WatchdogSettings
dog = Watchdog(WatchdogSettings(sys.argv[1], period_s=float(sys.argv[2])))
dog.start()
dog.beat()  # it counts from the first
print(dog.pid, flush=True)
while True:
    dog.beat()
    time.sleep(0.02)
"""


class Bench:
    """A generator with its output on, served on loopback; it notes when the output went off."""

    def __init__(self) -> None:
        self.off_at_s: float | None = None
        self.asked = 0
        self.generator = Simulated33220A(IMMEDIATE, listener=self._note)
        self.faults = FaultyInstrument(self.generator)
        self.server = TcpServer(self)
        self.generator.handle(b"OUTP:LOAD INF;:VOLT 2;:OUTP 1\n")

    def handle(self, data: bytes) -> bytes:
        self.asked += 1
        return self.faults.handle(data)

    def _note(self, output: object) -> None:
        if not self.generator.output().on and self.off_at_s is None:
            self.off_at_s = time.monotonic()

    @property
    def on(self) -> bool:
        return self.generator.output().on

    def settings(self, **changed: float) -> WatchdogSettings:
        return WatchdogSettings(
            self.server.resource, **{"period_s": 5.0, "give_up_s": 10.0, **changed}
        )  # type: ignore[arg-type]


@pytest.fixture
def bench():
    bench = Bench()
    with bench.server:
        yield bench


@pytest.fixture
def drivers():
    started: list[subprocess.Popen[str]] = []
    yield started
    for process in started:
        process.kill()
        process.communicate()


def driver(
    bench: Bench, drivers: list[subprocess.Popen[str]], period_s: float
) -> tuple[subprocess.Popen[str], int]:
    """A process that beats a watchdog of its own; its handle and the watchdog's process id."""
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(DRIVER), bench.server.resource, str(period_s)],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    drivers.append(process)
    assert process.stdout is not None
    return process, int(process.stdout.readline())


# --- the driver dies
# -------------------------------------------------------------------------------------------------


MAY_GO_FIRST = "import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))"


def test_a_busy_machine_does_not_let_it_wait_where_that_is_granted(bench):
    asked = subprocess.run(
        [sys.executable, "-c", MAY_GO_FIRST], stderr=subprocess.DEVNULL, check=False
    )
    dog = Watchdog(bench.settings())
    dog.start()
    try:
        assert dog.pid is not None
        granted = os.SCHED_FIFO if asked.returncode == 0 else os.SCHED_OTHER
        found = [os.sched_getscheduler(int(task)) for task in os.listdir(f"/proc/{dog.pid}/task")]
        assert sorted(found) == sorted(
            [os.SCHED_OTHER, *[granted] * (len(found) - 1)]
        )  # the log's alone waits
    finally:
        assert dog.close() is True


@pytest.mark.parametrize("name", ["SIGKILL", "SIGTERM"])
def test_whatever_ends_the_driver_switches_off(bench, drivers, name):
    """To the whole process group where that is how it comes; the period is long, so only the pipe
    can have told.
    """
    process, pid = driver(bench, drivers, period_s=1e3)
    assert bench.on
    if name == "SIGTERM":
        os.killpg(process.pid, getattr(signal, name))
    else:
        process.send_signal(getattr(signal, name))
    process.wait(HANG_S)
    until(lambda: not bench.on)
    until(lambda: not exists(pid))


@pytest.mark.realtime
def test_after_kill_9_the_output_is_off_within_the_period(bench, drivers):
    period_s = 5.0  # the bound of the contract, and generous for a busy machine
    process, _ = driver(bench, drivers, period_s)
    killed_s = time.monotonic()
    process.kill()
    until(lambda: bench.off_at_s is not None)
    assert bench.off_at_s is not None
    assert bench.off_at_s - killed_s < period_s


@pytest.mark.realtime
def test_a_driver_that_hangs_is_silence(bench, drivers):
    process, pid = driver(bench, drivers, period_s=0.5)
    assert bench.on
    process.send_signal(signal.SIGSTOP)  # the pipe stays open
    until(lambda: not bench.on)
    process.kill()
    until(lambda: not exists(pid))


def test_the_watchdog_ignores_what_is_meant_for_the_driver(bench):
    with Watchdog(bench.settings()) as watchdog:
        watchdog.beat()
        assert watchdog.pid is not None
        assert os.getpgid(watchdog.pid) == watchdog.pid  # a terminal's Ctrl-C does not reach it
        for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGABRT"):
            os.kill(watchdog.pid, getattr(signal, name))
        time.sleep(0.1)
        watchdog.beat()
        assert bench.on
        assert watchdog.close() is True
    assert not bench.on


# --- beats
# ------------------------------------------------------------------------------------------------


def beat_until_hang(watchdog: Watchdog) -> None:
    """Beat as a driver does, until it says why not."""
    until(lambda: time.sleep(0.05) or watchdog.beat())


def suppressed(watchdog: Watchdog, known: type[DeviceError]) -> None:
    with suppress(known):
        watchdog.beat()


@pytest.mark.realtime
def test_without_a_first_beat_and_at_rest_it_waits(bench):
    with Watchdog(bench.settings(period_s=0.2)) as watchdog:
        time.sleep(0.5)
        watchdog.beat()
        watchdog.rest()
        time.sleep(0.5)
        assert bench.on
        watchdog.beat()
        until(lambda: not bench.on)


@pytest.mark.realtime
def test_a_driver_that_was_kept_waiting_is_told_and_may_go_on(bench):
    """A machine that lets nobody run for a moment is no fault: the output was off meanwhile."""
    with Watchdog(bench.settings(period_s=0.5)) as watchdog:
        watchdog.beat()
        until(lambda: not bench.on)  # nobody has beaten
        until(lambda: watchdog.times_off() == 1)
        with pytest.raises(SwitchedOff, match="it switched off"):
            beat_until_hang(watchdog)
        watchdog.rest()  # as the rig does once it is off
        bench.generator.handle(b"OUTP 1\n")
        for _ in range(35):  # for longer than a period
            watchdog.beat()
            time.sleep(0.02)
        assert bench.on
        until(lambda: not bench.on)  # and it watches as before
        pid = watchdog.pid
        assert watchdog.close() is True
    assert pid is not None
    assert not exists(pid)


@pytest.mark.realtime
def test_one_that_is_stopped_is_noticed_and_ended(bench):
    watchdog = Watchdog(bench.settings(period_s=0.5))
    watchdog.start()
    watchdog.beat()
    assert watchdog.pid is not None
    os.kill(watchdog.pid, signal.SIGSTOP)
    with pytest.raises(DeviceTimeout, match="it does not answer"):
        beat_until_hang(watchdog)
    watchdog.close()
    watchdog.start()
    for _ in range(10):
        watchdog.beat()
        time.sleep(0.02)
    watchdog.close()


@pytest.mark.realtime
def test_one_that_is_stopped_while_the_finger_is_lifted_is_noticed_by_the_next_beats(bench):
    """A watchdog stopped as a finger was lifted let the next touch have voltage for its whole
    period.
    """
    watchdog = Watchdog(bench.settings(period_s=1.0))
    watchdog.start()
    watchdog.beat()
    until(lambda: watchdog._hear(watchdog._process) or not watchdog._unanswered)  # type: ignore[arg-type]
    assert watchdog.pid is not None
    os.kill(watchdog.pid, signal.SIGSTOP)
    watchdog.rest()
    time.sleep(1.1)
    for _ in range(FEWEST_UNANSWERED - 1):
        watchdog.beat()
    with pytest.raises(DeviceTimeout, match="it does not answer"):
        watchdog.beat()
    watchdog.close()


@pytest.mark.realtime
def test_one_that_gives_up_ends(bench):
    """Without evidence that the output is off, the driver must not go on."""
    watchdog = Watchdog(bench.settings(period_s=0.5, give_up_s=1.0, reply_timeout_s=0.1))
    watchdog.start()
    bench.faults.inject(Fault.HANG, count=float("inf"))
    asked = bench.asked
    watchdog.beat()
    until(lambda: bench.asked > asked)  # nobody has beaten
    with pytest.raises(SwitchedOff):
        watchdog.beat()
    with pytest.raises(
        DeviceDisconnected, match="not beaten in time, and has ended: output unknown"
    ):
        until(lambda: suppressed(watchdog, SwitchedOff))
    assert watchdog.close() is None


def test_silence_in_words():
    beats: queue.Queue[bytes] = queue.Queue()
    for beat in (BEAT, REST, BEAT):
        beats.put(beat)
    assert wait_for_silence(beats, 0.01) == "no beat for 0.01 s"
    for beat in (BEAT, REST, b""):
        beats.put(beat)
    assert wait_for_silence(beats, 1e3) == "the pipe is closed"


def test_silence_is_noticed_after_one_period_and_not_later():
    """Once a fault in the last look made it 10.9 periods, and no test noticed."""
    waited_s: list[float | None] = []

    class Beats(queue.Queue[bytes]):
        def get(self, block: bool = True, timeout: float | None = None) -> bytes:
            waited_s.append(timeout)
            if timeout is None:
                return BEAT
            raise queue.Empty

    assert wait_for_silence(Beats(), 4.0) == "no beat for 4 s"
    assert waited_s == [None, pytest.approx(3.6), pytest.approx(0.4)]


@pytest.mark.realtime
def test_its_own_sleep_is_not_the_drivers_silence(bench):
    """A busy machine let the watchdog sleep for nearly its period while its driver went on beating.

    Two at once: one wakes before its last look, one after it had begun.
    """
    settings = bench.settings(period_s=2.4)
    with Watchdog(settings) as one, Watchdog(settings) as other:
        for watchdog in (one, other):
            watchdog.beat()
        time.sleep(0.1)  # they have begun to wait
        began_s = time.monotonic()
        sleeping = {
            watchdog: began_s + slept_s for watchdog, slept_s in ((one, 1.8), (other, 2.22))
        }
        for watchdog in sleeping:
            assert watchdog.pid is not None
            os.kill(watchdog.pid, signal.SIGSTOP)
        beats_left = 20  # once all are awake
        while beats_left:
            for watchdog in (one, other):
                watchdog.beat()
                if time.monotonic() >= sleeping.get(watchdog, inf):
                    del sleeping[watchdog]
                    assert watchdog.pid is not None
                    os.kill(watchdog.pid, signal.SIGCONT)
            beats_left -= not sleeping
            time.sleep(0.02)
        assert bench.on


def test_starting_twice_does_not_let_go_of_the_first(bench):
    with Watchdog(bench.settings()) as watchdog:
        pid = watchdog.pid
        watchdog.beat()
        watchdog.start()
        assert watchdog.pid == pid
        assert bench.on


def test_one_that_has_ended_is_started_again(bench):
    with Watchdog(bench.settings()) as watchdog:
        assert watchdog.pid is not None
        os.kill(watchdog.pid, signal.SIGKILL)
        os.waitid(
            os.P_PID, watchdog.pid, os.WEXITED | os.WNOWAIT
        )  # ended, and nobody has noticed yet
        watchdog.start()
        watchdog.beat()


def test_an_input_that_cannot_be_read_is_at_its_end(bench, tmp_path):
    command = [sys.executable, "-m", "hw.safety.watchdog", "--generator", bench.server.resource]
    with (tmp_path / "written").open("w") as write_only:
        ended = subprocess.run(
            command, stdin=write_only, capture_output=True, text=True, check=False, timeout=HANG_S
        )
    assert ended.returncode == Outcome.OFF
    assert "the pipe is closed" in ended.stderr
    assert not bench.on


def test_beating_a_watchdog_that_was_never_started(bench):
    watchdog = Watchdog(bench.settings())
    with pytest.raises(DeviceDisconnected, match="it is not running"):
        watchdog.beat()
    watchdog.rest()
    assert watchdog.close() is None


def test_a_watchdog_that_was_killed_is_noticed(bench):
    watchdog = Watchdog(bench.settings())
    watchdog.start()
    watchdog.beat()
    assert watchdog.pid is not None
    os.kill(watchdog.pid, signal.SIGKILL)
    with pytest.raises(DeviceDisconnected, match=r"watchdog: (it has ended|its pipe is broken)"):  # noqa: PT012
        for _ in range(100):
            watchdog.beat()
            time.sleep(0.05)
    assert watchdog.close() is None  # it cannot say


# --- denials
# ------------------------------------------------------------------------------------------------

DENYING = """
import _thread, os, resource, socket, sys, threading
import hw.safety.watchdog as watchdog

denied = sys.argv[1].split("+")
say = watchdog._say

def refuse(*_, **__):
    raise RuntimeError("can't start new thread")

def armed(what):
    watchdog._say = say
    if "threads" in denied:
        _thread.start_new_thread = threading._start_new_thread = refuse
        resource.setrlimit(resource.RLIMIT_NPROC, (0, 0))
    if "fork" in denied:
        os.fork = os.posix_spawn = refuse
    if "memory" in denied:
        resource.setrlimit(resource.RLIMIT_AS, (1 << 20, 1 << 20))
    if "disk" in denied:
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    if "names" in denied:
        socket.getaddrinfo = lambda *_, **__: threading.Event().wait()
    say(what)

watchdog._say = armed
sys.exit(watchdog.main(sys.argv[2:]))
"""
DENIALS = ["threads", "fork", "memory", "disk", "stderr", "stdout", "names", "interlock", "folder"]


def full_pipe() -> tuple[int, int]:
    """A pipe that nobody reads and that takes no more."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with suppress(BlockingIOError):
        while True:
            os.write(writing, bytes(4096))
    os.set_blocking(writing, True)
    return reading, writing


@pytest.fixture
def box():
    """An interlock that may fall silent; `resource` is where it is served."""
    found = FaultyInstrument(SimulatedInterlock(ManualClock()))
    with TcpServer(found) as server:
        found.resource = server.resource  # type: ignore[attr-defined]
        yield found


@pytest.mark.parametrize(
    "denied", [*(pytest.param(one, marks=pytest.mark.soak) for one in DENIALS), "+".join(DENIALS)]
)
def test_whatever_is_denied_after_arming_it_switches_off(bench, box, tmp_path, denied):
    """Its connection is lost on the way, so that it has something to say that nobody reads. The
    generator has a host's name; the interlock falls silent where that is denied.
    """
    set_traps(tmp_path)
    settings = replace(
        bench.settings(period_s=0.3, retry_s=0.05, reply_timeout_s=0.3),
        generator=bench.server.resource.replace("127.0.0.1", "localhost"),
        interlock=box.resource,
    )
    reading, writing = full_pipe()
    process = subprocess.Popen(
        [*PYTHON, "-c", DENYING, denied, *settings.arguments()],
        cwd=tmp_path if "folder" in denied else None,
        bufsize=0,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=writing if "stderr" in denied else None,
    )
    try:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"  # and then nobody reads: it may run full
        process.stdin.write(BEAT)
        bench.faults.inject(Fault.DISCONNECT, count=1)
        box.inject(Fault.HANG, count=inf if "interlock" in denied else 0)
        until(lambda: not bench.on)
        assert sprung(tmp_path) == []
    finally:
        process.kill()
        process.communicate()
        os.close(reading)
        os.close(writing)


# --- evidence
# ------------------------------------------------------------------------------------------------


def test_a_generator_that_fails_for_a_while_is_tried_again(bench):
    watchdog = Watchdog(bench.settings(retry_s=0.05))
    watchdog.start()
    bench.faults.inject(Fault.HANG, count=3)
    assert watchdog.close() is True
    assert not bench.on


def test_whatever_a_link_raises_the_other_instrument_is_switched_off(bench, monkeypatch):
    class Broken:
        resource = "broken"

        def open(self) -> None:
            raise RuntimeError("nobody thought of this")

        def close(self) -> None:
            pass

    made = hw.safety.watchdog.make_transport
    monkeypatch.setattr(
        hw.safety.watchdog,
        "make_transport",
        lambda name, **said: Broken() if name == "broken" else made(name, **said),
    )
    settings = WatchdogSettings("broken", bench.server.resource, give_up_s=0.3, retry_s=0.1)
    broken, other = hw.safety.watchdog._instruments(settings)
    other._off, other._answers = (
        broken._off,
        broken._answers,
    )  # a second generator in the interlock's place
    hands = [hw.safety.watchdog.Hand(one, settings.retry_s) for one in (broken, other)]
    assert hw.safety.watchdog.switch_off(hands, settings) is Outcome.OFF
    assert not bench.on
    other._transport.close()


def test_no_hand_waits_for_another(bench):
    """A generator that failed twice was tried again when the interlock's name was resolved, after
    12 s.
    """
    answers = threading.Event()

    class Hangs:
        resource = "hangs"

        def switch_off(self) -> bool:
            return answers.wait()

    settings = bench.settings(give_up_s=60.0, retry_s=0.01)
    (generator,) = hw.safety.watchdog._instruments(settings)
    bench.faults.inject(Fault.HANG, count=2)
    hands = [hw.safety.watchdog.Hand(one, settings.retry_s) for one in (Hangs(), generator)]
    switching = threading.Thread(
        target=hw.safety.watchdog.switch_off, args=(hands, settings), daemon=True
    )
    switching.start()
    until(lambda: not bench.on)
    assert switching.is_alive()
    answers.set()
    switching.join(HANG_S)
    generator._transport.close()


@pytest.mark.parametrize("fault", [Fault.HANG, Fault.GARBAGE])
def test_without_an_answer_it_gives_up_and_says_unknown(bench, fault):
    watchdog = Watchdog(bench.settings(give_up_s=0.3, reply_timeout_s=0.1, retry_s=0.1))
    watchdog.start()
    bench.faults.inject(fault, count=float("inf"))
    assert watchdog.close() is None


def test_a_generator_that_insists_on_being_on_is_reported_on(bench):
    class Stubborn:
        def handle(self, data: bytes) -> bytes:
            return b"1\n"

    with TcpServer(Stubborn()) as server:
        watchdog = Watchdog(WatchdogSettings(server.resource, give_up_s=0.3))
        watchdog.start()
        assert watchdog.close() is False


def test_the_interlock_is_opened_as_well_and_is_evidence_alone(bench):
    box = SimulatedInterlock(ManualClock())
    box.handle(b"BEAT 1\nENABLE\n")
    with TcpServer(box) as server:
        settings = WatchdogSettings(
            bench.server.resource, server.resource, give_up_s=0.5, reply_timeout_s=0.1
        )
        watchdog = Watchdog(settings)
        watchdog.start()
        assert box.closed is True
        bench.faults.inject(Fault.HANG, count=float("inf"))
        assert watchdog.close() is True
    assert box.closed is False
    assert (
        bench.on
    )  # nothing could be done about the generator; the open contact takes its voltage away


def test_a_generator_that_is_late_at_the_start_is_asked_again(bench):
    """A daemon that took over from a killed one ended, since a busy machine let its generator
    answer after 0.4 s.
    """
    bench.faults.inject(Fault.SILENCE, count=2)
    watchdog = Watchdog(bench.settings(reply_timeout_s=0.1))
    watchdog.start()
    assert watchdog.close() is True


def test_a_generator_that_is_not_there_is_refused_at_the_start():
    with pytest.raises(DeviceDisconnected, match="does not answer"):
        Watchdog(WatchdogSettings(f"TCPIP::127.0.0.1::{closed_port()}::SOCKET")).start()


# --- settings
# ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["period_s", "reply_timeout_s", "retry_s", "give_up_s"])
@pytest.mark.parametrize("value", [0.0, float("nan"), float("inf")])
def test_senseless_times_are_refused(name, value):
    with pytest.raises(ValueError, match=name):
        WatchdogSettings("TCPIP::127.0.0.1::5025::SOCKET", **{name: value})  # type: ignore[arg-type]


def test_its_process_is_told_every_setting():
    settings = WatchdogSettings(
        "/dev/ttyS0", "/dev/ttyS1", "siglent_sdg", "@sim", 0.6, 0.4, 0.3, 50.0
    )
    assert hw.safety.watchdog._parse(settings.arguments()) == settings


def test_it_reaches_the_generator_through_the_library_it_is_told(caplog):
    (generator,) = hw.safety.watchdog._instruments(
        WatchdogSettings("GPIB0::10::INSTR", visa_backend="@nosuch")
    )
    assert generator.ask() is None
    assert "no VISA library for '@nosuch'" in caplog.text


@pytest.mark.parametrize(
    ("given", "said"), [(["--generator", "nonsense"], "nonsense"), ([], "--generator")]
)
def test_a_wrong_command_line_ends_with_status_2_and_says_why(given, said):
    ended = subprocess.run(
        [sys.executable, "-m", "hw.safety.watchdog", *given],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == Outcome.NOT_STARTED
    assert said in ended.stderr
