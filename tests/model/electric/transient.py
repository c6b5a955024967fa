"""Charges under any voltage, exact for straight pieces: what the closed forms are compared with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.electric.charges import Coefficients, Layers, coefficients
from model.support.arrays import Array

SERIES_BELOW = 0.05  # of rate times step: the six terms of the series leave 1e-12 there


def simulate(layers: Layers, gap_m: Array, time_s: Array, voltage_v: Array) -> tuple[Array, Array]:
    """rho1 and rho2 in C/m^2 [t, n] of n gaps under any voltage, from neutral layers at
    `time_s[0]`.

    `gap_m` [n] >= 0, `time_s` [t] rising, `voltage_v` [t] linear in between (its first value is
    applied at once). Exact for such a voltage at any step: the two modes of (16)-(17) are lags with
    real rates, each integrated in closed form.
    """
    slow, fast = _modes(coefficients(layers, gap_m))
    lag_slow, lag_fast = (_lag(mode.rate_per_s, time_s, voltage_v) for mode in (slow, fast))
    rho1, rho2 = (-(slow.drive[i] * lag_slow + fast.drive[i] * lag_fast) for i in (0, 1))
    return rho1, rho2


@dataclass(frozen=True)
class _Mode:
    """One decay of (16)-(17): its rate, and what part of (c, f) drives it, all [n]."""

    rate_per_s: Array
    drive: tuple[Array, Array]


def _modes(k: Coefficients) -> tuple[_Mode, _Mode]:
    """The slow and the fast mode; both rates are real and not negative, as in every network of R
    and C.

    Differences are formed so that the slow mode keeps its digits beside a fast one 1e7 times its
    rate.
    """
    theta = np.sqrt((0.5 * (k.a - k.e)) ** 2 + k.b * k.d)
    fast = 0.5 * (k.a + k.e) + theta
    slow = _ratio(k.a * k.e - k.b * k.d, fast)
    larger = np.maximum(k.a, k.e) - slow
    smaller = _ratio(k.b * k.d, larger)  # (a - slow)(e - slow) = bd
    a, e = np.where(k.a >= k.e, larger, smaller), np.where(k.a >= k.e, smaller, larger)
    spread = 2.0 * theta
    to_fast = _ratio(a * k.c + k.b * k.f, spread), _ratio(k.d * k.c + e * k.f, spread)
    apart = spread > 0.0  # equal modes need no splitting
    to_slow = (
        np.where(apart, _ratio(e * k.c - k.b * k.f, spread), k.c),
        np.where(apart, _ratio(a * k.f - k.d * k.c, spread), k.f),
    )
    return _Mode(slow, to_slow), _Mode(fast, to_fast)


def _ratio(numerator: Array, denominator: Array) -> Array:
    """Quotient, 0 where the denominator is 0, as without any conduction."""
    return np.divide(
        numerator, denominator, out=np.zeros_like(denominator), where=denominator > 0.0
    )


def _lag(rate_per_s: Array, time_s: Array, voltage_v: Array) -> Array:
    """q' = -rate q + V from q = 0, [t, n], exact for a voltage linear between the times."""
    step = np.diff(time_s)
    x = step[:, None] * rate_per_s
    decay, held = np.exp(-x), step[:, None] * _phi1(x)
    ramp = step[:, None] * _phi2(x)
    forced = held * voltage_v[:-1, None] + ramp * np.diff(voltage_v)[:, None]
    q = np.zeros((time_s.size, rate_per_s.size))
    for i in range(step.size):
        q[i + 1] = decay[i] * q[i] + forced[i]
    return q


def _phi1(x: Array) -> Array:
    """(1 - e^-x)/x."""
    safe = np.where(x > 0.0, x, 1.0)
    return np.where(x > 0.0, -np.expm1(-safe) / safe, 1.0)


def _phi2(x: Array) -> Array:
    """(x - 1 + e^-x)/x^2."""
    safe = np.where(x > SERIES_BELOW, x, 1.0)
    series = 1 / 2 - x * (1 / 6 - x * (1 / 24 - x * (1 / 120 - x * (1 / 720 - x / 5040))))
    return np.where(x > SERIES_BELOW, (1.0 - _phi1(safe)) / safe, series)
