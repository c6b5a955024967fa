"""The lookup surface: friction over frequency, normal force and voltage, looked up and inverted.

Axes are uniform in log frequency, log normal force and voltage; between nodes everything is linear, outside it is
clamped and never extrapolated. The kernels stand in `render/kernels.py`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from haptic_driver.render import kernels
from haptic_driver.render.kernels import LOG_FREQUENCY, Array


class Surface(NamedTuple):
    """A surface made ready for look-up, limits of the rig applied.

    `axes` [3, 3]: first node, last node and number of cells of each axis, in the order of the arrays. `cof` and
    `current_rms_a` are [frequency, normal force, voltage]; `voltage_limit_v` [frequency, normal force] is the largest
    voltage that every limit and mask allows there; `stuck_current_a_per_v` [frequency].
    """

    axes: Array
    cof: Array
    current_rms_a: Array
    stuck_current_a_per_v: Array
    voltage_limit_v: Array

    def nodes(self, axis: int) -> Array:
        """The nodes of one axis."""
        first, last, cells = self.axes[axis]
        return np.linspace(first, last, int(cells) + 1)


class Inverse(NamedTuple):
    """The voltage for a target at one frequency, and what it gives; `cof_high` is the most that is reachable there."""

    voltage_v: float
    cof: float
    current_rms_a: float
    stuck_current_rms_a: float
    cof_low: float
    cof_high: float


def cof_at(surface: Surface, frequency_hz: Array, voltage_v: Array, normal_force_n: Array) -> Array:
    """Friction at n points, any equal shapes; clamped to the surface, NaN where an input is NaN.

    Frequencies and forces must be positive.
    """
    f, v, n = (np.ascontiguousarray(x, dtype=np.float64).ravel() for x in (frequency_hz, voltage_v, normal_force_n))
    out = np.empty(f.shape)
    kernels.cof_many(surface.axes, surface.cof, kernels.LOG2_TABLE, f, f.view(np.int64), n, n.view(np.int64), v, out)
    return out.reshape(np.shape(frequency_hz))


def cof_scalar(surface: Surface, frequency_hz: float, voltage_v: float, normal_force_n: float) -> float:
    """Friction at one point; clamped to the surface."""
    return kernels.cof_one(surface.axes, surface.cof, frequency_hz, voltage_v, normal_force_n)


def invert(
    surface: Surface,
    target_cof: float,
    frequency_hz: float,
    normal_force_n: float,
    voltage_cap_v: float = np.inf,
    current_cap_a: float = np.inf,
) -> Inverse:
    """The smallest voltage that gives `target_cof` at that frequency and load, clamped to what is reachable there.

    The limits of the surface hold at its nodes; the caps hold at a frequency between them.
    """
    return Inverse(
        *kernels.invert_one(*surface, target_cof, frequency_hz, normal_force_n, voltage_cap_v, current_cap_a)
    )


def stuck_current_a_per_v(surface: Surface, frequency_hz: float) -> float:
    """Worst-case finger current per volt, between nodes as `invert` gives it."""
    i, a = kernels.locate(surface.axes[LOG_FREQUENCY], np.log(frequency_hz))
    return kernels.stuck_per_volt(surface.stuck_current_a_per_v, i, a)


def best_frequency(
    surface: Surface, target_cof: float, normal_force_n: float, first: int, stop: int, merit: int
) -> int:
    """Index of the node in first..stop with most authority, or that reaches the target with least volts or current.

    Where no node reaches the target, the one with most authority.
    """
    return kernels.best_frequency(*surface, highest_cof(surface), target_cof, normal_force_n, first, stop, merit)


def highest_cof(surface: Surface) -> Array:
    """The most friction at every frequency and load, as `kernels.highest_cof` lays it out for a quick search."""
    frequencies, loads, _ = surface.cof.shape
    highest = np.empty((loads - 1, frequencies, 2))
    kernels.highest_cof(surface.axes, surface.cof, surface.voltage_limit_v, highest)
    return highest
