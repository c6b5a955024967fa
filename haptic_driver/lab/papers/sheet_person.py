"""A person who slides for a data sheet, guided pass by pass, on a daemon that renders."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from haptic_driver.client import new_samples
from haptic_driver.errors import HapticError
from haptic_driver.files import write_rows
from haptic_driver.lab.papers.sheet_numbers import settled
from haptic_driver.lab.papers.sheet_passes import NEVER, Pass
from haptic_driver.render.texture import Profile, Script, Uniform

if TYPE_CHECKING:
    from haptic_driver.client import HapticClient, Session

READY_S = 0.5  # so long a finger slides as asked before a pass begins
PATIENCE_S = 60.0  # with a finger that does not come or leave
TRIES = 3
TOLERANCE = 0.3  # of load and speed, by which a person may differ from what was asked


class GuidedSlider:
    """See `Slider`. `tell` shows the person what to do; files are written into `folder`.

    `clock` is that of the samples, `sleep` waits on it.
    """

    def __init__(
        self,
        client: HapticClient,
        session: Session,
        folder: Path,
        tell: Callable[[str], object],
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._client = client
        self._session = session
        self._folder = folder
        self._tell = tell
        self._clock = clock
        self._sleep = sleep
        self._number = 0

    def slide(self, asked: Pass) -> NDArray[np.void]:
        """See `Slider`; again where load or speed were others. The output is off afterwards."""
        self._number += 1
        try:
            for _ in range(TRIES):
                samples = self._once(asked)
                if _is_as_asked(samples, asked):
                    return samples
        finally:
            self._session.off()
        raise HapticError(
            "not_as_asked",
            f"pass {self._number}: load or speed were not within {TOLERANCE:.0%} of what was asked",
            f"Slide with {_asked(asked)}; a stage or a metronome helps",
        )

    def _once(self, asked: Pass) -> NDArray[np.void]:
        self._session.off()
        self._tell(f"pass {self._number}: lift the finger")
        self._await(lambda new: not new["in_contact"][-1])
        self._session.set(NEVER, nearest=True)
        self._tell(f"pass {self._number}: slide back and forth along x with {_asked(asked)}")
        self._await(lambda new: _is_as_asked(new, asked))
        began_s = self._clock()
        self._play(asked)
        found: list[NDArray[np.void]] = []
        for new in self._new():
            found.append(new[new["time_s"] >= began_s])
            if new["time_s"][-1] >= began_s + asked.duration_s:
                break
        return np.concatenate(found)

    def _play(self, asked: Pass) -> None:
        target, path = asked.target, self._folder / f"pass-{self._number}.csv"
        if isinstance(target, Uniform):
            self._session.set(target.cof, nearest=True)
            return
        write_rows(path, _rows(target))
        self._session.play(str(path), nearest=True)

    def _await(self, is_there: Callable[[NDArray[np.void]], bool]) -> None:
        """Until the newest half second is as wanted; HapticError when it is not in time."""
        until_s = self._clock() + PATIENCE_S
        recent: NDArray[np.void] | None = None
        for new in self._new():
            recent = new if recent is None else np.concatenate([recent, new])
            recent = recent[recent["time_s"] >= recent["time_s"][-1] - READY_S]
            if recent["time_s"][-1] - recent["time_s"][0] > 0.9 * READY_S and is_there(recent):
                return
            if self._clock() > until_s:
                break
        said = f"pass {self._number}: the finger did not do so in {PATIENCE_S:g} s"
        raise HapticError("finger_missed", said, "Look at force sensor and finger tracker")

    def _new(self) -> Iterator[NDArray[np.void]]:
        return new_samples(self._client.samples, PATIENCE_S, self._clock, self._sleep)


def _asked(asked: Pass) -> str:
    return f"{asked.normal_force_n:g} N at {1e3 * asked.speed_m_s:g} mm/s"


def _is_as_asked(samples: NDArray[np.void], asked: Pass) -> bool:
    """Whether the median load and speed of sliding are near what was asked."""
    slides = samples["in_contact"] == 1
    if np.count_nonzero(slides) < 0.5 * samples.size or not settled(samples).any():
        return False
    load_n, speed_m_s = (
        float(np.median(samples[name][slides])) for name in ("normal_force_n", "speed_m_s")
    )
    return (
        abs(load_n / asked.normal_force_n - 1.0) <= TOLERANCE
        and abs(speed_m_s / asked.speed_m_s - 1.0) <= TOLERANCE
    )


def _rows(target: object) -> list[dict[str, str | float]]:
    """A profile or a script as the daemon reads it."""
    if isinstance(target, Profile):
        pairs = zip(target.position_m, target.cof, strict=True)
        return [{"position_mm": 1e3 * x, "cof": cof} for x, cof in pairs]
    assert isinstance(target, Script)  # passes ask for no other kind
    return [
        {
            "time_s": step.time_s,
            "cof": step.texture.bounds()[0],
            "interpolation": step.interpolation,
        }
        for step in target.steps
    ]
