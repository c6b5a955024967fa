"""Spectra of the electrode's impedance: are they one system's, and what is the stray capacitance.

A response that is linear, causal and stable obeys Kramers and Kronig's relations. Whether it does
is seen by fitting what obeys them by construction: a series of relaxations with fixed time
constants.
"""

from __future__ import annotations

import csv
import datetime
from collections import defaultdict
from collections.abc import Mapping, Sequence
from math import ceil, log10, pi, sqrt
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_driver.files import replacing
from haptic_driver.lab.measuring.data_file import note
from haptic_driver.signals import Array
from model.parameters import SPECIFICATION
from model.support.cells import read_cell, written_cells

RELAXATIONS_PER_DECADE = 3  # enough for the model's own spectra within 1 %
ROWS_PER_DECADE = 4  # that a spectrum needs at least, or the relaxations fit anything
LEAST_ROWS = 7
TOLERANCE = 0.02  # of |Z|: what valid spectra keep (1 to 2 %)
TOLD_FROM_ZERO = 2.0  # standard deviations
MOST_FAILURES = 1 / 3  # of a spectrum's rows; beyond, all of it fails

ComplexArray = NDArray[np.complex128]


class Stray(NamedTuple):
    """The stray capacitance of electrode and leads, from an open circuit, and when that was
    measured.

    `capacitance_f` is None where the rows hold no number; `why_none` says why.
    """

    capacitance_f: float | None
    std_f: float
    measured_at: str
    why_none: str = ""

    def as_parameter(self) -> str:
        """The line of a model's file, or a comment that says why there is none."""
        if self.capacitance_f is None:
            return f"# stray_capacitance_f: {self.why_none}"
        said = (
            f'value = {self.capacitance_f:.6g}, std = {self.std_f:.2g}, source = "open circuit,'
            f' {self.measured_at}"'
        )
        return f"stray_capacitance_f = {{ {said} }}"


def kramers_kronig_residual(
    frequency_hz: Array, impedance_ohm: ComplexArray, kept: NDArray[np.bool_]
) -> Array:
    """|Z - Z_fit| / |Z| of a spectrum [n] to a sum of relaxations, a resistance, a capacitance and
    an inductance.

    Z_fit is linear in its parameters, with time constants spread evenly over the band (Boukamp, J.
    Electrochem. Soc. 142 (1995) 1885). Only rows that are `kept` [n] are fitted.
    """
    omega = 2.0 * pi * frequency_hz
    taus = np.geomspace(
        1.0 / omega.max(),
        1.0 / omega.min(),
        ceil(RELAXATIONS_PER_DECADE * _decades(frequency_hz)) + 1,
    )
    relaxations = 1.0 / (1.0 + 1j * np.outer(omega, taus))
    basis = np.column_stack([relaxations, np.ones(omega.size), 1.0 / (1j * omega), 1j * omega])
    scaled = basis[kept] / np.abs(impedance_ohm[kept, None])
    wanted = impedance_ohm[kept] / np.abs(impedance_ohm[kept])
    size = np.linalg.norm(scaled, axis=0)
    left, right = (
        np.vstack([scaled.real, scaled.imag]) / size,
        np.concatenate([wanted.real, wanted.imag]),
    )
    fitted = basis @ (np.linalg.lstsq(left, right, rcond=1e-12)[0] / size)
    return np.asarray(np.abs(fitted - impedance_ohm) / np.abs(impedance_ohm))


def _decades(frequency_hz: Array) -> float:
    return log10(frequency_hz.max() / frequency_hz.min())


def passes(frequency_hz: Array, impedance_ohm: ComplexArray, std: Array) -> NDArray[np.bool_]:
    """Which rows of a spectrum [n] agree with the rest of it, within `TOLERANCE` and three times
    their own error.

    `std` is that of |Z| and of its phase, relative. The worst is left out of the fit until the
    others agree.
    """
    allowed = TOLERANCE + 3.0 * std
    kept = np.ones(frequency_hz.size, dtype=np.bool_)
    while kept.sum() >= LEAST_ROWS and (~kept).mean() <= MOST_FAILURES:
        excess = kramers_kronig_residual(frequency_hz, impedance_ohm, kept) / allowed
        worst = int(np.argmax(np.where(kept, excess, 0.0)))
        if excess[worst] <= 1.0:
            return np.asarray(excess <= 1.0)
        kept[worst] = False
    return np.zeros(frequency_hz.size, dtype=np.bool_)


