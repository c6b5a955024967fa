"""Friction in nine bands of frequency: what a texture asks for at a speed, and what a rig and a
finger make of it.

The bands, two thirds of an octave each from 12.5 to 800 Hz, are a choice of this driver. Textures
are felt up to about 800 Hz (Meyer, Dynamics of Ultrasonic and Electrostatic Friction Modulation).
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from haptic_driver.render.texture import Texture
from haptic_driver.signals import Array

BANDS = 9
EDGES_HZ = 12.5 * 2.0 ** (np.arange(BANDS + 1) * 2.0 / 3.0)
CENTRES_HZ = np.sqrt(EDGES_HZ[:-1] * EDGES_HZ[1:])

# The friction of skin is a first-order lag whose cut-off rises with speed (arXiv 2505.11162; 20 to
# 100 mm/s, and very different between people). So it is one of length, the same at any speed.
FINGER_CUTOFF_HZ_PER_M_S = 13.8e3
MEASURED_TO_M_S = 0.1
FINGER_LAG_M = 1.0 / (math.tau * FINGER_CUTOFF_HZ_PER_M_S)

LEAST_COF = 1e-4  # rms in a band; below, nothing is asked for there
REACHED = math.sqrt(0.5)  # of what is asked for
POINTS = 1 << 15
LINES = 9

Verdict = Literal["reached", "with_boost", "out_of_reach", "nothing_asked"]


class Output(NamedTuple):
    """How voltage comes out: a new value every `interval_s`, held until the next or, `straight`,
    joined to it.
    """

    interval_s: float
    straight: bool

    def gain(self, frequency_hz: Array) -> Array:
        """Of a wave [n]: 0 from half the rate on, where it comes out as another wave."""
        held = np.sinc(frequency_hz * self.interval_s)
        return np.where(
            frequency_hz < 0.5 / self.interval_s, held**2 if self.straight else held, 0.0
        )


class Band(NamedTuple):
    """One band: friction asked for (rms), what output and finger leave of it, and what that comes
    to.

    `reached`: at least 71 % (-3 dB) arrives. `with_boost`: it would if the texture asked for more,
    to make up for the loss, and the rig's reach has room for that. `out_of_reach`: neither.
    """

    low_hz: float
    high_hz: float
    asked_cof_rms: float
    output_gain: float
    finger_gain: float
    verdict: Verdict


def finger_gain(frequency_hz: Array, speed_m_s: float) -> Array:
    """What a sliding finger's friction follows of a wave [n] of adhesion."""
    return np.asarray(1.0 / np.hypot(1.0, frequency_hz / (FINGER_CUTOFF_HZ_PER_M_S * speed_m_s)))


def rms_in_bands(cof: Array, spacing_m: float, speed_m_s: float) -> Array:
    """Root mean square [BANDS] of friction [n] at places `spacing_m` apart, for a finger at a
    speed; by Parseval.
    """
    window = np.hanning(cof.size)
    share = np.abs(np.fft.rfft((cof - cof.mean()) * window)) ** 2
    frequency_hz = np.fft.rfftfreq(cof.size, spacing_m) * speed_m_s
    in_band = np.histogram(frequency_hz, EDGES_HZ, weights=share)[0]
    return np.asarray(np.sqrt(2.0 * in_band / (cof.size * np.sum(window**2))))


def asked(texture: Texture, speed_m_s: float, screen_m: tuple[float, float]) -> tuple[Array, float]:
    """Root mean square [BANDS] that a texture asks for along straight strokes over a screen, and
    its mean friction.

    Of strokes along x and along y those that meet more; where a stroke meets nothing it counts as
    the mean.
    """
    found = []
    for across in (0, 1):
        length_m, width_m = screen_m[across], screen_m[1 - across]
        along_m = length_m * (np.arange(POINTS) + 0.5) / POINTS
        strokes = []
        for side_m in width_m * (np.arange(LINES) + 0.5) / LINES:
            place = (along_m, np.full(POINTS, side_m))
            strokes.append(texture.cof_at(*(place if across == 0 else place[::-1])))
        cof = np.array(strokes)
        mean = float(np.nanmean(cof)) if np.isfinite(cof).any() else math.nan
        filled = np.where(np.isfinite(cof), cof, mean)
        rms = np.sqrt(
            np.mean(
                [rms_in_bands(line, length_m / POINTS, speed_m_s) ** 2 for line in filled], axis=0
            )
        )
        found.append((rms, mean))
    return max(found, key=lambda one: float(np.sum(one[0] ** 2)))


def predicted(
    asked_rms: Array,
    mean_cof: float,
    reachable_cof: tuple[float, float],
    output: Output,
    speed_m_s: float,
) -> list[Band]:
    """What arrives of each band; a band is judged alone, as if the others left it all of the
    reach.
    """
    room = min(mean_cof - reachable_cof[0], reachable_cof[1] - mean_cof)
    gains = zip(
        output.gain(CENTRES_HZ).tolist(), finger_gain(CENTRES_HZ, speed_m_s).tolist(), strict=True
    )
    edges = EDGES_HZ.tolist()
    return [
        Band(edges[i], edges[i + 1], rms, out, finger, _verdict(rms, out * finger, room))
        for i, (rms, (out, finger)) in enumerate(zip(asked_rms.tolist(), gains, strict=True))
    ]


def _verdict(rms: float, gain: float, room: float) -> Verdict:
    amplitude = math.sqrt(2.0) * rms
    if not rms > LEAST_COF:
        return "nothing_asked"
    if gain >= REACHED and amplitude <= room:
        return "reached"
    return "with_boost" if gain > 0.0 and amplitude / gain <= room else "out_of_reach"
