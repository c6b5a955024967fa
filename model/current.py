"""Current through the finger: what the safety limits are about.

Per area J(u) = (j w eps0 k_g/u + alpha) E(u) u, averaged over the gaps; the worst case (stuck or wet finger) is u -> 0
everywhere, where only insulator and skin limit it.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from model.compiled import kernel
from model.contact import area_ratio
from model.dielectrics import EPS0, Array, ComplexArray
from model.gap_table import GapTable, lookup
from model.layers import Stack
from model.pressure import ContactScales


def sliding_current_rms_a(
    table: GapTable, scales: ContactScales, stack: Stack, voltage_rms_v: Array, total_pressure_pa: Array, area_m2: float
) -> Array:
    """Current of the sliding finger, A rms; all arrays broadcast against each other.

    With z = k_g h/a: I = A0 V j w eps0 [ (beta/a)(1 - A_real/A0) + (k_g/a^2) L(p, z) ], beta = alpha/(j w eps0).
    """
    h, k_gap, leak, omega, voltage, pressure = np.broadcast_arrays(
        stack.h_m, stack.k_gap, stack.leak_per_m_pa, stack.omega, voltage_rms_v, total_pressure_pa
    )
    apart = 1.0 - area_ratio(table.shape, pressure / scales.pressure_pa)
    result = np.empty(pressure.shape)
    _admittance(
        table.values, scales.pressure_pa, scales.length_m, h.ravel(), k_gap.ravel(), leak.ravel(),
        pressure.ravel(), apart.ravel(), result.reshape(-1),
    )  # fmt: skip
    return np.asarray(area_m2 * EPS0 * omega * voltage * result)


def stuck_current_rms_a(stack: Stack, voltage_rms_v: Array, area_m2: float) -> Array:
    """Worst case, A rms: no air gap anywhere, |I| = A0 w eps0 V/|h|; broadcasts."""
    return np.asarray(area_m2 * EPS0 * stack.omega * voltage_rms_v / np.abs(stack.h_m))


RMS_OF_SINE = 1.0 / sqrt(2.0)


@kernel
def _admittance(
    values: Array, p_scale: float, h_scale: float, h: ComplexArray, k_gap: ComplexArray, leak: ComplexArray,
    pressure: Array, apart: Array, result: Array,
) -> None:  # fmt: skip
    """|current density/(j w eps0 V)| in 1/m; NaN pressure gives NaN."""
    out = np.empty(3)
    for i in range(pressure.size):
        if not np.isfinite(pressure[i]):
            result[i] = np.nan
            continue
        beta = leak[i] * pressure[i]
        a = 1.0 + beta * h[i]
        z = k_gap[i] * h[i] / a
        lookup(values, pressure[i] / p_scale, z / h_scale, out)
        inverse_gap = out[1] * np.exp(1j * out[2]) / h_scale
        result[i] = abs(beta / a * apart[i] + k_gap[i] / (a * a) * inverse_gap)
