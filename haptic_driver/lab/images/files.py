"""Files of pictures, by what they begin with: TIFF, a camera's raw, or what Pillow reads."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from haptic_driver.errors import BadInputError, HapticError, optional
from haptic_driver.lab.images.pixels import BYTE, Pixels, aspect_told, of_array
from haptic_driver.lab.images.tiff import TiffPictures
from haptic_driver.signals import Array
from model.support.reading import read_bytes

MOST_PICTURE_BYTES = 100 << 20
EXTRA = "camera"
RAW = (".dng",)
TIFF_BEGINS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
# others with several pictures have them as layers, or beside the one that is meant
ANIMATED = ("GIF", "PNG", "WEBP")
ORIENTATION = 0x0112
HINT = "Save it as PNG, or as TIFF without compression"


class Pictures(Protocol):
    """The pictures of one file.

    `said` is what a viewer would not expect of the file, `times_s` when each was taken if known.
    `pixel_m` is how wide a pixel is, by a file that counts it in a length.
    """

    count: int
    in_planes: bool
    times_s: Array | None
    pixel_m: float | None
    said: list[str]

    def read(self, number: int, /) -> Pixels: ...

    def close(self) -> None: ...


@contextmanager
def opened(path: Path) -> Iterator[Pictures]:
    """The pictures of a file; BadInputError for what cannot be read as such, also while inside."""
    if not path.is_file():
        read_bytes(path)
    try:
        pictures = _kind(path)(path)
        try:
            yield pictures
        finally:
            pictures.close()
    except HapticError as error:
        raise type(error)(error.code, _of(path, error.message), error.hint) from error
    except (Image.DecompressionBombWarning, Image.DecompressionBombError):
        said = f"{path} has too many pixels"
        raise BadInputError("map_too_large", said, "Scale it down first") from None
    except UnidentifiedImageError:
        said = f"{path} cannot be read as a picture: its format is not known"
        raise BadInputError("bad_image", said, HINT) from None
    except Exception as error:  # each format has errors of its own
        said = f"{path} cannot be read as a picture: {error}"
        raise BadInputError("bad_image", said, HINT) from error


def _of(path: Path, said: str) -> str:
    return said if str(path) in said else f"{path}: {said}"


def _kind(path: Path) -> Callable[[Path], Pictures]:
    if path.suffix.lower() in RAW:
        return RawPicture
    with path.open("rb") as file:
        return TiffPictures if file.read(4) in TIFF_BEGINS else PillowPictures


class RawPicture:
    """A camera's raw picture, as its sensor counted."""

    count, in_planes = 1, False
    times_s: Array | None = None
    pixel_m: float | None = None

    def __init__(self, path: Path) -> None:
        self.said: list[str] = []
        self._rawpy = optional("rawpy", EXTRA, f"{path.name}, a raw picture,")
        self._raw = self._rawpy.imread(str(path))

    def read(self, number: int) -> Pixels:
        """Without the camera's own brightness, white balance, gamma and colours."""
        image = self._raw.postprocess(
            no_auto_bright=True,
            output_bps=16,
            gamma=(1, 1),
            user_wb=[1.0, 1.0, 1.0, 1.0],
            output_color=self._rawpy.ColorSpace.raw,
        )
        return of_array(image)

    def close(self) -> None:
        self._raw.close()


class PillowPictures:
    """What Pillow reads; the frames of an animation are pictures."""

    in_planes = False
    pixel_m: float | None = None

    def __init__(self, path: Path) -> None:
        content = io.BytesIO(read_bytes(path, MOST_PICTURE_BYTES))
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            self._image = Image.open(content)
        about = self._image.info
        along = (about[k] for k in ("dpi", "aspect", "jfif_density") if k in about)
        per_x, per_y = next(along, (1, 1))
        self.said = aspect_told(float(per_y), float(per_x))
        animated = self._image.format in ANIMATED
        self.count = int(getattr(self._image, "n_frames", 1)) if animated else 1
        self.times_s = self._times_s() if self.count > 1 else None

    def read(self, number: int) -> Pixels:
        """One picture, upright, on white where it is transparent."""
        if self.count > 1:
            self._image.seek(number)
        upright = ImageOps.exif_transpose(self._image)
        turned = self._image.getexif().get(ORIENTATION, 1) != 1
        values, full, said = _grey(upright)
        if turned:
            said.insert(0, "turned upright by its EXIF orientation")
        return Pixels(values, full, said=tuple(said))

    def _times_s(self) -> Array | None:
        """By how long each frame is shown; None where a frame does not say."""
        shown_ms = [0.0]
        for number in range(self.count):
            self._image.seek(number)
            self._image.load()
            shown_ms.append(float(self._image.info.get("duration", 0.0)))
        return 1e-3 * np.cumsum(shown_ms[:-1]) if all(shown_ms[1:]) else None

    def close(self) -> None:
        self._image.close()


def _grey(image: Any) -> tuple[Array, float | None, list[str]]:
    """Luminance as stored, its full scale, and what was done."""
    if image.mode.startswith("I"):
        return np.asarray(image, dtype=float), 65535.0, []
    if image.mode == "F":
        return of_array(image).values, None, []
    said = []
    if image.has_transparency_data:
        white = Image.new("RGBA", image.size, "white")
        coloured = image.convert("RGBA")
        if coloured.getchannel("A").getextrema()[0] < BYTE:
            said.append("transparent parts on white")
        image = Image.alpha_composite(white, coloured)
    if image.mode not in ("L", "1"):
        said.append("colours as luminance")
        return of_array(image.convert("RGB")).values, BYTE, said
    return np.asarray(image.convert("L"), dtype=float), BYTE, said
