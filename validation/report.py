"""docs/validation.md and its pictures, from the rows of `study`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np

from model.contact.roughness import Array
from model.contact.theory_error import GAP_LENGTH_M, LOG_STD, PRESSURE_PA
from validation.study import GAP_EDGES_M, WIDEST, Row, theory_shares

mpl.use("Agg")
import matplotlib.pyplot as plt

AGREED = 0.02  # what `theory_error.LOG_STD`, which is rounded, may be less than a run
SCATTER = 0.05  # of log K at 5 um between the surfaces of one grid
# [pressure, length] solver/theory, four surfaces on one grid of 1024 x 1024, tamaas 2.9.0
EARLIER = ((0.74, 0.75, 0.89), (0.86, 0.85, 0.92), (1.05, 0.99, 0.98))
COLOURS = ("#1b6ca8", "#e08e0b", "#5b8c5a")
PAGE = """# How good the contact theory is

For people who need to know the error of an electrostatic force.

`make validate` solves the same contact twice. One solution is Persson's theory (`model/contact/gap_distribution.py`,
(41)-(49)). The other is a boundary-element solver, point by point (tamaas, Polonsky and Keer 1999, periodic, no adhesion;
only the extra `validate` installs it). The command rewrites this page, its table `validation.csv` and its pictures. It
fails if `model/contact/theory_error.py` claims a smaller error than it found.

| the contact | |
|---|---|
| surfaces | random-phase, self-affine, H 0.71, h_rms 20 um (each surface exactly), no roll-off plateau |
| q0 | 1e3 1/m, four longest waves along a side |
| modulus Y* | 13.33 MPa |
| widest spectrum | q1/q0 = {widest}: {per_wave} points for its shortest wave on the finest grid of {finest} x {finest} |
| seeds at that width | {seeds} on the finest grid, {coarse_seeds} on {coarse} x {coarse} |

All numbers are **solver over theory**. The electrostatic pressure is proportional to K(h), the integral of P(u)/(u + h)^2
over the gaps without the contact. h is the electrical length of insulator and skin.

## The finest grid: mean over the surfaces, and the range

{fine}

## Extrapolated to points without size

The extrapolation is of first order in the spacing, from {coarse} and {finest} points, surface by surface. First order is an
assumption. On one surface at 5 kPa it was compared with a finer grid:

| points | K(0.3 um) | K(1 um) | K(5 um) | real area |
|---|---|---|---|---|
| 2048 | 0.92 | 0.91 | 1.03 | 1.46 |
| {coarse}, {finest}, extrapolated | {seed1} |

The area falls as the grid is refined, because a point touches as a whole or not at all.

{extrapolated}

![Ratios of K over the pressure](pictures/validation-ratios.png)

![Distribution of the gaps](pictures/validation-gaps.png)

## Resolution and width of the spectrum

[validation.csv](validation.csv) has every contact: each width of spectrum, grid, surface and pressure.

## What follows

- The mean gap is known to {gap:.0f} % on any grid, because it depends on the longest waves.
- K at small h depends on the points next to the contact. Part of the difference on a given grid is an error of the solver,
  which falls as the grid is refined.
- `model/contact/theory_error.py` has the error that counts in a surface's uncertainty (second table). It is the rms over
  the surfaces of log(solver/theory) at the finest grid. A larger rms of the extrapolated values replaces it. So does a
  larger difference in a comparison on four surfaces of one grid, 1024 x 1024 (first table).
- The error is at least {scatter:.2f}, the scatter between surfaces.

| pressure | K(0.3 um) | K(1 um) | K(5 um) | mean gap | real area |
|---|---|---|---|---|---|
| 5 kPa | 0.74 | 0.75 | 0.89 | 0.93 | 1.47 |
| 20 kPa | 0.86 | 0.85 | 0.92 | 0.91 | 1.42 |
| 100 kPa | 1.05 | 0.99 | 0.98 | 0.82 | 1.32 |

{std}

