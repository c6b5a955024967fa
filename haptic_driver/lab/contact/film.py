"""Films as people have them: a video, a stack of TIFF, or a folder of pictures with time stamps."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from haptic_driver.errors import BadInputError, optional
from haptic_driver.files import listed
from haptic_driver.lab.contact.times import read_times
from haptic_driver.lab.images.files import EXTRA, opened
from haptic_driver.lab.images.pixels import (
    BYTE,
    Pixels,
    aspect_told,
    full_scale,
    of_array,
    shares,
    told,
)
from haptic_driver.signals import Array

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".gif", ".webp", ".tif", ".tiff", ".dng")
VIDEOS = (".avi", ".mp4", ".mov", ".mkv")
STAMPS = (".csv", ".txt")
LEAST_SIDE = 48
ALIKE = 0.02  # relative: what a file says and what a person says of one thing
NUMBERED = re.compile(r"(.*?)(-?\d+)")
GIVE = "Give a video, a stack of TIFF, or a folder of PNG, TIFF or DNG"
SAVED_AS_COLOURS = "Three grey frames saved as one colour picture look the same: save them as pages"

Place = tuple[Path, int]


@dataclass(frozen=True)
class Film:
    """Frames and when each was taken, in s. `frames` reads them one at a time, grey [y, x] in 0 to
    1, white being the most that the camera gives. `said` is what was done to read them.

    `shape` [y, x] is that of the first, `pixel_m` how wide a pixel is where the file says it.
    """

    path: Path
    time_s: Array
    places: tuple[Place, ...]
    full: float
    said: tuple[str, ...] = ()
    shape: tuple[int, ...] = ()
    pixel_m: float | None = None

    def frames(self) -> Iterator[Array]:
        """One after the other; BadInputError for one that cannot be read or is of another size."""
        shape: tuple[int, ...] = ()
        for number, pixels in enumerate(_pixels(self.places)):
            frame = shares(pixels, self.full)
            if shape and frame.shape != shape:
                said = f"{self.path}: frame {number} is of {frame.shape}, the first of {shape}"
                raise BadInputError("bad_film", said, "All frames of a film have one size")
            shape = frame.shape
            if min(shape) < LEAST_SIDE:
                said = f"{self.path}: frame {number} is of {frame.shape} pixels"
                raise BadInputError("bad_film", said, f"A touch fills {LEAST_SIDE} pixels or more")
            yield frame


def read_film(
    path: Path, times: Path | None = None, rate_hz: float | None = None, own: Sequence[Path] = ()
) -> Film:
    """A film, opened; BadInputError for one without frames or whose times do not fit.

    Times come from `times` (or the one CSV or TXT in a folder), else from `rate_hz`, else from the
    file's own data. Otherwise each frame is a second, which is said. `own`: results that stand in
    the folder and are no frames.
    """
    if not path.exists():
        raise BadInputError("no_film", f"{path}: is not there", GIVE)
    places, own_s, said, pixel_m = _places(path, own)
    if not places:
        raise BadInputError("empty_film", f"{path}: has no frames", GIVE)
    stamps = times or (_stamps_in(path, own) if path.is_dir() and rate_hz is None else None)
    if stamps is not None:
        time_s = read_times(stamps, len(places))
    elif rate_hz is not None:
        time_s = np.arange(len(places)) / rate_hz
        said += _rate_told(rate_hz, own_s)
    elif own_s is not None:
        time_s = own_s
    else:
        time_s = np.arange(float(len(places)))
        said.append("nothing says when frames were taken: one a second is counted")
    frames = _pixels(places)
    first = next(frames)
    full, words = _depth(path, first, frames)
    return Film(path, time_s, places, full, (*said, *words), first.values.shape, pixel_m)


def _rate_told(rate_hz: float, own_s: Array | None) -> list[str]:
    """That a rate is not the one of the file."""
    if own_s is None or own_s.size < 2:
        return []
    own_hz = (own_s.size - 1) / float(own_s[-1] - own_s[0])
    if abs(own_hz / rate_hz - 1.0) < ALIKE:
        return []
    return [f"the file says {own_hz:.4g} frames a second: --rate {rate_hz:g} is taken"]


def _depth(path: Path, first: Pixels, frames: Iterator[Pixels]) -> tuple[float, list[str]]:
    """What white is in all frames, and what was done to read the first; films of more than 8 bits
    are looked through.
    """
    if first.full is not None and first.full <= BYTE:
        return first.full, told(first, first.full)

    def all_alike() -> Iterator[Pixels]:
        yield first
        for number, pixels in enumerate(frames, 1):
            if pixels.full != first.full:
                said = f"{path}: frame {number} has another depth than the first"
                raise BadInputError("bad_film", said, "Save all frames in one format")
            yield pixels

    full = full_scale(all_alike())
    return full, told(first, full)


def _pixels(places: tuple[Place, ...]) -> Iterator[Pixels]:
    """What each frame's file holds; a file is opened once for all its frames."""
    for path, group in groupby(places, key=lambda place: place[0]):
        if path.suffix.lower() in VIDEOS:
            for frame in _video(path):
                deep = frame.format.components[0].bits > 8
                yield of_array(frame.to_ndarray(format="rgb48le" if deep else "rgb24"))
            continue
        with opened(path) as pictures:
            for _, number in group:
                yield pictures.read(number)


