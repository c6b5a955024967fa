"""The two gap integrals of electroadhesion, tabulated once for every finger of one roughness shape.

With z = b/a (a complex length that holds insulator, skin and leakage) the electrical side needs only

    K(p, z) = int P(u; p) / |u + z|^2 du      (pressure)
    L(p, z) = int P(u; p) / (u + z) du        (current)

and roughness only scales them: K = K^(p/(Y* q0 h_rms), z/h_rms) / h_rms^2 and L likewise with 1/h_rms. The table
holds log K^, log |L^| and arg L^ over (log p^, log |z^|, arg z^ in 0..90 degrees); one exists per
(H, q1/q0, gamma) and is kept on disk under the hash of these numbers and of its grid.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
import zipfile
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from math import atan2, log, pi
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from model import contact
from model.cache import cache_dir
from model.compiled import kernel
from model.roughness import Array, SelfAffineShape

FORMAT = 2  # of the cached file and of the quadrature behind it: raise it when either changes
LOG_P_AXIS = (np.log(1e-6), np.log(10.0), 85)
LOG_Z_AXIS = (np.log(1e-7), np.log(1e3), 121)
ANGLE_AXIS = (0.0, pi / 2.0, 15)
LOG_U_AXIS = (np.log(1e-13), np.log(60.0), 0.1)  # gaps, in units of h_rms
MAGNIFICATION_STEP = 0.2  # against 0.05: 3e-8 in every integral

NEAR = 12  # numbers of a row of the table around an angle: three at each of four nodes, side by side in memory
LOOKED_UP = 3 + NEAR  # what a look-up leaves: its three answers, and these

Four = tuple[float, float, float, float]
Length = tuple[float, float, int, Four, int, Four]  # see `length_of`


class Refined(NamedTuple):
    """A table at more pressures p^ [j]: `GapTable.flat` there, P(u) du [u, j], and its sum over all smaller gaps."""

    p_hat: Array
    flat: Array
    mass: Array
    mass_below: Array


@dataclass(frozen=True)
class GapTable:
    """`values` [n_p, n_z, n_angle, 3]: log K^, log |L^|, arg L^ (rad) on the axes of this module.

    `mass` [n_p, n_u]: P(u) du at the nodes of `gap_nodes`, for integrals that K and L cannot give.
    """

    shape: SelfAffineShape
    values: Array
    mass: Array

    @property
    def content_hash(self) -> str:
        """Identifies the numbers in the table, for provenance."""
        return _key(self.shape)

    @cached_property
    def flat(self) -> Array:
        """`values` as `lookup` takes them [n_p, n_z, 3 n_angle]."""
        return self.values.reshape(*self.values.shape[:2], -1)

    def refined(self, nodes_per_row: int) -> Refined:
        """With as many pressures per row of the table, evenly spaced in the logarithm, as `lookup` has them."""
        if nodes_per_row not in self._refined:
            place = np.arange((LOG_P_AXIS[2] - 1) * nodes_per_row + 1) / nodes_per_row
            weights = np.zeros((place.size, LOG_P_AXIS[2]))
            for i, x in enumerate(place):
                first, four, _ = _stencil(x, 0.0, LOG_P_AXIS[2] - 1.0, LOG_P_AXIS[2])
                weights[i, first : first + 4] = four
            p_hat = np.exp(np.linspace(*LOG_P_AXIS[:2], place.size))
            mass, below = (np.ascontiguousarray((weights @ x).T) for x in (self.mass, self.mass_below))
            self._refined[nodes_per_row] = Refined(p_hat, np.tensordot(weights, self.flat, axes=1), mass, below)
        return self._refined[nodes_per_row]

    @cached_property
    def mass_below(self) -> Array:
        """P(u) du [n_p, n_u] of all smaller gaps."""
        return np.cumsum(self.mass, axis=1) - self.mass

    @cached_property
    def _refined(self) -> dict[int, Refined]:
        return {}


@lru_cache(maxsize=8)
def gap_table(shape: SelfAffineShape, folder: Path | None = None) -> GapTable:
    """The table for `shape`: from the cache when it is there, else built (under a second) and cached."""
    path = (folder or cache_dir()) / f"gap-table-{_key(shape)}.npz"
    table = _read(shape, path)
    if table is None:
        table = build_table(shape)
        _write(path, table)
    return table


def build_table(shape: SelfAffineShape) -> GapTable:
    """Both integrals by quadrature at every node, and the distributions themselves."""
    z = np.exp(axis(LOG_Z_AXIS))[:, None] * np.exp(1j * axis(ANGLE_AXIS))
    values = np.empty((LOG_P_AXIS[2], *z.shape, 3))
    mass = np.empty((LOG_P_AXIS[2], gap_nodes().size))
    for i, log_p in enumerate(axis(LOG_P_AXIS)):
        mass[i] = gap_mass(shape, float(np.exp(log_p)))
        k_hat, l_hat = integrals_of(mass[i], z)
        values[i] = logarithms(k_hat, l_hat)
    return GapTable(shape, values, mass)


def gap_nodes() -> Array:
    """Gaps u [n_u] in units of h_rms at which distributions are kept, evenly spaced in the logarithm."""
    return np.asarray(np.exp(np.arange(*LOG_U_AXIS)))


def gap_mass(shape: SelfAffineShape, p_hat: float, magnification_step: float = MAGNIFICATION_STEP) -> Array:
    """P(u) du [n_u] under one pressure: weights of the trapezoid rule in log u."""
    u = gap_nodes()
    return contact.gap_distribution(shape, p_hat, magnification_step).density(u) * u * LOG_U_AXIS[2]


def gap_integrals(
    shape: SelfAffineShape, p_hat: float, z_hat: NDArray[np.complex128], magnification_step: float = MAGNIFICATION_STEP
) -> tuple[Array, NDArray[np.complex128]]:
    """K^ and L^ of one pressure at the complex lengths `z_hat` (any shape), by direct quadrature.

    Trapezoid rule in log u: the integrand is analytic in a strip of half-width pi/2 around the axis.
    """
    return integrals_of(gap_mass(shape, p_hat, magnification_step), z_hat)


def integrals_of(mass: Array, z_hat: NDArray[np.complex128]) -> tuple[Array, NDArray[np.complex128]]:
    """K^ and L^ of one distribution of gaps."""
    u = gap_nodes()
    x, y = z_hat.real.ravel(), z_hat.imag.ravel()
    inverse_square = 1.0 / ((u + x[:, None]) ** 2 + (y * y)[:, None])
    k_hat = inverse_square @ mass
    l_hat = inverse_square @ (mass * u) + z_hat.conj().ravel() * k_hat  # 1/(u+z) = (u + conj z)/|u+z|^2
    return k_hat.reshape(z_hat.shape), l_hat.reshape(z_hat.shape)


def logarithms(k_hat: Array, l_hat: NDArray[np.complex128]) -> Array:
    """log K^, log |L^|, arg L^ along a last axis; a finite floor where the skin is pressed flat and no gap is left."""
    tiny = np.finfo(np.float64).tiny
    return np.stack(
        [np.log(np.maximum(k_hat, tiny)), np.log(np.maximum(np.abs(l_hat), tiny)), np.angle(l_hat)], axis=-1
    )


def axis(spec: tuple[float, float, int]) -> Array:
    """The nodes of one uniform axis."""
    return np.linspace(*spec)


@kernel
def lookup(flat: Array, p_hat: float, z_hat: complex, out: Array) -> bool:
    """K^, |L^| and arg L^ at one point into `out` [LOOKED_UP]; False (and the nearest edge) outside the pressures.

    Local cubic interpolation on four nodes per axis of `GapTable.flat`: 3e-5 of the direct quadrature (4e-4 near the
    highest pressures, where hardly a gap is left). Beyond the lengths of the table its limits hold: K ~ 1/|z| below (P
    is constant there), K ~ 1/|z|^2 and L ~ 1/z above. K(conj z) = K(z), L(conj z) = conj L(z).
    """
    row, weights, inside = row_of(p_hat)
    lookup_between(flat, row, weights, length_of(z_hat), out)
    return inside


@kernel
def lookup_between(flat: Array, row: int, weights: Four, length: Length, out: Array) -> None:
    """The same at a place between four rows of the table, and one between its lengths."""
    log_z, angle, j, wz, k, wa = length
    for m in range(NEAR):
        n = np.uintp(3 * k + m)
        rows = weights[0] * _along_z(flat, row, j, wz, n) + weights[1] * _along_z(flat, row + 1, j, wz, n)
        rows += weights[2] * _along_z(flat, row + 2, j, wz, n) + weights[3] * _along_z(flat, row + 3, j, wz, n)
        out[3 + m] = rows
    _finish(log_z, angle, wa, out)


@kernel
def lookup_row(flat: Array, row: int, z_hat: complex, out: Array) -> None:
    """The same at the pressure of one row of the table, or of the `refined` one."""
    log_z, angle, j, wz, k, wa = length_of(z_hat)
    for m in range(NEAR):
        out[3 + m] = _along_z(flat, row, j, wz, np.uintp(3 * k + m))
    _finish(log_z, angle, wa, out)


@kernel
def length_of(z_hat: complex) -> Length:
    """Logarithm and angle of a length, and the four nodes around each."""
    log_z, angle = 0.5 * log(z_hat.real**2 + z_hat.imag**2), atan2(z_hat.imag, z_hat.real)
    j, wz, _ = _stencil(log_z, LOG_Z_AXIS[0], LOG_Z_AXIS[1], LOG_Z_AXIS[2])
    k, wa, _ = _stencil(abs(angle), ANGLE_AXIS[0], ANGLE_AXIS[1], ANGLE_AXIS[2])
    return log_z, angle, j, wz, k, wa


@kernel
def _along_z(flat: Array, row: int, j: int, wz: Four, n: np.uintp) -> float:
    """One number of the table at a length between four nodes."""
    return float(
        wz[0] * flat[row, j, n]
        + wz[1] * flat[row, j + 1, n]
        + wz[2] * flat[row, j + 2, n]
        + wz[3] * flat[row, j + 3, n]
    )


@kernel
def _finish(log_z: float, angle: float, wa: Four, out: Array) -> None:
    """Between four angles, and out of the logarithms; beyond the table's lengths by its limits."""
    below, above = max(LOG_Z_AXIS[0] - log_z, 0.0), max(log_z - LOG_Z_AXIS[1], 0.0)
    w0, w1, w2, w3 = wa
    out[0] = np.exp(w0 * out[3] + w1 * out[6] + w2 * out[9] + w3 * out[12] + below - 2.0 * above)
    out[1] = np.exp(w0 * out[4] + w1 * out[7] + w2 * out[10] + w3 * out[13] - above)
    at_angle = w0 * out[5] + w1 * out[8] + w2 * out[11] + w3 * out[14]
    out[2] = at_angle if angle >= 0.0 else -at_angle


