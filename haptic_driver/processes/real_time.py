"""What makes a loop keep its time: scheduling, locked memory, absolute deadlines. Linux; elsewhere
nothing is had.
"""

from __future__ import annotations

import ctypes
import errno
import gc
import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

NICENESS = -10  # of control: weighs ten times an ordinary process
LEAST = 19  # niceness of who works when nobody else does
SWITCH_INTERVAL_S = 5e-4  # of the interpreter's threads; 5 ms where nobody asks
RUNAWAY_S = 1.0
PRIORITY = 80  # of SCHED_FIFO, above threaded interrupt handlers (50)
BEFORE_RENDER = PRIORITY + 1  # for a short turn: render waits awake
LEAST_PRIORITY = 1  # of SCHED_FIFO: before all that is not in real time
# Of Python's search for garbage: new objects before one, such before a longer one, and those before
# one of everything. The last is 10 by default: that one stops all threads for 10 ms and more.
SEARCHES = 700, 10, 1000
SPIN_S = 260e-6  # longer than most wake-ups and a rehearsal take; it costs 26 % of a core
FIRST_REHEARSAL_S = 180e-6  # longer than one takes that has everything to fetch from memory
REHEARSAL_S = 110e-6  # longer than one takes that follows
_LOCK_CURRENT, _LOCK_FUTURE = 1, 2
_TIMER_ABSTIME = 1
_BILLION = 1_000_000_000

_libc: Any = ctypes.CDLL(None, use_errno=True) if os.name == "posix" else None


class RealTime(NamedTuple):
    """What was granted to this process, and in words why not the rest."""

    scheduled: bool
    refused: str

    def metronome(self, period_s: float, number: int = 0) -> Metronome:
        """A metronome as good as what was granted."""
        return Metronome(period_s, number, spin_s=SPIN_S if self.scheduled else 0.0)


def enter(priority: int = PRIORITY) -> RealTime:
    """Ask for real-time scheduling and locked memory; keep the processor awake while this process
    lives.

    The kernel kills it when it computes for `RUNAWAY_S` without a pause: on that priority nobody
    else could.
    """
    refused = []
    with suppress(ImportError, OSError, ValueError):
        import resource  # noqa: PLC0415 - not on Windows

        resource.setrlimit(resource.RLIMIT_RTTIME, (round(1e6 * RUNAWAY_S),) * 2)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        scheduled = True
    except (OSError, AttributeError) as error:
        scheduled = False
        refused.append(
            f"SCHED_FIFO {priority}: {error}; allow it with LimitRTPRIO={priority} or"
            " /etc/security/limits"
        )
    if _libc.mlockall(_LOCK_CURRENT | _LOCK_FUTURE) != 0:
        refused.append(
            f"mlockall: {os.strerror(ctypes.get_errno())}; allow it with LimitMEMLOCK=infinity"
        )
    _stay_awake()
    return RealTime(scheduled, "; ".join(refused))


def take_precedence() -> bool:
    """Ask for more of a busy processor for this thread and whatever it starts from now on; whether
    that was granted.

    Without it a loaded machine may not let control say in time that it is alive. Threads of this
    process get shorter turns besides: one that serves the API keeps the pump waiting for so long.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    try:
        os.setpriority(os.PRIO_PROCESS, 0, min(NICENESS, os.getpriority(os.PRIO_PROCESS, 0)))
    except (OSError, AttributeError):
        return False
    # as a service: Linux shares a busy processor among sessions first
    if os.getsid(0) == os.getpid():
        with suppress(OSError):
            Path("/proc/self/autogroup").write_text(str(NICENESS))
    return True


def go_first(*, with_its_own: bool = False) -> bool:
    """Put this thread before all that is not in real time; whether that was granted.

    What it starts is ordinary again, or with it where it is `with_its_own`. Niceness alone lets a
    busy machine keep a thread waiting for a tenth of a second and more.
    """
    try:
        kept = 0 if with_its_own else os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(0, os.SCHED_FIFO | kept, os.sched_param(LEAST_PRIORITY))
    except (OSError, AttributeError):
        return False
    return True


def give_way() -> None:
    """Let everybody else go first, from here on; in a session of its own, which has the share of
    any, or it starved.
    """
    with suppress(OSError, AttributeError):
        os.setpriority(os.PRIO_PROCESS, 0, LEAST)
        os.setpgid(0, os.getpgid(os.getppid()))  # who leads a group cannot begin a session
        os.setsid()


def _stay_awake() -> None:
    """No deep idle states: the kernel takes the wish for as long as this file is open."""
    with suppress(OSError):
        descriptor = os.open("/dev/cpu_dma_latency", os.O_WRONLY | os.O_CLOEXEC)
        os.write(descriptor, (0).to_bytes(4, "little"))


def settle_memory() -> None:
    """Look for garbage only among what is made from here on, often, and so for a short time.

    A search of all that a process has imported stops its threads for a third of a second.
    """
    gc.freeze()
    gc.set_threshold(*SEARCHES)


def never_collect() -> None:
    """Look for no garbage from here on."""
    gc.collect()
    gc.disable()


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


def sleep_until(time_s: float) -> None:
    """Sleep until CLOCK_MONOTONIC says `time_s`; returns at once when that is past."""
    until_ns = int(time_s * _BILLION)
    until = _Timespec(until_ns // _BILLION, until_ns % _BILLION)
    while (
        _libc.clock_nanosleep(time.CLOCK_MONOTONIC, _TIMER_ABSTIME, ctypes.byref(until), None)
        == errno.EINTR
    ):
        pass  # a signal came


class Due(NamedTuple):
    """One instant that is there: its number, when it was due, how late it is, how many before it
    were missed.
    """

    number: int
    due_s: float
    lateness_s: float
    missed: int


class Metronome:
    """Instants `period_s` apart. Those that are missed are counted and left out, never made up for
    in a burst.

    Numbers go on from `number`, which is that of `began_s`: now, unless another time is given. The
    last `spin_s` before an instant are waited for awake: waking up takes tens of microseconds,
    which is then over when it comes.
    """

    def __init__(
        self,
        period_s: float,
        number: int = 0,
        *,
        spin_s: float = 0.0,
        began_s: float | None = None,
        clock: Callable[[], float] = time.monotonic,
        sleep_until: Callable[[float], None] = sleep_until,
    ) -> None:
        self.period_s = period_s
        self._clock = clock
        self._sleep_until = sleep_until
        self._spin_s = spin_s
        self._began_s = clock() if began_s is None else began_s
        self._number = self._first = number

    def wait(self, rehearse: Callable[[Due], object] | None = None) -> Due:
        """Return at the next instant, or at once when it is there already and the one after it is
        not.

        `rehearse` is called while awake before an instant, as often as there is time for it;
        without it nobody is awake before.
        """
        number = self._number + 1
        due_s = self._began_s + (number - self._first) * self.period_s
        now_s = self._clock()
        missed = max(int((now_s - due_s) / self.period_s), 0)
        if missed:
            number, due_s = number + missed, due_s + missed * self.period_s
        if now_s < due_s:
            self._sleep_until(due_s - self._spin_s if rehearse is not None else due_s)
            needed_s = FIRST_REHEARSAL_S
            while rehearse is not None and due_s - self._clock() > needed_s:
                rehearse(Due(number, due_s, 0.0, 0))
                needed_s = REHEARSAL_S
            while (now_s := self._clock()) < due_s:
                pass
        self._number = number
        return Due(number, due_s, now_s - due_s, missed)
