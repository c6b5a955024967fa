"""`python -m validation voltage`: how force grows with voltage, the models beside published laws.

Writes docs/voltage-law.md and its picture; what is published stands in `published_voltage.csv`.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np

from haptic_driver.lookup.models import load_model
from model.conditions import Conditions
from model.contact.theory_error import LOG_STD
from model.description import ModelDescription
from model.support.arrays import Array
from model.touch_model import TouchModel

mpl.use("Agg")
import matplotlib.pyplot as plt

PUBLISHED = Path(__file__).with_name("published_voltage.csv")
VARIANTS = ("reference", "published", "table1", "measured")
LOADS_N = (0.2, 0.5, 1.0)
VOLTAGE_V = np.array([25.0, 50.0, 75.0, 100.0, 125.0, 150.0])
FITTED = VOLTAGE_V >= 75.0  # where a published law says that it holds
FREQUENCY_HZ, SPEED_M_S = 125.0, 0.02
SHOWN = (0, 2, 3, 5)  # of `VOLTAGE_V`
LOAD_N = 0.5
SCORED_ON = "4TU"
MODULUS = "skin_modulus_pa"
# from wet to dry: an order of magnitude (Yuan and Verma 2006)
MODULI_PA = 10e6, 100e6
STEP_PA = 5e6
WITHIN = math.exp(LOG_STD[0][0])  # the error of the contact theory at light load
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

`python -m validation voltage` rewrites this page and its picture. Force goes with a power of the voltage, its *exponent*,
which is 2 where the gaps do not close.

## What others report

| source | of | says of | from, to | exponent | reads as | read from | how, and its error |
|---|---|---|---|---|---|---|---|
{published}

Two sources speak of bare fingers over voltage, and both say the square in words. Without an interval of its own, an
exponent is read as nearer to this whole number than to another. No force of a bare finger at a stated voltage could be
read. Other sources say something without an exponent:

- eShiver, 10.1109/TOH.2016.2630057: an artificial finger gets a net lateral force of up to 0.3 N (abstract).
- Li et al. 2020, 10.1109/TOH.2020.2979439: at high voltage, electrowetting may be up to 60 % of the friction that is
  added (abstract).
- PubMed 30736006: attraction increases with load, 0.5 to 4.5 N, at one apparent contact area (abstract).

Of these only abstract and introduction could be read, without a number over voltage:

- Ayyildiz et al. 2018, doi 10.1073/pnas.1811750115
- Hess and Popov 2019, doi 10.3390/lubricants7120102
- Basdogan et al. 2020
- Hess and Forsbach 2020, doi 10.3389/fmech.2020.567386
- Forsbach et al. 2023, doi 10.3389/fmech.2022.1074393

## What the models say

At {frequency:g} Hz. The ratio is that of force over voltage squared at 150 V and at 25 V. The picture is at 0.5 N.

| model | load, N | force at 25, 75, 100 and 150 V, N | ratio | exponent, 75 to 150 V |
|---|---|---|---|---|
{models}

![Force over voltage](pictures/voltage-law.png)

Above 75 V the model `reference` is steeper than published fingers. If its force is right at 25 V, it is too large by
the ratio at 150 V. Limits hold all the same, because they are of voltage, current and field. Friction near the upper end
of the reach is in doubt, and a diagnosis may find an effect that makes up for it. `haptic predict`, `haptic solve` and
the data sheet say so where it applies.

## What makes it steep

The voltage presses the rough skin closer. That raises the field, which presses more. Each row changes one number of
`reference` at 0.5 N:

| changed | by | ratio | exponent, 75 to 150 V | force at 150 V over load |
|---|---|---|---|---|
{changes}

So a skin that yields less to the voltage brings the exponent to 2: a higher modulus, a rougher or finer surface, a thicker
insulator. Leak, skin thickness and load matter less. Every such change makes the force smaller too. In all of these
rows the exponent is the larger, the nearer the force comes to the load. So a finger with the square and a force near its
load would speak against the theory, and not against one of its numbers.

## The model `measured`

`measured` is `reference` with one other number. The skin's modulus is {modulus:.0f} MPa instead of 10 MPa.

- **Reason.** What touches is the outermost skin. Dry stratum corneum is stiffer than wet by an order of magnitude (Yuan
  and Verma 2006, Colloids and Surfaces B 48:6, abstract). So 10 to 100 MPa is open, if Table I has moist skin (judged).
- **Fit.** Meyer et al. 2013 report the square. In steps of {step:.0f} MPa this is the least modulus that keeps it within
  a factor of {within:.2f}. The factor is the contact theory's own error at light load (`model/contact/theory_error.py`). The
  voltages, 25 to 150 V, and the load, 0.5 N, are chosen here; the abstract has none.
- **Score.** The 4TU data set has the exponent {exponent:g} from 75 to 150 V, which reads as {low:g} to {high:g}. The model has
  {least:.2f} to {most:.2f} at the three loads.

| modulus, MPa | ratio | exponent, 75 to 150 V | force at 100 V, N |
|---|---|---|---|
{moduli}

What does not follow:

- Both sources say the same, so the score hardly tests the fit: from 20 MPa on every modulus passes it at 0.5 N. So does
  `table1`, unfitted, with half the force.
- Geerligs et al. 2011 (Journal of Biomechanics 44:1176, abstract) press a large sphere on stratum corneum and find 1 to
  2 MPa. Which modulus holds for asperities is open.
- At 0.5 N the force is {weaker} of that of `reference` at 25, 75, 100 and 150 V. No published force
  decides between them.
- Under 0.5 N the model reaches a coefficient of friction of {reach} at 100 and 150 V, and `reference` {reach_by_reference}.
- `reference` stays the default, and the paper's facts are held against it.
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


def of_modulus(modulus_pa: float) -> ModelDescription:
    """`reference` with another modulus of the skin."""
    model = load_model("reference")
    return changed(model, MODULUS, modulus_pa / model.parameters[MODULUS].value)


def fitted_modulus_pa() -> float:
    """The least modulus that keeps the square of Meyer et al. 2013 as well as theory can say."""
    return next(
        modulus_pa
        for modulus_pa in np.arange(*MODULI_PA, STEP_PA)
        if growth(of_modulus(modulus_pa), LOAD_N).ratio <= WITHIN
    )


def published() -> list[dict[str, str]]:
    """What others report, as `published_voltage.csv` has it."""
    with PUBLISHED.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def write(docs: Path) -> Path:
    """Rewrite the page and its picture."""
    found = {(name, n): growth(load_model(name), n) for name in VARIANTS for n in LOADS_N}
    page = docs / "voltage-law.md"
    text = PAGE.format(
        published="\n".join(_published()),
        models="\n".join(
            f"| `{name}` | {load_n:g} | {_listed(one.force_n)} | {one.ratio:.2f} | {one.exponent:.2f} |"
            for (name, load_n), one in found.items()
        ),
        changes="\n".join(_changes()),
        frequency=FREQUENCY_HZ,
        **_measured(found),
    )
    page.write_text(text, encoding="utf-8")
    _draw(found, docs / "pictures" / "voltage-law.png")
    return page


def _listed(values: Array) -> str:
    return ", ".join(f"{values[i]:.2g}" for i in SHOWN)


def _published() -> Iterator[str]:
    for row in published():
        ends = row["low"], row["high"]
        span = f"{ends[0]} to {ends[1]} {row['over']}" if all(ends) else "not said"
        reads = f"{row['exponent_low']} to {row['exponent_high']}"
        cells = (
            f"{row['source']}, {row['reference']}",
            row["contact"],
            row["says"],
            span,
            row["exponent"],
            reads if row["exponent_low"] else "not said",
            row["place"],
            f"{row['how_read']}; {row['error']}",
        )
        yield f"| {' | '.join(cells)} |"


def _changes() -> Iterator[str]:
    model = load_model("reference")
    yield f"| nothing | | {_grown(growth(model, LOAD_N))} |"
    for name, factor in CHANGES.items():
        yield f"| `{name}` | {factor:g} | {_grown(growth(changed(model, name, factor), LOAD_N))} |"


def _grown(one: Growth) -> str:
    return f"{one.ratio:.2f} | {one.exponent:.2f} | {one.force_n[-1] / LOAD_N:.2f}"


def _measured(found: dict[tuple[str, float], Growth]) -> dict[str, object]:
    """What the page says of the model `measured`."""
    model = load_model("measured")
    ours, reference = found["measured", LOAD_N], found["reference", LOAD_N]
    exponents = [found["measured", n].exponent for n in LOADS_N]
    (score,) = _scores()
    friction = model.parameters["cof_off"].value / LOAD_N
    at_100_v, at_150_v = (list(VOLTAGE_V).index(v) for v in (100.0, 150.0))
    cofs, cofs_by_reference = (
        friction * (LOAD_N + one.force_n[[at_100_v, at_150_v]]) for one in (ours, reference)
    )
    return {
        "modulus": model.parameters[MODULUS].value / 1e6,
        "step": STEP_PA / 1e6,
        "within": WITHIN,
        "exponent": float(score["exponent"]),
        "low": float(score["exponent_low"]),
        "high": float(score["exponent_high"]),
        "least": min(exponents),
        "most": max(exponents),
        "moduli": "\n".join(_moduli(at_100_v)),
        "weaker": _listed(ours.force_n / reference.force_n),
        "reach": " and ".join(f"{cof:.2f}" for cof in cofs),
        "reach_by_reference": " and ".join(f"{cof:.2f}" for cof in cofs_by_reference),
    }


def _scores() -> list[dict[str, str]]:
    return [row for row in published() if row["source"].startswith(SCORED_ON)]


def _moduli(at_100_v: int) -> Iterator[str]:
    for modulus_pa in (10e6, 20e6, 25e6, 30e6, 50e6, 100e6):
        one = growth(of_modulus(modulus_pa), LOAD_N)
        cells = f"{one.ratio:.2f} | {one.exponent:.2f} | {one.force_n[at_100_v]:.2g}"
        yield f"| {modulus_pa / 1e6:.0f} | {cells} |"


def _draw(found: dict[tuple[str, float], Growth], path: Path) -> None:
    """Force over voltage squared, of that at 75 V: the square is a level line."""
    figure, axes = plt.subplots(figsize=(6.0, 3.6), layout="constrained")
    (score,) = _scores()
    of_75_v = VOLTAGE_V[FITTED] / VOLTAGE_V[FITTED][0]
    ends = float(score["exponent_low"]), float(score["exponent_high"])
    low, high = (of_75_v ** (end - 2.0) for end in ends)
    band = f"exponent {ends[0]:g} to {ends[1]:g}, as fingers are published"
    axes.fill_between(VOLTAGE_V[FITTED], low, high, color="#dddddd", label=band)
    for (name, load_n), one in found.items():
        if load_n == LOAD_N:
            scaled = one.force_n / VOLTAGE_V**2
            axes.plot(VOLTAGE_V, scaled / scaled[FITTED][0], "o-", label=f"model {name}")
    axes.axhline(1.0, color="k", ls="--", label="square of voltage")
    axes.set_xticks(VOLTAGE_V, [f"{v:g}" for v in VOLTAGE_V])
    axes.set_xlabel("peak voltage at the electrode (V)")
    axes.set_ylabel("force over voltage squared,\nof that at 75 V")
    axes.legend(frameon=False)
    figure.savefig(path, dpi=130, metadata={"Software": None})
    plt.close(figure)
