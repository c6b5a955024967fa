"""The equations as printed: (1)-(31) and (36)-(40) of AliAbbasi et al. 2022 with their slips
(docs/errata.md).

To show what the print gives, never to drive a screen by. Where the print leaves a choice, four
hold. A sine of amplitude V gives the phasors (18)-(19) at s = j w. The real part of the complex
(29) is taken for its stress. (40) has the exponent that converges. The contact (41)-(49) is that of
`contact`. `published` reads (4)-(26) with the relative permittivities of Table I, as printed.
`published_absolute` differs in that alone; the leakage term (26) is visible there.

What has no answer is NaN with a note, never a number.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi

import numpy as np
from scipy.interpolate import CubicSpline

from model.contact.gap_distribution import area_ratio
from model.contact.gap_table import GapTable, axis, gap_nodes
from model.contact.resolution import LOG_P_AXIS, LOG_U_AXIS
from model.contact.roughness import contact_length_m
from model.description import ModelDescription
from model.electric.charges import Coefficients, Layers, coefficients, constant_layers
from model.electric.dielectrics import EPS0
from model.electric.layers import DC_FREQUENCY_HZ
from model.parameters import TouchParameters
from model.support.arrays import Array, ComplexArray, Mask
from model.support.errors import ModelError, RowError
from model.touch import Attraction, Drive

LEAK_CUT_OFF_M = 10e-9  # a_c below (29): gaps smaller than this count in E_g only
PRESSURE_NODES = 673  # eight per row of the gap table
BISECTIONS = 40  # from one node of pressure to rounding

NEGATIVE = "(29) as printed gives an attraction that is negative or undefined"
NO_EQUILIBRIUM = "(29) as printed has no equilibrium within the pressures of the contact theory"
DIVERGED = "(31) as printed diverges: the electrostatic force reaches the normal force"


def as_published(description: ModelDescription, *, absolute: bool = False) -> ModelDescription:
    """The same finger and screen by the equations as printed, friction by (31), without effects."""
    variant = "published_absolute" if absolute else "published"
    return replace(description, variant=variant, friction_law="total_load", effect_parameters={})


def contact_conductance_per_pa(
    parameters: TouchParameters, skin_conductivity_s_per_m: Array
) -> Array:
    """alpha of (36) per pascal with (37) as printed: insulator and skin in series, S/(m^2 Pa)."""
    p = parameters
    length_m = contact_length_m(
        p.hurst_exponent, p.roughness_rms_m, p.roll_off_wavenumber_per_m, p.cut_off_wavenumber_per_m
    )
    with np.errstate(divide="ignore"):
        series = 1.0 / (
            1.0 / np.float64(p.insulator_conductivity_s_per_m) + 1.0 / skin_conductivity_s_per_m
        )
    return np.asarray(p.leak_scale * 2.0 * series / (p.effective_modulus_pa * length_m))


def complex_layers(
    description: ModelDescription, frequency_hz: Array, *, absolute: bool = False
) -> Layers:
    """Table I as (4)-(26) take it: the skin's complex permittivity (1) and its conductivity both,
    at each frequency.

    Permittivities are relative, as printed, unless `absolute`.
    """
    f = np.maximum(frequency_hz, DC_FREQUENCY_HZ)
    skin = EPS0 * description.dielectric.permittivity(f)
    layers = replace(
        constant_layers(description.values, description.dielectric, f),
        skin_permittivity_f_per_m=skin,
    )
    return layers if absolute else layers.relative


def printed_coefficients(layers: Layers, gap_m: Array) -> Coefficients:
    """(14)-(15) with the two slips of (15): the sign of sigma_g d2/eps2, and d2/eps1 in the
    voltage's term.
    """
    right = coefficients(layers, gap_m)
    insulator, gap, skin = layers.elastances(gap_m)
    air = layers.air_conductivity_s_per_m / (
        layers.air_permittivity_f_per_m * (insulator + gap + skin)
    )  # sigma_g/D_g
    slip = layers.skin_thickness_m / layers.insulator_permittivity_f_per_m
    return replace(right, e=right.e - 2.0 * air * skin, f=right.f + air - air * slip)


@dataclass(frozen=True)
class PrintedField:
    """(27) per volt for gaps that broadcast against frequencies: E_tot = `gap_per_m` -
    `leak_pa_per_m`/p, 1/m.
    """

    gap_per_m: ComplexArray
    leak_pa_per_m: ComplexArray


def printed_field(
    description: ModelDescription, frequency_hz: Array, gap_m: Array, *, absolute: bool = False
) -> PrintedField:
    """E_g of (10) and E_L of (26) per volt at any gap > 0, with the charges of (18)-(19)."""
    layers = complex_layers(description, frequency_hz, absolute=absolute)
    with np.errstate(all="ignore"):  # `solve` reports nonsense
        rho1, rho2 = printed_coefficients(layers, gap_m).response(
            2j * pi * np.maximum(frequency_hz, 1e-9)
        )
        insulator, gap, skin = layers.elastances(gap_m)
        thickness = layers.air_permittivity_f_per_m * (insulator + gap + skin)
        tau1 = layers.insulator_permittivity_f_per_m / np.float64(
            layers.insulator_conductivity_s_per_m
        )
        tau2 = layers.skin_permittivity_f_per_m / layers.skin_conductivity_s_per_m
        leak_current = (rho2 - rho1) / (tau2 - tau1)  # (24)-(25)
        alpha_per_pa = contact_conductance_per_pa(
            description.values, layers.skin_conductivity_s_per_m
        )
        return PrintedField(
            gap_per_m=np.asarray((1.0 + insulator * rho1 - skin * rho2) / thickness),
            leak_pa_per_m=np.asarray(leak_current / (alpha_per_pa * gap_m)),
        )


def solve(description: ModelDescription, table: GapTable, drive: Drive) -> Attraction:
    """Attraction of each condition [n] at its lowest equilibrium; ModelError for drives that it
    does not know.
    """
    _check(description, drive)
    p = description.values
    if np.any(drive.seen_area_m2):
        raise ModelError(
            "the equations as printed know one area of contact",
            "Leave contact_area_m2 out, or use variant 'corrected'",
        )
    fields = dict(zip(vars(drive), np.broadcast_arrays(*vars(drive).values()), strict=True))
    frequency, voltage, load_n = (
        fields[name].ravel() for name in ("frequency_hz", "voltage_v", "normal_force_n")
    )
    load = load_n / p.contact_area_m2
    scale = p.pressure_scale_pa
    pressure, (negative, pulled_in) = np.empty(load.shape), np.zeros((2, load.size), bool)
    distinct, group = np.unique(frequency, return_inverse=True)
    sums = _stress_sums(description, table, distinct, scale)
    for i in range(distinct.size):
        here = group == i
        pressure[here], negative[here], pulled_in[here] = _equilibria(
            sums[:, i], voltage[here], load[here], scale
        )
    # (30)
    force = pressure * p.contact_area_m2 * area_ratio(table.shape, (load + pressure) / scale)
    lost = np.isnan(pressure) & ~negative
    diverged = (
        force >= load_n if description.friction_law == "total_load" else np.zeros(load.shape, bool)
    )
    found = ((NEGATIVE, negative), (NO_EQUILIBRIUM, lost), (DIVERGED, diverged))
    notes = tuple(
        f"{np.sum(rows)} of {rows.size} conditions: {text}" for text, rows in found if rows.any()
    )
    return Attraction(pressure, np.asarray(force), pulled_in, notes)


def _check(description: ModelDescription, drive: Drive) -> None:
    if description.effects:
        names = ", ".join(effect.name for effect in description.effects)
        raise ModelError(
            f"variant '{description.variant}' has no effects, but {names} is on",
            "Use variant 'corrected'",
        )
    voltage = np.asarray(drive.voltage_v)
    square = (
        (np.asarray(drive.mean_square_factor) == 1.0)
        & (np.asarray(drive.steady) == 0.0)
        & (voltage != 0.0)
    )
    biased = np.asarray(drive.voltage_offset_v) != 0.0
    for what, rows in (("a square wave", square), ("a bias", biased)):
        if rows.any():
            raise RowError(
                int(np.argmax(rows)),
                f"the equations as printed know nothing of {what}",
                "Give a sine or dc, or variant 'corrected'",
            )


def _stress_sums(
    description: ModelDescription, table: GapTable, frequency_hz: Array, scale: float
) -> Array:
    """Real parts per V^2 at each row of the table [rows, f, 3]. They are those of int P E_g^2, int
    P E_g E_L p and int P (E_L p)^2.
    """
    gap_m = gap_nodes() * description.values.roughness_rms_m
    field = printed_field(
        description,
        frequency_hz,
        gap_m[:, None],
        absolute=description.variant == "published_absolute",
    )
    # of each node's cell above a_c
    counted = np.clip(np.log(gap_m / LEAK_CUT_OFF_M) / LOG_U_AXIS[2] + 0.5, 0.0, 1.0)
    leaking = table.mass * counted
    with np.errstate(invalid="ignore", over="ignore"):
        return np.stack(
            [
                table.mass @ (field.gap_per_m**2).real,
                leaking @ (field.gap_per_m * field.leak_pa_per_m).real,
                leaking @ (field.leak_pa_per_m**2).real,
            ],
            axis=-1,
        )


def _equilibria(
    sums: Array, voltage_v: Array, load_pa: Array, scale: float
) -> tuple[Array, Mask, Mask]:
    """Lowest p_e = V^2 g(p0 + p_e) of each condition; where attraction is negative or undefined
    from the start.

    Last, where there is none since V(p_e) turns back below this voltage. `sums` as of
    `_stress_sums`.
    """
    square, log_p = voltage_v**2, axis(LOG_P_AXIS) + np.log(scale)
    defined = 1.0 if np.isfinite(sums).all() else np.nan
    of_log_p = CubicSpline(log_p, np.nan_to_num(sums, posinf=0.0, neginf=0.0))

    def gain(p: Array) -> Array:
        """(29) per V^2 at a total pressure in Pa."""
        s = of_log_p(np.log(p))
        return np.asarray(
            defined * 0.5 * EPS0 * (s[..., 0] - 2.0 * s[..., 1] / p + s[..., 2] / p**2)
        )

    nodes = np.geomspace(np.exp(log_p[0]), np.exp(log_p[-1]), PRESSURE_NODES)
    inside = (load_pa >= nodes[0]) & (load_pa <= nodes[-1])
    negative = inside & (square > 0.0) & ~(gain(np.where(inside, load_pa, nodes[0])) >= 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.nan_to_num((nodes - load_pa[:, None]) / gain(nodes), nan=0.0)  # V^2
    # attraction no longer outruns the pressure
    closed = load_pa[:, None] + square[:, None] * gain(nodes) <= nodes
    closed &= nodes >= load_pa[:, None]
    found, at = closed.any(axis=1) & inside & ~negative, np.argmax(closed, axis=1)
    low, high = np.maximum(nodes[np.maximum(at - 1, 0)], load_pa), nodes[at]
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        above = load_pa + square * gain(middle) <= middle
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    pressure = np.where(found, square * gain(high), np.nan)
    pulled_in = inside & ~found & ~negative & (np.argmax(needed, axis=1) < nodes.size - 1)
    return np.where(inside & (square == 0.0), 0.0, pressure), negative, pulled_in
