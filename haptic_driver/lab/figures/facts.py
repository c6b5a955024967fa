"""What the paper's text states about its figures 3 and 5-8, beside what the corrected and the
printed equations give.

Only statements of the text: the paper prints no number of its measured curves, so none is compared.
Each fact is one number per variant and whether the statement holds for it; NaN where the printed
equations have no answer.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from haptic_driver.lab.figures.numbers import (
    PAPER_HZ,
    STEP_V,
    SWEEP_HZ,
    VOLTAGE_V,
    Charges,
    Sensitivity,
    Touching,
    loss_tangent,
)
from model.electric.dielectrics import Dielectric
from model.support.arrays import Array, Mask

COF_OFF, COF_OFF_STANDARD_ERROR = 0.512, 0.006  # section IV.A, mean of 9 trials
PEAK_HZ, LEAST_LOSS_HZ = 250.0, 1e5  # abstract; section V
NAMES = ("corrected", "published")
GONE = 0.05  # "no charge transfer": less than this share of what is there at 1 Hz


@dataclass(frozen=True)
class Fact:
    """`quantity` names the number and its unit; the fields of a variant are its number and whether
    it agrees.
    """

    figure: str
    statement: str
    where: str
    quantity: str
    corrected: float
    corrected_holds: bool
    published: float
    published_holds: bool


T = TypeVar("T")
Answer = tuple[float, bool | np.bool_]  # the number, and whether the statement holds
# figure, statement, where, quantity, and how it is answered
Row = tuple[str, str, str, str, Callable[[T], Answer]]


def _facts(rows: Sequence[Row[T]], both: Sequence[T]) -> list[Fact]:
    """Each row answered from what the corrected and what the printed equations give."""
    facts = []
    for figure, statement, where, quantity, answer in rows:
        corrected, published = ((float(number), bool(holds)) for number, holds in map(answer, both))
        facts.append(Fact(figure, statement, where, quantity, *corrected, *published))
    return facts


def of_step(step: Mapping[str, Charges]) -> list[Fact]:
    """Of Fig. 5, at 75 V."""
    at_75 = STEP_V.index(VOLTAGE_V)

    def last(charges: Array, sign: float) -> Answer:
        return charges[-1, at_75] * 1e6, sign * charges[-1, at_75] > 0.0

    def growth(charges: Charges) -> Answer:
        ratio = np.abs(charges.rho2_c_per_m2[1:, at_75] / charges.rho1_c_per_m2[1:, at_75])
        return ratio[-1] / ratio[0], ratio[-1] > ratio[0]

    final, ratio = (
        "charge after a long time at 75 V DC, µC/m²",
        "|ρ₂/ρ₁| at the end over that at the start",
    )
    rows: list[Row[Charges]] = [
        (
            "5(a)",
            "positive charges accumulate at insulator-air",
            "V",
            final,
            lambda c: last(c.rho1_c_per_m2, 1.0),
        ),
        (
            "5(b)",
            "negative charges gather at air-skin",
            "V",
            final,
            lambda c: last(c.rho2_c_per_m2, -1.0),
        ),
        ("5", "the ratio of negative to positive charges increases in time", "V", ratio, growth),
    ]
    return _facts(rows, [step[name] for name in NAMES])


def of_steady_charges(steady: Mapping[str, Charges]) -> list[Fact]:
    """Of Fig. 6, at 75 V."""

    def least_ratio(charges: Charges) -> Answer:
        ratio = np.min(charges.rho2_c_per_m2 / charges.rho1_c_per_m2)
        return ratio, ratio > 1.0

    def left(charges: Charges | None) -> Answer:
        if charges is None:
            return float("nan"), False
        both = charges.rho1_c_per_m2 + charges.rho2_c_per_m2
        share = both[_index(PEAK_HZ)] / both[0]
        return share, share < GONE

    least, quantity = "least |ρ₂/ρ₁|", "|ρ₁| + |ρ₂| at 250 Hz over that at 1 Hz"
    rows: list[Row[Charges]] = [
        (
            "6",
            "more charge at air-skin than at insulator-air, at every frequency",
            "V",
            least,
            least_ratio,
        ),
        ("6", "no charge transfer above 250 Hz", "V", quantity, left),
    ]
    leaking: Row[Charges | None] = (
        "6",
        "the same, with the contact leakage that the force has",
        "V",
        quantity,
        left,
    )
    return _facts(rows, [steady[name] for name in NAMES]) + _facts(
        [leaking], [steady["with_leak"], None]
    )


def of_force(solved: Mapping[str, Touching], dielectric: Dielectric, cof_off: float) -> list[Fact]:
    """Of Figs. 3(b) and 7; among the paper's ten frequencies where it names one."""
    ten = [_index(f) for f in PAPER_HZ]
    least_hz = float(SWEEP_HZ[np.argmin(loss_tangent(dielectric))])
    least = (least_hz, LEAST_LOSS_HZ / 2 <= least_hz <= LEAST_LOSS_HZ * 2)
    off = (cof_off, abs(cof_off - COF_OFF) <= COF_OFF_STANDARD_ERROR)

    def peak(column: Array) -> Answer:
        best = PAPER_HZ[np.argmax(column[ten])]
        return best, best == PEAK_HZ

    def slope(found: Touching, side: Mask, sign: float) -> Answer:
        """Last over first force on one side of the peak, which rises or falls there throughout."""
        force = found.force_n[ten][side]
        return force[-1] / force[0], np.all(sign * np.diff(force) > 0.0)

    def local_peak(found: Touching) -> Answer:
        """The force at 100 kHz over the larger of those at 10 kHz and 1 MHz."""
        force = found.force_n[ten]
        ratio = force[8] / max(force[7], force[9])
        return ratio, ratio > 1.0

    largest = "largest of the ten frequencies, Hz"
    rows: list[Row[Touching]] = [
        (
            "3(b)",
            "mu_OFF is 0.512 with a standard error of 0.006 (an input of the model)",
            "IV.A",
            "friction without voltage",
            lambda _: off,
        ),
        (
            "7(a)",
            "the force peaks at about 250 Hz",
            "abstract, V",
            largest,
            lambda t: peak(t.force_n),
        ),
        (
            "7(a)",
            "it rises up to 250 Hz",
            "V",
            "F(250 Hz)/F(1 Hz)",
            lambda t: slope(t, PAPER_HZ <= PEAK_HZ, 1.0),
        ),
        (
            "7(a)",
            "it is not zero towards direct current",
            "V",
            "F at 1 Hz, mN",
            lambda t: (t.force_n[0] * 1e3, t.force_n[0] > 0.0),
        ),
        (
            "7(a)",
            "it decays above 250 Hz",
            "abstract, V",
            "F(1 MHz)/F(250 Hz)",
            lambda t: slope(t, PAPER_HZ >= PEAK_HZ, -1.0),
        ),
        (
            "7(a)",
            "it is relatively high at 100 kHz (read here as: higher than at 10 kHz and 1 MHz)",
            "V",
            "F(100 kHz)/max of the neighbours",
            local_peak,
        ),
        (
            "7(a)",
            "the loss tangent is least at about 100 kHz",
            "V",
            "frequency of the least loss tangent, Hz",
            lambda _: least,
        ),
        (
            "7(b)",
            "the real contact area is largest at 250 Hz",
            "V",
            largest,
            lambda t: peak(t.area_ratio),
        ),
        (
            "7(b)",
            "the average separation is least there",
            "V",
            "least of the ten frequencies, Hz",
            lambda t: peak(-t.mean_gap_m),
        ),
    ]
    return _facts(rows, [solved[name] for name in NAMES])


