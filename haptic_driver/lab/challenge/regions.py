"""Where a fitted finger does not fit: found in half of the rows, and certified by the other half.

So does LISDD (arXiv:2606.23215): an F-test each, with a bound on the share of false regions. Here
the finger is fitted to both halves.
"""

from __future__ import annotations

import numpy as np
from scipy.special import fdtrc

from model.diagnosis.data import Measurements
from model.diagnosis.model_fit import Fit
from model.diagnosis.where import Box, ranges_of
from model.diagnosis.witness import FRICTION
from model.support.arrays import Array, Mask

CANDIDATES = 10  # regions of the first half that the second one tests
FALSE_SHARE = 0.05  # of the certified regions, at most on average
FEWEST = 3  # rows of a region in each half


def certified(data: Measurements, fit: Fit) -> list[dict[str, list[float]]]:
    """Ranges of inputs in which friction is off, the most certain first."""
    friction = data.of(FRICTION)
    residual = fit.residual[friction]
    boxes = ranges_of(data.subset(friction))
    first = np.random.default_rng(0).permutation(residual.size) % 2 == 0
    halves = [box for box in boxes if min(_count(box, first), _count(box, ~first)) >= FEWEST]
    located = sorted(halves, key=lambda box: -_f_of(residual, box, first))[:CANDIDATES]
    of_second = int(np.sum(~first)) - 1
    tested = sorted(
        (float(fdtrc(1, of_second, _f_of(residual, box, ~first))), i, box)
        for i, box in enumerate(located)
    )
    # Benjamini and Hochberg
    passed = [k for k, (p, _, _) in enumerate(tested, 1) if p <= FALSE_SHARE * k / len(tested)]
    return [_region(box) for _, _, box in tested[: max(passed, default=0)]]


def _count(box: Box, half: Mask) -> int:
    return int(np.sum(box.rows & half))


def _f_of(residual: Array, box: Box, half: Mask) -> float:
    """The square of the mean of a region's residuals over what chance would make of it."""
    inside = residual[box.rows & half]
    return float(inside.size * np.mean(inside) ** 2 / np.mean(residual[half] ** 2))


def _region(box: Box) -> dict[str, list[float]]:
    ends = zip(box.axes, box.low, box.high, strict=True)
    return {axis: [low, high] for axis, low, high in ends}
