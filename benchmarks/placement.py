"""How far from the finger a place is rendered, by recorded paths of fingers on a touch panel.

`FINGER_PATHS` names a folder of text files whose rows are time in s, x and y in pixels of 0.17 mm.
Rows that repeat a place are no reports. Each report is extrapolated by a latency, and compared with
where the panel says the finger is then, between reports on a line. So the panel's own doubt of a
place counts twice.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.claim import Claim
from haptic_driver.render.finger import INITIAL, FingerSettings, track
from haptic_driver.render.way import follow
from haptic_driver.signals import Array, FingerSample

FOLDER, PIXEL_M = "FINGER_PATHS", 0.17e-3
LATENCIES_S = 0.02, 0.04
PRESSED_N = 0.5
WAVES_M = 0.001, 0.002, 0.004
TICK_S, PIECE, MOVED = 1e-3, 100, 0.3


def run() -> Iterator[Claim]:
    folder = os.environ.get(FOLDER)
    if not folder:
        yield Claim("placement on recorded paths", f"not measured: set {FOLDER} to their folder")
        return
    paths = [reports(path) for path in sorted(Path(folder).glob("*.txt"))]
    for latency_s in LATENCIES_S:
        rows = [row for path in paths for row in errors(path, latency_s)]
        ours_m, held_m, std_m, turns = np.array(rows).T
        at_turns = turns == 1.0
        share = np.mean(ours_m < std_m * math.sqrt(2.0 * math.log(2.0)))
        what = f"{len(paths)} paths, {1e3 * latency_s:.0f} ms ahead"
        yield Claim(
            f"{what}: error, median and 95 %",
            f"{told(ours_m)}; by the last report {told(held_m)}",
            "nearer than the last report",
            bool(np.median(ours_m) < np.median(held_m)),
        )
        yield Claim(
            f"{what}: the same at {at_turns.sum()} reports beside a turn",
            f"{told(ours_m[at_turns])}; by the last report {told(held_m[at_turns])}"
            if at_turns.any()
            else "there is none",
        )
        yield Claim(f"{what}: within the half that its own deviation promises", f"{share:.0%}")
    own_m = np.array([error_m for path in paths for error_m in doubts(path)])
    yield Claim("a report beside what its neighbours on both sides tell", told(own_m))
    for wave_m in WAVES_M:
        fits = np.array([fit for path in paths for fit in fits_of_waves(path, wave_m)])
        by_time, by_space = fits.mean(axis=0)
        yield Claim(
            f"waves of {1e3 * wave_m:g} mm, {len(fits)} pieces of 0.1 s: r at the best delay",
            f"by time {by_time:.2f}; by space {by_space:.2f}",
            "better by time",
            bool(by_time > by_space),
        )


def reports(path: Path) -> Array:
    """Time, x and y in metres [n, 3]: rows at which the place has changed."""
    rows = np.loadtxt(path, delimiter=",")
    moved = np.any(np.diff(rows[:, 1:], axis=0) != 0.0, axis=1)
    return rows[np.concatenate([[True], moved])] * [1.0, PIXEL_M, PIXEL_M]


def errors(path: Array, latency_s: float) -> Iterator[tuple[float, float, float, bool]]:
    """Of each report from the second on: distance to the finger, that of the last report, the
    standard deviation along an axis, whether a turn is beside it.
    """
    settings = _settings(path, latency_s)
    steps = np.diff(path[:, 1:], axis=0)
    back = np.flatnonzero(np.sum(steps[1:] * steps[:-1], axis=1) < 0.0) + 1
    turns = {int(k + d) for k in back for d in (-1, 0, 1)}
    state = INITIAL
    for k, (time_s, x_m, y_m) in enumerate(path.tolist()):
        state, finger = track(settings, state, FingerSample(time_s, x_m, y_m, PRESSED_N))
        due_s = time_s + latency_s
        if k == 0 or due_s > path[-1, 0]:
            continue
        there = [float(np.interp(due_s, path[:, 0], column)) for column in path[:, 1:].T]
        ours_m = math.dist((finger.position_x_m, finger.position_y_m), there)
        yield ours_m, math.dist((x_m, y_m), there), state.std_m(latency_s), k in turns


def doubts(path: Array) -> Iterator[float]:
    """Of each report, the distance to a cubic through four neighbours on each side: nobody who
    knows less tells its place better.
    """
    for k in range(4, len(path) - 4):
        near = np.delete(path[k - 4 : k + 5], 4, axis=0)
        age = (near[:, 0] - path[k, 0]) / LATENCIES_S[0]
        there = np.polynomial.polynomial.polyfit(age, near[:, 1:], 3)[0]
        yield math.dist(there, path[k, 1:])


def fits_of_waves(path: Array, wave_m: float) -> Iterator[tuple[float, float]]:
    """How well waves along x and y, as rendered in each 0.1 s, are those under the finger at the
    best delay up to 0.1 s: by time, and by space.
    """
    time_s = np.arange(path[1, 0], path[-1, 0] - LATENCIES_S[0], TICK_S)
    settings = _settings(path, LATENCIES_S[0])
    state, way, placed = INITIAL, None, []
    for now_s in time_s.tolist():
        report = path[np.searchsorted(path[:, 0], now_s, side="right") - 1]
        sample = FingerSample(*report.tolist(), PRESSED_N, now_s=now_s)
        state, finger = track(settings, state, sample)
        way, at = follow(way, sample, finger, settings.longest_age_s)
        placed.append([at[1:3], finger[1:3]])
    ways_m = np.array(placed)  # [tick, by time or space, axis]
    for axis in (0, 1):
        felt = np.interp(time_s + LATENCIES_S[0], path[:, 0], path[:, 1 + axis])
        felt_wave, waves = (np.sin(math.tau * m / wave_m) for m in (felt, ways_m[:, :, axis]))
        for begin in range(0, time_s.size - 2 * PIECE, PIECE // 2):
            piece = felt_wave[begin : begin + PIECE]
            if piece.std() > MOVED:
                longer = waves[begin : begin + 2 * PIECE].T
                yield _fit(piece, longer[0]), _fit(piece, longer[1])


def _fit(piece: Array, longer: Array) -> float:
    """The highest correlation of a piece [n] with one of a longer piece."""
    windows = np.lib.stride_tricks.sliding_window_view(longer, piece.size)
    centred = windows - windows.mean(axis=1, keepdims=True)
    size = np.maximum(np.linalg.norm(centred, axis=1), 1e-12)
    own = piece - piece.mean()
    return float((centred @ own / (size * np.linalg.norm(own))).max())


def _settings(path: Array, latency_s: float) -> FingerSettings:
    interval_s = float(np.median(np.diff(path[:, 0])))
    return FingerSettings(
        output_latency_s=latency_s,
        longest_age_s=2.0 * interval_s,
        position_noise_m=PIXEL_M / math.sqrt(12.0),
        report_jitter_s=interval_s / math.sqrt(12.0),
    )


def told(error_m: Array) -> str:
    return "{:.2f} and {:.2f} mm".format(*1e3 * np.percentile(error_m, [50.0, 95.0]))
