"""One finger's own numbers from its measured friction: a fit with priors, and what the data could
and could not say.

The fit is that of the diagnosis (`diagnosis/model_fit.py`), without effects to choose. Parameters
are in prior units; session gains and noise scale are integrated out. The posterior is Gaussian
around the most probable finger.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from model.description import ModelDescription
from model.diagnosis.data import Measurements
from model.diagnosis.ends import at_an_end
from model.diagnosis.model_fit import Fit, Problem
from model.diagnosis.noise import Noise, noise_of
from model.diagnosis.space import FINGER, GAP_OFFSET, Nuisance, Predictor
from model.diagnosis.witness import FRICTION
from model.effects import Effect
from model.parameters import SPECIFICATION, Parameter
from model.reporting.model_file import (
    dielectric_entry,
    fitted_effects,
    fitted_nuisances,
    model_text,
    program,
)
from model.support.arrays import Array
from model.support.errors import ModelError, nearest

# known of a screen or hidden behind the others, so fitted only where asked for; spreads judged,
# but for the area: between the medians of 10 people in CapContact's masks
OPTIONAL = (
    Nuisance("contact_area_m2", 0.22),
    Nuisance("skin_modulus_pa", 0.30),
    Nuisance("insulator_thickness_m", 0.10),
    Nuisance("insulator_permittivity", 0.03),
    GAP_OFFSET,
)
KEPT = ("roughness_rms_m", "skin_thickness_m")  # of a finger, over hours
LEAST_ROWS = 8
STARTS = (0.0, 1.5, -1.5)  # prior units, of all parameters but friction without voltage
CORRELATED = 0.9
FAR = 3.0  # prior units
# posterior over prior standard deviation from which the data said next to nothing
BARELY_LEARNT = 0.9
INTERVALS = {
    "68 %": float(ndtri(0.84)),
    "95 %": float(ndtri(0.975)),
}  # half-widths in standard deviations


class FittedParameter(NamedTuple):
    """One number of the finger, in its own unit; intervals as (low, high).

    `learnt`: posterior over prior standard deviation, 1 where the data said nothing.
    """

    name: str
    unit: str
    value: float
    interval_68: tuple[float, float]
    interval_95: tuple[float, float]
    prior_68: tuple[float, float]
    learnt: float


@dataclass(frozen=True)
class Calibration:
    """A finger fitted to its data.

    `residual` [n] is whitened (standard normal where the model fits). `correlated` names pairs that
    the data hardly separate, with their correlation. `warnings` say in words what not to rely on.
    `at_an_end` names what stands at an end of its range, and is no measurement.
    """

    model: ModelDescription
    parameters: tuple[FittedParameter, ...]
    correlated: tuple[tuple[str, str, float], ...]
    warnings: tuple[str, ...]
    data: Measurements
    noise: Noise
    fit: Fit
    predicted_cof: Array
    at_an_end: tuple[str, ...] = ()

    @property
    def residual(self) -> Array:
        """Whitened residuals [n]."""
        return self.fit.residual

    @property
    def chi2_per_point(self) -> float:
        """Chi-square over rows less parameters: 1 where noise is all that is left."""
        return self.fit.chi2 / max(self.data.count - len(self.parameters), 1)


def calibrate(
    description: ModelDescription,
    data: Measurements,
    also: Sequence[str] = (),
    kinds: Sequence[type[Effect]] = (),
    same_finger: bool = False,
) -> Calibration:
    """Fit the finger's parameters, those of `also` (names of `OPTIONAL`) and of effects of `kinds`
    to its data.

    The priors are centred on the model's own values. With `same_finger`, what a finger keeps
    (`KEPT`) has the model's own spread, and the rows keep their stated errors. Where age has
    widened them, their scatter gives no scale. An effect to fit that the model has on begins anew.
    Of the data only friction is used. ModelError where they cannot carry a fit.
    """
    data = data.subset(data.of(FRICTION))
    free = (*FINGER, *(_optional(name) for name in also))
    if same_finger:
        free = tuple(_as_known(n, description.parameters[n.name]) for n in free)
    fitted = {kind.name for kind in kinds}
    others = {
        name: values for name, values in description.effect_parameters.items() if name not in fitted
    }
    description = replace(description, effect_parameters=others)
    noise = noise_of(data)
    if data.count < LEAST_ROWS or not data.driven.any():
        raise ModelError(
            f"{data.count} rows, {int(data.driven.sum())} of them with voltage, are too few to"
            " calibrate a finger",
            f"Give at least {LEAST_ROWS} rows, with and without voltage",
        )
    if noise is None:
        raise ModelError(
            "the noise of the data is not known",
            "Give a column cof_std, or measure settings repeatedly",
        )
    problem = Problem(Predictor(description, data, free), data.observed, noise)
    unmoved = np.zeros(problem.predictor.size(kinds) - len(free))
    starts = [np.array([0.0 if n.name == "cof_off" else x for n in free]) for x in STARTS]
    fits = (problem.fit(kinds, np.concatenate([start, unmoved])) for start in starts)
    fit = max(fits, key=lambda found: found.log_evidence)
    parameters = tuple(_fitted(description, n, fit, i) for i, n in enumerate(free))
    correlated = _correlated(free, fit)
    ends = at_an_end(description, free, fit)
    predicted = np.exp(problem.predictor.predicted(kinds, fit.vector[None])[0])
    return Calibration(
        model=_model(description, data, free, fit),
        parameters=parameters,
        correlated=correlated,
        warnings=(
            *data.notes,
            *noise.warnings,
            *_warnings(data, parameters, correlated, fit),
            *ends.values(),
        ),
        at_an_end=tuple(ends),
        data=data,
        noise=noise,
        fit=fit,
        predicted_cof=predicted,
    )


def _as_known(nuisance: Nuisance, own: Parameter) -> Nuisance:
    """With the model's own spread, where it says one that is narrower."""
    if nuisance.name not in KEPT or not own.std:
        return nuisance
    return replace(nuisance, log_std=min(nuisance.log_std, own.std / own.value))


