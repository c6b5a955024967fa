"""Switch render to the surface of a refitted model, and back to the model as its file has it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from enum import Enum, auto
from math import inf
from typing import NamedTuple

from haptic_driver.lookup.file import SurfaceFile

TOLD_S = 60.0  # between events of refits without success
NOTHING_YET = "no refit yet"

Install = Callable[[SurfaceFile, Callable[[], bool]], bool]
"""Gives render a surface, unless the question passed with it answers that it is too late."""


class Word(Enum):
    """The orders to whoever refits: whether to, and the surface that render uses from here on."""

    ADAPT = auto()
    REST = auto()
    TAKEN = auto()  # the one that was proposed last
    BASE = auto()  # the model's own


class Proposal(NamedTuple):
    """The result of a refit, in words; with a better model its surface, its numbers and the windows
    it came from.
    """

    said: str
    surface: SurfaceFile | None = None
    numbers: dict[str, float] | None = None
    rows: Sequence[Sequence[float]] = ()


class Swap:
    """By which surface render goes, of one model; thread-safe. `base` is the model's own.

    `said` is the result of the last refit, None while there is none. `tell` makes an event, `send`
    reaches whoever refits. Nothing is swapped once `ending` is set.
    """

    def __init__(
        self,
        base: SurfaceFile,
        install: Install,
        tell: Callable[..., object],
        send: Callable[[Word], object],
        said: str | None = None,
    ) -> None:
        self.said = said
        self.ending = threading.Event()
        self._base, self._install, self._tell, self._send = base, install, tell, send
        self._is_swapped = False
        self._told_s = -inf
        self._lock = threading.RLock()

    def adapt(self, on: bool) -> None:
        """Refit the model from now on, or restore it."""
        with self._lock:
            self.said = (self.said or NOTHING_YET) if on else None
            self._send(Word.ADAPT if on else Word.REST)
            if not on:
                self.back()

    def back(self) -> bool:
        """Whether render goes by the model's own surface now, which is an event."""
        with self._lock:
            if self._is_swapped and self._install(self._base, self.ending.is_set):
                self._is_swapped = False
                self._send(Word.BASE)
                surface_hash = self._base.content_hash
                self._tell("adapt", "back to the model as it was", surface_hash=surface_hash)
            return not self._is_swapped

    def take(self, proposal: Proposal) -> None:
        """Let render take up what is proposed, unless refits have been switched off."""
        said, surface, numbers, rows = proposal
        with self._lock:
            if self.said is None:
                return
            news, self.said = said != self.said, said
            if surface is None:
                if news and time.monotonic() - self._told_s > TOLD_S:
                    self._told_s = time.monotonic()
                    self._tell("adapt", f"no refit: {said}")
            elif self._install(surface, self.ending.is_set):
                self._is_swapped = True
                self._send(Word.TAKEN)
                told = {"surface_hash": surface.content_hash, "model": numbers, "rows": rows}
                self._tell("adapt", f"refitted: {said}", **told)