def _video(path: Path) -> Iterator[Any]:
    """A video's frames, decoded; BadInputError."""
    av = optional("av", EXTRA, "a video")
    try:
        with av.open(str(path)) as container:
            yield from container.decode(video=0)
    except (av.FFmpegError, IndexError) as error:
        raise BadInputError("bad_film", f"{path}: cannot be read: {error}", GIVE) from error


def _video_told(path: Path) -> list[str]:
    """What a video says of its pixels that a viewer would not expect."""
    av = optional("av", EXTRA, "a video")
    with av.open(str(path)) as container:
        aspect = container.streams.video[0].sample_aspect_ratio
    return aspect_told(float(aspect or 1), 1.0)


def _numbers_told(files: Sequence[Path]) -> list[str]:
    """What the last numbers in the names of frames say: some missing, or several alike."""
    found = [re.findall(r"\d+", file.stem) for file in files]
    if len(files) < 2 or not all(found):
        return []
    names: dict[int, list[str]] = {}
    for file, of_name in zip(files, found, strict=True):
        names.setdefault(int(of_name[-1]), []).append(file.name)
    alike = [number for number, several in names.items() if len(several) > 1]
    if alike:
        several = " and ".join(names[alike[0]][:3])
        return [f"{len(alike)} numbers stand for several frames, as {several}: is it one film?"]
    numbers = np.array(sorted(names))
    steps = np.diff(numbers)
    usual = int(np.median(steps))
    missing = int(np.sum(steps // usual - 1))
    if not missing or steps.min() < usual:
        return []
    after = names[int(numbers[np.argmax(steps > usual)])][0]
    return [f"{missing} frames are missing by the numbers in their names, the first after {after}"]


def read_bare(path: Path, film: Film | None = None) -> Array:
    """A single picture, grey [y, x] in 0 to 1 of what white is in `film`; BadInputError."""
    with opened(path) as pictures:
        if pictures.count != 1:
            said = f"{path}: holds {pictures.count} pictures"
            raise BadInputError("several_pictures", said, "Save the one that is meant by itself")
        pixels = pictures.read(0)
    return shares(pixels, film.full if film else None)


def grey(images: Sequence[Any]) -> list[Array]:
    """Arrays of one camera, grey or of colours, as floats [y, x] in 0 to 1 of its full scale."""
    pictures = [of_array(image) for image in images]
    full = full_scale(pictures)
    return [shares(pixels, full) for pixels in pictures]


class _Frames(NamedTuple):
    """Where each frame is, its time and the width of a pixel if the file says them, and what was
    done to find it.
    """

    places: tuple[Place, ...]
    time_s: Array | None
    said: list[str]
    pixel_m: float | None = None


def _places(path: Path, own: Sequence[Path]) -> _Frames:
    ending = path.suffix.lower()
    if path.is_dir():
        files, notes = _in_order(listed(path, PICTURES, own))
        notes = notes or _numbers_told(files)
        pixel_m = None
        if files:
            with opened(files[0]) as pictures:
                notes += pictures.said
                pixel_m = pictures.pixel_m
        return _Frames(tuple((file, 0) for file in files), None, notes, pixel_m)
    if ending in VIDEOS:
        times = [frame.time for frame in _video(path)]
        known = times and None not in times and bool((np.diff(times) > 0.0).all())
        own_s = np.array(times) - times[0] if known else None
        return _Frames(tuple((path, i) for i in range(len(times))), own_s, _video_told(path))
    if ending not in PICTURES:
        raise BadInputError("bad_film", f"{path}: is no film of a kind that is known", GIVE)
    with opened(path) as pictures:
        if pictures.in_planes:
            said = f"{path}: is one picture in planes of colour"
            raise BadInputError("one_picture", said, SAVED_AS_COLOURS)
        places = tuple((path, i) for i in range(pictures.count))
        return _Frames(places, pictures.times_s, list(pictures.said), pictures.pixel_m)


def _in_order(files: Sequence[Path]) -> tuple[list[Path], list[str]]:
    """So that frame 10 comes after frame 9; and whether a minus counts as a sign.

    It does where others of the same name have none: f-2, f-1, f0.
    """
    parts = {file: NUMBERED.fullmatch(file.stem) for file in files}
    ends = [(found[1], found[2]) for found in parts.values() if found]
    signed = {bare for bare, number in ends if number.startswith("-")}
    signed &= {bare for bare, number in ends if not number.startswith("-")}

    def key(file: Path) -> list[Any]:
        found = parts[file]
        if found is None or found[1] not in signed:
            return _natural(file.name)
        return [*_natural(found[1]), int(found[2]), file.suffix]

    told = ["a minus before a frame's number counts as its sign: frames stand in that order"]
    return sorted(files, key=key), told if signed else []


def _natural(name: str) -> list[Any]:
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]


def _stamps_in(folder: Path, own: Sequence[Path]) -> Path | None:
    found = listed(folder, STAMPS, own)
    if len(found) > 1:
        names = ", ".join(sorted(file.name for file in found))
        raise BadInputError("bad_times", f"{folder}: {names}: which has the times?", "Say --times")
    return found[0] if found else None
