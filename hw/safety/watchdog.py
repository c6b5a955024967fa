"""A process of its own that switches the output off when the driver dies, over connections of its
own.

`atexit`, signal handlers and `finally` do not run after SIGKILL, a crash of the interpreter or a
hang; this does. The driver beats over a pipe. The watchdog acts when beats stop for `period_s`, or
when the pipe closes (however the driver ended). It switches the generator off by the commands of
its kind, and opens the interlock's contact where it has one. It reads both back, and tries each
again, without waiting for the other, until it says off or `give_up_s` have passed. A driver that
was only delayed by a busy machine may beat again once there is evidence. Otherwise the watchdog
ends, and its exit status says what it knows. It can do nothing against a computer without power or
an instrument that is cut off: that is what the interlock box is for. With a load stage, the
watchdog lifts or stops it, beside the others, when the driver has ended while it pressed.

From when it is ready it starts nothing more: its threads, connections and commands are there. Its
log waits for nobody.

    python -m hw.safety.watchdog --generator TCPIP::192.168.0.5::5025::SOCKET [--model M]
    [--interlock I] ...

reads beats from its standard input. `b`: the output is wanted. `r`: rest, the output is known to be
off, do not wait for beats. `p`: the load stage presses from here on. `l`: it has let go. It counts
from the first beat. Standard output gets one line, `ready` or why not. Then come `h` whenever it
has heard, `s` when it begins to switch off, and `d` when it has.
"""

from __future__ import annotations

import argparse
import enum
import logging
import os
import queue
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

from haptic_driver.base.interpreter import module_command
from hw.analog.cards import check_name, make_card
from hw.analog.output import QUIET_V, CardReserved, at_zero
from hw.dropping_log import DroppingHandler
from hw.errors import DeviceDisconnected, DeviceTimeout, SwitchedOff
from hw.generator.contract import generator_kind
from hw.safety.guarded_stage import GuardedStage, StageHold
from hw.transport.contract import Transport
from hw.transport.resource import make_transport
from hw.transport.running import Running

BEAT, REST = b"b", b"r"
PRESSED, LIFTED = b"p", b"l"
READY = "ready"
HEARD, SWITCHING, DONE = b"h", b"s", b"d"
NOT_BEATEN = "it switched off, since it was not beaten in time"
CLOSED = "the pipe is closed"
# beats, before silence is its own and not that of a machine that let nobody run
FEWEST_UNANSWERED = 3
LAST_LOOK = 0.1  # of the period
# times: nothing is on yet, and a busy machine's late answer is no reason to go without
ASKED_AT_START = 4
PRIORITY = 1  # of SCHED_FIFO, where that is granted: before all that is not in real time
STAGE_S = 10.0  # for a load stage, whose driver may still hold it for a moment
# What ends the driver must not end it: a terminal, or a service manager that ends all of a unit,
# which sends SIGABRT where the driver hangs. SIGTTOU: a terminal stops who writes unasked.
IGNORED = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGABRT", "SIGTTOU")
_END_S = 10.0  # for the process to be scheduled and to end; it switches off meanwhile
_log = logging.getLogger("hw.safety.watchdog")


class Outcome(enum.IntEnum):
    """Exit status of the watchdog: what it knows about the output."""

    OFF = 0
    NOT_STARTED = 2
    UNKNOWN = 3
    ON = 4


