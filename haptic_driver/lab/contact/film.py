"""Films as people have them: a video, a stack of TIFF, or a folder of pictures with time stamps."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from haptic_driver.errors import BadInputError, HapticError, optional
from haptic_driver.files import listed
from haptic_driver.lab.contact.times import read_times
from haptic_driver.signals import Array

EXTRA = "camera"
STACKS = (".tif", ".tiff")
RAW = (".dng",)
PICTURES = (".png", ".jpg", ".jpeg", ".bmp", *STACKS, *RAW)
VIDEOS = (".avi", ".mp4", ".mov", ".mkv")
STAMPS = (".csv", ".txt")
LEAST_SIDE = 48
GIVE = "Give a video, a stack of TIFF, or a folder of PNG, TIFF or DNG"


@dataclass(frozen=True)
class Film:
    """Frames and when each was taken, in s. `frames` reads them one at a time, grey [y, x] in 0 to
    1, white being the most that the camera gives.
    """

    path: Path
    time_s: Array
    places: tuple[tuple[Path, int | None], ...]

    def frames(self) -> Iterator[Array]:
        """One after the other; BadInputError for one that cannot be read or is of another size."""
        shape: tuple[int, ...] = ()
        for number, image in enumerate(self._read()):
            frame = grey(image)
            if shape and frame.shape != shape:
                said = f"{self.path}: frame {number} is of {frame.shape}, the first of {shape}"
                raise BadInputError("bad_film", said, "All frames of a film have one size")
            shape = frame.shape
            if min(shape) < LEAST_SIDE:
                said = f"{self.path}: frame {number} is of {frame.shape} pixels"
                raise BadInputError("bad_film", said, f"A touch fills {LEAST_SIDE} pixels or more")
            yield frame

    def _read(self) -> Iterator[Any]:
        if self.path.suffix.lower() in VIDEOS and self.path.is_file():
            yield from _opened(self.path).imiter(self.path, plugin=_video_plugin())
            return
        for path, page in self.places:
            yield read_picture(path, page)


def read_film(path: Path, times: Path | None = None, rate_hz: float | None = None) -> Film:
    """A film, opened; BadInputError for one without frames or whose times do not fit.

    Times come from `times` (or the one CSV or TXT in a folder), else from `rate_hz`, else from the
    video's own data. Otherwise each frame is a second.
    """
    if not path.exists():
        raise BadInputError("no_film", f"{path}: is not there", GIVE)
    places, own_rate_hz = _places(path)
    if not places:
        raise BadInputError("empty_film", f"{path}: has no frames", GIVE)
    stamps = times or (_stamps_in(path) if path.is_dir() and rate_hz is None else None)
    if stamps is None:
        time_s = np.arange(len(places)) / (rate_hz or own_rate_hz or 1.0)
        return Film(path, time_s, places)
    return Film(path, read_times(stamps, len(places)), places)


def grey(image: Any) -> Array:
    """A picture of integers or floats, grey or of colours, as floats [y, x] in 0 to 1."""
    util, color = (optional(f"skimage.{name}", EXTRA, "a picture") for name in ("util", "color"))
    picture = util.img_as_float64(np.asarray(image))
    if picture.ndim == 3:
        picture = color.rgb2gray(picture[..., :3]) if picture.shape[2] >= 3 else picture[..., 0]
    if picture.ndim != 2:
        raise BadInputError("bad_film", f"a frame has the shape {np.shape(image)}", GIVE)
    return np.asarray(picture, dtype=np.float64)


def read_picture(path: Path, page: int | None = None) -> Any:
    """One picture of any of the formats, a raw one as the camera counted; BadInputError."""
    try:
        return _picture(path, page)
    except HapticError:
        raise
    except Exception as error:  # each format has errors of its own
        raise BadInputError("bad_film", f"{path}: cannot be read: {error}", GIVE) from error


def _picture(path: Path, page: int | None) -> Any:
    if path.suffix.lower() in RAW:
        rawpy = optional("rawpy", EXTRA, f"{path.name}, a raw picture,")
        as_counted = {
            "no_auto_bright": True,
            "output_bps": 16,
            "gamma": (1, 1),
            "user_wb": [1.0, 1.0, 1.0, 1.0],
            "output_color": rawpy.ColorSpace.raw,
        }
        return _opened(path).imread(path, plugin="rawpy", **as_counted)
    if page is not None:
        return optional("tifffile", EXTRA, str(path)).imread(path, key=page)
    return _opened(path).imread(path)


def _opened(path: Path) -> Any:
    return optional("imageio.v3", EXTRA, str(path))


def _video_plugin() -> str:
    optional("av", EXTRA, "a video")
    return "pyav"


def _places(path: Path) -> tuple[tuple[tuple[Path, int | None], ...], float | None]:
    """Where each frame is, and the rate that a video says."""
    ending = path.suffix.lower()
    if path.is_dir():
        files = listed(path, PICTURES)
        return tuple((file, None) for file in sorted(files, key=_natural)), None
    if ending not in (*PICTURES, *VIDEOS):
        raise BadInputError("bad_film", f"{path}: is no film of a kind that is known", GIVE)
    try:
        if ending in VIDEOS:
            plugin = _video_plugin()
            count = sum(1 for _ in _opened(path).imiter(path, plugin=plugin))
            rate_hz = float(_opened(path).immeta(path, plugin=plugin)["fps"])
            return tuple((path, i) for i in range(count)), rate_hz
        if ending in STACKS:
            with optional("tifffile", EXTRA, str(path)).TiffFile(path) as stack:
                return tuple((path, i) for i in range(len(stack.pages))), None
    except HapticError:
        raise
    except Exception as error:  # each format has errors of its own
        raise BadInputError("bad_film", f"{path}: cannot be read: {error}", GIVE) from error
    return ((path, None),), None


def _natural(path: Path) -> list[Any]:
    """So that frame 10 comes after frame 9."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", path.name)]


def _stamps_in(folder: Path) -> Path | None:
    found = listed(folder, STAMPS)
    if len(found) > 1:
        names = ", ".join(sorted(file.name for file in found))
        raise BadInputError("bad_times", f"{folder}: {names}: which has the times?", "Say --times")
    return found[0] if found else None
