"""Analog output for envelopes: a level that is held or a stream of samples, never longer than
someone asks for it.
"""

from __future__ import annotations

import math
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hw.errors import (
    DeviceDisconnected,
    DeviceError,
    DeviceTimeout,
    InstrumentRejected,
    LimitExceeded,
)
from hw.setting import Setting

Array = NDArray[np.float64]

QUIET_V = 0.01  # what a look at an output at 0 V may read

_LEAST_WATCH_S, _MOST_WATCH_S = 1e-3, 50e-3


class OutputUnderrun(DeviceError):  # noqa: N818 - named as its siblings in hw.errors
    """Nobody refreshed the output in time; it went to its zero level."""

    code = "output_underrun"


class CardReserved(InstrumentRejected):
    """Another program has it, one that hangs maybe; see `AnalogOutput.reset`."""

    code = "card_reserved"


@dataclass(frozen=True)
class AnalogOutputSettings:
    """What the output may do, in volts at its terminal. Raises ValueError for what cannot be.

    `zero_level_v` is the level that means no voltage at the electrode. It is NOT always 0 V.
    External AM of the 33220A's class takes -5 V..+5 V for 0..100 %, so 0 V, or an open input, is
    half the amplitude. That is stated for sibling instruments, and is not verified on the 33220A.
    No more than `buffer_s` may wait in the buffer, which bounds the delay. A held level other than
    zero ends after `lease_s` unless held again. A stream that runs dry stays at its last sample for
    `gap_s`, in which it may go on. No call takes much longer than `timeout_s`.
    """

    low_v: float
    high_v: float
    zero_level_v: float
    sample_rate_limit_hz: float
    buffer_s: float = 0.1
    lease_s: float = 0.5
    timeout_s: float = 0.5
    gap_s: float = 0.03

    def __post_init__(self) -> None:
        """Refuse what cannot be an output."""
        for name in ("sample_rate_limit_hz", "buffer_s", "lease_s", "timeout_s", "gap_s"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ValueError(
                    f"analog output {name} must be a finite number > 0, not {getattr(self, name)!r}"
                )
        if not (
            -math.inf < self.low_v <= self.zero_level_v <= self.high_v < math.inf
            and self.low_v < self.high_v
        ):
            raise ValueError(
                f"analog output needs low <= zero level <= high, not {self.low_v},"
                f" {self.zero_level_v}, {self.high_v} V"
            )


def at_zero(timeout_s: float) -> AnalogOutputSettings:
    """Of an output that is only to be taken to 0 V and held there."""
    return AnalogOutputSettings(-1e-3, 1e-3, 0.0, 1.0, timeout_s=timeout_s)


class AnalogOutput(ABC):
    """One analog output between `open` and `close`; both leave it at its zero level. Thread-safe.

    `write` streams, `hold` keeps a level, `zero` ends either. Output that is not refreshed ends. A
    stream ends some time after its last sample, or at once when that sample is the zero level. A
    held level ends with its lease. The output then goes to zero and the next `write`, `hold` or
    `check` raises OutputUnderrun, once. A stream that is written to within `gap_s` of its end goes
    on from its last sample, where the device stays meanwhile; `gaps` counts these. While zero is
    not known to have been reached it is tried again, and they keep raising what the device says. A
    thread sees to all that, unless `watched` is False and someone else calls `check`: a loop that
    writes anyway, or simulated time. It ends with the process: when that dies, what remains at the
    terminal is the device's affair, and switching off is the watchdog's.

    Implementations supply the underscored methods at the end; all run under the lock and raise
    DeviceError.
    """

    def __init__(
        self,
        resource: str,
        settings: AnalogOutputSettings,
        *,
        clock: Callable[[], float] = time.monotonic,
        watch: bool = True,
    ) -> None:
        self.resource = resource
        self.settings = settings
        self._clock = clock
        self._lock = threading.RLock()
        self._is_open = False
        self._rate_hz: float | None = None
        self._last_v: float | None = None
        self._lease_end_s = math.inf
        self._dry_s = -math.inf  # when the stream runs out of what has been written
        self.gaps = 0
        self._plays: Setting | None = None
        self._failure: DeviceError | None = None
        self._wake = threading.Event()
        self.watched = watch
        self._watcher: threading.Thread | None = None

    @property
    def level_v(self) -> float | None:
        """The level held at the terminal as far as is known; None while streaming, when closed or
        after a failure.
        """
        return self._last_v if self._is_open and self._rate_hz is None else None

    @property
    def buffered_s(self) -> float:
        """Time until the stream runs out, s; 0 when not streaming. Raises DeviceError."""
        with self._exclusive():
            return 0.0 if self._rate_hz is None else self._buffered_samples() / self._rate_hz

    def open(self) -> None:
        """Take the device and set its zero level; does nothing when open. Raises DeviceError."""
        with self._exclusive():
            if self._is_open:
                return
            try:
                self._connect()
                self._is_open, self._failure = True, None
                self._go_to_zero()
            except BaseException:
                self._is_open = False
                self._disconnect()
                raise
            if self.watched:
                self._watcher = threading.Thread(
                    target=self._watch, name=f"watch {self.resource}", daemon=True
                )
                self._watcher.start()

    def plays_at(self, sample_rate_hz: float) -> float:
        """The rate that the device gets when it is asked for one; write at that. Raises as `write`.

        Devices divide a clock by whole numbers, or run at a rate of their own.
        """
        with self._exclusive():
            self._check_open()
            self._check_limit(sample_rate_hz)
            got_hz = self._rate_got_hz(sample_rate_hz)
            self._plays = Setting("sample_rate_hz", sample_rate_hz, got_hz)
            return got_hz

    def held(self) -> list[Setting]:
        """What was asked of the device and what it got, since it was opened."""
        return [] if self._plays is None else [self._plays]

    def read_back_v(self) -> float | None:
        """The peak at the terminal by a look of the device's own; None where it has none.

        Needs no opening and changes nothing. Raises DeviceError.
        """
        return None

    def reset(self) -> None:
        """Take it from whatever program has it, and to its level at power-up. Needs no opening.

        Everything that goes on on the same device ends. Raises DeviceError, also where the device
        cannot be taken.
        """
        raise DeviceError(
            f"{self.resource}: it cannot be taken from another program", "end that program"
        )

    @property
    def latency_s(self) -> float:
        """How much later than its turn in the stream a sample is at the terminal."""
        return 0.0

    def write(self, envelope_v: ArrayLike, sample_rate_hz: float) -> None:
        """Append a block to the stream, starting it when there is none. Does not wait for the
        samples to be played.

        Raises LimitExceeded, and the stream goes on, for a sample or rate out of range or another
        rate than the stream's. It is raised too for more than fits the buffer (see `buffered_s`).
        Raises OutputUnderrun when the output fell to zero since the last call; nothing is written.
        Raises DeviceError, after going to zero, when the device fails.
        """
        block_v = _checked(self.resource, self.settings, envelope_v)
        with self._exclusive():
            self._check_open()
            self.check()  # first: a stream that has ended by now has no rate
            self._check_rate(sample_rate_hz)
            waiting = 0 if self._rate_hz is None else self._buffered_samples()
            if (waiting + block_v.size) / sample_rate_hz > self.settings.buffer_s * (1.0 + 1e-9):
                raise LimitExceeded(
                    f"{self.resource}: {block_v.size} samples more than the {waiting} waiting do"
                    f" not fit its buffer of {self.settings.buffer_s:g} s",
                    "write smaller blocks, or later",
                )
            with self._zero_on_failure():
                if waiting:
                    self._append(block_v)
                else:  # none yet, or one that has just run dry
                    self.gaps += self._rate_hz is not None
                    # unknown until done: an interrupt must not leave a stream that nobody watches
                    self._last_v = None
                    self._wake.set()  # a stream that goes on is looked at before it ends anyway
                    self._start(block_v, sample_rate_hz)
                self._rate_hz, self._last_v = sample_rate_hz, float(block_v[-1])
                self._dry_s = self._clock() + (waiting + block_v.size) / sample_rate_hz

    def hold(self, level_v: float) -> None:
        """Hold a level from now on, in place of a stream, for `lease_s`; at zero for ever. Raises
        as `write` does.
        """
        level = float(_checked(self.resource, self.settings, [level_v])[0])
        with self._exclusive():
            self._check_open()
            self.check()
            self._wake.set()
            with self._zero_on_failure():
                self._hold(level)

    def zero(self) -> None:
        """Go to the zero level now, whatever is waiting. Raises DeviceError when that is not known
        to have happened.
        """
        with self._exclusive():
            self._check_open()
            self._go_to_zero()

    def check(self) -> None:
        """Raise what happened since the last call: OutputUnderrun, or the device's failure. Never
        waits for samples.
        """
        with self._exclusive():
            self._expire()
            failure, self._failure = self._failure, None
            if failure is not None:
                raise failure

    def close(self) -> None:
        """Go to zero and release the device; does nothing when closed.

        Raises DeviceError, after releasing it, when the output is not known to be at zero.
        """
        with self._exclusive():
            if not self._is_open:
                return
            try:
                self._go_to_zero()
            finally:
                self._is_open = False
                self._disconnect()
                self._wake.set()

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *reason: object) -> None:
        """Close, whatever the reason."""
        self.close()

    def _rate_got_hz(self, sample_rate_hz: float) -> float:
        """What the device makes of a rate."""
        return sample_rate_hz

    def _check_rate(self, sample_rate_hz: float) -> None:
        if self._plays is None or sample_rate_hz != self._plays.got:
            self._check_limit(sample_rate_hz)
        if self._rate_hz is not None and sample_rate_hz != self._rate_hz:
            raise LimitExceeded(
                f"{self.resource} streams at {self._rate_hz:g} samples/s, not {sample_rate_hz:g}",
                "end the stream with zero() or hold() first",
            )

    def _check_limit(self, sample_rate_hz: float) -> None:
        if not 0.0 < sample_rate_hz <= self.settings.sample_rate_limit_hz:
            raise LimitExceeded(
                f"{self.resource}: {sample_rate_hz:g} samples/s is outside its range, up to "
                f"{self.settings.sample_rate_limit_hz:g}",
                "choose a rate within it",
            )

    def _check_open(self) -> None:
        if not self._is_open:
            raise DeviceDisconnected(f"{self.resource} is not open", "call open() first")

    def _hold(self, level_v: float) -> None:
        self._rate_hz, self._last_v, self._lease_end_s = None, None, math.inf  # unknown until done
        self._set_level(level_v)
        self._last_v = level_v
        at_zero = level_v == self.settings.zero_level_v
        self._lease_end_s = math.inf if at_zero else self._clock() + self.settings.lease_s

    def _go_to_zero(self) -> None:
        self._hold(self.settings.zero_level_v)

    def _expire(self) -> None:
        """Go to zero when what is at the output was not refreshed; keep what happened for `check`.
        Never raises.
        """
        if not self._is_open:
            return
        try:
            if self._rate_hz is None:
                if self._last_v is None:
                    self._fall_to_zero(None)  # failed before: try again
                elif self._clock() > self._lease_end_s:
                    self._fall_to_zero(
                        self._underrun(
                            f"held {self._last_v:g} V beyond {self.settings.lease_s:g} s"
                        )
                    )
            elif self._buffered_samples() == 0:
                if self._last_v == self.settings.zero_level_v:
                    self._fall_to_zero(None)
                elif self._clock() > self._dry_s + self.settings.gap_s:
                    self._fall_to_zero(self._underrun("ran out of samples"))
        except DeviceError as error:
            self._fall_to_zero(error)

    def _fall_to_zero(self, why: DeviceError | None) -> None:
        try:
            self._go_to_zero()
        except DeviceError as error:
            before = "" if why is None else f"; before that: {why.message}"
            why = type(error)(
                f"{error.message}; the output is NOT known to be at zero{before}", error.hint
            )
        self._failure = self._failure or why

    def _underrun(self, what: str) -> OutputUnderrun:
        return OutputUnderrun(
            f"{self.resource} {what} and went to zero", "refresh it sooner, or buffer more"
        )

    @contextmanager
    def _zero_on_failure(self) -> Iterator[None]:
        try:
            yield
        except DeviceError as error:
            self._fall_to_zero(error)
            failure, self._failure = self._failure, None
            raise (failure or error) from error

    @contextmanager
    def _exclusive(self) -> Iterator[None]:
        if not self._lock.acquire(timeout=self.settings.timeout_s):
            raise DeviceTimeout(
                f"{self.resource} has been busy for {self.settings.timeout_s:g} s", "try again"
            )
        try:
            yield
        finally:
            self._lock.release()

    def _watch(self) -> None:
        while self._is_open and self._watcher is threading.current_thread():
            busy = self._last_v is None or self._rate_hz is not None or self._lease_end_s < math.inf
            self._wake.wait(self._next_look_s() if busy else None)
            self._wake.clear()
            with (
                suppress(DeviceTimeout),
                self._exclusive(),
            ):  # busy: whoever is in there checks as well
                self._expire()

    def _next_look_s(self) -> float:
        left_s = self._lease_end_s - self._clock()
        with suppress(DeviceError):
            left_s = self.buffered_s if self._rate_hz is not None else left_s
        return min(max(left_s, _LEAST_WATCH_S), _MOST_WATCH_S)

    @abstractmethod
    def _connect(self) -> None:
        """Take the device."""

    @abstractmethod
    def _disconnect(self) -> None:
        """Release the device, if taken; never raises."""

    @abstractmethod
    def _set_level(self, level_v: float) -> None:
        """Put out a constant level now; ends a stream, dropping what is waiting."""

    @abstractmethod
    def _start(self, block_v: Array, sample_rate_hz: float) -> None:
        """Begin a stream with its first block, also after one that ran dry."""

    @abstractmethod
    def _append(self, block_v: Array) -> None:
        """Add a block to the stream; there is room for it, and some of it is still to be played."""

    @abstractmethod
    def _buffered_samples(self) -> int:
        """Samples of the stream that are still to be played; 0 also when the device says that it
        ran dry.
        """


def _checked(resource: str, settings: AnalogOutputSettings, values_v: ArrayLike) -> Array:
    # a copy: the device may read it after the caller has moved on
    block_v = np.array(values_v, dtype=np.float64)
    if block_v.ndim != 1 or block_v.size == 0:
        raise LimitExceeded(
            f"{resource}: an envelope is one row of samples, not of shape {block_v.shape}",
            "give one row of at least one sample",
        )
    inside = (block_v >= settings.low_v) & (block_v <= settings.high_v)
    if not inside.all():
        worst_v = block_v[~inside][0]
        raise LimitExceeded(
            f"{resource}: {worst_v:g} V is outside its {settings.low_v:g}..{settings.high_v:g} V",
            "lower the target, or the limits are not those of this rig",
        )
    return block_v