@dataclass(frozen=True)
class WatchdogSettings:
    """What it switches off, and when. Resources as `make_transport` takes them; each may be absent,
    not all of them.

    `model` is the generator's kind, see `hw.generator.contract`; `visa_backend` as `make_transport`
    takes it.

    A serial port or USB device cannot be shared with the driver: give the watchdog resources of its
    own.

    `give_up_s`: how long it goes on trying without evidence. Raises ValueError for times that are
    not > 0.
    """

    generator: str | None
    interlock: str | None = None
    model: str = "agilent_33220a"
    visa_backend: str = "@py"
    period_s: float = 0.5
    reply_timeout_s: float = 0.3
    retry_s: float = 0.2
    give_up_s: float = 60.0
    load_stage: GuardedStage | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot be a setting."""
        for name in ("period_s", "reply_timeout_s", "retry_s", "give_up_s"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise ValueError(
                    f"watchdog {name} must be a finite number > 0, not {getattr(self, name)!r}"
                )

    def arguments(self) -> list[str]:
        """The command line that says the same."""
        given: dict[str, object] = {
            name.removesuffix("_s").replace("_", "-"): value for name, value in vars(self).items()
        }
        given["load-stage"] = None if self.load_stage is None else self.load_stage.as_text()
        return [f"--{name}={value}" for name, value in given.items() if value is not None]


class Watchdog(Running):
    """The driver's side: starts the process and beats it; a heartbeat for `Rig`.

    The process is in a group of its own and ignores the signals that ask a program to end. So it
    survives what ends the driver. It stays in the driver's session, since Linux shares a busy
    processor among sessions first. `beat` never waits.
    """

    def __init__(self, settings: WatchdogSettings) -> None:
        self.settings = settings
        self._process: subprocess.Popen[bytes] | None = None
        self._unanswered: list[float] = []  # when lines were sent to it since its last answer
        self._switching = False  # off, and not done with it
        self._went_off = False  # and nobody has been told
        self._times_off = 0

    @property
    def pid(self) -> int | None:
        """Its process id; None when it is not running for us."""
        return None if self._process is None else self._process.pid

    def start(self, timeout_s: float = 30.0) -> None:
        """Start it and wait until its own connections answer; does nothing when it runs already.

        Raises DeviceDisconnected when they do not.
        """
        if self._process is not None and self._process.poll() is None:
            return  # letting go of it would switch off
        self.close()
        process = subprocess.Popen(
            [*module_command("hw.safety.watchdog"), *self.settings.arguments()],
            bufsize=0,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            process_group=0,
        )
        said = _first_line(process, timeout_s)
        if said != READY:
            process.kill()
            process.communicate()
            raise DeviceDisconnected(
                f"watchdog: {said or f'not ready within {timeout_s:g} s'}",
                "the generator must accept a second connection; check its address",
            )
        for pipe in (process.stdin, process.stdout):
            assert pipe is not None
            os.set_blocking(pipe.fileno(), False)
        self._process, self._unanswered = process, []
        self._switching = self._went_off = False

    def beat(self) -> None:
        """Say that the output is still wanted.

        Raises SwitchedOff when it has switched off for want of beats and listens again. Raises
        another DeviceError once it has ended or has not answered for a period. It is killed then,
        since it watches nothing.
        """
        if self._process is None:
            raise DeviceDisconnected("watchdog: it is not running", "start it before switching on")
        self._hear(self._process)
        went_off, now_s = self._went_off, time.monotonic()
        self._went_off = False
        status = self._process.poll()
        if status is not None:
            raise DeviceDisconnected(
                f"watchdog: {_how_it_ended(status)}",
                "find out why beats stopped; then start it again",
            )
        if went_off:
            raise SwitchedOff(f"watchdog: {NOT_BEATEN}", "the machine is too busy")
        if (
            len(self._unanswered) >= FEWEST_UNANSWERED
            and now_s - self._unanswered[0] > self.settings.period_s
        ):
            self._process.kill()
            raise DeviceTimeout(
                "watchdog: it does not answer, and is ended", "find out what stopped it"
            )
        try:
            os.write(_pipe(self._process), BEAT)
        except BlockingIOError as error:
            raise DeviceTimeout("watchdog: it does not take beats", "restart the driver") from error
        except OSError as error:
            raise DeviceDisconnected(
                f"watchdog: its pipe is broken ({error})", "start it again"
            ) from error
        self._unanswered.append(now_s)

    def _hear(self, process: subprocess.Popen[bytes]) -> None:
        """Learn whether it has switched off since the last time, or is at it."""
        assert process.stdout is not None
        said = process.stdout.read(1 << 16) or b""  # None when there is nothing
        self._times_off += said.count(SWITCHING)
        self._went_off = self._went_off or self._switching or SWITCHING in said
        if said:
            self._unanswered = []
            self._switching = said.rfind(SWITCHING) > said.rfind(DONE) or (
                self._switching and DONE not in said
            )

    def rest(self) -> None:
        """Say that the output is known to be off; no matter when the watchdog has ended."""
        if self._process is not None:
            self._hear(self._process)
            self._went_off = False  # that it has switched off is no news any more
            with suppress(OSError):
                os.write(_pipe(self._process), REST)
                # stopped while it rests, the next beats tell
                self._unanswered.append(time.monotonic())

    def times_off(self) -> int:
        """How often it has switched off for want of beats."""
        if self._process is not None:
            self._hear(self._process)
        return self._times_off

    def press(self) -> None:
        """Say that the load stage will press. Raises DeviceDisconnected where nobody listens."""
        try:
            if self._process is None:
                raise BrokenPipeError("it is not running")
            os.write(_pipe(self._process), PRESSED)
        except OSError as error:
            raise DeviceDisconnected(
                f"watchdog: nothing would lift the finger if this program died ({error})",
                "start it again",
            ) from error

    def lifted(self) -> None:
        """Say that the load stage has let go; no matter when the watchdog has ended."""
        if self._process is not None:
            with suppress(OSError):
                os.write(_pipe(self._process), LIFTED)

    def close(self) -> bool | None:
        """Let it switch off and end; return whether the output is off (None: unknown). Never
        raises.

        Takes at most `give_up_s`, `STAGE_S` for a load stage, a few reply timeouts, and what a busy
        machine needs to end a process.
        """
        process, self._process = self._process, None
        if process is None:
            return None
        try:
            # closes its input, which makes it switch off
            process.communicate(
                timeout=self.settings.give_up_s
                + STAGE_S
                + 10.0 * self.settings.reply_timeout_s
                + _END_S
            )
        except subprocess.TimeoutExpired:
            return None
        return {Outcome.OFF.value: True, Outcome.ON.value: False}.get(process.returncode)


def _pipe(process: subprocess.Popen[bytes]) -> int:
    assert process.stdin is not None
    return process.stdin.fileno()


def _first_line(process: subprocess.Popen[bytes], timeout_s: float) -> str:
    """What the process says first; empty when it says nothing in time or ends."""
    assert process.stdout is not None
    lines: queue.Queue[bytes] = queue.Queue()
    stdout = process.stdout
    threading.Thread(target=lambda: lines.put(stdout.readline()), daemon=True).start()
    try:
        return lines.get(timeout=timeout_s).decode(errors="replace").strip()
    except queue.Empty:
        return ""


def _how_it_ended(status: int) -> str:
    """Its driver is there, so that an outcome other than off came of beats that did not come."""
    if status in (Outcome.UNKNOWN, Outcome.ON):
        return f"{NOT_BEATEN}, and has ended: output {Outcome(status).name.lower()}"
    return f"it has ended (status {status})"


# --- the process itself


class _Instrument:
    """A connection of the watchdog's own and the commands for it; `answers` distinguishes off from
    on.

    All but the last line of `off` answer nothing.
    """

    def __init__(
        self,
        transport: Transport,
        timeout_s: float,
        ask: bytes,
        off: Sequence[bytes],
        answers: re.Pattern[bytes],
    ) -> None:
        self.resource = transport.resource
        self._transport = transport
        self._timeout_s = timeout_s
        self._ask = ask
        self._off = off
        self._answers = answers

    def ask(self) -> bool | None:
        """Whether it is off; None when it does not say."""
        return self._query([self._ask])

    def switch_off(self) -> bool | None:
        """Switch off and read back; a connection that fails is made anew the next time."""
        return self._query(self._off)

    def _query(self, lines: Sequence[bytes]) -> bool | None:
        *commands, question = lines
        try:
            self._transport.open()
            with self._transport.exchange(self._timeout_s):
                for command in commands:
                    self._transport.write(command)
                reply = self._transport.query(question, self._timeout_s)
        except (
            Exception
        ) as error:  # whatever it is, the other instrument and the next attempt must not suffer
            said = str(error)
            _log.warning("%s", said if self.resource in said else f"{self.resource}: {said}")
            self._transport.close()
            return None
        match = self._answers.fullmatch(reply.strip())
        if match is None:
            _log.warning("%s answered %r to %r", self.resource, reply[:80], question)
            self._transport.close()
            return None
        return match["off"] is not None


class _Card:
    """An analog output of the watchdog's own, which opens at zero; in place of an `_Instrument`."""

    def __init__(self, resource: str, timeout_s: float) -> None:
        self.resource = resource
        self._output = make_card(resource, at_zero(timeout_s))

    def ask(self) -> bool | None:
        """Whether it reads back as zero; None where it cannot."""
        return self._told(self._output.read_back_v)

    def switch_off(self) -> bool | None:
        """To zero, and read back; a card that a hanging driver keeps is reset."""

        def off() -> float | None:
            try:
                with self._output:
                    return self._output.read_back_v()
            except CardReserved:
                self._output.reset()
                return self._output.read_back_v()

        return self._told(off)

    def _told(self, read_v: Callable[[], float | None]) -> bool | None:
        try:
            found_v = read_v()
        except Exception as error:  # as for an instrument
            _log.warning("%s: %s", self.resource, error)
            return None
        return None if found_v is None else found_v <= QUIET_V


