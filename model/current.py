"""Current through the finger: what the safety limits are about.

Per area J(u) = (j w eps0 k_g/u + alpha) E(u) u, averaged over the gaps; the worst case (stuck or wet finger) is u -> 0
everywhere, where only insulator and skin limit it.
"""

from __future__ import annotations

import math

import numpy as np

from model.compiled import kernel
from model.contact import area_ratio
from model.dielectrics import EPS0, Array, ComplexArray
from model.gap_table import LOOKED_UP, GapTable, lookup
from model.pressure import GapCircuit, divider


def sliding_current_per_v(table: GapTable, circuit: GapCircuit, total_pressure_pa: Array, omega: Array) -> Array:
    """|current density|/V of each touch and branch [n, c], A/(m^2 V), omega [n, c].

    With z = k_g h/a: J = V j w eps0 [ (beta/a)(1 - A_real/A0) + (k_g/a^2) L(p, z) ], beta = alpha/(j w eps0).
    """
    apart = 1.0 - area_ratio(table.shape, total_pressure_pa / circuit.pressure_scale_pa)
    result = np.empty(circuit.h_m.shape)
    _admittance(
        table.flat, circuit.pressure_scale_pa, circuit.length_scale_m, circuit.h_m, circuit.k_gap,
        circuit.bypass_per_m, circuit.leak_per_m_pa, circuit.gap_shift_m, total_pressure_pa, apart, result,
    )  # fmt: skip
    return np.asarray(EPS0 * omega * result)


def stuck_current_per_v(h_m: ComplexArray, omega: Array) -> Array:
    """Worst case, A/(m^2 V): no air gap anywhere, |J| = w eps0 V/|h|; broadcasts."""
    return np.asarray(EPS0 * omega / np.abs(h_m))


@kernel
def _admittance(
    flat: Array, p_scale: Array, h_scale: Array, h: ComplexArray, k_gap: ComplexArray, bypass: ComplexArray,
    leak: ComplexArray, shift: Array, pressure: Array, apart: Array, result: Array,
) -> None:  # fmt: skip
    """|current density/(j w eps0 V)| in 1/m; NaN pressure gives NaN."""
    out = np.empty(LOOKED_UP)
    for i in range(pressure.size):
        for c in range(h.shape[1]):
            if not np.isfinite(pressure[i]):
                result[i, c] = np.nan
                continue
            beta, per_a, z = divider(h[i, c], k_gap[i, c], bypass[i, c], leak[i, c], shift[i], pressure[i])
            lookup(flat, pressure[i] / p_scale[i], z / h_scale[i], out)
            result[i, c] = density_per_v(beta, per_a, k_gap[i, c], apart[i], out, h_scale[i])


@kernel
def density_per_v(
    beta: complex, per_a: complex, k_gap: complex, apart: float, looked_up: Array, h_scale: float
) -> float:
    """|current density/(j w eps0 V)| in 1/m from what `lookup` found; `apart` is the share out of contact."""
    size = looked_up[1] / h_scale
    inverse_gap = complex(size * math.cos(looked_up[2]), size * math.sin(looked_up[2]))
    density = per_a * (beta * apart + k_gap * per_a * inverse_gap)
    return math.sqrt(density.real * density.real + density.imag * density.imag)
