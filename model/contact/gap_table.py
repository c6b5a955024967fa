"""The two gap integrals of electroadhesion, tabulated once for every finger of one roughness shape.

With z = b/a (a complex length that holds insulator, skin and leakage) the electrical side needs
only

    K(p, z) = int P(u; p) / |u + z|^2 du      (pressure)
    L(p, z) = int P(u; p) / (u + z) du        (current)

and roughness only scales them: K = K^(p/(Y* q0 h_rms), z/h_rms) / h_rms^2 and L likewise with
1/h_rms. The table holds log K^, log |L^| and arg L^ over (log p^, log |z^|, arg z^ in 0..90
degrees). One exists per (H, q1/q0, gamma). It is kept on disk under the hash of these numbers and
of its grid.
"""

from __future__ import annotations

import hashlib
import json
import os
import zipfile
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from haptic_driver.base.cache import cache_dir
from model.contact import resolution
from model.contact.gap_integrals import TableArrays
from model.contact.resolution import (
    ANGLE_AXIS,
    LOG_P_AXIS,
    LOG_U_AXIS,
    LOG_Z_AXIS,
    MAGNIFICATION_STEP,
)
from model.contact.roughness import SelfAffineShape
from model.support.arrays import Array


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
    def arrays(self) -> TableArrays:
        """The same for compiled code."""
        log_k, log_l, arg_l = (np.ascontiguousarray(x) for x in np.moveaxis(self.values, -1, 0))
        mass_below = np.cumsum(self.mass, axis=1) - self.mass
        return TableArrays(log_k, log_l + 1j * arg_l, gap_nodes(), self.mass, mass_below)


@lru_cache(maxsize=8)
def gap_table(shape: SelfAffineShape, folder: Path | None = None) -> GapTable:
    """The table for `shape`: from the cache when it is there, else built (under a second) and
    cached.
    """
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
    """Gaps u [n_u] in units of h_rms at which distributions are kept, evenly spaced in the
    logarithm.
    """
    return np.asarray(np.exp(np.arange(*LOG_U_AXIS)))


def gap_mass(
    shape: SelfAffineShape, p_hat: float, magnification_step: float = MAGNIFICATION_STEP
) -> Array:
    """P(u) du [n_u] under one pressure: weights of the trapezoid rule in log u."""
    # scipy is slow to import, tables are kept
    from model.contact.gap_distribution import gap_distribution  # noqa: PLC0415

    u = gap_nodes()
    return gap_distribution(shape, p_hat, magnification_step).density(u) * u * LOG_U_AXIS[2]


def integrals_of(
    mass: Array, z_hat: NDArray[np.complex128]
) -> tuple[Array, NDArray[np.complex128]]:
    """K^ and L^ of one distribution of gaps at the complex lengths `z_hat` (any shape), by direct
    quadrature.

    Trapezoid rule in log u: the integrand is analytic in a strip of half-width pi/2 around the
    axis.
    """
    u = gap_nodes()
    x, y = z_hat.real.ravel(), z_hat.imag.ravel()
    inverse_square = 1.0 / ((u + x[:, None]) ** 2 + (y * y)[:, None])
    k_hat = inverse_square @ mass
    # 1/(u+z) = (u + conj z)/|u+z|^2
    l_hat = inverse_square @ (mass * u) + z_hat.conj().ravel() * k_hat
    return k_hat.reshape(z_hat.shape), l_hat.reshape(z_hat.shape)


def logarithms(k_hat: Array, l_hat: NDArray[np.complex128]) -> Array:
    """log K^, log |L^|, arg L^ along a last axis; a finite floor where the skin is pressed flat and
    no gap is left.
    """
    tiny = np.finfo(np.float64).tiny
    return np.stack(
        [np.log(np.maximum(k_hat, tiny)), np.log(np.maximum(np.abs(l_hat), tiny)), np.angle(l_hat)],
        axis=-1,
    )


def axis(spec: tuple[float, float, int]) -> Array:
    """The nodes of one uniform axis."""
    return np.linspace(*spec)


def _key(shape: SelfAffineShape) -> str:
    rules = {name: value for name, value in vars(resolution).items() if name.isupper()}
    text = json.dumps([asdict(shape), rules], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _read(shape: SelfAffineShape, path: Path) -> GapTable | None:
    """The cached table; None where it is absent or damaged, for it is only a cache."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            values, mass, checksum = file["values"], file["mass"], str(file["checksum"])
    except (OSError, ValueError, KeyError, EOFError, AttributeError, TypeError, zipfile.BadZipFile):
        return None
    shapes = (LOG_P_AXIS[2], LOG_Z_AXIS[2], ANGLE_AXIS[2], 3), (LOG_P_AXIS[2], gap_nodes().size)
    for numbers, expected in zip((values, mass), shapes, strict=True):
        if (
            numbers.dtype != np.float64
            or numbers.shape != expected
            or not np.isfinite(numbers).all()
        ):
            return None
    return GapTable(shape, values, mass) if checksum == _checksum(values, mass) else None


def _checksum(*arrays: Array) -> str:
    """Over every number: the file's name says what it should hold, and this that it does."""
    digest = hashlib.sha256()
    for numbers in arrays:
        digest.update(np.ascontiguousarray(numbers).tobytes())
    return digest.hexdigest()


def _write(path: Path, table: GapTable) -> None:
    """Atomically, so that two processes may build at once; a cache that cannot be written is done
    without.
    """
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with part.open("wb") as stream:
                np.savez(
                    stream,
                    values=table.values,
                    mass=table.mass,
                    checksum=_checksum(table.values, table.mass),
                )
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
