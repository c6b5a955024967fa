"""Every slip of docs/errata.md: derived from the laws with sympy or measured, and the numbers that
the page quotes.

Each test of a slip fails if the correction were what is printed.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import quad

from haptic_driver.lab.figures.closed_forms import closed_form
from model.conditions import Conditions
from model.contact.gap_distribution import area_ratio, mean_gap
from model.contact.roughness import r_of_hurst
from model.electric.charges import Layers, coefficients, constant_layers
from model.electric.dielectrics import EPS0, total_conductivity_s_per_m
from model.electric.layers import branch, leak_conductance_per_pa
from model.published import (
    as_published,
    complex_layers,
    contact_conductance_per_pa,
    printed_coefficients,
    printed_field,
)
from model.touch_model import TouchModel

PAGE = Path(__file__).parents[2] / "docs" / "errata.md"
F_HZ, V, LOAD_N, P0_PA = 250.0, 75.0, 0.5, 5e3  # where the page counts consequences: Table I
QUOTED = re.compile(r"`(\w+) = ([-+]?[0-9.]+(?:e[-+]?[0-9]+)?)(?: [^`]*)?`")

# symbols of the laws: permittivities absolute
D1, D2, U, E1P, EGP, E2P, S1, SG, S2 = LAYERS = sp.symbols(
    "d1 d2 u eps1 epsg eps2 sigma1 sigmag sigma2", positive=True
)
RHO1, RHO2, VOLT = CHARGED = sp.symbols("rho1 rho2 V")
A, B, C, D, E, F, W = RATES = sp.symbols("a b c d e f omega")
NAMES = {symbol.name: symbol for symbol in (*LAYERS, *CHARGED, *RATES)}


def formula(text: str) -> sp.Expr:
    return sp.sympify(text, NAMES)


@pytest.fixture(scope="module")
def charging():
    """-d rho1/dt and -d rho2/dt from (2)-(8) alone, solved by sympy."""
    f1, fg, f2 = sp.symbols("E1 Eg E2")
    laws = [
        EGP * fg - E1P * f1 - RHO1,
        E2P * f2 - EGP * fg - RHO2,
        D1 * f1 + U * fg + D2 * f2 - VOLT,
    ]
    field = sp.solve(laws, [f1, fg, f2], dict=True)[0]
    return (
        sp.expand(sp.simplify(-S1 * field[f1] + SG * field[fg])),
        sp.expand(sp.simplify(-SG * field[fg] + S2 * field[f2])),
    )


def is_coefficient(expression: sp.Expr, of: sp.Symbol, text: str) -> bool:
    return bool(sp.simplify(sp.diff(expression, of) - formula(text)) == 0)


BIG_D1, BIG_DG = "(d1 + eps1*(u/epsg + d2/eps2))", "(u + epsg*(d1/eps1 + d2/eps2))"
BIG_D2 = "(d2 + eps2*(d1/eps1 + u/epsg))"
RHO2_PRINTED = f"sigma2*(d1/eps1 + u/epsg)/{BIG_D2} - sigmag*(d2/eps2)/{BIG_DG}"
VOLT_PRINTED = f"sigma2/{BIG_D2} - sigmag*(d2/eps1)/{BIG_DG}"


class TestInterfaceCharge:
    @pytest.mark.parametrize(
        ("of", "printed"),
        [
            (RHO1, f"sigma1*(u/epsg + d2/eps2)/{BIG_D1} + sigmag*(d1/eps1)/{BIG_DG}"),
            (RHO2, f"sigma1*(d2/eps2)/{BIG_D1} - sigmag*(d2/eps2)/{BIG_DG}"),
            (VOLT, f"-sigma1/{BIG_D1} + sigmag/{BIG_DG}"),
        ],
    )
    def test_14_is_right_as_printed(self, charging, of, printed):
        assert is_coefficient(charging[0], of, printed)

    @pytest.mark.parametrize(
        ("of", "printed", "right"),
        [
            (RHO2, RHO2_PRINTED, RHO2_PRINTED.replace(" - ", " + ")),
            (VOLT, VOLT_PRINTED, f"sigma2/{BIG_D2} - sigmag/{BIG_DG}"),
        ],
    )
    def test_15_is_not(self, charging, of, printed, right):
        assert is_coefficient(charging[1], of, right)
        assert not is_coefficient(charging[1], of, printed)

    def test_the_code_has_the_right_ones_and_the_printed_ones(self, charging):
        values = dict(zip(LAYERS, (1.3, 0.7, 0.4, 2.1, 1.1, 3.7, 0.3, 0.9, 1.7), strict=True))
        layers = Layers(1.3, 2.1, 0.3, 1.1, 0.9, 0.7, 3.7, 1.7)
        right = coefficients(layers, 0.4)
        for i, names in enumerate(("abc", "def")):
            for symbol, name in zip(CHARGED, names, strict=True):
                expected = float(sp.diff(charging[i], symbol).subs(values))
                assert getattr(right, name) == pytest.approx(expected, rel=1e-12)
        printed = printed_coefficients(layers, 0.4)
        expected = (float(formula(text).subs(values)) for text in (RHO2_PRINTED, VOLT_PRINTED))
        assert (printed.e, printed.f) == pytest.approx(tuple(expected), rel=1e-12)


PSI = formula("omega**4 + (a**2 + e**2 + 2*b*d)*omega**2 + (a*e - b*d)**2")
ETA, ALPHA2, KAPPA, BETA2, LAMBDA, DELTA = (
    formula(text) / PSI
    for text in (
        "(a*c + b*f)*omega**2 + a*c*e**2 + d*f*b**2 - a*b*e*f - b*c*d*e",
        "-(c*omega**3 + (c*e**2 - a*b*f + b*c*d - b*e*f)*omega)",
        "(c*d + e*f)*omega**2 + b*c*d**2 + e*f*a**2 - a*b*d*f - a*c*d*e",
        "-(f*omega**3 + (f*a**2 - a*c*d + b*d*f - c*d*e)*omega)",
        "(c*a*e - c*b*d)*omega**2 + c*a*e**3 - c*b*d*e**2 - f*a*b*e**2 - f*b*e*a**2",
        "(f*a*e - f*b*d)*omega**2 + f*e*a**3 - f*b*d*a**2 - c*d*e*a**2 - c*a*d*e**2",
    )
)


class TestAppendixB:
    """lambda and delta follow from the rest of (34)-(35) and from layers that are neutral at
    first.
    """

    def test_the_other_coefficients_are_right(self):
        """alpha_1 - j alpha_2 with alpha_1 = -eta is (18) at s = j w, and so for (19)."""
        s = sp.I * W
        determinant = (s + E) * (s + A) - D * B
        rho1 = (-C * (s + E) + F * B) / determinant
        rho2 = (-F * (s + A) + C * D) / determinant
        assert sp.simplify(rho1 - (-ETA - sp.I * ALPHA2)) == 0
        assert sp.simplify(rho2 - (-KAPPA - sp.I * BETA2)) == 0

    @pytest.mark.parametrize(
        ("steady", "eta", "lambda_", "missing", "drive"),
        [
            (ALPHA2, ETA, LAMBDA, "a*b*f + a*c*e - b*c*d + b*e*f", C),
            (BETA2, KAPPA, DELTA, "a*c*d + a*e*f - b*d*f + c*d*e", F),
        ],
        ids=["lambda", "delta"],
    )
    def test_what_is_missing(self, steady, eta, lambda_, missing, drive):
        """d rho/dt at t = 0 of (34), per volt, for neutral layers."""
        start = W * steady - (A + E) * eta + lambda_ + drive
        assert sp.simplify(start + B * D * formula(missing) / PSI) == 0
        assert sp.simplify(start) != 0


def test_conduction_of_the_skin_is_counted_once():
    """With eps2 real and sigma2 in (7), E_g is V/(u + eps_g h), k2 = eps2' + sigma2/s; with (1) in
    (7) it is not.
    """
    s = sp.symbols("s")

    def gap_field(eps2: sp.Expr) -> sp.Expr:
        y1, yg, y2 = (
            sigma + s * eps for sigma, eps in ((S1, E1P), (SG, EGP), (S2, eps2))
        )  # (6)-(7): one current
        current = VOLT / (D1 / y1 + U / yg + D2 / y2)  # (8)
        return current / yg

    def stack_field(k2: sp.Expr) -> sp.Expr:
        k1, kg = E1P + S1 / s, EGP + SG / s
        return VOLT / (U + kg * (D1 / k1 + D2 / k2))

    once, twice = E2P + S2 / s, E2P + 2 * S2 / s
    assert sp.cancel(gap_field(E2P) - stack_field(once)) == 0
    assert sp.cancel(gap_field(once) - stack_field(once)) != 0
    assert sp.cancel(gap_field(once) - stack_field(twice)) == 0


def test_relaxation_times_need_absolute_permittivities(models):
    """(4)-(7) with absolute permittivities give the RC time of a layer by itself: R C = eps0
    eps_r/sigma.
    """
    parameters = models["table1"].description.values
    k_skin = models["table1"].description.dielectric.permittivity(np.array([F_HZ]))
    sigma = float(total_conductivity_s_per_m(k_skin, np.array([F_HZ]))[0])
    resistance, capacitance = 200e-6 / sigma, EPS0 * float(k_skin.real[0]) / 200e-6
    layers = constant_layers(parameters, models["table1"].description.dielectric, F_HZ)
    assert 1.0 / layers.relaxation_rates_per_s(0.0)[2] == pytest.approx(
        resistance * capacitance, rel=1e-12
    )
    relative = complex_layers(models["table1"].description, np.array([F_HZ]))
    assert 1.0 / relative.relaxation_rates_per_s(0.0)[2].real[0] > 1e10 * resistance * capacitance


def test_constants_that_follow_the_drive_break_superposition(models):
    """The charge of two sines is not the sum of each with its own constants."""
    d = models["table1"].description
    time = np.linspace(0.0, 2e-4, 2001)

    def charge(at_hz: float, drive_hz: float) -> np.ndarray:
        layers = constant_layers(d.values, d.dielectric, at_hz)
        return closed_form(coefficients(layers, 66.6e-6), drive_hz).charges(time)[1]

    one_system = charge(250.0, 250.0) + charge(250.0, 1e5)
    each_its_own = charge(250.0, 250.0) + charge(1e5, 1e5)
    assert np.abs(each_its_own - one_system).max() > 0.01 * np.abs(one_system).max()


def test_the_leak_lies_beside_the_gap():
    """One current (s k_g/u + alpha) u E crosses gap and stack (eps0 = 1); alpha -> inf leaves no
    field.
    """
    s, alpha, h, k_gap, field = sp.symbols("s alpha h k_g E", positive=True)
    current = (s * k_gap / U + alpha) * U * field
    found = sp.solve(U * field + current * h / s - VOLT, field)[0]
    assert sp.simplify(found - VOLT / ((1 + alpha * h / s) * U + k_gap * h)) == 0
    assert sp.limit(found.subs({k_gap: 1, VOLT: 1}), alpha, sp.oo) == 0


def test_the_printed_leak_does_not_short_the_gap(at):
    """(26) as printed grows where the leak is smaller: E_L ~ 1/alpha. A leak that vanishes must not
    matter.
    """
    field = printed_field(at.description, np.array([F_HZ]), np.array([at.gap_m]), absolute=True)
    leaks = [abs(field.leak_pa_per_m[0]) / p for p in (P0_PA, P0_PA / 10.0)]
    assert leaks[1] == pytest.approx(10.0 * leaks[0], rel=1e-12)


def test_stress_is_the_mean_of_the_square():
    """<(Re E e^jwt)^2> = |E|^2/2, whatever the phase of E; E^2 as printed is complex and depends on
    it.
    """
    t, phase, size = sp.symbols("t phi E", real=True)
    mean = sp.integrate(sp.expand_trig((size * sp.cos(t + phase)) ** 2), (t, 0, 2 * sp.pi)) / (
        2 * sp.pi
    )
    assert sp.simplify(mean - size**2 / 2) == 0
    square = (size * sp.exp(sp.I * phase)) ** 2
    assert sp.simplify(sp.re(square) - size**2 * sp.cos(2 * phase)) == 0


def test_friction_that_a_sensor_under_the_screen_reads():
    """F_t = mu_off (F_n + F_e) by Coulomb; mu_on = F_t/F_n with F_n applied."""
    off, on, load, force = sp.symbols("mu_off mu_on F_n F_e", positive=True)
    found = sp.solve(sp.Eq(on * load, off * (load + force)), force)[0]
    assert sp.simplify(found - (on / off - 1) * load) == 0
    assert sp.simplify(found - (1 - off / on) * load) != 0
    total = sp.solve(sp.Eq(on * load, off * (load + force)).subs(load, load - force), force)[0]
    assert (
        sp.simplify(total - (1 - off / on) * load) == 0
    )  # (31) holds for a load that contains F_e


def literal_partial_integrals() -> list[float]:
    """H/(2(1-H)) times the integral (40) read from left to right, x^(-(1/2)(1-H)), up to 1e3 and
    1e6, at H = 0.86.
    """
    s = 0.86 / 0.28
    return [
        s * quad(lambda y: 2.0 * (1.0 + y * y) ** -0.07, 0.0, np.sqrt(end))[0] for end in (1e3, 1e6)
    ]


@dataclass(frozen=True)
class _At:
    """Table I under 0.5 N at 250 Hz: what most numbers of the page start from."""

    model: TouchModel

    @property
    def description(self):
        return self.model.description

    @property
    def scale_pa(self) -> float:
        v = self.description.values
        return v.effective_modulus_pa * v.roll_off_wavenumber_per_m * v.roughness_rms_m

    @property
    def gap_m(self) -> float:
        return (
            mean_gap(self.model.table.shape, P0_PA / self.scale_pa)
            * self.description.values.roughness_rms_m
        )

    @property
    def sigma(self) -> np.ndarray:
        return total_conductivity_s_per_m(
            self.description.dielectric.permittivity(np.array([F_HZ])), np.array([F_HZ])
        )


@pytest.fixture(scope="module")
def at(models):
    return _At(models["table1"])


@pytest.fixture(scope="module")
def numbers(at, fresh_tables):
    """Everything that the page quotes, computed."""
    d, v = at.description, at.description.values
    f, gap = np.array([F_HZ]), np.array([at.gap_m])
    layers = constant_layers(v, d.dielectric, F_HZ)
    right, printed = coefficients(layers, at.gap_m), printed_coefficients(layers, at.gap_m)
    mended, slipped = (closed_form(right, 0.0, printed=p) for p in (False, True))
    stack = branch(v, d.dielectric, f)
    h = stack.h_m(v)[0]
    leak = leak_conductance_per_pa(v, at.sigma)[0] * P0_PA
    beta = leak / (2j * np.pi * F_HZ * EPS0)
    field = printed_field(d, f, gap, absolute=True)
    with_leak, without = (
        1.0 / abs((1.0 + b * h) * at.gap_m + stack.k_gap[0] * h) for b in (beta, 0.0)
    )
    conditions = Conditions(f, np.array([V]), np.array([LOAD_N]))
    ours = at.model.predict(conditions)
    as_read, in_si = (
        fresh_tables(TouchModel(as_published(d, absolute=a))).predict(conditions)
        for a in (False, True)
    )
    force, cof = ours.electrostatic_force_n[0], ours.cof[0]
    p_e = force / v.contact_area_m2
    real_area = float(area_ratio(at.model.table.shape, (P0_PA + p_e) / at.scale_pa))
    ends = np.array([1.0, 1e6])
    sigma_ends = total_conductivity_s_per_m(d.dielectric.permittivity(ends), ends)
    ours_at_ends, printed_at_ends = (
        leak_conductance_per_pa(v, sigma_ends),
        contact_conductance_per_pa(v, sigma_ends),
    )
    partial = literal_partial_integrals()
    assert np.isnan(in_si.cof).all()  # negative or diverging: see section 9

    def tau2(at_hz: float) -> float:
        return float(1.0 / constant_layers(v, d.dielectric, at_hz).relaxation_rates_per_s(0.0)[2])

    skin_k = stack.k_skin[0].real + 2j * stack.k_skin[0].imag
    total = field.gap_per_m[0] - field.leak_pa_per_m[0] / P0_PA
    return {
        "mean_gap": at.gap_m,
        "e": right.e,
        "e_error": printed.e / right.e - 1.0,
        "f": right.f,
        "f_printed": printed.f,
        "lambda_error": slipped.lambda_ / mended.lambda_ - 1.0,
        "delta_error": slipped.delta / mended.delta - 1.0,
        "skin_length_once": abs(v.skin_thickness_m / stack.k_skin[0]),
        "skin_length_twice": abs(v.skin_thickness_m / skin_k),
        "tau2": tau2(F_HZ),
        "tau2_relative": stack.k_skin[0].real / at.sigma[0],
        "charge_share_absolute": charge_share(d, gap, absolute=True),
        "charge_share_relative": charge_share(d, gap, absolute=False),
        "tau2_at_1_kHz": tau2(1e3),
        "tau2_at_100_kHz": tau2(1e5),
        "leak_over_gap_field": abs(field.leak_pa_per_m[0]) / P0_PA / abs(field.gap_per_m[0]),
        "leak_takes": 1.0 - with_leak / without,
        "square_real_part": (total**2).real / abs(total) ** 2,
        "stress_ratio": 2.0 * ((1.0 / (1e-6 + h)) ** 2).real * abs(1e-6 + h) ** 2,
        "area_ratio": real_area,
        "force": force,
        "force_by_30": force * real_area,
        "published_force": as_read.electrostatic_force_n[0],
        "cof": cof,
        "published_cof": as_read.cof[0],
        "force_by_31": (1.0 - v.cof_off / cof) * LOAD_N,
        "alpha": leak,
        "alpha_by_37": contact_conductance_per_pa(v, at.sigma)[0] * P0_PA,
        "r": r_of_hurst(0.86),
        "r_literal_to_1e3": partial[0],
        "r_literal_to_1e6": partial[1],
        "alpha_rise": ours_at_ends[1] / ours_at_ends[0],
        "alpha_rise_by_37": printed_at_ends[1] / printed_at_ends[0],
    }


def charge_share(description, gap: np.ndarray, *, absolute: bool) -> float:
    """What the interface charges add to V in (10) at 250 Hz, as a share of V."""
    layers = complex_layers(description, np.array([F_HZ]), absolute=absolute)
    rho1, rho2 = printed_coefficients(layers, gap).response(2j * np.pi * F_HZ)
    insulator, _, skin = layers.elastances(gap)
    return float(abs(insulator * rho1 - skin * rho2)[0])


class TestPage:
    TEXT = PAGE.read_text(encoding="utf-8")
    SLIPS = (
        "(15), the term of rho2",
        "(15), the term of V",
        "Appendix B, lambda",
        'Appendix B, the second "lambda"',
        "(1) with (7)",
        "(4)-(24)",
        "(20)-(21) and Fig. 5",
        "(24)-(26)",
        "(28)-(29)",
        "(30)",
        "(31)",
        "(36)-(37)",
        "(40)",
        "The text on alpha",
    )

    def test_every_slip_has_its_section_in_order(self):
        titles = re.findall(r"^## \d+\. (.+)$", self.TEXT, re.M)
        assert titles == list(self.SLIPS)
        sections = re.split(r"^## \d+\. .+$", self.TEXT, flags=re.M)[1:]
        for section in sections:
            for part in ("**Printed.**", "**Corrected.**", "**Why.**", "**Consequence.**"):
                assert section.count(part) == 1

    def test_every_quoted_number_is_computed_and_every_computed_one_quoted(self, numbers):
        quoted = QUOTED.findall(self.TEXT)
        assert {name for name, _ in quoted} == set(numbers)
        for name, text in quoted:
            digits = len(text.lstrip("-+").split("e")[0].replace(".", "").lstrip("0"))
            assert float(f"{numbers[name]:.{digits - 1}e}") == pytest.approx(
                float(text), rel=1e-12
            ), name
