"""How far a model's answers may be off: its numbers' own uncertainty and the contact theory's,
carried to friction.

Every number of a model file that has a `std` is uncertain by it. Where the file gives none, the
finger's own numbers are uncertain by the spread between fingers (`FINGER` of the diagnosis). The
numbers are taken as independent of one another, log-normal where they are positive by nature. Those
that shape the roughness (Hurst exponent, wavenumbers, gamma) are held.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

import numpy as np

from model import solver
from model.conditions import sines
from model.contact.theory_error import theory_log_std
from model.description import ModelDescription
from model.diagnosis.space import FINGER
from model.electric.dielectrics import Dielectric
from model.parameters import SPECIFICATION, Parameter
from model.support.arrays import Array, ComplexArray, Values
from model.support.errors import ModelError
from model.support.interpolation import linear_weights
from model.touch import SPEED_REFERENCE_M_S, Drive
from model.touch_model import TouchModel, cof, prepare

INTERVAL = (0.16, 0.84)  # one standard deviation each way, were friction normal
DRAWS = 64
DRAWS_AT_ONE = 512  # condition; they cost little there
SEED = 0
# at which draws are solved; the interval's width is smooth between them
MOST_FREQUENCIES = MOST_VOLTAGES = 25
MOST_THEORY_ERROR = 0.6  # of the logarithm of pressure, either way
SHAPE_OF_ROUGHNESS = (
    "hurst_exponent",
    "roll_off_wavenumber_per_m",
    "cut_off_wavenumber_per_m",
    "contact_gamma",
)
# Between subjects and sites, judged from the scatter of skin's dielectric data; unverified.
SKIN_PERMITTIVITY, SKIN_CONDUCTIVITY = "skin_permittivity", "skin_conductivity"
SKIN_LOG_STD = {SKIN_PERMITTIVITY: 0.2, SKIN_CONDUCTIVITY: 0.4}


@dataclass(frozen=True)
class ScaledDielectric:
    """A data set with its permittivity and its total conductivity multiplied by a factor each, at
    every frequency.

    It stands for another person's skin; where the two factors differ it is not causal, as no data
    scatter is.
    """

    base: Dielectric
    permittivity_factor: Values
    conductivity_factor: Values

    @property
    def name(self) -> str:
        """That of the data set."""
        return self.base.name

    @property
    def source(self) -> str:
        """That of the data set."""
        return self.base.source

    def permittivity(self, frequency_hz: Array) -> ComplexArray:
        """See `Dielectric`; factors broadcast against the frequencies."""
        k = self.base.permittivity(frequency_hz)
        return np.asarray(
            k.real * self.permittivity_factor + 1j * k.imag * self.conductivity_factor
        )


@dataclass(frozen=True)
class Uncertain:
    """One number that is known within a spread.

    `name` is a parameter's, `effect.parameter`, or one of `SKIN_LOG_STD`; `std` is of the logarithm
    if `logarithmic`.
    """

    name: str
    value: float
    std: float
    logarithmic: bool
    low: float
    high: float

    def at(self, x: Values) -> Values:
        """The value `x` standard deviations from the model's, kept within the file's range; any
        shape.
        """
        value = self.value * np.exp(self.std * x) if self.logarithmic else self.value + self.std * x
        return np.clip(value, self.low, self.high)


def uncertain_numbers(description: ModelDescription) -> tuple[Uncertain, ...]:
    """Every number of the model that is uncertain, the finger and the screen first, then skin data
    and effects.
    """
    between_fingers = {n.name: n.log_std for n in FINGER if n.name != "cof_off"}
    found = []
    for name, p in description.parameters.items():
        std = p.std if p.std is not None else p.value * between_fingers.get(name, 0.0)
        if std > 0.0 and name not in SHAPE_OF_ROUGHNESS:
            low, high = SPECIFICATION[name]["low"], SPECIFICATION[name]["high"]
            found.append(_uncertain(name, p.value, std, p.value > 0.0, low, high))
    found += [
        Uncertain(name, 1.0, log_std, True, 0.0, np.inf) for name, log_std in SKIN_LOG_STD.items()
    ]
    for effect, values in description.effect_parameters.items():
        for known_as in description.kinds[effect].parameters_in(values):
            p = values[known_as.name]
            if p.std:
                logarithmic = known_as.scale == "log" and p.value > 0.0
                full_name = f"{effect}.{known_as.name}"
                found.append(
                    _uncertain(full_name, p.value, p.std, logarithmic, known_as.low, known_as.high)
                )
    return tuple(found)


def _uncertain(
    name: str, value: float, std: float, logarithmic: bool, low: float, high: float
) -> Uncertain:
    return Uncertain(name, value, std / value if logarithmic else std, logarithmic, low, high)


def varied(
    description: ModelDescription, numbers: tuple[Uncertain, ...], x: Any
) -> ModelDescription:
    """The model with `numbers` [d] at `x` [d, ...] standard deviations: values of shape [...], as a
    fit has them.
    """
    values = {number.name: number.at(x_i) for number, x_i in zip(numbers, x, strict=True)}

    def changed(entries: dict[str, Parameter], prefix: str = "") -> dict[str, Parameter]:
        return {k: replace(p, value=values.get(prefix + k, p.value)) for k, p in entries.items()}

    factors = (values.get(SKIN_PERMITTIVITY, 1.0), values.get(SKIN_CONDUCTIVITY, 1.0))
    return replace(
        description,
        dielectric=ScaledDielectric(description.dielectric, *factors),
        parameters=changed(description.parameters),
        effect_parameters={
            e: changed(p, f"{e}.") for e, p in description.effect_parameters.items()
        },
    )


def normal_draws(count: int, dimensions: int, seed: int) -> Array:
    """Standard normal numbers [count, dimensions] that fill their space evenly: a Latin hypercube.

    In each dimension one in the middle of every `count`-th part of the probability; McKay, Beckman
    and Conover, Technometrics 21 (1979) 239.
    """
    middles = np.array([NormalDist().inv_cdf((i + 0.5) / count) for i in range(count)])
    return np.random.default_rng(seed).permuted(np.tile(middles, (dimensions, 1)), axis=1).T


def cof_interval(
    description: ModelDescription,
    frequency_hz: Array,
    voltage_v: Array,
    normal_force_n: Array,
    own_cof: Array,
    draws: int = DRAWS,
    seed: int = SEED,
) -> tuple[Array, Array]:
    """Friction at both ends of `INTERVAL` at every point [f, v, n] of a surface, whose friction is
    `own_cof`.

    Infinite where so high a friction means that the contact may have pulled in. Solved on some of
    the frequencies and voltages (from 0); what is interpolated is the ratio to `own_cof`.
    ModelError for the equations as printed, whose error is not one of their numbers.
    """
    f, v = _thinned(frequency_hz, MOST_FREQUENCIES), np.linspace(0.0, voltage_v[-1], MOST_VOLTAGES)
    drive = sines(f[:, None, None], v[:, None], normal_force_n, SPEED_REFERENCE_M_S, 0.0)
    base, ends = _base_and_ends(description, drive, draws, seed)
    weights = linear_weights(np.log(f), np.log(frequency_hz)), linear_weights(v, voltage_v)
    low, high = (own_cof * _interpolated(end / base, *weights) for end in ends)
    return low, high


def cof_interval_at(
    description: ModelDescription, frequency_hz: float, voltage_v: float, normal_force_n: float
) -> tuple[float, float]:
    """The same under one condition, where more draws are solved."""
    f, v, n = (np.array([x]) for x in (frequency_hz, voltage_v, normal_force_n))
    _, ends = _base_and_ends(
        description, sines(f, v, n, SPEED_REFERENCE_M_S, 0.0), DRAWS_AT_ONE, SEED
    )
    return float(ends[0, 0]), float(ends[1, 0])


def _base_and_ends(
    description: ModelDescription, drive: Drive, draws: int, seed: int
) -> tuple[Array, Array]:
    """Friction of the model itself [...] and at both ends of `INTERVAL` [2, ...], all draws solved
    at once.
    """
    if description.is_published:
        raise ModelError(
            "the equations as printed have no uncertainty to carry",
            "Use a model of variant 'corrected'",
        )
    base, numbers = TouchModel(description).answer(drive), uncertain_numbers(description)
    x = normal_draws(draws, len(numbers) + 1, seed).T.reshape(
        len(numbers) + 1, draws, *[1] * base.cof.ndim
    )
    theory = theory_error(description, drive, base.electrostatic_force_n)
    # of the pressure per squared volt
    gain = np.exp(np.clip(theory * x[-1], -MOST_THEORY_ERROR, MOST_THEORY_ERROR))
    drawn = varied(description, numbers, x[:-1])
    drive = replace(drive, voltage_v=drive.voltage_v * np.ones_like(x[-1]))
    touch = prepare(drawn.values, drawn.dielectric, drawn.effects, drive)
    circuit = touch.circuit._replace(
        mean_square_v2=touch.circuit.mean_square_v2 * gain.reshape(-1, 1)
    )
    p_e, _ = solver.solve(TouchModel(description).table, circuit)
    found = cof(description.friction_law, drawn.values, touch, p_e, drive.normal_force_n)
    found = np.where(np.isnan(found), np.inf, found)
    return base.cof, np.quantile(found, INTERVAL, axis=0, method="inverted_cdf")


def provenance(description: ModelDescription) -> dict[str, Any]:
    """What an interval was made from, as JSON can hold it: spreads of the logarithm where they are
    of it.
    """
    numbers = {
        u.name: {"std": u.std, "of_logarithm": u.logarithmic}
        for u in uncertain_numbers(description)
    }
    return {
        "interval": list(INTERVAL),
        "draws": DRAWS,
        "seed": SEED,
        "theory": "theory_log_std",
        "numbers": numbers,
    }


def theory_error(description: ModelDescription, drive: Drive, force_n: Array) -> Array:
    """One standard deviation of log(pressure) that the contact theory leaves, where `force_n` acts;
    of its shape.
    """
    p = description.values
    touch = prepare(p, description.dielectric, description.effects, drive)
    circuit = touch.circuit
    pressure_pa = (
        circuit.load_pa + np.nan_to_num(force_n.ravel()) / touch.area_m2 + circuit.added_pa
    )
    a = (
        1.0
        + (circuit.bypass_per_m[:, 0] + circuit.leak_per_m_pa[:, 0] * pressure_pa)
        * circuit.h_m[:, 0]
    )
    std = theory_log_std(
        pressure_pa,
        np.abs(circuit.k_gap[:, 0] * circuit.h_m[:, 0] / a + circuit.gap_shift_m),
        pressure_scale_pa=circuit.pressure_scale_pa,
        length_scale_m=circuit.length_scale_m,
    )
    return std.reshape(force_n.shape)


def _thinned(values: Array, most: int) -> Array:
    """At most `most` of the values, both ends among them."""
    kept = np.unique(np.round(np.linspace(0, values.size - 1, min(most, values.size))).astype(int))
    return np.asarray(values[kept])


def _interpolated(ratio: Array, by_frequency: Array, by_voltage: Array) -> Array:
    """`ratio` [f, v, n] by weights [m, f], [k, v]: [m, k, n], linear in the logarithm; infinite
    where a used one is.
    """

    def at(values: Array) -> Array:
        return np.asarray(
            np.einsum("mf,kv,fvn->mkn", by_frequency, by_voltage, values, optimize=True)
        )

    known = np.isfinite(ratio)
    return np.where(at(1.0 - known) > 0.0, np.inf, np.exp(at(np.log(np.where(known, ratio, 1.0)))))
