"""TIFF by what its tags say: series of pages, planes, photometric interpretation, sample format.

Numbers of tags and their values: TIFF 6.0; 42113 is GDAL's, 32803 and 34892 are of DNG.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.lab.images.pixels import LUMINANCE, Pixels, aspect_told, of_array
from haptic_driver.signals import Array
from model.support.errors import ModelError
from model.support.units import to_si

REDUCED = 1
PHOTOMETRIC, ORIENTATION, NO_DATA = 262, 274, 42113
RESOLUTIONS, RESOLUTION_UNIT = (282, 283), 296
WHITE_IS_ZERO, BLACK_IS_ZERO, RGB, PALETTE, SEPARATED, YCBCR, LAB = 0, 1, 2, 3, 5, 6, 8
JPEG = (6, 7)
BESIDE_TIME = {"C": "channel", "Z": "plane"}
CENTIMETRE = 3
COMPLEX = (5, 6)
ASSOCIATED, UNASSOCIATED = 1, 2
# from stored to upright, by the value of the tag
UPRIGHT: dict[int, Callable[[Array], Array]] = {
    2: np.fliplr,
    3: lambda image: np.rot90(image, 2),
    4: np.flipud,
    5: lambda image: np.swapaxes(image, 0, 1),
    6: lambda image: np.rot90(image, -1),
    7: lambda image: np.rot90(np.swapaxes(image, 0, 1), 2),
    8: np.rot90,
}


@dataclass(frozen=True)
class _Plane:
    """One picture of a file: its page, and which part of that, if the page holds several."""

    page: Any
    stored: Callable[[], Any]
    in_planes: bool


class TiffPictures:
    """The pictures of a TIFF file, all but reduced copies; `read` takes one at a time.

    `in_planes`: it is one picture in planes of colour, as grey frames are by mistake. `times_s` is
    when each was taken, where the file says so.
    """

    def __init__(self, path: Path) -> None:
        from tifffile import TiffFile  # noqa: PLC0415  (slow to import)

        self.said: list[str] = []
        with ExitStack() as on_failure:
            self._file = on_failure.enter_context(TiffFile(path))
            whole = [
                series
                for series in self._file.series
                if not int(series.keyframe.subfiletype or 0) & REDUCED
            ]
            self._planes = [plane for series in whole for plane in _planes(series, self.said)]
            left = len(self._file.pages) - sum(len(series.pages) for series in whole)
            on_failure.pop_all()
        if left > 0:
            self.said.append(f"{left} of its pages passed over: reduced, or not described")
        self.count = len(self._planes)
        self.in_planes = self.count == 1 and self._planes[0].in_planes
        if self._planes:
            along = (_tag(self._planes[0].page, number) or (1, 1) for number in RESOLUTIONS)
            per_x, per_y = (n / d if d else 0.0 for n, d in along)
            self.said += aspect_told(per_y, per_x)
        self.pixel_m = _pixel_m(self._file, self._planes)
        about = self._file.imagej_metadata or {}
        step_s = _interval_s(about, _ome(self._file))
        self.times_s = None if step_s is None else step_s * np.arange(float(self.count))
        self._offset = about.get("c0"), about.get("c1")

    def read(self, number: int) -> Pixels:
        """One picture, upright; any error of the decoder for one that is damaged."""
        plane = self._planes[number]
        turn = int(_tag(plane.page, ORIENTATION) or 1)
        pixels = _pixels(plane)
        c0, c1 = self._offset
        if c0 is not None and c1:
            said = (*pixels.said, f"calibrated by ImageJ's {c0:g} + {c1:g} x value")
            pixels = Pixels(c0 + c1 * pixels.values, None, pixels.white_is_zero, said)
        if turn in UPRIGHT:
            values = np.ascontiguousarray(UPRIGHT[turn](pixels.values))
            said = (*pixels.said, f"turned upright by its orientation, {turn}")
            pixels = replace(pixels, values=values, said=said)
        return pixels

    def close(self) -> None:
        self._file.close()


def _planes(series: Any, said: list[str]) -> list[_Plane]:
    """Each picture of a series, whose axes tell what is not a picture's own."""
    own = set("YXS") if series.keyframe.samplesperpixel > 1 else set("YX")
    sizes = dict(zip(series.axes, series.shape, strict=True))
    others = {axis: size for axis, size in sizes.items() if axis not in own and size > 1}
    for axis, what in BESIDE_TIME.items():
        count = others.get(axis, 1)
        if count > 1 and len(others) > 1:
            hint = f"Save the {what} that shows the touch as a file of its own"
            raise BadInputError("several_channels", f"{count} {what}s in each frame", hint)
        if count > 1:
            said.append(f"{count} {what}s taken as frames")
    in_planes = series.axes.endswith("YX") and "S" in own
    count = math.prod(others.values())
    pages = series.pages
    if count == len(pages):
        # tags of a series stand with its first page, as in OME
        return [
            _Plane(page if hasattr(page, "tags") else series.keyframe, page.asarray, in_planes)
            for page in pages
        ]
    picture = [size for axis, size in sizes.items() if axis in own]
    whole: list[Any] = []

    def part(number: int) -> Any:
        if not whole:
            whole.append(series.asarray(out="memmap").reshape(count, *picture))
        return whole[0][number]

    return [_Plane(series.keyframe, partial(part, i), in_planes) for i in range(count)]


