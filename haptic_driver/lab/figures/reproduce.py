"""One folder with the paper's figures: a picture and CSV tables of each, and the facts that the
text states.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from haptic_driver.lab.figures import drawing, facts, numbers
from haptic_driver.lab.figures.facts import Fact
from haptic_driver.lab.figures.numbers import Charges, Sensitivity, Touching
from model.description import ModelDescription
from model.support.arrays import Array
from model.support.cells import written_cells
from model.support.errors import ModelError
from model.touch_model import TouchModel

Columns = dict[str, Sequence[float] | Sequence[str] | Array]  # of one table, equally long


@dataclass(frozen=True)
class Reproduced:
    """`tables` by file name and the drawn figure of one of the paper's figures, with the facts
    about it.
    """

    tables: dict[str, Columns]
    figure: Figure
    facts: list[Fact]


def figure4(models: Mapping[str, TouchModel]) -> Reproduced:
    """Pressure, separation and area over the amplitude."""
    solved = numbers.against_voltage(models)
    f, v = np.meshgrid(numbers.PAPER_HZ, numbers.VOLTAGES_V, indexing="ij")
    columns: Columns = {"frequency_hz": f.ravel(), "voltage_v": v.ravel()}
    for name, found in solved.items():
        columns |= _contact(found, name)
    return Reproduced({"figure-4.csv": columns}, drawing.figure4(solved), [])


def figure5(models: Mapping[str, TouchModel]) -> Reproduced:
    """Charges after a direct voltage is switched on."""
    found = numbers.charges_after_step(models)
    tables = {f"figure-5-{name}.csv": _over_time(charges) for name, charges in found.items()}
    return Reproduced(tables, drawing.figure5(found), facts.of_step(found))


def _over_time(charges: Charges) -> Columns:
    t, v = np.meshgrid(charges.at, numbers.STEP_V, indexing="ij")
    return {
        "voltage_v": v.ravel(),
        "time_s": t.ravel(),
        "insulator_air_c_per_m2": charges.rho1_c_per_m2.ravel(),
        "air_skin_c_per_m2": charges.rho2_c_per_m2.ravel(),
    }


def figure6(models: Mapping[str, TouchModel]) -> Reproduced:
    """Steady charges over frequency."""
    found = numbers.steady_charges(models)
    columns: Columns = {"frequency_hz": numbers.SWEEP_HZ}
    for name, charges in found.items():
        columns[f"insulator_air_{name}_c_per_m2"] = charges.rho1_c_per_m2
        columns[f"air_skin_{name}_c_per_m2"] = charges.rho2_c_per_m2
    return Reproduced(
        {"figure-6.csv": columns}, drawing.figure6(found), facts.of_steady_charges(found)
    )


def figure7(models: Mapping[str, TouchModel]) -> Reproduced:
    """Force, loss tangent, separation, area and friction over frequency."""
    solved = numbers.against_frequency(models)
    description = models["corrected"].description
    tangent = numbers.loss_tangent(description.dielectric)
    columns: Columns = {"frequency_hz": numbers.SWEEP_HZ, "loss_tangent": tangent}
    for name, found in solved.items():
        columns |= {
            f"electrostatic_force_{name}_n": found.force_n,
            f"cof_{name}": found.cof,
            **_contact(found, name),
        }
    stated = facts.of_force(solved, description.dielectric, description.values.cof_off)
    return Reproduced({"figure-7.csv": columns}, drawing.figure7(solved, tangent), stated)


def figure8(models: Mapping[str, TouchModel]) -> Reproduced:
    """Four parameters changed by half, and elasticities."""
    found = {name: numbers.sensitivities(model) for name, model in models.items()}
    parts = [
        _changes(name, parameter, s)
        for name, each in found.items()
        for parameter, s in each.items()
    ]
    elasticities: Columns = {"frequency_hz": numbers.PAPER_HZ}
    for name, each in found.items():
        elasticities |= {f"{parameter}_{name}": s.elasticity for parameter, s in each.items()}
    tables: dict[str, Columns] = {
        "figure-8.csv": {
            column: [x for part in parts for x in part[column]] for column in parts[0]
        },
        "figure-8-elasticities.csv": elasticities,
    }
    return Reproduced(tables, drawing.figure8(found), facts.of_sensitivity(found))


def _changes(name: str, parameter: str, s: Sensitivity) -> dict[str, Sequence[Any]]:
    return {
        "equations": [name] * s.frequency_hz.size,
        "parameter": [parameter] * s.frequency_hz.size,
        "frequency_hz": s.frequency_hz.tolist(),
        "force_minus_50_percent_n": s.lower_n.tolist(),
        "force_nominal_n": s.nominal_n.tolist(),
        "force_plus_50_percent_n": s.higher_n.tolist(),
        "change_minus_50_percent": s.lower_percent.tolist(),
        "change_plus_50_percent": s.higher_percent.tolist(),
    }


def _contact(found: Touching, name: str) -> Columns:
    return {
        f"electrostatic_pressure_{name}_pa": found.pressure_pa.ravel(),
        f"mean_separation_{name}_m": found.mean_gap_m.ravel(),
        f"contact_area_ratio_{name}": found.area_ratio.ravel(),
    }


FIGURES: dict[int, Callable[[Mapping[str, TouchModel]], Reproduced]] = {
    4: figure4,
    5: figure5,
    6: figure6,
    7: figure7,
    8: figure8,
}


def reproduce(
    description: ModelDescription, wanted: Sequence[int], folder: Path, tell: Callable[[str], None]
) -> tuple[list[Path], list[Fact]]:
    """Write the `wanted` figures into `folder` and return the files and facts; OSError where it
    cannot be written.
    """
    unknown = [number for number in wanted if number not in FIGURES]
    if unknown:
        raise ModelError(
            f"figure {unknown[0]} is not computed by the model", "Give one of 4, 5, 6, 7, 8"
        )
    models = numbers.variants(description)
    folder.mkdir(parents=True, exist_ok=True)
    files: list[Path] = []
    stated: list[Fact] = []
    for number in wanted:
        tell(f"figure {number}")
        made = FIGURES[number](models)
        for name, columns in made.tables.items():
            files.append(folder / name)
            _write(columns, files[-1])
        files.append(folder / f"figure-{number}.png")
        drawing.save(made.figure, files[-1])
        stated += made.facts
    if stated:
        files.append(folder / "facts.csv")
        _write(
            {key: [asdict(fact)[key] for fact in stated] for key in asdict(stated[0])}, files[-1]
        )
    return files, stated


def _write(columns: Columns, path: Path) -> None:
    """Six significant digits; an empty field where there is no answer."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(written_cells(columns))
        writer.writerows(
            written_cells(_text(value) for value in row)
            for row in zip(*columns.values(), strict=True)
        )


def _text(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}" if np.isfinite(value) else ""
    return str(value)