def _optional(name: str) -> Nuisance:
    for known in OPTIONAL:
        if known.name == name:
            return known
    names = [n.name for n in OPTIONAL]
    if name in (n.name for n in FINGER):
        raise ModelError(
            f"parameter '{name}' is fitted in any case", f"Choose among {', '.join(names)}"
        )
    raise ModelError(f"parameter '{name}' cannot be calibrated", nearest(name, names))


def _fitted(description: ModelDescription, nuisance: Nuisance, fit: Fit, i: int) -> FittedParameter:
    before, specification = description.parameters[nuisance.name], SPECIFICATION[nuisance.name]
    std = float(np.sqrt(fit.covariance[i, i]))

    def at(x: float) -> float:
        value = nuisance.value(before.value, np.asarray(x))
        return float(np.clip(value, specification["low"], specification["high"]))

    half_68, half_95 = INTERVALS.values()
    x = float(fit.vector[i])
    return FittedParameter(
        name=nuisance.name,
        unit=before.unit,
        value=at(x),
        interval_68=(at(x - half_68 * std), at(x + half_68 * std)),
        interval_95=(at(x - half_95 * std), at(x + half_95 * std)),
        prior_68=(at(-half_68), at(half_68)),
        learnt=std,
    )


def _correlated(free: Sequence[Nuisance], fit: Fit) -> tuple[tuple[str, str, float], ...]:
    std = np.sqrt(np.diag(fit.covariance))
    correlation = fit.covariance / np.outer(std, std)
    return tuple(
        (free[i].name, free[j].name, float(correlation[i, j]))
        for i, j in combinations(range(len(free)), 2)
        if abs(correlation[i, j]) > CORRELATED
    )


def _warnings(
    data: Measurements,
    parameters: Sequence[FittedParameter],
    correlated: Sequence[tuple[str, str, float]],
    fit: Fit,
) -> list[str]:
    said = [
        f"the data say next to nothing of {p.name}: it stays at its prior"
        for p in parameters
        if p.learnt > BARELY_LEARNT
    ]
    said += [
        f"{a} and {b} are known only together (correlation {r:+.2f})" for a, b, r in correlated
    ]
    far = np.abs(fit.vector[: len(parameters)]) > FAR
    said += [
        f"{p.name} lies far outside its prior"
        for p, is_far in zip(parameters, far, strict=True)
        if is_far
    ]
    if data.driven.all():
        said.append(
            "no row is without voltage: friction without voltage follows from the model alone"
        )
    if fit.chi2 > data.count + 4.0 * np.sqrt(2.0 * data.count):
        said.append("the model does not fit: see `haptic diagnose` for what is missing")
    return said


def _model(
    description: ModelDescription, data: Measurements, free: Sequence[Nuisance], fit: Fit
) -> ModelDescription:
    """The model with this finger: values with one standard deviation each, to first order.

    The numbers held in the fit lose theirs: the data fix what they do together with the fitted
    ones.
    """
    source = f"calibrated, data sha256 {data.content_hash[:16]}"
    held = {name: replace(p, std=None) for name, p in description.parameters.items()}
    return replace(
        description,
        name=f"{description.name.removesuffix('-calibrated')}-calibrated",
        about=f"{description.name}, calibrated to one finger",
        parameters=held | fitted_nuisances(description, fit, free, source),
        effect_parameters=description.effect_parameters | fitted_effects(fit, source),
    )


def write_calibration(
    found: Calibration, parent: ModelDescription, path: Path, data_name: str
) -> None:
    """Write the finger's model to `path`, atomically; a user's own dielectric table goes into a
    folder beside it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    origin: dict[str, float | int | str] = {
        "data": data_name,
        "data_sha256": found.data.content_hash,
        "parent_model": parent.name,
        "parent_hash": parent.content_hash,
        "chi2_per_point": found.chi2_per_point,
        "program": program(),
    }
    part = path.with_name(f"{path.name}.part")
    part.write_text(
        model_text(found.model, dielectric_entry(found.model, path.parent), origin),
        encoding="utf-8",
    )
    part.replace(path)
