"""How far other forms of effects are from the catalogue's, and what is no effect: `forms.csv`.

`make forms` writes that file. A row is one published form of one effect, or something that no
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

from model.effects import CATALOGUE

FILE = Path(__file__).with_suffix(".csv")
EXACT, *WAYS = "exact", "apart", "together"  # ways in which a form is off, as `form_terms` has them
NODES = 5  # by which a distribution of shares is summed, each as probable


class Row(NamedTuple):
    """`way` in which a form is off, and by what `share`; no way of what is no effect.

    `closed`: the share of the gap that the catalogue's form closes on held-out data, or the best of
    its effects.
    """

    name: str
    form: str
    way: str
    share: float
    closed: float


class Share(NamedTuple):
    """Share of a gap that an effect closes on held-out data, and its standard deviation."""

    effect: str
    closed: float
    std: float


class FormErrors(NamedTuple):
    """Probability that a form is the catalogue's, and shares that it is off otherwise, by way."""

    exact: float
    shares: list[list[float]]


def form_errors(effects: Iterable[str]) -> FormErrors:
    """How far forms of these effects may be off, by those of all others."""
    return _form_errors(frozenset(effects))


@cache
def _form_errors(left_out: frozenset[str]) -> FormErrors:
    forms = [row for row in rows_of_file() if row.way and row.name not in left_out]
    exact = sum(row.way == EXACT for row in forms)
    at = (np.arange(NODES) + 0.5) / NODES
    off = [[row.share for row in forms if row.way == way] for way in WAYS]
    shares = [np.quantile(each, at).tolist() for each in off]
    return FormErrors((exact + 1) / (len(forms) + 2), shares)  # by Laplace's rule of succession


def share_odds(shares: Iterable[Share]) -> float:
    """How many times more probable such shares of a gap are if these effects are there, in whatever
    form, than if something else is.
    """
    return float(np.prod([_odds(share) for share in shares]))


def _odds(share: Share) -> float:
    forms = [row.closed for row in rows_of_file() if row.way and row.name != share.effect]
    others = [row.closed for row in rows_of_file() if not row.way]
    odds = _density(share, forms) / _density(share, others)
    return float(odds) if np.isfinite(odds) else 1.0  # nothing was held out, or there is no gap


def _density(share: Share, closed: list[float]) -> float:
    """Of a share among others, by normal kernels as wide as Scott's rule says; 1 is the most."""
    known = np.clip(np.array(closed)[np.isfinite(closed)], 0.0, 1.0)
    std = np.hypot(share.std, known.std() * known.size**-0.2)
    away = (np.clip(share.closed, 0.0, 1.0) - known) / std
    return float(np.mean(np.exp(-0.5 * away**2)) / std)


@cache
def rows_of_file() -> list[Row]:
    """What the file has, in its order."""
    lines = FILE.read_text(encoding="utf-8").splitlines()[1:]
    found = csv.DictReader(lines)
    return [
        Row(r["name"], r["form"], r["way"], float(r["share"]), float(r["closed"])) for r in found
    ]


def catalogue_hash() -> str:
    """Of the names, parameters and priors of all effects."""
    known = [(effect.name, effect.parameters()) for effect in CATALOGUE]
    return hashlib.sha256(repr(known).encode()).hexdigest()[:16]