def mark_spectra(path: Path, today: datetime.date) -> tuple[int, Stray | None]:
    """Write into a data file's `kramers_kronig` which rows of its sweeps pass.

    Returns how many fail, and the stray capacitance of all open circuits, which the sidecar keeps
    too; None without one. Spectra of fewer rows than tell anything stay unmarked.
    """
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        names = list(reader.fieldnames or ())
        rows = [{name: read_cell(row[name] or "") for name in names} for row in reader]
    failed = 0
    for spectrum in _spectra(rows):
        table = [_impedance(row) for row in spectrum]
        agrees = passes(*map(np.array, zip(*table, strict=True)))
        failed += int(np.sum(~agrees))
        for row, good in zip(spectrum, agrees, strict=True):
            row["kramers_kronig"] = "passes" if good else "fails"
    with replacing(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        lines = (names, *([row[name] for name in names] for row in rows))
        csv.writer(file, lineterminator="\n").writerows(map(written_cells, lines))
    stray = stray_capacitance(rows, today)
    if stray is not None:
        note(path, {"stray_capacitance": stray._asdict()})
    return failed, stray


def stray_capacitance(rows: Sequence[Mapping[str, str]], today: datetime.date) -> Stray | None:
    """Im(I/V)/omega of the open circuits among the rows, weighted by their errors; None without
    any.
    """
    open_circuit = [
        row for row in rows if row["finger"] == "none" and row["current_a"] and _marked_good(row)
    ]
    if not open_circuit:
        return None
    f, z, std = map(np.array, zip(*(_impedance(row) for row in open_circuit), strict=True))
    capacitance, error = np.imag(1.0 / z) / (2.0 * pi * f), std * np.abs(1.0 / z) / (2.0 * pi * f)
    weight = error**-2
    mean = float(np.sum(weight * capacitance) / np.sum(weight))
    spread = sqrt(float(np.mean(weight * (capacitance - mean) ** 2)))
    std_f = max(spread, 1.0) / sqrt(float(np.sum(weight)))
    highest = SPECIFICATION["stray_capacitance_f"]["high"]
    if TOLD_FROM_ZERO * std_f < mean <= highest:
        return Stray(mean, std_f, today.isoformat())
    said = f"the open circuits give {mean:.3g} F, std {std_f:.2g}: "
    why = f"above {highest:g} F" if mean > highest else "not distinguishable from zero"
    return Stray(None, std_f, today.isoformat(), said + why)


def _marked_good(row: Mapping[str, str]) -> bool:
    return row["kramers_kronig"] != "fails"


def _spectra(rows: Sequence[dict[str, str]]) -> list[list[dict[str, str]]]:
    """The rows of each sweep: everything but the frequency, and the voltage that follows it, is the
    same.
    """
    groups: dict[tuple[str, ...], list[dict[str, str]]] = defaultdict(list)
    for row in rows:
        if not row["cof"] and row["current_a"]:
            key = tuple(
                row[name] for name in ("session", "trial", "finger", "normal_force_n", "speed_m_s")
            )
            groups[key].append(row)
    return [
        group for group in groups.values() if _tells([float(row["frequency_hz"]) for row in group])
    ]


def _tells(frequency_hz: Sequence[float]) -> bool:
    """Whether a spectrum is dense enough to contradict itself."""
    distinct = np.unique(frequency_hz)
    return len(distinct) >= max(LEAST_ROWS, 1 + ROWS_PER_DECADE * (_decades(distinct) - 0.1))


def _impedance(row: Mapping[str, str]) -> tuple[float, complex, float]:
    """Frequency, impedance seen by the amplifier, and the relative error of it."""
    phase = float(row["current_phase_rad"]) - float(row["electrode_voltage_phase_rad"] or 0.0)
    voltage_v, current_a = float(row["electrode_voltage_v"]), float(row["current_a"])
    std = np.hypot(
        float(row["electrode_voltage_std_v"]) / voltage_v, float(row["current_std_a"]) / current_a
    )
    return float(row["frequency_hz"]), voltage_v / current_a * np.exp(-1j * phase), float(std)
