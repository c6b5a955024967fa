"""The curves of the paper's figures 4-8 as arrays, by the corrected equations and by the printed
ones.

The conditions are those of the paper's text: 75 V, 0.5 N and ten frequencies from 1 Hz to 1 MHz.
Direct voltages are 50 to 300 V; four parameters vary by +-50 %. The printed equations are
`published` (relative permittivities where the print has them); what they cannot answer is NaN.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from haptic_driver.lab.figures.closed_forms import closed_form
from model.conditions import Conditions
from model.contact.gap_distribution import area_ratio, mean_gap
from model.description import ModelDescription
from model.electric.charges import coefficients, constant_layers
from model.electric.dielectrics import EPS0, Dielectric
from model.electric.layers import leak_conductance_per_pa
from model.parameters import TouchParameters
from model.published import as_published, complex_layers, printed_coefficients
from model.published import solve as solve_published
from model.support.arrays import Array
from model.support.errors import ModelError
from model.touch_model import TouchModel

PAPER_HZ = np.array([1.0, 10.0, 50.0, 100.0, 250.0, 500.0, 1e3, 1e4, 1e5, 1e6])  # section III
SWEEP_HZ = np.unique(np.concatenate([np.geomspace(1.0, 1e6, 121), PAPER_HZ]))
VOLTAGE_V = 75.0
NORMAL_FORCE_N = 0.5
STEP_V = (50.0, 75.0, 100.0, 150.0, 200.0, 300.0)  # Fig. 5
VOLTAGES_V = np.unique(np.concatenate([np.linspace(0.0, 300.0, 61), STEP_V]))  # Fig. 4
# of the skin under a direct voltage; the print's constants change with the frequency (slip 7)
DIELECTRIC_AT_HZ = 1.0
STEP_TIME_S = np.concatenate([[0.0], np.geomspace(1e-7, 1e5, 241)])
PRINTED_TIME_S = np.geomspace(1e5, 1e16, 221)  # relative permittivities make seconds of 1/eps0 s
CHANGED = {
    "insulator_thickness_m": "d₁, insulator thickness",
    "skin_thickness_m": "d₂, skin thickness",
    "insulator_permittivity": "ε₁, insulator permittivity",
    "skin_modulus_pa": "Y₂, skin's Young's modulus",
}
CHANGE = 0.5  # Fig. 8
ELASTICITY_STEP = 0.01  # of the central difference; halving it moves no elasticity by 1e-3


def variants(description: ModelDescription) -> dict[str, TouchModel]:
    """The same finger by the corrected and by the printed equations; ModelError for what has no
    corrected form.
    """
    if description.is_published or description.effects:
        raise ModelError(
            f"model '{description.name}' is not the plain corrected model that the figures compare"
            " with the print",
            "Give a model with variant 'corrected' and without effects, such as 'reference' or"
            " 'table1'",
        )
    return {
        "corrected": TouchModel(description),
        "published": TouchModel(as_published(description)),
    }


@dataclass(frozen=True)
class Touching:
    """Answers for conditions of one shape; NaN where there is none. `pressure_pa` is the
    electrostatic part p_e.
    """

    force_n: Array
    cof: Array
    pressure_pa: Array
    mean_gap_m: Array
    area_ratio: Array


def touching(
    model: TouchModel, frequency_hz: Array, voltage_v: Array | float = VOLTAGE_V
) -> Touching:
    """Solve sines that broadcast, at the paper's normal force, with the contact that each
    leaves.
    """
    f, v = np.broadcast_arrays(
        np.asarray(frequency_hz, dtype=np.float64), np.asarray(voltage_v, dtype=np.float64)
    )
    conditions = Conditions(f.ravel(), v.ravel(), np.full(f.size, NORMAL_FORCE_N))
    found, p = model.predict(conditions), model.description.values
    pressure_pa = found.electrostatic_force_n / p.contact_area_m2
    # whose force is not the pressure times the nominal area (30)
    if model.description.is_published:
        pressure_pa = solve_published(
            model.description, model.table, conditions.drive()
        ).pressure_pa
    p_hat = _total_pressure_pa(p, pressure_pa) / p.pressure_scale_pa
    gap_m = p.roughness_rms_m * np.array(
        [mean_gap(model.table.shape, x) if x > 0.0 else np.nan for x in p_hat]
    )
    columns = (
        found.electrostatic_force_n,
        found.cof,
        pressure_pa,
        gap_m,
        area_ratio(model.table.shape, p_hat),
    )
    return Touching(*(np.asarray(c).reshape(f.shape) for c in columns))


def _total_pressure_pa(p: TouchParameters, electrostatic_pa: Array) -> Array:
    return np.asarray(NORMAL_FORCE_N / p.contact_area_m2 + electrostatic_pa)


def against_voltage(models: Mapping[str, TouchModel]) -> dict[str, Touching]:
    """Fig. 4: [frequency, voltage] over `PAPER_HZ` and `VOLTAGES_V`, by variant."""
    return {name: touching(model, PAPER_HZ[:, None], VOLTAGES_V) for name, model in models.items()}


def against_frequency(models: Mapping[str, TouchModel]) -> dict[str, Touching]:
    """Fig. 7: [frequency] over `SWEEP_HZ` at 75 V, by variant."""
    return {name: touching(model, SWEEP_HZ) for name, model in models.items()}


def loss_tangent(dielectric: Dielectric) -> Array:
    """eps''/eps' of the skin over `SWEEP_HZ`, purple in Fig. 7(a)."""
    k = dielectric.permittivity(SWEEP_HZ)
    return np.asarray(-k.imag / k.real)


