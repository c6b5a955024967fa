"""How well felt friction met what was asked, and what a finger feels of the difference.

It is a function of strokes alone, so that demo, daemon, page, experiments and benchmarks agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from haptic_driver.fidelity.lag import SEARCH_S, best_peak, correlation_by_lag
from haptic_driver.fidelity.perception import Perception
from haptic_driver.fidelity.spectra import BandSpectra, band_spectra
from haptic_driver.fidelity.strokes import Stroke, known_pieces, moving_average
from haptic_driver.signals import WITHIN, Array, Mask
from haptic_driver.textures.bands import CENTRES_HZ, EDGES_HZ, LEAST_COF

AVERAGE_S = 0.010  # over which forces and target are averaged, each apart, to be compared


@dataclass(frozen=True)
class Fidelity:
    """How felt friction compares with asked friction; None is unknown.

    Shares and errors are of 10 ms averages. Those of `within_5_percent`, the errors and the
    constant's are over reachable ticks, `share_above_jnd` is of all sliding time. `constant_cof` is
    the constant that lies within 5 % of what was asked for longest.

    Lists have one entry for each of the nine bands of `textures/bands.py`, from forces that are not
    averaged, reachable or not. `band_gain` and `band_coherence` are of felt against asked friction.
    `band_residual_n` is the force (rms) of felt less asked friction at the mean load, without the
    sensor's noise. `bands_felt` says whether it exceeds `band_threshold_n`, None where noise hides
    it. `threshold_spread_factor` is how far people differ in that, up and down. Correlations are
    Pearson's of all sliding ticks, not averaged, means taken out.

    `others_correlation` is what other labs report, from and to; `unverified` names which of the
    published numbers are not verified.
    """

    sliding_time_s: float
    reachable_share: float | None
    share_within_5_percent: float | None
    relative_error_rms: float | None
    cof_error_rms: float | None
    constant_cof: float | None
    constant_share_within_5_percent: float | None
    constant_relative_error_rms: float | None
    asked_cof_rms: list[float | None]
    felt_cof_rms: list[float | None]
    band_gain: list[float | None]
    band_coherence: list[float | None]
    correlation: float | None
    best_lag_s: float | None
    correlation_at_best_lag: float | None
    share_above_jnd: float | None
    jnd_friction: float
    band_residual_n: list[float | None]
    band_threshold_n: list[float]
    threshold_spread_factor: float
    bands_felt: list[bool | None]
    reach_hz: float | None
    thresholds: str
    unverified: list[str]
    others_correlation: list[float] | None
    others_correlation_at_best_lag: list[float] | None

    def bands_within(self, low: float, high: float) -> list[bool | None]:
        """Whether each band's gain lies from `low` to `high`.

        None where nothing is asked, where it is unknown, and where a band's centre lies above what
        the rig can do.
        """
        reach_hz = np.inf if self.reach_hz is None else self.reach_hz * (1.0 + 1e-9)
        return [
            None if gain is None or centre_hz > reach_hz else low <= gain <= high
            for gain, centre_hz in zip(self.band_gain, CENTRES_HZ.tolist(), strict=True)
        ]


class Errors(NamedTuple):
    """Asked and felt friction, averaged over 10 ms: arrays [n] of all sliding ticks."""

    asked: Array
    felt: Array
    reachable: Mask

    @property
    def relative(self) -> Array:
        """Felt less asked friction, as a share of asked friction."""
        return self.felt / self.asked - 1.0

    def where_reachable(self) -> Errors:
        """Those of the ticks whose target was within reach."""
        there = self.reachable
        return Errors(self.asked[there], self.felt[there], self.reachable[there])


def fidelity_of(
    strokes: Sequence[Stroke],
    tick_s: float,
    perception: Perception,
    reach_hz: float | None = None,
    noise_n: float = 0.0,
) -> Fidelity:
    """Compare felt with asked friction over strokes of ticks that are `tick_s` apart.

    `reach_hz` is the highest frequency that the rig can do, None for any. `noise_n` is the noise of
    one reading of the lateral force (rms, white), which no finger feels. ValueError where the
    arrays of a stroke differ in length.
    """
    pieces = known_pieces(strokes)
    errors = _averaged(pieces, tick_s)
    reachable = errors.where_reachable()
    constant = best_constant(reachable.asked)
    of_constant = reachable._replace(felt=np.full(reachable.asked.size, constant))
    spectra = band_spectra(pieces, tick_s)
    residual_n, felt = _felt(pieces, spectra, perception, tick_s, noise_n)
    correlation, lag_s, at_lag = _correlations(pieces, tick_s)
    others = perception.correlation
    above_jnd = np.abs(errors.relative) > perception.jnd_friction
    return Fidelity(
        sliding_time_s=errors.asked.size * tick_s,
        reachable_share=_mean(errors.reachable),
        share_within_5_percent=_mean(np.abs(reachable.relative) <= WITHIN),
        relative_error_rms=_rms(reachable.relative),
        cof_error_rms=_rms(reachable.felt - reachable.asked),
        constant_cof=_number(constant),
        constant_share_within_5_percent=_mean(np.abs(of_constant.relative) <= WITHIN),
        constant_relative_error_rms=_rms(of_constant.relative),
        asked_cof_rms=_numbers(spectra.asked_rms),
        felt_cof_rms=_numbers(spectra.felt_rms),
        band_gain=_numbers(spectra.gain),
        band_coherence=_numbers(spectra.coherence),
        correlation=_number(correlation),
        best_lag_s=_number(lag_s),
        correlation_at_best_lag=_number(at_lag),
        share_above_jnd=_mean(above_jnd),
        jnd_friction=perception.jnd_friction,
        band_residual_n=residual_n,
        band_threshold_n=perception.band_thresholds_n(),
        threshold_spread_factor=perception.detection.spread_factor,
        bands_felt=felt,
        reach_hz=reach_hz,
        thresholds=perception.name,
        unverified=perception.unverified,
        others_correlation=others.as_it_is if others else None,
        others_correlation_at_best_lag=others.at_best_lag if others else None,
    )


def errors_of(strokes: Sequence[Stroke], tick_s: float) -> Errors:
    """Felt beside asked friction over strokes, as `fidelity_of` compares them.

    ValueError where the arrays of a stroke differ in length.
    """
    return _averaged(known_pieces(strokes), tick_s)


def best_constant(asked: Array) -> float:
    """The constant that lies within 5 % of the largest share of asked friction [n]; NaN of none.

    A constant c does so for asked friction from c/1.05 to c/0.95. So the most populated window of
    that width counts, and of the constants that share it, the middle one.
    """
    if asked.size == 0:
        return np.nan
    ordered = np.sort(asked)
    ends = np.searchsorted(ordered, ordered * (1.0 + WITHIN) / (1.0 - WITHIN), side="right")
    first = int(np.argmax(ends - np.arange(ordered.size)))
    lowest, highest = ordered[first], ordered[ends[first] - 1]
    return float(0.5 * (lowest * (1.0 + WITHIN) + highest * (1.0 - WITHIN)))


def _averaged(pieces: Sequence[Stroke], tick_s: float) -> Errors:
    """Lateral force, load and target averaged apart, as a sensor's filter would."""
    ticks = round(AVERAGE_S / tick_s)
    asked, felt = [np.empty(0)], [np.empty(0)]
    for piece in pieces:
        lateral_n, normal_n = (moving_average(v, ticks) for v in (piece.lateral_n, piece.normal_n))
        asked.append(moving_average(piece.asked_cof, ticks))
        felt.append(lateral_n / normal_n)
    reachable = [np.empty(0, bool), *(piece.reachable for piece in pieces)]
    return Errors(np.concatenate(asked), np.concatenate(felt), np.concatenate(reachable))


