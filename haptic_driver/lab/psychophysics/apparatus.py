"""The rig as an experiment sees it, through the daemon's client: what is presented, and what was
felt of it.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from haptic_driver.client import new_samples
from haptic_driver.config import texture_dirs
from haptic_driver.daemon.messages import LoadPhase
from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.files import write_text
from haptic_driver.lab.psychophysics.delivery import (
    NO_ONSET,
    Delivered,
    Onsets,
    felt,
    onsets,
    strokes,
)
from haptic_driver.lab.psychophysics.description import Experiment, Stimulus, TrialSettings
from haptic_driver.rig.load_loop import settled
from haptic_driver.textures.description import FINEST_MM
from haptic_driver.textures.library import load
from model.support.errors import nearest
from model.support.reading import read_bytes

if TYPE_CHECKING:
    from haptic_driver.client import HapticClient, Session

TAKEN_AWAY = ("state", "lease", "fault")  # events that may mean that nobody is armed any more
SILENT_S = 3.0  # without a new sample the daemon has stopped
PRESSED_S = 60.0  # a stage that takes longer to hold a load has stopped
POLL_S = 0.05
SCREEN_MM = 2000.0  # larger than any screen


class Apparatus(Protocol):
    """Presents the intervals of a trial; `onset` is of the last one."""

    onset: Onsets

    def present(
        self, stimuli: Sequence[Stimulus], settings: TrialSettings, settle_s: float
    ) -> list[Delivered]:
        """What was felt in each; the output is off afterwards."""

    def mark(self, label: str, data: dict[str, Any]) -> float:
        """Write a marker; its time on the clock of the recording, s."""


class DaemonApparatus:
    """A rig through an armed client.

    `folder`: where textures that show two regions are written. `tell` gets which interval runs and
    when to wait, and `ring` sounds as one begins, where the file says so. Each interval has markers
    `interval 1 begins` and `interval 1 ends`; the second carries its onsets.
    """

    def __init__(
        self,
        client: HapticClient,
        session: Session,
        folder: Path,
        tell: Callable[[str], object] = lambda said: None,
        ring: Callable[[], object] = lambda: None,
    ) -> None:
        self.onset = NO_ONSET
        self._client = client
        self._session = session
        self._folder = folder.absolute()
        self._tell, self._ring = tell, ring

    def mark(self, label: str, data: dict[str, Any]) -> float:
        """A marker of the daemon's."""
        return float(self._client.mark(label, data).time_s)

    def present(
        self, stimuli: Sequence[Stimulus], settings: TrialSettings, settle_s: float
    ) -> list[Delivered]:
        """One after the other, or both at once. HapticError when the output went away meanwhile."""
        if settings.place == "regions":
            return self._regions(stimuli, settings, settle_s)
        found, count = [], len(stimuli)
        for number, stimulus in enumerate(stimuli, start=1):
            if number > 1:
                self._tell("wait …")
                time.sleep(settings.pause_s)
            samples = self._interval(stimulus, settings, number, count)
            found.append(felt(samples, settle_s=settle_s))
        return found

    def _regions(
        self, stimuli: Sequence[Stimulus], settings: TrialSettings, settle_s: float
    ) -> list[Delivered]:
        left, right = (s.cof for s in stimuli)
        assert left is not None  # regions are of frictions alone
        assert right is not None
        path = self._folder / "regions.csv"
        write_text(path, _halves(left, right, settings.middle_mm))
        samples = self._interval(Stimulus(None, str(path)), settings, 1, 1)
        is_left = samples["position_x_m"] < 1e-3 * settings.middle_mm
        return [felt(samples, where, settle_s) for where in (is_left, ~is_left)]

    def _interval(
        self, stimulus: Stimulus, settings: TrialSettings, number: int, count: int
    ) -> NDArray[np.void]:
        """Present one of `count`, say so, and mark its ends; its samples."""
        if settings.load_n is not None:
            self._tell("the stage presses …")
            self._press(settings.load_n)
        which: dict[str, Any] = {"interval": number, "of": count, "sound": settings.sound}
        began = self._client.mark(f"interval {number} begins", which)
        self._begin(stimulus)
        self._tell(f"{number} … slide now" if count > 1 else "slide now")
        if settings.sound:
            self._ring()
        samples = self._samples(settings, began.number)
        when = onsets(samples)
        ended = which | {"began_s": began.time_s} | when._asdict()
        self.mark(f"interval {number} ends", ended)
        self.onset = when
        return samples

    def _press(self, load_n: float) -> None:
        """Have the load stage hold a load, which it lets go at the interval's end with the output.

        HapticError where it does not come to hold it.
        """
        said, until_s = str(self._session.hold_load(load_n).load), time.monotonic() + PRESSED_S
        while time.monotonic() < until_s:
            load = self._client.status().load
            if load is None or load.target_n != load_n:
                break
            said = str(load)
            held_n = load.load_n if load.phase is LoadPhase.HOLD else None
            if held_n is not None and settled(held_n, load_n):
                return
            time.sleep(POLL_S)
        hint = "Look at haptic status; try the same load by haptic load hold"
        raise HapticError("load_let_go", f"{load_n:g} N was not held: {said}", hint)

    def _begin(self, stimulus: Stimulus) -> None:
        """What is out of reach is presented as near as can be, and reported by its measured
        friction.
        """
        if stimulus.cof is not None:
            self._session.set(stimulus.cof, nearest=True)
        elif stimulus.texture is not None:
            self._session.play(stimulus.texture, nearest=True)

    def _samples(self, settings: TrialSettings, began: int) -> NDArray[np.void]:
        """Those of the interval whose first event is `began`; the output is off when they are all
        there.
        """
        found: list[NDArray[np.void]] = []
        for new in new_samples(self._client.samples, SILENT_S):
            found.append(new)
            if _over(np.concatenate(found), settings):
                break
        status = self._client.status()
        if status.state != "rendering":
            told = (e.message for e in self._client.events(began) if e.kind in TAKEN_AWAY)
            raise stopped(next(told, f"the daemon is {status.state}"))
        self._session.off()
        return np.concatenate(found)