def _instruments(settings: WatchdogSettings) -> list[_Instrument | _Card]:
    timeout_s, found = settings.reply_timeout_s, list[_Instrument | _Card]()
    if settings.generator is not None:
        found.append(_generator(settings, settings.generator))
    if settings.interlock is not None:
        said = re.compile(rb"(?P<off>OFF) [A-Z]+ \d+|ON OK \d+")
        found.append(
            _Instrument(
                make_transport(settings.interlock), timeout_s, b"STATUS?\n", [b"DISABLE\n"], said
            )
        )
    return found


def _generator(settings: WatchdogSettings, resource: str) -> _Instrument | _Card:
    kind, timeout_s = generator_kind(settings.model), settings.reply_timeout_s
    if kind.by_samples:
        return _Card(resource, timeout_s)
    off = (kind.switch_off, kind.ask_off)
    transport = make_transport(resource, visa_backend=settings.visa_backend)
    return _Instrument(transport, timeout_s, kind.ask_off, off, kind.off_answers)


def _answers(instrument: _Instrument | _Card | StageHold) -> bool:
    """Whether it says anything about its output, asked up to ASKED_AT_START times."""
    return any(instrument.ask() is not None for _ in range(ASKED_AT_START))


def wait_for_silence(
    beats: queue.Queue[bytes], period_s: float, heard: Callable[[], None] = lambda: None
) -> str:
    """Return, in words, why there are no more beats; `beats` gives BEAT, REST, or nothing at the
    end of the pipe.

    `heard` is called for each.

    The last tenth of the period is waited for apart. A busy machine may let this process sleep for
    longer than its driver was silent. The extra wait lets the listener hand over the beats that
    came meanwhile.
    """
    timeout_s = None
    while True:
        try:
            beat = beats.get(timeout=timeout_s)
        except queue.Empty:
            try:
                beat = beats.get(timeout=period_s * LAST_LOOK)
            except queue.Empty:
                return f"no beat for {period_s:g} s"
        if not beat:
            return CLOSED
        heard()
        timeout_s = None if beat == REST else period_s * (1.0 - LAST_LOOK)


