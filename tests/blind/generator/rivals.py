"""lambda_ij: what is left of a hidden effect after fitting another catalogue effect with the base
nuisances.

Two starts per rival and a bounded fit: an upper bound, good enough to tell "inseparable" (below 9)
from "distinct".
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from .designs import Design
from .effect import CATALOGUE, Effect, Hidden
from .effects import CATALOGUE_EFFECTS
from .touch import Finger
from .visibility import Visibility, coordinates, finger_from, with_effects


def _free_shape(shape: dict) -> list[str]:
    """Shape entries a fit may move: positive numbers, not signs and whole orders."""
    return [k for k, v in shape.items() if isinstance(v, float) and k != "sign"]


def _variants(effect: Effect) -> list[dict]:
    """Distinct discrete choices of the effect (sign, order), each with its median-like continuous
    shape.
    """
    draws = [effect.draw(np.random.default_rng(i)) for i in range(12)]
    found: dict[tuple, dict] = {}
    for shape in draws:
        found.setdefault(
            tuple((k, v) for k, v in shape.items() if k not in _free_shape(shape)), shape
        )
    return list(found.values())


def _fit(
    design: Design, start: Finger, sight: Visibility, log_cof: np.ndarray, hidden: Hidden
) -> float:
    white, unit = sight.white, replace(start, mu_off=1.0)
    one = white(np.ones_like(log_cof))
    names = _free_shape(hidden.shape)
    low, high = np.log(hidden.effect.knob)

    def residual(theta: np.ndarray) -> np.ndarray:
        shape = hidden.shape | {
            k: hidden.shape[k] * np.exp(x) for k, x in zip(names, theta[4:], strict=True)
        }
        trial = Hidden(hidden.effect, float(np.exp(theta[3])), shape, CATALOGUE)
        cof = with_effects(design.rows, finger_from(theta[:3], unit), (trial,))
        r = white(log_cof - np.log(np.maximum(cof, 1e-6)))
        level = np.clip((one @ r) / (one @ one), np.log(0.2), np.log(2.0))
        return np.concatenate([r - level * one, theta[:3]])

    rough = [
        (float((residual(_start(start, s, names)) ** 2).sum()), s)
        for s in np.linspace(low, high, 9)
    ]
    bounds = (np.r_[[-6] * 3, low, [-1.5] * len(names)], np.r_[[6] * 3, high, [1.5] * len(names)])
    costs = []
    for _, s in sorted(rough)[:2]:
        x0 = np.clip(_start(start, s, names), bounds[0] + 1e-6, bounds[1] - 1e-6)
        fit = least_squares(
            residual, x0, bounds=bounds, xtol=1e-4, ftol=1e-4, max_nfev=20, diff_step=1e-4
        )
        costs.append(2 * fit.cost)
    return min(costs)


def _start(finger: Finger, log_knob: float, names: list[str]) -> np.ndarray:
    return np.concatenate([np.clip(coordinates(finger), -5, 5), [log_knob], np.zeros(len(names))])


def lambda_of_rivals(
    design: Design, finger: Finger, sight: Visibility, clean: np.ndarray, skip: str = ""
) -> dict[str, float]:
    """Left-over lambda for each rival whose column the design records."""
    out = {}
    for name, effect in CATALOGUE_EFFECTS.items():
        if name == skip or (effect.needs and effect.needs not in design.columns):
            continue
        fits = [
            _fit(design, finger, sight, np.log(clean), Hidden(effect, 1.0, shape))
            for shape in _variants(effect)
        ]
        out[name] = max(min(fits) - sight.null, 0.0)
    return out
