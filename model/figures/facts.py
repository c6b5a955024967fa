"""What the paper's text states about its figures 3 and 5-8, beside what the corrected and the printed equations give.

Only statements of the text: the paper prints no number of its measured curves, so none is compared. Each fact is one
number per variant and whether the statement holds for it; NaN where the printed equations have no answer.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from model.electric.dielectrics import Dielectric
from model.figures.numbers import PAPER_HZ, STEP_V, SWEEP_HZ, VOLTAGE_V, Charges, Sensitivity, Touching, loss_tangent
from model.support.arrays import Array

COF_OFF, COF_OFF_STANDARD_ERROR = 0.512, 0.006  # section IV.A, mean of 9 trials
PEAK_HZ, LEAST_LOSS_HZ = 250.0, 1e5  # abstract; section V
GONE = 0.05  # "no charge transfer": less than this share of what is there at 1 Hz


@dataclass(frozen=True)
class Fact:
    """`quantity` names the number and its unit; the fields of a variant are its number and whether it agrees."""

    figure: str
    statement: str
    where: str
    quantity: str
    corrected: float
    corrected_holds: bool
    published: float
    published_holds: bool


Answer = tuple[float, bool]  # the number, and whether the statement holds
Row = tuple[str, str, str, str, list[Answer]]  # figure, statement, where, quantity, corrected and published


def _fact(figure: str, statement: str, where: str, quantity: str, answers: list[Answer]) -> Fact:
    (corrected, first), (published, second) = answers
    return Fact(figure, statement, where, quantity, float(corrected), bool(first), float(published), bool(second))


NAMES = ("corrected", "published")


def of_step(step: Mapping[str, Charges]) -> list[Fact]:
    """Of Fig. 5, at 75 V."""
    at_75 = STEP_V.index(VOLTAGE_V)

    def last(charges: Array) -> float:
        return float(charges[-1, at_75] * 1e6)

    def positive(charges: Charges) -> Answer:
        return last(charges.rho1_c_per_m2), last(charges.rho1_c_per_m2) > 0.0

    def negative(charges: Charges) -> Answer:
        return last(charges.rho2_c_per_m2), last(charges.rho2_c_per_m2) < 0.0

    def growth(charges: Charges) -> Answer:
        ratio = np.abs(charges.rho2_c_per_m2[1:, at_75] / charges.rho1_c_per_m2[1:, at_75])
        return ratio[-1] / ratio[0], ratio[-1] > ratio[0]

    both = [step[name] for name in NAMES]
    final = "charge after a long time at 75 V DC, µC/m²"
    rows: list[Row] = [
        ("5(a)", "positive charges accumulate at insulator-air", "V", final, [positive(c) for c in both]),
        ("5(b)", "negative charges gather at air-skin", "V", final, [negative(c) for c in both]),
        ("5", "the ratio of negative to positive charges increases in time", "V",
         "|ρ₂/ρ₁| at the end over that at the start", [growth(c) for c in both]),
    ]  # fmt: skip
    return [_fact(*row) for row in rows]


def of_steady_charges(steady: Mapping[str, Charges]) -> list[Fact]:
    """Of Fig. 6, at 75 V."""

    def least_ratio(charges: Charges) -> Answer:
        ratio = float(np.min(charges.rho2_c_per_m2 / charges.rho1_c_per_m2))
        return ratio, ratio > 1.0

    def left(charges: Charges) -> Answer:
        both = charges.rho1_c_per_m2 + charges.rho2_c_per_m2
        share = float(both[_index(PEAK_HZ)] / both[0])
        return share, share < GONE

    both = [steady[name] for name in NAMES]
    quantity = "|ρ₁| + |ρ₂| at 250 Hz over that at 1 Hz"
    rows: list[Row] = [
        ("6", "more charge at air-skin than at insulator-air, at every frequency", "V", "least |ρ₂/ρ₁|",
         [least_ratio(c) for c in both]),
        ("6", "no charge transfer above 250 Hz", "V", quantity, [left(c) for c in both]),
        ("6", "the same, with the contact leakage that the force has", "V", quantity,
         [left(steady["with_leak"]), (float("nan"), False)]),
    ]  # fmt: skip
    return [_fact(*row) for row in rows]


def of_force(solved: Mapping[str, Touching], dielectric: Dielectric, cof_off: float) -> list[Fact]:
    """Of Figs. 3(b) and 7; among the paper's ten frequencies where it names one."""
    corrected, published = solved["corrected"], solved["published"]
    ten = [_index(f) for f in PAPER_HZ]
    tangent = loss_tangent(dielectric)
    least_hz = float(SWEEP_HZ[np.argmin(tangent)])
    least = (least_hz, LEAST_LOSS_HZ / 2 <= least_hz <= LEAST_LOSS_HZ * 2)

    def peak(column: Array, sign: float = 1.0) -> Answer:
        best = float(PAPER_HZ[np.argmax(sign * column[ten])])
        return best, best == PEAK_HZ

    def at_1_hz(found: Touching) -> Answer:
        return found.force_n[0] * 1e3, found.force_n[0] > 0.0

    def decay(found: Touching) -> Answer:
        above = found.force_n[ten][PAPER_HZ >= PEAK_HZ]
        return above[-1] / above[0], bool(np.all(np.diff(above) < 0.0))

    def rise_to_peak(found: Touching) -> Answer:
        below = found.force_n[ten][PAPER_HZ <= PEAK_HZ]
        return below[-1] / below[0], bool(np.all(np.diff(below) > 0.0))

    def local_peak(found: Touching) -> Answer:
        """The force at 100 kHz over the larger of those at 10 kHz and 1 MHz."""
        force = found.force_n[ten]
        ratio = float(force[8] / max(force[7], force[9]))
        return ratio, ratio > 1.0

    off = (cof_off, abs(cof_off - COF_OFF) <= COF_OFF_STANDARD_ERROR)
    both = corrected, published
    rows: list[Row] = [
        ("3(b)", "mu_OFF is 0.512 with a standard error of 0.006 (an input of the model)", "IV.A",
         "friction without voltage", [off, off]),
        ("7(a)", "the force peaks at about 250 Hz", "abstract, V", "largest of the ten frequencies, Hz",
         [peak(t.force_n) for t in both]),
        ("7(a)", "it rises up to 250 Hz", "V", "F(250 Hz)/F(1 Hz)", [rise_to_peak(t) for t in both]),
        ("7(a)", "it is not zero towards direct current", "V", "F at 1 Hz, mN", [at_1_hz(t) for t in both]),
        ("7(a)", "it decays above 250 Hz", "abstract, V", "F(1 MHz)/F(250 Hz)", [decay(t) for t in both]),
        ("7(a)", "it is relatively high at 100 kHz (read here as: higher than at 10 kHz and 1 MHz)", "V",
         "F(100 kHz)/max of the neighbours", [local_peak(t) for t in both]),
        ("7(a)", "the loss tangent is least at about 100 kHz", "V", "frequency of the least loss tangent, Hz",
         [least, least]),
        ("7(b)", "the real contact area is largest at 250 Hz", "V", "largest of the ten frequencies, Hz",
         [peak(t.area_ratio) for t in both]),
        ("7(b)", "the average separation is least there", "V", "least of the ten frequencies, Hz",
         [peak(t.mean_gap_m, -1.0) for t in both]),
    ]  # fmt: skip
    return [_fact(*row) for row in rows]


