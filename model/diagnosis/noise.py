"""What is known about the noise before any fit: each row's own, what sessions share, and how far to trust both."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from model.diagnosis.data import Measurements
from model.support.arrays import Array

SESSION_GAIN_STD = 0.05  # of friction, between sessions: electrodes, washing, posture
LOOSE_DEGREES = 6.0  # worth of the stated noise where no replicates check it: a scale known to about 30 %
MOST_DEGREES = 200.0


@dataclass(frozen=True)
class Noise:
    """Covariance of log friction: diag(`relative_std`^2) + session gain + AR(1), up to one unknown scale.

    The scale's square is inverse-gamma around 1 with `degrees` degrees of freedom; `source` says where the noise comes
    from, `replicate_degrees` how many replicates checked it; `correlation` and `inflation` are what it was asked to be.
    `whiten` takes residuals [n] or [n, k] to unit variance.
    """

    relative_std: Array
    lower: Array
    degrees: float
    source: str
    replicate_degrees: int
    correlation: float
    inflation: Array
    warnings: tuple[str, ...] = field(default=())

    @property
    def log_determinant(self) -> float:
        """Half the log determinant of the covariance: what evidences under two noises differ by besides the fit."""
        return float(np.sum(np.log(np.diag(self.lower))))

    def whiten(self, values: Array) -> Array:
        """L^-1 values."""
        return np.asarray(solve_triangular(self.lower, values, lower=True, check_finite=False))


def noise_of(data: Measurements, correlation: float = 0.0, inflation: Array | None = None) -> Noise | None:
    """The noise model of a data set; None where there is neither a stated noise nor a replicate to estimate it from.

    `correlation`: of neighbouring rows in a session, in order of measurement. `inflation` [n]: of single rows' noise.
    """
    log_cof = np.log(data.columns["cof"])
    inflation = np.ones(data.count) if inflation is None else inflation
    scatter, degrees = _replicate_scatter(data, log_cof, inflation)
    warnings: list[str] = []
    if "cof_std" in data.columns:
        relative = data.columns["cof_std"] / data.columns["cof"] * inflation
        source = "cof_std"
        if degrees >= 4:
            standard, degrees = _replicate_scatter(data, log_cof, relative)
            ratio = float(np.sqrt(standard))
            if not 1.0 / 1.3 < ratio < 1.3:
                warnings.append(f"replicates scatter {ratio:.2f} times as much as cof_std says; their scatter is used")
                source = "cof_std, scaled to the replicates"
            relative = relative * ratio
    elif degrees >= 2:
        relative = np.sqrt(scatter) * inflation
        source = "replicates"
    else:
        return None
    relative = np.maximum(relative, 1e-4)
    covariance = np.diag(relative**2)
    if correlation != 0.0:
        covariance += _correlated(data, correlation, relative)
    covariance += SESSION_GAIN_STD**2 * (data.session[:, None] == data.session)
    degrees_known = min(max(float(degrees), LOOSE_DEGREES), MOST_DEGREES)
    lower = cholesky(covariance, lower=True)
    return Noise(relative, lower, degrees_known, source, degrees, correlation, inflation, tuple(warnings))


def _replicate_scatter(data: Measurements, values: Array, std: Array) -> tuple[float, int]:
    """Pooled variance within groups of replicates, in units of `std` squared, and its degrees of freedom."""
    group = data.replicate_groups()
    weight = std**-2
    means = np.bincount(group, values * weight) / np.bincount(group, weight)
    degrees = int(np.sum(np.bincount(group) - 1))
    squares = np.sum(((values - means[group]) / std) ** 2)
    return (float(squares / degrees) if degrees else 0.0), degrees


def rows_in_order(data: Measurements) -> list[NDArray[np.intp]]:
    """The rows of each session in order of measurement: by `time_s` where there is one, else as in the file."""
    time = data.columns.get("time_s", np.arange(data.count, dtype=float))
    sessions = (np.flatnonzero(data.session == s) for s in range(len(data.session_names)))
    return [rows[np.argsort(time[rows], kind="stable")] for rows in sessions]


def _correlated(data: Measurements, correlation: float, relative: Array) -> Array:
    """Off-diagonal part of an AR(1) covariance along the order of measurement within each session."""
    rank = np.empty(data.count)
    for rows in rows_in_order(data):
        rank[rows] = np.arange(rows.size)
    same = data.session[:, None] == data.session
    matrix = np.where(same, correlation ** np.abs(rank[:, None] - rank), 0.0) * np.outer(relative, relative)
    np.fill_diagonal(matrix, 0.0)
    return matrix
