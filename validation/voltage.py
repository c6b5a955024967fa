"""`python -m validation voltage`: how force grows with voltage, the models beside published laws.

Writes docs/voltage-law.md and its picture; what is published stands in `published_voltage.csv`.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np

from haptic_driver.lookup.models import load_model
from model.conditions import Conditions
from model.description import ModelDescription
from model.support.arrays import Array
from model.touch_model import TouchModel

mpl.use("Agg")
import matplotlib.pyplot as plt

PUBLISHED = Path(__file__).with_name("published_voltage.csv")
VARIANTS = ("reference", "published", "table1")
LOADS_N = (0.2, 0.5, 1.0)
VOLTAGE_V = np.array([25.0, 50.0, 75.0, 100.0, 125.0, 150.0])
FITTED = VOLTAGE_V >= 75.0  # where a published law says that it holds
FREQUENCY_HZ, SPEED_M_S = 125.0, 0.02
CHANGES = {
    "skin_modulus_pa": 2.0,
    "roughness_rms_m": 2.0,
    "roll_off_wavenumber_per_m": 2.0,
    "insulator_thickness_m": 2.0,
    "contact_area_m2": 0.5,
    "leak_scale": 2.0,
    "skin_thickness_m": 2.0,
    "hurst_exponent": 0.5,
}
PAGE = """# How force grows with voltage

For people who ask how far above 75 V a prediction may be trusted.

`python -m validation voltage` rewrites this page and its picture. Nothing is fitted. Force goes with a power of the
voltage, its *exponent*, which is 2 where the gaps do not close.

## What others report

| source | says of | from, V | to, V | exponent | read from |
|---|---|---|---|---|---|
{published}

Models of adhesion fit friction over voltage and load up to 200 V. Three are open texts whose curves have not been read
yet:

- Basdogan 2020
- Hess and Forsbach 2020, doi 10.3389/fmech.2020.567386
- Forsbach 2023, doi 10.3389/fmech.2022.1074393

## What the models say

At {frequency:g} Hz. The ratio is that of force over voltage squared at 150 V and at 25 V.

| model | load, N | force at 25, 75 and 150 V, N | ratio | exponent, 75 to 150 V |
|---|---|---|---|---|
{models}

![Force over voltage](pictures/voltage-law.png)

Above 75 V the model `reference` is steeper than published fingers. If its force is right at 25 V, it is too large by
the ratio at 150 V. Limits hold all the same, because they are of voltage, current and field. Friction near the upper end
of the reach is in doubt, and a diagnosis may find an effect that makes up for it.

## What makes it steep

The voltage presses the rough skin closer. That raises the field, which presses more. Each row changes one number of
`reference` at 0.5 N:

| changed | by | ratio | exponent, 75 to 150 V |
|---|---|---|---|
{changes}

So a skin that yields less to the voltage brings the exponent to 2: a higher modulus, a rougher or finer surface, a thicker
insulator. Leak, skin thickness and load matter less. A model fitted to measured curves is still missing.
"""


class Growth(NamedTuple):
    """Force [6] at `VOLTAGE_V`."""

    force_n: Array

    @property
    def ratio(self) -> float:
        """By which force grows more than the square of voltage, from the first to the last."""
        scaled = self.force_n / VOLTAGE_V**2
        return float(scaled[-1] / scaled[0])

    @property
    def exponent(self) -> float:
        """Of the power that fits best from 75 V on."""
        logs = np.log(VOLTAGE_V[FITTED]), np.log(self.force_n[FITTED])
        return float(np.polyfit(*logs, 1)[0])


def growth(model: ModelDescription, load_n: float) -> Growth:
    every = np.ones(VOLTAGE_V.size)
    conditions = Conditions(
        frequency_hz=FREQUENCY_HZ * every,
        voltage_v=VOLTAGE_V,
        normal_force_n=load_n * every,
        speed_m_s=SPEED_M_S * every,
    )
    return Growth(TouchModel(model).predict(conditions).electrostatic_force_n)


def changed(model: ModelDescription, name: str, factor: float) -> ModelDescription:
    """The model with one of its numbers multiplied."""
    own = model.parameters[name]
    return replace(
        model, parameters={**model.parameters, name: replace(own, value=factor * own.value)}
    )


def write(docs: Path) -> Path:
    """Rewrite the page and its picture."""
    found = {(name, n): growth(load_model(name), n) for name in VARIANTS for n in LOADS_N}
    page = docs / "voltage-law.md"
    text = PAGE.format(
        published="\n".join(_published()),
        models="\n".join(
            f"| `{name}` | {load_n:g} | {_forces(one)} | {one.ratio:.2f} | {one.exponent:.2f} |"
            for (name, load_n), one in found.items()
        ),
        changes="\n".join(_changes()),
        frequency=FREQUENCY_HZ,
    )
    page.write_text(text, encoding="utf-8")
    _draw(found, docs / "pictures" / "voltage-law.png")
    return page


def _forces(one: Growth) -> str:
    return ", ".join(f"{one.force_n[i]:.2g}" for i in (0, 2, 5))


def _published() -> Iterator[str]:
    with PUBLISHED.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            where = f"{row['source']}, {row['doi']}"
            cells = where, row["says"], row["low_v"], row["high_v"], row["exponent"]
            yield f"| {' | '.join(cell or 'not said' for cell in cells)} | {row['read_from']} |"


def _changes() -> Iterator[str]:
    model = load_model("reference")
    own = growth(model, 0.5)
    yield f"| nothing | | {own.ratio:.2f} | {own.exponent:.2f} |"
    for name, factor in CHANGES.items():
        one = growth(changed(model, name, factor), 0.5)
        yield f"| `{name}` | {factor:g} | {one.ratio:.2f} | {one.exponent:.2f} |"


def _draw(found: dict[tuple[str, float], Growth], path: Path) -> None:
    figure, axes = plt.subplots(figsize=(6.0, 3.6), layout="constrained")
    for (name, load_n), one in found.items():
        if load_n == 0.5:
            axes.loglog(VOLTAGE_V, one.force_n / one.force_n[0], "o-", label=f"model {name}")
    square = (VOLTAGE_V / VOLTAGE_V[0]) ** 2
    axes.loglog(VOLTAGE_V, square, "k--", label="square of voltage, as reported")
    axes.set_xticks(VOLTAGE_V, [f"{v:g}" for v in VOLTAGE_V])
    axes.minorticks_off()
    axes.set_xlabel("peak voltage at the electrode (V)")
    axes.set_ylabel("force, of that at 25 V")
    axes.legend(frameon=False)
    figure.savefig(path, dpi=130, metadata={"Software": None})
    plt.close(figure)