def _felt(
    pieces: Sequence[Stroke],
    spectra: BandSpectra,
    perception: Perception,
    tick_s: float,
    noise_n: float,
) -> tuple[list[float | None], list[bool | None]]:
    """The residual's force in each band (rms), less noise, and whether it is above threshold."""
    if not pieces:
        return [None] * len(CENTRES_HZ), [None] * len(CENTRES_HZ)
    load_n = float(np.mean(np.concatenate([piece.normal_n for piece in pieces])))
    raw_n = spectra.residual_rms * load_n
    noise_rms_n = noise_n * np.sqrt(np.diff(EDGES_HZ) * 2.0 * tick_s)
    residual_n = np.sqrt(np.maximum(raw_n**2 - noise_rms_n**2, 0.0))
    threshold_n = np.array(perception.band_thresholds_n())
    above = residual_n > threshold_n
    hidden = np.isnan(raw_n) | ((noise_rms_n > threshold_n) & (residual_n < noise_rms_n))
    felt = [None if h else bool(a) for h, a in zip(hidden, above, strict=True)]
    return _numbers(residual_n), felt


def _correlations(pieces: Sequence[Stroke], tick_s: float) -> tuple[float, float, float]:
    """Correlation as it is, the best lag in seconds, and the correlation there; NaN for unknown."""
    most = round(SEARCH_S / tick_s)
    gap = np.full(most, np.nan)  # so that no stroke meets another
    asked = np.concatenate([gap, *(v for p in pieces for v in (p.asked_cof, gap))])
    felt = np.concatenate([gap, *(v for p in pieces for v in (p.felt_cof, gap))])
    known = asked[np.isfinite(asked)]
    if known.size == 0 or np.std(known) < LEAST_COF:
        return np.nan, np.nan, np.nan
    by_lag = correlation_by_lag(asked, felt, most)
    peak = best_peak(by_lag)
    if peak is None:
        return float(by_lag[most]), np.nan, np.nan
    return float(by_lag[most]), peak.lag * tick_s, peak.correlation


def _mean(values: Mask) -> float | None:
    return float(np.mean(values)) if values.size else None


def _rms(values: Array) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if values.size else None


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _numbers(values: Array) -> list[float | None]:
    return [_number(value) for value in values.tolist()]