def of_sensitivity(found: Mapping[str, Mapping[str, Sensitivity]]) -> list[Fact]:
    """Of Fig. 8."""

    def falls(s: Sensitivity) -> Answer:
        """The elasticity nearest to zero: below zero, the force falls with the parameter at every
        frequency.
        """
        worst = np.max(s.elasticity)
        return worst, worst < 0.0

    def rises(s: Sensitivity) -> Answer:
        worst = np.min(s.elasticity)
        return worst, worst > 0.0

    def contrast(s: Sensitivity, high: bool) -> Answer:
        """|elasticity| at 1 MHz over that at 1 Hz."""
        ratio = abs(s.elasticity[-1] / s.elasticity[0])
        return ratio, ratio > 1.0 if high else ratio < 1.0

    nearest, ends = "elasticity of F nearest to 0", "|elasticity| at 1 MHz over that at 1 Hz"
    rows: list[Row[Mapping[str, Sensitivity]]] = [
        (
            "8(a)",
            "a thinner insulator gives more force",
            "V",
            nearest,
            lambda s: falls(s["insulator_thickness_m"]),
        ),
        (
            "8(b)",
            "a thinner skin gives more force",
            "V",
            nearest,
            lambda s: falls(s["skin_thickness_m"]),
        ),
        (
            "8(c)",
            "a higher permittivity of the insulator gives more force",
            "V",
            nearest,
            lambda s: rises(s["insulator_permittivity"]),
        ),
        (
            "8(d)",
            "a softer skin gives more force",
            "V",
            nearest,
            lambda s: falls(s["skin_modulus_pa"]),
        ),
        (
            "8(b), (f)",
            "the skin's thickness matters more at high frequency",
            "V",
            ends,
            lambda s: contrast(s["skin_thickness_m"], True),
        ),
        (
            "8(c), (g)",
            "the insulator's permittivity matters most at low frequency",
            "V",
            ends,
            lambda s: contrast(s["insulator_permittivity"], False),
        ),
    ]
    return _facts(rows, [found[name] for name in NAMES])


def _index(frequency_hz: float) -> int:
    return int(np.argmin(np.abs(np.log(SWEEP_HZ / frequency_hz))))