@dataclass(frozen=True)
class Charges:
    """Charge densities in C/m^2 at insulator-air (1) and air-skin (2); `at` is time in s or
    frequency in Hz.
    """

    at: Array
    rho1_c_per_m2: Array
    rho2_c_per_m2: Array


def charges_after_step(models: Mapping[str, TouchModel]) -> dict[str, Charges]:
    """Fig. 5: [time, voltage] after each of `STEP_V` is switched on, by variant, without contact
    leakage.

    The gap is the mean of Fig. 4(b) at 1 Hz and that voltage, the skin's constants are those at 1
    Hz. The print's permittivities are relative: its charges are multiplied by eps0 here, its time
    is left as it comes out.
    """
    volts = np.array(STEP_V)
    at_hz = np.full(volts.shape, DIELECTRIC_AT_HZ)
    gaps = {name: touching(model, at_hz, volts).mean_gap_m for name, model in models.items()}
    description = models["corrected"].description
    layers = constant_layers(description.values, description.dielectric, DIELECTRIC_AT_HZ)
    right = coefficients(layers, gaps["corrected"])
    slipped = printed_coefficients(layers.relative, gaps["published"])
    forms = {
        "corrected": (closed_form(right, 0.0), STEP_TIME_S, volts),
        "published": (closed_form(slipped, 0.0, printed=True), PRINTED_TIME_S, EPS0 * volts),
    }
    found = {}
    for name, (form, time_s, unit) in forms.items():
        rho1, rho2 = form.charges(time_s[:, None])
        found[name] = Charges(time_s, unit * rho1, unit * rho2)
    return found


def steady_charges(models: Mapping[str, TouchModel]) -> dict[str, Charges]:
    """Fig. 6: amplitudes [frequency] over `SWEEP_HZ` at 75 V and the mean gap there; also
    `with_leak`, corrected.

    `with_leak` has the contact conductance beside the gap, as the force has it; the paper's charges
    have none.
    """
    solved = against_frequency(models)
    p, dielectric = (
        models["corrected"].description.values,
        models["corrected"].description.dielectric,
    )
    layers = constant_layers(p, dielectric, SWEEP_HZ)
    leak = leak_conductance_per_pa(p, layers.skin_conductivity_s_per_m)
    leaking = replace(
        layers,
        contact_conductance_s_per_m2=leak * _total_pressure_pa(p, solved["corrected"].pressure_pa),
    )
    gap = {name: found.mean_gap_m for name, found in solved.items()}
    printed = printed_coefficients(
        complex_layers(models["published"].description, SWEEP_HZ), gap["published"]
    )
    systems = {
        "corrected": (coefficients(layers, gap["corrected"]), 1.0),
        "published": (printed, EPS0),
        "with_leak": (coefficients(leaking, gap["corrected"]), 1.0),
    }
    found = {}
    for name, (system, unit) in systems.items():
        rho1, rho2 = (unit * VOLTAGE_V * np.abs(rho) for rho in system.response(2j * pi * SWEEP_HZ))
        found[name] = Charges(SWEEP_HZ, rho1, rho2)
    return found


@dataclass(frozen=True)
class Sensitivity:
    """Fig. 8 for one parameter: forces [frequency] at 50 %, 100 % and 150 % of it, and d ln F/d ln
    x at 100 %.
    """

    frequency_hz: Array
    lower_n: Array
    nominal_n: Array
    higher_n: Array
    elasticity: Array

    @property
    def lower_percent(self) -> Array:
        """Change of the force in percent when the parameter is halved."""
        return np.asarray(100.0 * (self.lower_n / self.nominal_n - 1.0))

    @property
    def higher_percent(self) -> Array:
        """Change of the force in percent when the parameter is half as large again."""
        return np.asarray(100.0 * (self.higher_n / self.nominal_n - 1.0))


def sensitivities(model: TouchModel) -> dict[str, Sensitivity]:
    """Fig. 8: by parameter of `CHANGED`, at 75 V."""
    up, down = 1.0 + ELASTICITY_STEP, 1.0 - ELASTICITY_STEP
    found = {}
    for name in CHANGED:
        low, nominal, high, above, below = (
            _force_n(_scaled(model, name, factor), PAPER_HZ)
            for factor in (1.0 - CHANGE, 1.0, 1.0 + CHANGE, up, down)
        )
        elasticity = np.log(above / below) / np.log(up / down)
        found[name] = Sensitivity(PAPER_HZ, low, nominal, high, elasticity)
    return found


def _force_n(model: TouchModel, frequency_hz: Array) -> Array:
    at = np.full_like(frequency_hz, VOLTAGE_V), np.full_like(frequency_hz, NORMAL_FORCE_N)
    return model.predict(Conditions(frequency_hz, *at)).electrostatic_force_n


def _scaled(model: TouchModel, name: str, factor: float) -> TouchModel:
    given = model.description.parameters
    changed = replace(given[name], value=given[name].value * factor)
    return TouchModel(replace(model.description, parameters={**given, name: changed}))
