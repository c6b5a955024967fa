"""Where data and model disagree: contiguous regions of the inputs whose residuals lean one way,
with family-wise p.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.linalg import qr
from scipy.special import chdtrc, ndtr

from model.diagnosis.data import Measurements
from model.diagnosis.levels import rows_in_order
from model.diagnosis.model_fit import Fit
from model.diagnosis.noise import Noise
from model.diagnosis.smooth import INPUTS, standardised
from model.diagnosis.witness import FRICTION
from model.support.arrays import Array, Mask

PAIRS = (
    ("frequency_hz", "voltage_v"),
    ("frequency_hz", "normal_force_n"),
    ("frequency_hz", "speed_m_s"),
    ("voltage_v", "speed_m_s"),
    ("voltage_v", "normal_force_n"),
    ("frequency_hz", "time_s"),
)
BINS = {"frequency_hz": 8}
OTHER_BINS = 5
FEWEST = 6  # rows inside and outside of a region
DRAWS = 2000
MOST_REGIONS = 5
ALARM = 0.01


@dataclass(frozen=True)
class Region:
    """A contiguous range of one input, or of two, in one witness; `sign` +1 where that exceeds the
    model's.
    """

    axes: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    count: int
    z: float
    p_value: float
    mean_error: float
    witness: int = FRICTION

    @property
    def sign(self) -> int:
        """+1: more than the model says; -1: less."""
        return 1 if self.z > 0 else -1


@dataclass(frozen=True)
class Disagreement:
    """Everything the residuals of one fit say: regions, and tests of smooth lack of fit and of
    order in time.
    """

    regions: tuple[Region, ...]
    lack_of_fit_p: float
    order_p: float
    order_correlation: float

    @property
    def alarm(self) -> bool:
        """Whether the strongest region disagrees beyond chance."""
        return bool(self.regions and self.regions[0].p_value < ALARM)

    @property
    def certain(self) -> list[Region]:
        """The regions that disagree beyond chance, strongest first."""
        return [region for region in self.regions if region.p_value < ALARM]


def disagreement(
    data: Measurements, noise: Noise, fit: Fit, bent: Array, seed: int
) -> Disagreement:
    """Scan the residuals of `fit`; what its form may be off by, `bent` [n, m], is no lack of
    fit.
    """
    residual = fit.residual / np.sqrt(fit.scale2)
    tangent = qr(fit.jacobian, mode="economic")[0]
    boxes = _boxes(data)
    regions = (
        _scan(data, noise, residual, tangent, boxes, fit, np.random.default_rng(seed))
        if boxes
        else ()
    )
    correlation, order_p = neighbour_correlation(data, residual)
    lack_of_fit_p = _lack_of_fit(data, noise, residual, tangent, bent / np.sqrt(fit.scale2))
    return Disagreement(tuple(regions), lack_of_fit_p, order_p, correlation)


@dataclass(frozen=True)
class Box:
    """A range of one input, or of two, with its rows."""

    axes: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    rows: Mask
    witness: int = FRICTION


def _boxes(data: Measurements) -> list[Box]:
    """Contiguous ranges of bins of each input, and of the pairs, in each witness; every set of rows
    once.
    """
    boxes: list[Box] = []
    for witness in data.witnesses:
        mine = data.of(witness)
        for box in ranges_of(data.subset(mine)):
            rows = np.zeros(data.count, bool)
            rows[mine] = box.rows
            boxes.append(Box(box.axes, box.low, box.high, rows, witness))
    seen: set[bytes] = set()
    distinct = []
    for box in boxes:
        key = np.packbits(box.rows).tobytes()
        if key not in seen and FEWEST <= box.rows.sum() <= data.count - FEWEST:
            seen.add(key)
            distinct.append(box)
    return distinct


def ranges_of(data: Measurements) -> list[Box]:
    """Contiguous ranges of bins of each input, and of the pairs that make sense together."""
    ranges = {name: _ranges(data, name) for name in INPUTS if data.varies(name)}
    boxes = [
        Box((name,), (low,), (high,), rows)
        for name, items in ranges.items()
        for low, high, rows in items
    ]
    for a, b in PAIRS:
        if a in ranges and b in ranges:
            boxes += [
                Box((a, b), (la, lb), (ha, hb), ra & rb)
                for la, ha, ra in ranges[a]
                for lb, hb, rb in ranges[b]
            ]
    return boxes


def _ranges(data: Measurements, name: str) -> list[tuple[float, float, Mask]]:
    values = data.columns[name]
    allowed = data.driven if name == "frequency_hz" else np.ones(data.count, bool)
    levels = np.unique(values[allowed])
    bins = BINS.get(name, OTHER_BINS)
    groups = (
        np.array_split(levels, min(bins, levels.size))
        if levels.size <= 2 * bins
        else np.array_split(np.sort(values[allowed]), bins)
    )
    edges = [(float(g[0]), float(g[-1])) for g in groups if len(g)]
    found = []
    for i, j in combinations(range(len(edges) + 1), 2):
        if (i, j) != (0, len(edges)):
            low, high = edges[i][0], edges[j - 1][1]
            found.append((low, high, allowed & (values >= low) & (values <= high)))
    return found


def _scan(
    data: Measurements,
    noise: Noise,
    residual: Array,
    tangent: Array,
    boxes: list[Box],
    fit: Fit,
    rng: np.random.Generator,
) -> list[Region]:
    directions = noise.whiten(np.stack([box.rows for box in boxes], axis=1).astype(float))
    directions -= tangent @ (tangent.T @ directions)
    norms = np.linalg.norm(directions, axis=0)
    usable = norms > 1e-6 * np.sqrt(data.count)
    boxes = [box for box, ok in zip(boxes, usable, strict=True) if ok]
    if not boxes:
        return []
    directions = directions[:, usable] / norms[usable]
    chance = rng.standard_normal((data.count, DRAWS), dtype=np.float32)
    largest = np.abs(directions.T.astype(np.float32) @ chance).max(axis=0)
    raw = noise.lower @ residual * np.sqrt(fit.scale2)
    regions, left = [], residual.copy()
    for _ in range(MOST_REGIONS):
        z = directions.T @ left
        best = int(np.argmax(np.abs(z)))
        p = float((np.sum(largest >= abs(z[best])) + 1.0) / (DRAWS + 1.0))
        box = boxes[best]
        error = float(raw[box.rows].mean())
        count = int(box.rows.sum())
        regions.append(
            Region(box.axes, box.low, box.high, count, float(z[best]), p, error, box.witness)
        )
        left = left - z[best] * directions[:, best]
        if p > 0.2:
            break
    return regions


def _lack_of_fit(
    data: Measurements, noise: Noise, residual: Array, tangent: Array, bent: Array
) -> float:
    """p of a smooth (quadratic) pattern in the inputs that the model's own parameters cannot
    make.
    """
    columns = []
    for witness in data.witnesses:
        mine = data.of(witness)
        part = data.subset(mine)
        driven = part.driven.astype(float)
        x = {name: standardised(part, name) for name in INPUTS if part.varies(name)}
        of_witness = [driven]
        for i, a in enumerate(x):
            of_witness.append(x[a] * (driven if a in ("frequency_hz", "voltage_v") else 1.0))
            of_witness += [x[a] * x[b] * driven for b in list(x)[i:]]
        columns.append(np.zeros((data.count, len(of_witness))))
        columns[-1][mine] = np.stack(of_witness, axis=1)
    basis = noise.whiten(np.concatenate(columns, axis=1))
    basis -= tangent @ (tangent.T @ basis)
    left, singular, _ = np.linalg.svd(basis, full_matrices=False)
    left = left[:, singular > 1e-6 * singular[0]]
    along, off = left.T @ residual, left.T @ bent
    square = along @ np.linalg.solve(np.eye(len(along)) + off @ off.T, along)
    return float(chdtrc(len(along), square))


def neighbour_correlation(data: Measurements, residual: Array) -> tuple[float, float]:
    """Correlation of neighbours in time within sessions, and its two-sided p."""
    sessions = [residual[rows] for rows in rows_in_order(data)]
    products = sum(float(r[1:] @ r[:-1]) for r in sessions)
    squares = sum(float(r @ r) for r in sessions)
    pairs = sum(max(r.size - 1, 0) for r in sessions)
    if pairs < FEWEST or squares == 0.0:
        return 0.0, 1.0
    correlation = products / squares
    return correlation, float(2.0 * ndtr(-abs(correlation) * np.sqrt(pairs)))
