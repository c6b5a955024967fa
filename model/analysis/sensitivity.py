"""Which uncertain number matters where: Sobol indices of the electrostatic force at chosen
conditions.

Each number of `uncertainty.uncertain_numbers` is drawn from its own spread. The first-order index
is the share of the variance of log(force) that one number explains by itself. The total index
includes all its interactions (Saltelli et al. 2010, Comput. Phys. Commun. 181:259).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri
from scipy.stats import qmc, sobol_indices

from model import solver
from model.analysis.uncertainty import uncertain_numbers, varied
from model.conditions import Conditions
from model.description import ModelDescription
from model.support.arrays import Array
from model.support.errors import ModelError
from model.touch_model import TouchModel, prepare

DRAWS = 1024  # per matrix; a power of two
ROWS_AT_ONCE = 2048

Function = Callable[[Array], Array]


@dataclass(frozen=True)
class Sensitivity:
    """Sobol indices [condition, number]; `relative_std` [condition] of the force's logarithm over
    all draws.
    """

    names: tuple[str, ...]
    conditions: tuple[str, ...]
    first: Array
    total: Array
    relative_std: Array


def sobol(
    function: Function, dimensions: int, draws: int = DRAWS, seed: int = 0
) -> tuple[Array, Array]:
    """First-order and total indices [output, dimension] of a function of standard normal numbers.

    `function` takes [m, dimensions] and gives [m, outputs].
    """
    uniform = qmc.Sobol(2 * dimensions, seed=np.random.default_rng(seed)).random(draws)
    normal = ndtri(np.clip(uniform, 1e-9, 1.0 - 1e-9))
    a, b = normal[:, :dimensions], normal[:, dimensions:]
    f_ab = []
    for i in range(dimensions):
        mixed = a.copy()
        mixed[:, i] = b[:, i]
        f_ab.append(function(mixed).T)
    found = sobol_indices(
        func={"f_A": function(a).T, "f_B": function(b).T, "f_AB": np.stack(f_ab)}, n=draws
    )
    shape = (-1, dimensions)
    return np.reshape(found.first_order, shape), np.reshape(found.total_order, shape)


def force_sensitivity(
    description: ModelDescription, conditions: Conditions, draws: int = DRAWS, seed: int = 0
) -> Sensitivity:
    """Indices of log(force) at every condition; ModelError where the force of some draw does not
    exist.
    """
    if description.is_published:
        raise ModelError(
            "the equations as printed have no sensitivity of their own", "Use variant 'corrected'"
        )
    names = [n.name for n in uncertain_numbers(description) if n.name != "cof_off"]
    function = _log_force(description, names, conditions)
    first, total = sobol(function, len(names), draws, seed)
    spread = function(np.random.default_rng(seed).standard_normal((draws, len(names))))
    return Sensitivity(tuple(names), _labels(conditions), first, total, spread.std(axis=0))


def _log_force(
    description: ModelDescription, names: Sequence[str], conditions: Conditions
) -> Function:
    numbers = tuple(n for n in uncertain_numbers(description) if n.name in names)
    table, drive = TouchModel(description).table, conditions.drive()

    def some(x: Array) -> Array:
        model = varied(description, numbers, x.T[:, :, None])
        p = model.values
        touch = prepare(p, model.dielectric, model.effects, drive)
        p_e = solver.solve(table, touch.circuit)[0].reshape(touch.shape)
        area_m2 = touch.area_m2.reshape(touch.shape)
        if not np.isfinite(p_e).all():
            raise ModelError(
                "the contact pulls in for some of the drawn numbers", "Give a lower voltage"
            )
        if not (p_e > 0.0).all():
            raise ModelError(
                "nothing attracts the finger under some condition", "Give a voltage above 0"
            )
        return np.asarray(np.log(p_e * area_m2))

    def log_force(x: Array) -> Array:
        return np.concatenate(
            [some(x[i : i + ROWS_AT_ONCE]) for i in range(0, len(x), ROWS_AT_ONCE)]
        )

    return log_force


def _labels(conditions: Conditions) -> tuple[str, ...]:
    rows = zip(
        conditions.frequency_hz, conditions.voltage_v, conditions.normal_force_n, strict=True
    )
    return tuple(f"{f:g} Hz, {v:g} V, {n:g} N" for f, v, n in rows)
