"""Which contacts are compared, and what is compared in each: solver over theory, one row per
contact and pressure.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from functools import lru_cache
from pathlib import Path

import numpy as np

from model.contact.gap_distribution import area_ratio, gap_distribution, mean_gap
from model.contact.gap_table import gap_mass, integrals_of
from model.contact.roughness import Array, SelfAffineShape
from model.contact.theory_error import GAP_LENGTH_M, PRESSURE_PA
from validation.contact_solver import RoughContact, SolvedContact, random_surface, solve

HURST, GAMMA = 0.71, 0.45
WIDEST = 32  # q1/q0 of the surfaces that the theory's error is taken from
GAP_EDGES_M = np.geomspace(0.05e-6, 200e-6, 41)
DRAWN_STEP = 0.02  # of magnification: far gaps show steps of 0.1 as hills, see docs/physics.md


@dataclass(frozen=True)
class Study:
    """Surfaces of one q1/q0 on one grid."""

    zeta1: int
    points: int
    seeds: tuple[int, ...]


ALL = (1, 2, 3, 4)
STUDIES = (
    Study(WIDEST, 512, ALL),
    Study(WIDEST, 1024, ALL),
    Study(8, 256, ALL),
    Study(8, 512, ALL),
    Study(16, 512, ALL),
)


@dataclass(frozen=True)
class Row:
    """Ratios solver/theory of one surface under one pressure; `k_*` are of K at the lengths h of
    `theory_error`.
    """

    zeta1: int
    points: int
    seed: int
    pressure_pa: float
    mean_gap: float
    area: float
    k_0_3_um: float
    k_1_um: float
    k_5_um: float

    @property
    def k(self) -> tuple[float, ...]:
        """The three ratios of K, in the order of `theory_error.GAP_LENGTH_M`."""
        return self.k_0_3_um, self.k_1_um, self.k_5_um


@dataclass(frozen=True)
class Theory:
    """What the shipped theory says of the same contact, in SI units."""

    mean_gap_m: float
    area_ratio: float
    k_per_m2: Array


def contact_of(zeta1: int) -> RoughContact:
    """The compared contact at one q1/q0."""
    return RoughContact(SelfAffineShape(HURST, float(zeta1), GAMMA))


@lru_cache(maxsize=64)
def theory(contact: RoughContact, pressure_pa: float) -> Theory:
    """By direct quadrature, not by the table."""
    p_hat = pressure_pa / contact.pressure_scale_pa
    z_hat = np.array(GAP_LENGTH_M, dtype=np.complex128) / contact.h_rms_m
    k_hat, _ = integrals_of(gap_mass(contact.shape, p_hat), z_hat)
    gap_m = mean_gap(contact.shape, p_hat) * contact.h_rms_m
    return Theory(gap_m, float(area_ratio(contact.shape, p_hat)), k_hat / contact.h_rms_m**2)


def compare(study: Study, seed: int, solved: SolvedContact) -> Row:
    expected = theory(contact_of(study.zeta1), solved.pressure_pa)
    k = [
        float(solved.inverse_square_per_m2(h) / e)
        for h, e in zip(GAP_LENGTH_M, expected.k_per_m2, strict=True)
    ]
    gap = solved.mean_gap_m / expected.mean_gap_m
    return Row(
        study.zeta1,
        study.points,
        seed,
        solved.pressure_pa,
        gap,
        solved.area_ratio / expected.area_ratio,
        *k,
    )


def gap_shares(solved: SolvedContact) -> Array:
    """Share of the nominal area per unit of ln u between `GAP_EDGES_M`, without the contact."""
    counts, _ = np.histogram(solved.gap_m[~solved.touching], GAP_EDGES_M)
    return np.asarray(counts / solved.gap_m.size / np.diff(np.log(GAP_EDGES_M)))


def theory_shares(pressure_pa: float, gap_m: Array) -> Array:
    """u P(u) of (48) for the widest spectrum: the same per unit of ln u."""
    contact = contact_of(WIDEST)
    u = gap_m / contact.h_rms_m
    return (
        gap_distribution(
            contact.shape, pressure_pa / contact.pressure_scale_pa, DRAWN_STEP
        ).density(u)
        * u
    )


def run(
    tell: Callable[[str], None],
    studies: Sequence[Study] = STUDIES,
    pressures_pa: Iterable[float] = PRESSURE_PA,
) -> tuple[list[Row], dict[float, Array]]:
    """Solve everything: rows, and the distribution of gaps [bins] by pressure, the mean over the
    finest surfaces.
    """
    rows: list[Row] = []
    finest = max((s for s in studies), key=lambda s: (s.zeta1, s.points))
    shares: dict[float, list[Array]] = {}
    for study in studies:
        for seed in study.seeds:
            heights = random_surface(contact_of(study.zeta1), seed, study.points)
            for pressure in pressures_pa:
                solved = solve(contact_of(study.zeta1), heights, pressure)
                rows.append(compare(study, seed, solved))
                tell(
                    f"q1/q0 {study.zeta1}, {study.points} points, seed {seed},"
                    f" {pressure / 1e3:g} kPa"
                )
                if study == finest:
                    shares.setdefault(pressure, []).append(gap_shares(solved))
    return rows, {pressure: np.mean(each, axis=0) for pressure, each in shares.items()}


def write_rows(rows: Sequence[Row], path: Path) -> None:
    """As CSV, four significant digits."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(f.name for f in fields(Row))
        writer.writerows([f"{value:.4g}" for value in asdict(row).values()] for row in rows)


def read_rows(path: Path) -> list[Row]:
    with path.open(newline="", encoding="utf-8") as file:
        return [
            Row(**{f.name: (int if f.type == "int" else float)(line[f.name]) for f in fields(Row)})
            for line in csv.DictReader(file)
        ]