@kernel
def row_of(p_hat: float) -> tuple[int, Four, bool]:
    """The first of the four rows around `p_hat`, their weights, and whether the table holds it."""
    return _stencil(np.log(p_hat), LOG_P_AXIS[0], LOG_P_AXIS[1], LOG_P_AXIS[2])


@kernel
def _stencil(x: float, low: float, high: float, count: int) -> tuple[int, Four, bool]:
    """First node, four Lagrange weights, and whether `x` lies on the axis (to rounding)."""
    inside = low - 1e-9 <= x <= high + 1e-9
    position = (min(max(x, low), high) - low) / (high - low) * (count - 1)
    first = min(max(int(position) - 1, 0), count - 4)
    t = position - first
    t1, t2, t3 = t - 1.0, t - 2.0, t - 3.0
    weights = (-t1 * t2 * t3 / 6.0, t * t2 * t3 / 2.0, -t * t1 * t3 / 2.0, t * t1 * t2 / 6.0)
    return first, weights, inside


def _key(shape: SelfAffineShape) -> str:
    grid = [
        FORMAT, LOG_P_AXIS, LOG_Z_AXIS, ANGLE_AXIS, LOG_U_AXIS, MAGNIFICATION_STEP,
        contact.ZETA_MINUS_ONE_LOW, contact.LOGISTIC_END, contact.X_NEGLIGIBLE, contact.S_NODES,
    ]  # fmt: skip
    text = json.dumps([asdict(shape), grid], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _read(shape: SelfAffineShape, path: Path) -> GapTable | None:
    """The cached table; None where it is absent or damaged, for it is only a cache."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            values, mass = file["values"], file["mass"]
    except (OSError, ValueError, KeyError, EOFError, AttributeError, TypeError, zipfile.BadZipFile):
        return None
    if values.dtype != np.float64 or mass.dtype != np.float64:
        return None
    expected = (LOG_P_AXIS[2], LOG_Z_AXIS[2], ANGLE_AXIS[2], 3), (LOG_P_AXIS[2], gap_nodes().size)
    sound = (values.shape, mass.shape) == expected and np.isfinite(values).all() and np.isfinite(mass).all()
    return GapTable(shape, values, mass) if sound else None


def _write(path: Path, table: GapTable) -> None:
    """Atomically, so that two processes may build at once; a cache that cannot be written is done without."""
    part = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, part = tempfile.mkstemp(dir=path.parent, suffix=".part")
        with os.fdopen(handle, "wb") as stream:
            np.savez(stream, values=table.values, mass=table.mass)
        os.replace(part, path)
    except OSError:
        if part is not None:
            Path(part).unlink(missing_ok=True)
