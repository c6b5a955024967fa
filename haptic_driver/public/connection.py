"""A running daemon, in the words of an experiment."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from pydantic import JsonValue

from haptic_driver.client import LEASE_S, HapticClient, Session
from haptic_driver.daemon.messages import RefusedError, Status
from haptic_driver.daemon.scene import Scene
from haptic_driver.errors import require_range
from haptic_driver.lookup import labelled
from haptic_driver.pictures.friction_pictures import draw_ticks
from haptic_driver.public.picture import Picture


class Rig:
    """The rig of a running daemon; inside `armed()` it renders.

    Raises BadInputError for what cannot be used, RefusedError for what the present state forbids,
    NoDaemonError when nobody answers, HapticError for a fault. `client` has every verb.
    """

    def __init__(self, client: HapticClient) -> None:
        self.client = client
        self._session: Session | None = None

    @contextmanager
    def armed(self, lease_s: float = LEASE_S) -> Iterator[Self]:
        """Arm in the block. At its end, however it ends, the output is off, or an error says so."""
        with self.client.armed(lease_s) as session:
            self._session = session
            try:
                yield self
            finally:
                self._session = None

    @contextmanager
    def record(self, path: Path | str) -> Iterator[Path]:
        """Record into a file in the block; `read_recording` reads it."""
        asked = self._session or self.client
        asked.record(Path(path))
        try:
            yield Path(path)
        finally:
            asked.record(None)

    def set_friction(self, cof: float, nearest: bool = False) -> Status:
        """Render one friction everywhere; with `nearest`, what comes nearest to it in reach."""
        return self._asked().set(cof, nearest)

    def play(self, texture: str, nearest: bool = False) -> Status:
        """Render a texture, by its name or the path of its file."""
        return self._asked().play(texture, nearest)

    def hold_load(self, newtons: float) -> Status:
        """Have the load stage press, and hold so much; returns while it comes."""
        return self._asked().hold_load(newtons)

    def release_load(self) -> Status:
        """Have the load stage let go."""
        return self.client.release_load()

    @property
    def scene(self) -> Scene:
        """The objects on the screen, which may be added, moved, turned, changed and removed."""
        return self._asked().scene

    def measured_friction(self, average_s: float = 2.0) -> float:
        """Mean lateral over mean normal force of sliding in the newest `average_s`, at most 2 s.

        The lateral force counts by its amount. NaN where no finger slid meanwhile.
        """
        require_range("average", average_s, 0.01, 2.0, unit=" s")
        ticks = self.client.samples(most=2000)
        recent = ticks["time_s"] >= ticks["time_s"].max(initial=-math.inf) - average_s
        slides = ticks[recent & np.isfinite(ticks["measured_cof"])]
        normal_n = float(np.sum(slides["normal_force_n"]))
        return float(np.sum(np.abs(slides["lateral_force_n"]))) / normal_n if normal_n else math.nan

    def mark(self, label: str, **data: JsonValue) -> None:
        """Put a text into the recording, at its time."""
        self.client.mark(label, data)

    def plot(self, most: int = 2000) -> Picture:
        """Friction asked and measured over the newest ticks."""
        ticks = self.client.samples(most=most)
        return Picture(lambda path: draw_ticks(ticks, path))

    def to_frame(self, most: int = 1000) -> Any:
        """The newest ticks, as a pandas DataFrame. HapticError where pandas is not installed."""
        ticks = self.client.samples(most=most)
        return labelled.frame({name: ticks[name] for name in ticks.dtype.names or ()}, {})

    def status(self) -> Status:
        """What the daemon does now."""
        return self.client.status()

    def off(self) -> Status:
        """Output to zero at once. HapticError where it cannot be shown to be off."""
        return self.client.off()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.client.close()

    def _asked(self) -> Session:
        """The session of `armed()`, whose lease rendering needs."""
        if self._session is None:
            raise RefusedError("not_armed", "the rig is not armed", "Use: with rig.armed():")
        return self._session


def connect(socket: Path | str | None = None) -> Rig:
    """Connect to a running daemon, by its socket or page, or where it usually is.

    NoDaemonError when nobody answers there; it says how to start one.
    """
    return Rig(HapticClient(socket))
