"""The circuit that a gap sees: everything electrical behind and beside it, as one complex
length.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.support.arrays import Array, ComplexArray
from model.support.compiled import kernel


class GapCircuit(NamedTuple):
    """Touches [n] as the closed loop sees them, each with `c` branches; everything already
    broadcast.

    `pressure_scale_pa` is Y* q0 h_rms and `length_scale_m` is h_rms [n]. Per branch [n, c] there
    are the complex length `h_m`, `k_gap`, `mean_square_v2` and its `crest_square` (peak over mean
    square). The admittance beside the gap over j w eps0 is `bypass_per_m` + `leak_per_m_pa` p. [n]
    are `gap_shift_m`, `load_pa` (normal force over area), `added_pa` (other attraction) and
    `field_limit_v_per_m`.
    """

    pressure_scale_pa: Array
    length_scale_m: Array
    h_m: ComplexArray
    k_gap: ComplexArray
    bypass_per_m: ComplexArray
    leak_per_m_pa: ComplexArray
    mean_square_v2: Array
    crest_square: Array
    gap_shift_m: Array
    load_pa: Array
    added_pa: Array
    field_limit_v_per_m: Array

    def rows(self, which: slice | NDArray[np.intp]) -> GapCircuit:
        """Some of the touches."""
        return GapCircuit(*(values[which] for values in self))  # type: ignore[arg-type]


@kernel
def squared(x: complex) -> float:
    """|x|^2."""
    return x.real * x.real + x.imag * x.imag


@kernel
def divider(circuit: GapCircuit, i: int, c: int, p: float) -> tuple[complex, complex, complex]:
    """The stack at the total pressure `p`: leak beside the gap beta, 1/a with a = 1 + beta h, and
    its length z.
    """
    beta = circuit.bypass_per_m[i, c] + circuit.leak_per_m_pa[i, c] * p
    per_a = 1.0 / (1.0 + beta * circuit.h_m[i, c])
    return beta, per_a, circuit.k_gap[i, c] * circuit.h_m[i, c] * per_a + circuit.gap_shift_m[i]
