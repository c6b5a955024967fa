"""How much of a gap an effect closes in another form than its own, and how much a wrong one.

`make forms` writes `forms.csv`. A row is one published form of one effect, or something that no
catalogue has, clearly visible to all witnesses. What is said of an effect here comes from others.
"""

from __future__ import annotations

import csv
import hashlib
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from model.effects import BY_NAME, CATALOGUE

FILE = Path(__file__).with_suffix(".csv")


class Row(NamedTuple):
    """The share of the gap that the catalogue's form closes on held-out data.

    Where `name` is none of the catalogue's, that of the effect with the most evidence.
    """

    name: str
    form: str
    closed: float


class Share(NamedTuple):
    """Share of a gap that an effect closes on held-out data, and its standard deviation."""

    effect: str
    closed: float
    std: float


def share_odds(shares: Iterable[Share]) -> float:
    """How many times more probable such shares are if these effects are there, in whatever form,
    than if something else is.
    """
    return float(np.prod([_odds(share) for share in shares]))


def _odds(share: Share) -> float:
    known, unknown = list[float](), list[float]()
    for row in rows_of_file():
        if row.name != share.effect and np.isfinite(row.closed):
            (known if row.name in BY_NAME else unknown).append(row.closed)
    odds = _density(share, known) / _density(share, unknown)
    return float(odds) if np.isfinite(odds) else 1.0  # nothing was held out, or there is no gap


def _density(share: Share, closed: list[float]) -> float:
    """Of a share among others, by normal kernels as wide as Scott's rule says; 1 is the most."""
    known = np.clip(closed, 0.0, 1.0)
    std = np.hypot(share.std, known.std() * known.size**-0.2)
    away = (np.clip(share.closed, 0.0, 1.0) - known) / std
    return float(np.mean(np.exp(-0.5 * away**2)) / std)


@cache
def rows_of_file() -> list[Row]:
    """What the file has, in its order."""
    lines = FILE.read_text(encoding="utf-8").splitlines()[1:]
    return [Row(r["name"], r["form"], float(r["closed"])) for r in csv.DictReader(lines)]


def catalogue_hash() -> str:
    """Of the names, parameters and priors of all effects."""
    known = [(effect.name, effect.parameters()) for effect in CATALOGUE]
    return hashlib.sha256(repr(known).encode()).hexdigest()[:16]
