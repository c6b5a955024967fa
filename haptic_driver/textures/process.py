"""Processes y[n] + ar[0] y[n-1] + ... = noise[n] + ma[0] noise[n-1] + ...: their spectrum, and what
lies between two.

Coefficients may not be averaged: what comes out can grow without end. Reflection coefficients may.
A process dies away exactly when all of them lie between -1 and 1 (Markel and Gray, Linear
Prediction of Speech, 1976).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from haptic_driver.signals import Array


def reflections(coefficients: Sequence[float] | Array) -> Array:
    """The reflection coefficients [n] of a polynomial 1, c[0], ..., c[n-1], by stepping down; NaN
    beyond one of 1.
    """
    left, found = np.asarray(coefficients, float), []
    while left.size:
        found.append(left[-1])
        with np.errstate(divide="ignore", invalid="ignore"):
            left = (left[:-1] - left[-1] * left[-2::-1]) / (1.0 - left[-1] ** 2)
    return np.array(found[::-1])


def coefficients(reflected: Array) -> Array:
    """The coefficients [n] of a polynomial from its reflection coefficients: the steps up again."""
    found = np.empty(0)
    for reflection in reflected.tolist():
        found = np.append(found + reflection * found[::-1], reflection)
    return found


def power(
    frequency_hz: Array,
    rate_hz: float,
    ar: Sequence[float] | Array,
    ma: Sequence[float] | Array = (),
) -> Array:
    """Of the waves [n] in a process driven by noise of power 1; none above half its rate."""
    turn = np.exp(-1j * math.tau * frequency_hz / rate_hz)
    loud, quiet = (np.abs(np.polyval([*side[::-1], 1.0], turn)) ** 2 for side in (ma, ar))
    return np.where(frequency_hz <= rate_hz / 2.0, loud / quiet, 0.0)
