"""A surface's vibration -> friction over position: from a sound file, or made by a model of it.

What a vibration is in friction nobody measured: its shape is kept, its size is the user's choice.
"""

from __future__ import annotations

import io
import struct
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np

from haptic_driver.errors import BadInputError, require_range
from haptic_driver.lab.importers import NOT_MEASURED, Asked, Made, needs_scale, profiled
from haptic_driver.signals import Array
from haptic_driver.textures.description import FINEST_MM, require_swing
from model.support.reading import read_bytes

SPEED_M_S = (0.005, 1.0)  # of the surface
LARGEST_WAV_BYTES = 64 << 20
LONGEST_M = 0.5  # of the surface; it repeats after that
LEAST_PERIODS = 4  # of the lowest frequency kept, in the whole
SIZE_UNKNOWN = b"\xff" * 4  # of a file that was written to a pipe
WAV_DAMAGE = (
    ValueError,
    EOFError,
    struct.error,
    OSError,
    UnboundLocalError,
    ZeroDivisionError,
    MemoryError,
    TypeError,
)


class Vibration(NamedTuple):
    """Samples [n] of any unit at a steady rate."""

    samples: Array
    rate_hz: float


def made(source: Path, asked: Asked) -> Made:
    """See `importers`."""
    speed_m_s, mean_cof, amplitude_cof = asked.speed_m_s, asked.mean_cof, asked.amplitude_cof
    if speed_m_s is None or amplitude_cof is None or mean_cof is None:
        said = (
            f"{source} holds a vibration: it does not say which friction that is, nor how long the"
            " surface"
        )
        raise needs_scale(said, "--speed 0.05 --mean-cof 0.65 --amplitude-cof 0.1")
    require_range("--speed", speed_m_s, *SPEED_M_S, unit=" m/s")
    try:
        require_swing(mean_cof, amplitude_cof)
    except ValueError as error:
        raise BadInputError(
            "out_of_range", str(error), "Give another --mean-cof or --amplitude-cof"
        ) from None
    found = read_wav(source)
    position_m, cof = along_the_way(found, speed_m_s, mean_cof, amplitude_cof, str(source))
    length_mm = 1e3 * float(np.ptp(position_m))
    told = {"length_mm": length_mm, "speed_m_s": speed_m_s, "rate_hz": found.rate_hz}
    words = f"the vibration's shape at that speed; {NOT_MEASURED}"
    how = {"direction_deg": 0.0, "outside": "tile", "perceptual_gain": asked.perceptual_gain}
    return profiled(position_m, cof, words, told, **how)


def read_wav(path: Path) -> Vibration:
    """A sound file of one channel, of whole numbers or floats."""
    content = read_bytes(path, LARGEST_WAV_BYTES)
    from scipy.io import wavfile  # noqa: PLC0415  (slow to import)

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", wavfile.WavFileWarning)  # of chunks that are no sound
            if content[4:8] != SIZE_UNKNOWN:
                warnings.filterwarnings("error", "Reached EOF prematurely")
            rate_hz, samples = wavfile.read(io.BytesIO(content))
    except wavfile.WavFileWarning as error:
        raise BadInputError(
            "bad_wav", f"{path} is cut off: {error}", "Copy or export it again, to its end"
        ) from None
    except WAV_DAMAGE as error:
        raise BadInputError(
            "bad_wav", f"{path} is no sound file: {error}", "Export it as WAV, PCM or float"
        ) from None
    if samples.ndim != 1:
        said = f"{path} has {samples.shape[1]} channels"
        raise BadInputError(
            "bad_wav", said, "Export the one across the surface, or their sum, as a mono file"
        )
    if not rate_hz > 0 or not np.all(np.isfinite(samples)):
        raise BadInputError(
            "bad_wav",
            f"{path} has a rate of {rate_hz} Hz, or samples that are no numbers",
            "Export it anew",
        )
    return Vibration(samples.astype(float), float(rate_hz))


def along_the_way(
    vibration: Vibration, speed_m_s: float, mean_cof: float, amplitude_cof: float, where: str
) -> tuple[Array, Array]:
    """Positions in m and friction [n] of a tile of surface that gives this vibration at this speed.

    The tile is at most `LONGEST_M` long and ends as it began. Detail finer than `FINEST_MM` is
    averaged away, what is left has `amplitude_cof` as its largest deviation from the mean.
    BadInputError where it is too short or silent.
    """
    per_sample_m = speed_m_s / vibration.rate_hz
    pitch_m = max(FINEST_MM * 1e-3, per_sample_m)
    samples = vibration.samples[: round(LONGEST_M / per_sample_m)]
    count = int(samples.size * per_sample_m / pitch_m)
    if count < 2 * LEAST_PERIODS:
        said = (
            f"{where}: {1e3 * samples.size * per_sample_m:.3g} mm of surface at {speed_m_s:g} m/s"
        )
        raise BadInputError("too_short", said, "Record for longer, or check --speed: it is in m/s")
    edges = np.linspace(0.0, samples.size, count + 1)
    sums = np.interp(
        edges,
        np.arange(samples.size + 1),
        np.concatenate([[0.0], np.cumsum(samples - samples.mean())]),
    )
    felt = np.diff(sums)
    felt -= felt.mean()
    if not np.abs(felt).max() > 1e-12 * max(float(np.abs(samples).max()), 1e-300):
        said = (
            f"{where}: nothing is left of it coarser than {1e3 * pitch_m:g} mm at {speed_m_s:g} m/s"
        )
        raise BadInputError("silent", said, "Give a file that is not silent, or a higher --speed")
    cof = mean_cof + amplitude_cof * felt / np.abs(felt).max()
    position_m = samples.size * per_sample_m * (np.arange(count + 1) + 0.5) / count
    return position_m, np.append(cof, cof[0])