Three things are not tested. A fingerpad's spectrum is far wider (q1/q0 = 1e7 in Table I) than any solver resolves. Skin is
neither linear nor an elastic half-space. Adhesion is left out. For a finger the figures above are a judged error.

## Against fingers

[How force grows with voltage](voltage-law.md) confronts the models with what others report of fingers, untuned. The same
command rewrites it.

![Force over voltage](pictures/voltage-law.png)
"""


def write(rows: Sequence[Row], shares: Mapping[float, Array], docs: Path) -> None:
    """The page and its pictures; the table is written by `study`."""
    coarse, finest = _grids(rows)
    wide = [r for r in rows if (r.zeta1, r.points) == (WIDEST, finest)]
    limit = _extrapolated(rows)
    first = next(r for r in limit if r.pressure_pa == PRESSURE_PA[0])
    page = PAGE.format(
        widest=WIDEST,
        per_wave=finest // (4 * WIDEST),
        finest=finest,
        coarse=coarse,
        seeds=", ".join(str(s) for s in sorted({r.seed for r in wide})),
        coarse_seeds=", ".join(
            str(s)
            for s in sorted({r.seed for r in rows if (r.zeta1, r.points) == (WIDEST, coarse)})
        ),
        fine=_table(wide),
        extrapolated=_table(limit),
        seed1=" | ".join(f"{k:.2f}" for k in (*first.k, first.area)),
        gap=max(abs(100.0 * (r.mean_gap - 1.0)) for r in wide),
        scatter=SCATTER,
        std=_std_table(log_std(rows)),
    )
    (docs / "validation.md").write_text(page, encoding="utf-8")
    _draw_ratios(wide, limit, docs / "pictures" / "validation-ratios.png")
    _draw_gaps(shares, docs / "pictures" / "validation-gaps.png")


def log_std(rows: Sequence[Row]) -> Array:
    """[pressure, length]: log(solver/theory) of K at the finest grid, extrapolated or earlier, the
    largest.
    """
    _, finest = _grids(rows)
    wide = [r for r in rows if (r.zeta1, r.points) == (WIDEST, finest)]
    found = np.maximum.reduce([_rms(wide), _rms(_extrapolated(rows)), np.abs(np.log(EARLIER))])
    return np.asarray(np.maximum(found, SCATTER))


def disagreements(rows: Sequence[Row]) -> list[str]:
    """Where `theory_error.LOG_STD` claims less than this run found, in words."""
    found = log_std(rows)
    return [
        f"{p / 1e3:g} kPa, h = {h * 1e6:g} um: {found[i, j]:.3f} instead of {LOG_STD[i][j]:g}"
        for i, p in enumerate(PRESSURE_PA)
        for j, h in enumerate(GAP_LENGTH_M)
        if found[i, j] > LOG_STD[i][j] + AGREED
    ]


def _grids(rows: Sequence[Row]) -> tuple[int, int]:
    """The two finest grids of the widest spectrum."""
    coarse, finest = sorted({r.points for r in rows if r.zeta1 == WIDEST})[-2:]
    return coarse, finest


def _extrapolated(rows: Sequence[Row]) -> list[Row]:
    """Each surface and pressure at no spacing, first order, from the two finest grids."""
    coarse, finest = _grids(rows)
    at = {(r.points, r.seed, r.pressure_pa): r for r in rows if r.zeta1 == WIDEST}
    share = coarse / (finest - coarse)
    found = []
    for (points, seed, pressure), fine in at.items():
        if points == finest:
            rough = at[coarse, seed, pressure]
            pairs = zip(_numbers(fine), _numbers(rough), strict=True)
            found.append(Row(WIDEST, 0, seed, pressure, *(f + share * (f - c) for f, c in pairs)))
    return found


def _numbers(row: Row) -> tuple[float, ...]:
    return row.mean_gap, row.area, *row.k


def _rms(rows: Sequence[Row]) -> Array:
    logs = [[np.log(r.k) for r in rows if r.pressure_pa == p] for p in PRESSURE_PA]
    return np.array([np.sqrt(np.mean(np.square(each), axis=0)) for each in logs])


def _table(rows: Sequence[Row]) -> str:
    lines = [
        "| pressure | mean gap | real area | K(0.3 um) | K(1 um) | K(5 um) |",
        "|---|---|---|---|---|---|",
    ]
    for p in PRESSURE_PA:
        numbers = np.array([_numbers(r) for r in rows if r.pressure_pa == p])
        spans = zip(numbers.mean(0), numbers.min(0), numbers.max(0), strict=True)
        cells = [f"{m:.2f} ({a:.2f}-{b:.2f})" if b > a else f"{m:.2f}" for m, a, b in spans]
        lines.append(f"| {p / 1e3:g} kPa | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _std_table(std: Array) -> str:
    lines = ["| pressure | h = 0.3 um | 1 um | 5 um |", "|---|---|---|---|"]
    lines += [
        f"| {p / 1e3:g} kPa | " + " | ".join(f"{s:.2f}" for s in row) + " |"
        for p, row in zip(PRESSURE_PA, std, strict=True)
    ]
    return "\n".join(lines)


def _draw_ratios(finest: Sequence[Row], limit: Sequence[Row], path: Path) -> None:
    figure, axes = plt.subplots(1, 2, figsize=(12.0, 4.8), sharey=True, layout="constrained")
    for ax, rows, title in ((axes[0], finest, "finest grid"), (axes[1], limit, "extrapolated")):
        for j, (h, colour) in enumerate(zip(GAP_LENGTH_M, COLOURS, strict=True)):
            x = np.array([r.pressure_pa for r in rows]) * 1.06 ** (j - 1) / 1e3
            y = np.array([r.k[j] for r in rows])
            ax.semilogx(x, y, "o", color=colour, ms=5, alpha=0.7, label=f"K, h = {h * 1e6:g} µm")
            mean = [y[[r.pressure_pa == p for r in rows]].mean() for p in PRESSURE_PA]
            ax.semilogx(np.array(PRESSURE_PA) * 1.06 ** (j - 1) / 1e3, mean, color=colour, lw=1.8)
        gaps = [np.mean([r.mean_gap for r in rows if r.pressure_pa == p]) for p in PRESSURE_PA]
        ax.semilogx(
            np.array(PRESSURE_PA) / 1e3,
            gaps,
            "s--",
            color="#3a3a3a",
            lw=1.2,
            ms=4,
            label="mean gap",
        )
        ax.axhline(1.0, color="#8a8f98", lw=1.0)
        ax.set(xlabel="nominal pressure, kPa", title=title)
        ax.set_xticks([5, 20, 100], ["5", "20", "100"])
        ax.set_xticks([], minor=True)
        ax.grid(alpha=0.25)
    axes[0].set_ylabel("solver over theory")
    axes[1].legend(loc="best", frameon=False)
    figure.savefig(path, dpi=130, metadata={"Software": None})
    plt.close(figure)


def _draw_gaps(shares: Mapping[float, Array], path: Path) -> None:
    figure, axes = plt.subplots(
        1, len(shares), figsize=(15.0, 4.6), sharey=True, squeeze=False, layout="constrained"
    )
    middle = np.sqrt(GAP_EDGES_M[1:] * GAP_EDGES_M[:-1])
    fine = np.geomspace(GAP_EDGES_M[0], GAP_EDGES_M[-1], 300)
    for ax, (pressure, share) in zip(axes[0], sorted(shares.items()), strict=True):
        ax.loglog(
            fine * 1e6, theory_shares(pressure, fine), color=COLOURS[0], lw=2.0, label="theory (48)"
        )
        ax.loglog(
            middle * 1e6, share, "o", color=COLOURS[1], ms=4, label="solver, mean of the surfaces"
        )
        ax.set(xlabel="gap u, µm", title=f"{pressure / 1e3:g} kPa", ylim=(1e-4, 3.0))
        ax.grid(alpha=0.25)
    axes[0][0].set_ylabel("share of the area per unit of ln u")
    axes[0][0].legend(loc="upper left", frameon=False)
    figure.savefig(path, dpi=130, metadata={"Software": None})
    plt.close(figure)