class Hand:
    """A thread that switches one instrument off whenever it is asked to; it is there from the
    start.

    It waits for no other: each tries again by itself until its instrument says off or time is up.
    """

    def __init__(self, instrument: _Instrument | _Card | StageHold, retry_s: float) -> None:
        self._instrument = instrument
        self._retry_s = retry_s
        self._asked: queue.SimpleQueue[float] = queue.SimpleQueue()
        self._concluded = threading.Event()
        self._off: bool | None = None
        threading.Thread(target=self._work, name=instrument.resource, daemon=True).start()

    def begin(self, until_s: float) -> None:
        """Switch off, by `until_s` of the monotonic clock at the latest; waits for nothing."""
        self._off = None
        self._concluded.clear()
        self._asked.put(until_s)

    def said(self, until_s: float) -> bool | None:
        """What the instrument said last; waits until it says off, or time is up."""
        self._concluded.wait(max(0.0, until_s - time.monotonic()))
        return self._off

    def __str__(self) -> str:
        """What its instrument said last."""
        word = {True: "off", False: "ON", None: "nothing"}[self._off]
        return f"{self._instrument.resource} says {word}"

    def _work(self) -> None:
        while True:
            until_s = self._asked.get()
            while True:
                with suppress(BaseException):  # no memory, say: it is asked again
                    self._off = self._instrument.switch_off()
                if self._off or time.monotonic() >= until_s:
                    break
                time.sleep(self._retry_s)
            self._concluded.set()


def switch_off(hands: Sequence[Hand], settings: WatchdogSettings) -> Outcome:
    """Switch all off at the same time, until all say so or time is up; what is known at the end.

    One that says off is evidence, as each of them alone takes the voltage away.
    """
    until_s = time.monotonic() + settings.give_up_s
    for hand in hands:
        hand.begin(until_s)
    said = [hand.said(until_s) for hand in hands]
    if any(said):
        return Outcome.OFF
    return Outcome.ON if False in said else Outcome.UNKNOWN


class _Lifter:
    """Has the load stage let go, where there is one and it presses."""

    def __init__(self, stage: StageHold | None, settings: WatchdogSettings) -> None:
        self.presses = threading.Event()
        self._hand = None if stage is None else Hand(stage, settings.retry_s)
        self._until_s: float | None = None

    def begin(self) -> None:
        """Beside all others; waits for nothing."""
        if self._hand is not None and self.presses.is_set():
            self._until_s = time.monotonic() + STAGE_S
            self._hand.begin(self._until_s)

    def end(self) -> None:
        """Say whether it has let go, once it has or time is up."""
        if self._hand is not None and self._until_s is not None:
            said = self._hand.said(self._until_s)
            _log.info("load stage %s", "has let go" if said else "may still press")