def _pixels(plane: _Plane) -> Pixels:
    page = plane.page
    if int(page.sampleformat or 1) in COMPLEX:
        raise ValueError("its samples are complex numbers")
    tag = _tag(page, PHOTOMETRIC)
    meaning = BLACK_IS_ZERO if tag is None else int(tag)
    colour = meaning == RGB or (meaning == YCBCR and int(page.compression) in JPEG)
    if not (colour or meaning in (WHITE_IS_ZERO, BLACK_IS_ZERO, PALETTE, SEPARATED, LAB)):
        raise ValueError(f"photometric interpretation {meaning} is not understood")
    stored = np.asarray(plane.stored())
    if plane.in_planes:
        stored = np.moveaxis(stored, 0, -1)
    if stored.ndim == 2:
        stored = stored[..., None]
    no_data = _tag(page, NO_DATA)
    blank = float(str(no_data).strip("\0 ")) if no_data is not None else None
    said = () if tag is not None else ("it does not say whether 0 is black: taken as black",)
    if meaning == PALETTE:
        colours = np.asarray(page.colormap, dtype=float).T / 257.0
        return Pixels(colours[stored[..., 0]] @ LUMINANCE, 255.0, said=("colours as luminance",))
    grey = of_array(stored[..., 0], blank)
    full = float(2**page.bitspersample - 1) if grey.full else None
    used = 1
    if colour or meaning == SEPARATED:
        used, said = (3 if colour else 4), ("colours as luminance",)
        values = stored[..., :3].astype(float) @ LUMINANCE
        if meaning == SEPARATED:
            white = full or 1.0
            values = (white - values) * (1.0 - stored[..., 3].astype(float) / white)
        grey = replace(grey, values=values)
    grey = replace(grey, full=full, white_is_zero=meaning == WHITE_IS_ZERO, said=said)
    return _on_white(grey, stored, page.extrasamples, used)


def _on_white(grey: Pixels, stored: Any, extra: Sequence[int], used: int) -> Pixels:
    """Transparent parts on white, where a sample beyond those of colour tells them."""
    for number, kind in enumerate(int(each) for each in extra):
        if kind not in (ASSOCIATED, UNASSOCIATED):
            said = (*grey.said, "a sample of each pixel is not explained by the file: left out")
            grey = replace(grey, said=said)
        elif grey.full:
            opaque = stored[..., used + number].astype(float) / grey.full
            if (opaque == 1.0).all():
                return grey
            shown = grey.values * (opaque if kind == UNASSOCIATED else 1.0)
            white = 0.0 if grey.white_is_zero else grey.full
            said = (*grey.said, "transparent parts on white")
            return replace(grey, values=shown + white * (1.0 - opaque), said=said)
    return grey


def _tag(page: Any, number: int) -> Any:
    tag = page.tags.get(number)
    return None if tag is None else tag.value


def _ome(file: Any) -> Any:
    """What OME says of the pixels, by attribute; nothing where the file has none."""
    try:
        found = ElementTree.fromstring(file.ome_metadata or "<OME/>").find(".//{*}Pixels")
    except ElementTree.ParseError:
        return {}
    return {} if found is None else found.attrib


def _pixel_m(file: Any, planes: Sequence[_Plane]) -> float | None:
    """How wide a pixel is by OME, by ImageJ's unit, or by a resolution; those in inches are of
    print.
    """
    about = _ome(file)
    if size := about.get("PhysicalSizeX"):
        return _in_si("position", float(size), about.get("PhysicalSizeXUnit", "µm"))
    per, over = (_tag(planes[0].page, RESOLUTIONS[0]) if planes else None) or (0, 0)
    if not per or not over:
        return None
    if file.imagej_metadata:
        return _in_si("position", over / per, str(file.imagej_metadata.get("unit", "")))
    is_cm = int(_tag(planes[0].page, RESOLUTION_UNIT) or 0) == CENTIMETRE
    return 0.01 * over / per if is_cm else None


def _in_si(quantity: str, value: float, unit: str) -> float | None:
    """None where the unit is not one; ImageJ writes a micrometre in an escape."""
    try:
        return value * to_si(quantity, unit.replace("\\u00B5", "µ"), "a pixel")
    except ModelError:
        return None


def _interval_s(imagej: Mapping[str, Any], ome: Mapping[str, str]) -> float | None:
    """From frame to frame by the metadata of ImageJ, or of OME."""
    interval_s, rate_hz = imagej.get("finterval"), imagej.get("fps")
    if interval_s:
        return float(interval_s)
    if step := ome.get("TimeIncrement"):
        return _in_si("time", float(step), ome.get("TimeIncrementUnit", "s"))
    return 1.0 / float(rate_hz) if rate_hz else None
