"""The states of a rig's output, what moves it from one to another, and the right to raise the
voltage.
"""

from __future__ import annotations

import enum
import logging
import math
import threading
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

EVENTS_KEPT = 1000

_log = logging.getLogger(__name__)


class RigState(enum.Enum):
    """What is known of the output; UNKNOWN is never to be shown as off."""

    OFF = "off"
    ON = "on"
    TRIPPED = "tripped"
    UNKNOWN = "unknown"


class Output(enum.Enum):
    """The same in more detail: whether it may be on, and whether a trip has been shown to be
    off.
    """

    OFF = enum.auto()
    STARTING = enum.auto()
    ON = enum.auto()
    UNKNOWN = enum.auto()
    TRIPPED = enum.auto()
    TRIPPED_UNKNOWN = enum.auto()

    @property
    def may_be_on(self) -> bool:
        """Whether it has been switched on, or begun to be, and not off since."""
        return self in (Output.STARTING, Output.ON)

    @property
    def shown_off(self) -> bool:
        """Whether there is evidence that it is off."""
        return self in (Output.OFF, Output.TRIPPED)


class Happening(enum.Enum):
    """What changes it."""

    STARTS = enum.auto()
    CAME_ON = enum.auto()
    LAPSED = enum.auto()
    SHOWN_OFF = enum.auto()
    NOT_SHOWN_OFF = enum.auto()
    TRIPS = enum.auto()
    RESET = enum.auto()


_OFF, _STARTING, _ON, _UNKNOWN, _TRIPPED, _TRIPPED_UNKNOWN = Output
_MOVES = {
    Happening.STARTS: {_OFF: _STARTING, _UNKNOWN: _STARTING},
    Happening.CAME_ON: {_STARTING: _ON},
    Happening.LAPSED: {_STARTING: _UNKNOWN, _ON: _UNKNOWN},
    Happening.SHOWN_OFF: {_STARTING: _OFF, _ON: _OFF, _UNKNOWN: _OFF, _TRIPPED_UNKNOWN: _TRIPPED},
    Happening.NOT_SHOWN_OFF: {
        _OFF: _UNKNOWN,
        _STARTING: _UNKNOWN,
        _ON: _UNKNOWN,
        _TRIPPED: _TRIPPED_UNKNOWN,
    },
    Happening.TRIPS: {
        _OFF: _TRIPPED,
        _STARTING: _TRIPPED_UNKNOWN,
        _ON: _TRIPPED_UNKNOWN,
        _UNKNOWN: _TRIPPED_UNKNOWN,
    },
    Happening.RESET: {_TRIPPED: _OFF},
}
_SHOWN = {
    _OFF: RigState.OFF,
    _STARTING: RigState.UNKNOWN,
    _ON: RigState.ON,
    _UNKNOWN: RigState.UNKNOWN,
    _TRIPPED: RigState.TRIPPED,
    _TRIPPED_UNKNOWN: RigState.TRIPPED,
}


class RigEvent(NamedTuple):
    """One change of state, on the caller's clock (NaN before its first command), and why."""

    time_s: float
    state: RigState
    reason: str


class OutputStates:
    """Where the output is. A (state, event) pair outside the table leaves the state unchanged.

    Every change that `RigState` shows is logged, kept in `events` (the last 1000), and passed to
    `on_event`. A tripped output that is not shown to be off any more counts as UNKNOWN. Starting
    is reported when it is over. `now_s` is the time of the caller's newest command.
    """

    def __init__(self, on_event: Callable[[RigEvent], None]) -> None:
        self.output = Output.UNKNOWN
        self.events: deque[RigEvent] = deque(maxlen=EVENTS_KEPT)
        self.now_s = math.nan
        self.trip_reason: str | None = None
        self._told: Output | None = None
        self._on_event = on_event
        self._changing = threading.Lock()

    @property
    def shown(self) -> RigState:
        """What is known of the output now; a trip outlasts everything but its reset."""
        return _SHOWN[self.output]

    def happens(self, what: Happening, reason: str) -> None:
        """Move on. The first reason of a trip is kept until it is reset."""
        with self._changing:
            before, self.output = self.output, _MOVES[what].get(self.output, self.output)
            told = self._told
            if self.output is not _STARTING:
                self._told = self.output
            is_lost = (told, self._told) == (_TRIPPED, _TRIPPED_UNKNOWN)
            is_told = self._told is not told and (
                is_lost or told is None or _SHOWN[told] is not self.shown
            )
            if self.shown is not RigState.TRIPPED:
                self.trip_reason = None
            elif _SHOWN[before] is not RigState.TRIPPED:
                self.trip_reason = reason
            state = RigState.UNKNOWN if is_lost else self.shown
            event = RigEvent(self.now_s, state, reason)
            if is_told:
                self.events.append(event)
        if is_told:
            level = logging.INFO if event.state in (RigState.ON, RigState.OFF) else logging.WARNING
            _log.log(level, "%s: %s", event.state.value, reason)
            try:
                self._on_event(event)
            except Exception:  # who listens keeps nobody from switching off
                _log.exception("an event of the rig could not be reported")


class Withdrawn(Exception):  # noqa: N818 - an event: somebody switched off while this thread was switching on
    """The right to raise the voltage is gone."""


class Permit(NamedTuple):
    """The right to raise the voltage, until anybody switches off."""

    withdrawals: Withdrawals
    number: int

    def check(self) -> None:
        """Raise Withdrawn when somebody has switched off since this was given, or is at it."""
        if self.number != self.withdrawals.begun:
            raise Withdrawn


class Withdrawals:
    """Counts who switches off, so that nobody who switches on needs to be waited for."""

    def __init__(self) -> None:
        self.begun = self._ended = 0
        self._counting = threading.Lock()

    @property
    def under_way(self) -> bool:
        """Whether somebody is switching off."""
        return self.begun != self._ended

    def permit(self) -> Permit:
        """A permit; worth nothing while somebody is switching off."""
        return Permit(self, self._ended)

    def begin(self) -> None:
        """Somebody switches off: every permit ends here."""
        with self._counting:
            self.begun += 1

    def end(self) -> None:
        """It is off, or known not to be."""
        with self._counting:
            self._ended += 1