def main(arguments: Sequence[str] | None = None) -> Outcome:
    """Run the process; the outcome is its exit status."""
    settings = _parse(arguments)
    for name in IGNORED:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    log = DroppingHandler()
    logging.basicConfig(
        format="%(asctime)s watchdog: %(message)s", level=logging.INFO, handlers=[log]
    )
    instruments = _instruments(settings)
    stage = None if settings.load_stage is None else StageHold(settings.load_stage)
    asked = [*instruments, *([] if stage is None else [stage])]
    silent = [instrument.resource for instrument in asked if not _answers(instrument)]
    if silent:
        print(f"{', '.join(silent)} does not answer", flush=True)
        return Outcome.NOT_STARTED
    # it has little to do, and must not wait for a machine that has too much
    with suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    hands = [Hand(instrument, settings.retry_s) for instrument in instruments]
    lifter = _Lifter(stage, settings)
    print(READY, flush=True)
    beats: queue.Queue[bytes] = queue.Queue()
    threading.Thread(target=_listen, args=(beats, lifter.presses), daemon=True).start()
    os.set_blocking(sys.stdout.fileno(), False)  # it waits for nobody who does not read
    while True:
        try:
            reason = wait_for_silence(beats, settings.period_s, lambda: _say(HEARD))
        except Exception:  # no memory, say: there is nothing left to wait with
            reason = CLOSED
        _say(SWITCHING)
        if reason == CLOSED:  # else the driver holds the stage
            lifter.begin()
        outcome = switch_off(hands, settings)
        _say(DONE)
        if hands:
            said = ", ".join(map(str, hands))
            _log.info("%s; output %s (%s)", reason, outcome.name.lower(), said)
        if reason == CLOSED or outcome is not Outcome.OFF:
            lifter.end()
            log.flush()
            return outcome


def _say(what: bytes) -> None:
    """A byte for the driver, unless it is gone or does not read."""
    with suppress(OSError):
        os.write(sys.stdout.fileno(), what)


def _listen(beats: queue.Queue[bytes], presses: threading.Event) -> None:
    """Put what comes on standard input, the newest beat of each read, and nothing at its end."""
    try:
        while received := os.read(0, 4096):
            if (PRESSED in received) or (LIFTED in received):
                last = received.rfind(PRESSED) > received.rfind(LIFTED)
                presses.set() if last else presses.clear()
            if beat := received.translate(None, PRESSED + LIFTED)[-1:]:
                beats.put(beat)
    finally:  # an input that cannot be read is at its end too
        beats.put(b"")


def _parse(arguments: Sequence[str] | None) -> WatchdogSettings:
    parser = argparse.ArgumentParser(
        prog="python -m hw.safety.watchdog", description="Switch off when the driver dies."
    )
    parser.add_argument("--generator", help="its resource, e.g. TCPIP::host::5025::SOCKET")
    parser.add_argument("--model", default=WatchdogSettings.model, help="the generator's kind")
    parser.add_argument(
        "--visa-backend",
        default=WatchdogSettings.visa_backend,
        help="what pyvisa calls its library",
    )
    parser.add_argument("--interlock", help="resource of a heartbeat interlock box")
    parser.add_argument("--load-stage", help="a load stage, as GuardedStage writes it")
    for name in ("period", "reply-timeout", "retry", "give-up"):
        default = getattr(WatchdogSettings, f"{name.replace('-', '_')}_s")
        parser.add_argument(
            f"--{name}", type=float, default=default, metavar="S", help=f"seconds; {default:g}"
        )
    given = parser.parse_args(arguments)
    try:
        settings = WatchdogSettings(
            given.generator,
            given.interlock,
            given.model,
            given.visa_backend,
            given.period,
            given.reply_timeout,
            given.retry,
            given.give_up,
            None if given.load_stage is None else GuardedStage.from_text(given.load_stage),
        )
        if settings.generator is not None:
            by_samples = generator_kind(settings.model).by_samples
            (check_name if by_samples else make_transport)(settings.generator)
        elif settings.load_stage is None:
            raise ValueError("--generator or --load-stage: there is nothing to watch")
        if settings.interlock is not None:
            make_transport(settings.interlock)
    except ValueError as error:
        parser.error(str(error))
    return settings


if __name__ == "__main__":
    sys.exit(main())