def stopped(why: str) -> HapticError:
    """The output was taken away from a session."""
    return HapticError(
        "stopped", why, "Remove the cause, then run the same command again: it goes on"
    )


class AssumedApparatus:
    """No rig: every friction is felt exactly as it is asked for. For trying a design, in no
    time.
    """

    onset = NO_ONSET

    def mark(self, label: str, data: dict[str, Any]) -> float:
        return 0.0

    def present(
        self, stimuli: Sequence[Stimulus], settings: TrialSettings, settle_s: float
    ) -> list[Delivered]:
        """As asked; of a texture nothing is known."""
        return [
            _as_asked(s.cof if s.cof is not None else np.nan, settings.duration_s) for s in stimuli
        ]


def _as_asked(cof: float, lasted_s: float) -> Delivered:
    return Delivered(
        cof, cof, cof, error=0.0, within_5_percent=1.0, reachable_share=1.0, sliding_s=lasted_s
    )


def _over(samples: NDArray[np.void], settings: TrialSettings) -> bool:
    lasted_s = float(samples["time_s"][-1] - samples["time_s"][0])
    if settings.strokes:
        # the last one goes on until it turns or lifts
        ended = strokes(samples) - int(samples["in_contact"][-1])
        return ended >= settings.strokes or lasted_s >= settings.most_s
    return lasted_s >= settings.duration_s


def _halves(left_cof: float, right_cof: float, middle_mm: float) -> str:
    """A profile with one friction left of the middle and another one right of it."""
    edge_mm = 0.5 * FINEST_MM
    points = (
        (-SCREEN_MM, left_cof),
        (middle_mm - edge_mm, left_cof),
        (middle_mm + edge_mm, right_cof),
    )
    rows = [f"{x_mm!r},{cof!r}" for x_mm, cof in (*points, (SCREEN_MM, right_cof))]
    return "\n".join(["position_mm,cof", *rows]) + "\n"


def check_textures(experiment: Experiment, known: Sequence[str]) -> None:
    """BadInputError for a texture that the daemon does not play, by its name or the path of its
    file.
    """
    for name in experiment.textures:
        if name not in known and not Path(name).is_file():
            said = f"{experiment.path}: there is no texture named '{name}'"
            raise BadInputError("unknown_texture", said, nearest(name, list(known)))


def texture_hashes(experiment: Experiment) -> dict[str, str]:
    """SHA-256 of the file of each texture that an experiment presents."""
    files = {name: load(name, texture_dirs()).path for name in experiment.textures}
    return {name: hashlib.sha256(read_bytes(path)).hexdigest() for name, path in files.items()}