def of_sensitivity(found: Mapping[str, Mapping[str, Sensitivity]]) -> list[Fact]:
    """Of Fig. 8."""

    def largest(name: str, parameter: str) -> Answer:
        """The elasticity nearest to zero: below zero, the force falls with the parameter at every frequency."""
        worst = float(np.max(found[name][parameter].elasticity))
        return worst, worst < 0.0

    def smallest(name: str, parameter: str) -> Answer:
        worst = float(np.min(found[name][parameter].elasticity))
        return worst, worst > 0.0

    def contrast(name: str, parameter: str, high: bool) -> Answer:
        """|elasticity| at 1 MHz over that at 1 Hz."""
        size = np.abs(found[name][parameter].elasticity)
        ratio = float(size[-1] / size[0])
        return ratio, ratio > 1.0 if high else ratio < 1.0

    falls, ends = "elasticity of F nearest to 0", "|elasticity| at 1 MHz over that at 1 Hz"
    rows: list[Row] = [
        ("8(a)", "a thinner insulator gives more force", "V", falls,
         [largest(n, "insulator_thickness_m") for n in NAMES]),
        ("8(b)", "a thinner skin gives more force", "V", falls, [largest(n, "skin_thickness_m") for n in NAMES]),
        ("8(c)", "a higher permittivity of the insulator gives more force", "V", falls,
         [smallest(n, "insulator_permittivity") for n in NAMES]),
        ("8(d)", "a softer skin gives more force", "V", falls, [largest(n, "skin_modulus_pa") for n in NAMES]),
        ("8(b), (f)", "the skin's thickness matters more at high frequency", "V", ends,
         [contrast(n, "skin_thickness_m", True) for n in NAMES]),
        ("8(c), (g)", "the insulator's permittivity matters most at low frequency", "V", ends,
         [contrast(n, "insulator_permittivity", False) for n in NAMES]),
    ]  # fmt: skip
    return [_fact(*row) for row in rows]


def _index(frequency_hz: float) -> int:
    return int(np.argmin(np.abs(np.log(SWEEP_HZ / frequency_hz))))
