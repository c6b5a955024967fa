"""What was measured or recorded elsewhere becomes friction over position, or a texture.

An importer is a module with a function `made` that takes a source and what is `Asked` of it.
"""

from __future__ import annotations

__all__ = ["image", "strokes"]

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from haptic_driver.errors import BadInputError
from haptic_driver.textures.formulas import amplified

if TYPE_CHECKING:
    from haptic_driver.signals import Array
    from model.support.tables import Named

IMPORTERS = {
    ".h5": f"{__name__}.recording",
    ".hdf5": f"{__name__}.recording",
    ".csv": f"{__name__}.strokes",
    ".wav": f"{__name__}.vibration",
    ".xml": f"{__name__}.hatt",
}
TRIAL = "haptic_driver.lab.raw_trials.strokes"  # whatever its ending
PLAYBACK_GAIN = 3.0  # Grigorii 2021, 10.1109/TOH.2021.3130091: 3 for fine textures, 5 for coarse
NOT_MEASURED = "its size in friction is what you said, not measured"


class Asked(NamedTuple):
    """What may be said of a source; None where it is not."""

    run: str | None
    named: Mapping[str, Named]
    map_file: Path | None
    pitch_m: float
    speed_m_s: float | None
    mean_cof: float | None
    amplitude_cof: float | None
    cof_rms: float | None
    perceptual_gain: float


class Made(NamedTuple):
    """A texture: the `head` of its file, and its processes or its profile [n], in m and friction.

    `found` is for `--json`; `shown` is said to a person, a line each.
    """

    head: dict[str, Any]
    found: dict[str, Any]
    shown: list[str]
    processes: Sequence[dict[str, Any]] = ()
    profile: tuple[Array, Array] | None = None


def importer_of(source: Path, map_file: Path | None) -> Callable[[Path, Asked], Made]:
    """How a source is imported; BadInputError for a file of an ending that nobody knows."""
    where = IMPORTERS.get(source.suffix.lower()) if map_file is None else TRIAL
    if where is None:
        said = f"{source}: '{source.suffix}' is not a file that can be imported"
        hint = f"Known: {', '.join(IMPORTERS)}; other trial files with --map"
        raise BadInputError("bad_ending", said, hint)
    made: Callable[[Path, Asked], Made] = import_module(where).made
    return made


def usual_gain(source: Path, map_file: Path | None) -> float:
    """How much stronger than recorded friction is played: that of strokes on a real surface is."""
    strokes = map_file is not None or source.suffix.lower() == ".csv"
    return PLAYBACK_GAIN if strokes else 1.0


def profiled(position_m: Array, cof: Array, words: str, found: dict[str, Any], **more: Any) -> Made:
    """A texture of friction [n] over position; `more` goes into its file."""
    ends = [float(cof.min()), float(cof.max())]
    gain = more["perceptual_gain"]
    played = amplified(position_m, cof, gain)
    played_ends = [float(played.min()), float(played.max())]
    speed_m_s, length_mm = found["speed_m_s"], found["length_mm"]
    at = "" if speed_m_s != speed_m_s else f", at {speed_m_s:.3g} m/s"  # noqa: PLR0124 - NaN
    shown = [
        f"{cof.size} points over {length_mm:.4g} mm, friction {ends[0]:.4g} to {ends[1]:.4g}{at}",
        words,
    ]
    if gain != 1.0:
        shown.append(
            f"played with {gain:g} times its variation, {played_ends[0]:.4g} to"
            f" {played_ends[1]:.4g}: so people took a fine texture for the original at about 3, a"
            " coarse one at 5 (10.1109/TOH.2021.3130091). As recorded: --perceptual-gain 1"
        )
    head = {"kind": "profile", "description": words, **more}
    told = {"points": cof.size, "cof": ends, "words": words}
    told |= {"perceptual_gain": gain, "played_cof": played_ends} | found
    return Made(head, told, shown, profile=(position_m, cof))


def needs_scale(said: str, example: str) -> BadInputError:
    """What to raise where a source does not say how much friction it is."""
    return BadInputError("texture_needs_scale", said, f"Add for example: {example}")
