"""Current through the finger, which safety limits are about, and through the electrode, which
instruments see.

Per area J(u) = (j w eps0 k_g/u + alpha) E(u) u, averaged over the gaps. The worst case (stuck or
wet finger) is u -> 0 everywhere, where only insulator and skin limit it. The electrode's current is
a phasor. It includes what flows beside the finger, and the real contact (u = 0). The latter is some
1e-4 of the area and up to 1 % of the current.
"""

from __future__ import annotations

import math

import numpy as np

from model.contact.gap_integrals import TableArrays, l_hat
from model.contact.gap_table import GapTable
from model.electric.circuit import GapCircuit, divider
from model.electric.dielectrics import EPS0
from model.support.arrays import Array, ComplexArray, Values
from model.support.compiled import in_slices, kernel


def sliding_admittance_per_m(
    table: GapTable, circuit: GapCircuit, total_pressure_pa: Array
) -> ComplexArray:
    """Current density over j w eps0 V of each touch and branch [n, c], 1/m; NaN where the pressure
    [n] is.

    With z = k_g h/a: (beta/a)(1 - A_real/A0) + (k_g/a^2) L(p, z), beta = alpha/(j w eps0).
    """
    full_hat = table.shape.full_contact
    result = np.empty(circuit.h_m.shape, dtype=np.complex128)

    def work(which: slice) -> None:
        _admittance(
            table.arrays, circuit.rows(which), total_pressure_pa[which], full_hat, result[which]
        )

    in_slices(work, total_pressure_pa.size)
    return result


def contact_admittance_per_m(
    table: GapTable, circuit: GapCircuit, total_pressure_pa: Array
) -> ComplexArray:
    """The share of the real contact in it, where the gap is 0, for the alternating branch of each
    touch [n], 1/m.
    """
    result = np.empty(total_pressure_pa.shape, dtype=np.complex128)
    _contact_admittance(circuit, total_pressure_pa, table.shape.full_contact, result)
    return result


def stuck_admittance_per_m(circuit: GapCircuit) -> ComplexArray:
    """The same for the worst case, without any air gap."""
    return np.asarray(1.0 / circuit.h_m)


def current_rms_a(
    admittance_per_m: ComplexArray, omega: Array, rms_v: Array, area_m2: Values
) -> Array:
    """rms current in A of each touch [n] of these areas from its branches [n, c], whose currents
    differ in frequency.
    """
    branches = np.reshape(area_m2, (-1, 1)) * EPS0 * omega * np.abs(admittance_per_m) * rms_v
    return np.asarray(np.sqrt(np.sum(branches**2, axis=1)))


def electrode_current_a(
    admittance_per_m: ComplexArray,
    omega: Array,
    electrode_v: ComplexArray,
    area_m2: Values,
    stray_f: Values,
) -> ComplexArray:
    """Peak phasor in A of the electrode's current, I = j w (eps0 A0 <J>/(j w eps0 V) + C_stray)
    V_e; all broadcast.

    The stray capacitance lies between electrode and ground, before any series resistance.
    """
    return np.asarray(1j * omega * (EPS0 * area_m2 * admittance_per_m + stray_f) * electrode_v)


@kernel
def _contact_admittance(
    circuit: GapCircuit, pressure: Array, full_hat: float, result: ComplexArray
) -> None:
    for i in range(pressure.size):
        beta, per_a, z = divider(circuit, i, 0, pressure[i])
        share = math.erf(pressure[i] / circuit.pressure_scale_pa[i] / full_hat)  # of the area, (42)
        no_gap = circuit.k_gap[i, 0] * per_a / z if z != 0.0 else complex(np.inf, 0.0)
        result[i] = share * per_a * (beta + no_gap)


@kernel
def _admittance(
    table: TableArrays, circuit: GapCircuit, pressure: Array, full_hat: float, result: ComplexArray
) -> None:
    for i in range(pressure.size):
        p_hat, h_rms = pressure[i] / circuit.pressure_scale_pa[i], circuit.length_scale_m[i]
        apart = math.erfc(p_hat / full_hat)  # share of the area, (42)
        for c in range(circuit.h_m.shape[1]):
            result[i, c] = complex(np.nan, np.nan)
            if np.isfinite(pressure[i]):
                beta, per_a, z = divider(circuit, i, c, pressure[i])
                inverse_gap = l_hat(table, p_hat, z / h_rms) / h_rms
                result[i, c] = per_a * (beta * apart + circuit.k_gap[i, c] * per_a * inverse_gap)
