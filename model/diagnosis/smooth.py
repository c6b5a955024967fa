"""Smooth functions of the inputs, of unknown shape: what a discrepancy may look like, or a form be
off by.

Gaussian processes with squared-exponential kernels over the inputs that vary. A discrepancy of log
friction has three terms per input: of the force, of friction while there is voltage, and of all
friction. The first weighs each row by the force's share of its friction. It also has terms of
frequency together with each of voltage, time and speed. Every other witness has terms of its own,
likewise.
"""

from __future__ import annotations

import numpy as np

from model.diagnosis.data import Measurements
from model.diagnosis.priors import AMPLITUDES
from model.diagnosis.witness import CONTACT_AREA, FRICTION
from model.effects.learned import LOG_INPUTS
from model.support.arrays import Array

LENGTH = 0.8  # of the kernel, in standardised inputs
MOST_DISTINCT = 220
GRID = 0.05  # in standardised inputs
# of the noise: what is smaller in a direction at the largest amplitude counts as nothing
FAINT = 1e-3
NEGLIGIBLE = 1e-7  # eigenvalues of a kernel below this share of the largest
INPUTS = ("frequency_hz", "voltage_v", "normal_force_n", "speed_m_s", "time_s")


def standardised(data: Measurements, name: str, decades: bool = False) -> Array:
    """One input [n] to zero mean and unit spread; as a logarithm where it is known, or said, to
    span `decades`.
    """
    values = data.columns[name]
    rows = (
        data.driven
        if name in ("frequency_hz", "voltage_v")
        else data.sliding
        if name == "speed_m_s"
        else None
    )
    rows = np.ones(data.count, bool) if rows is None else rows
    x = (
        np.log(np.where(rows, np.maximum(values, 1e-12), 1.0))
        if decades or name in LOG_INPUTS
        else values
    )
    x = np.where(rows, x, 0.0)
    centre, spread = x[rows].mean(), x[rows].std()
    return np.asarray(np.where(rows, (x - centre) / (spread if spread > 0 else 1.0), 0.0))


def discrepancy_terms(data: Measurements, force: Array) -> list[Array]:
    """Features F [n, m] of every term; F F' is its kernel at unit amplitude.

    `force` [n]: how far each row's friction is the force's; a force that drifts shows in proportion
    to it.
    """
    parts = []
    for witness in data.witnesses:
        mine = data.of(witness)
        driven = data.driven[mine].astype(float)
        always = np.ones(driven.size)
        known = {FRICTION: [driven, force[mine], always], CONTACT_AREA: [always]}
        shown = known.get(witness, [driven])
        for part in _terms(data.subset(mine), shown):
            parts.append(np.zeros((data.count, part.shape[1])))
            parts[-1][mine] = part
    return parts or [np.zeros((data.count, 0))]


def smooth_terms(data: Measurements) -> Array:
    """F [n, m] of smooth functions of each input, each witness apart; F F' is the kernel at unit
    amplitude.
    """
    parts = []
    for witness in data.witnesses:
        mine = data.of(witness)
        of_witness = data.subset(mine)
        for name in INPUTS:
            if of_witness.varies(name):
                part = roots(standardised(of_witness, name)[:, None])
                parts.append(np.zeros((data.count, part.shape[1])))
                parts[-1][mine] = part
    return np.concatenate(parts, axis=1) if parts else np.zeros((data.count, 0))


def compressed(together: Array) -> Array:
    """G [n, k] with G G' = F F' but for what no amplitude would show: many terms share their
    directions.
    """
    square, directions = np.linalg.eigh(together.T @ together)
    return np.asarray(together @ directions[:, square > (FAINT / AMPLITUDES[-1]) ** 2])


def _terms(data: Measurements, shown: list[Array]) -> list[Array]:
    """The terms of one witness's observations, each as far as it is `shown` [n] there: first by
    what is driven.
    """
    inputs = {name: standardised(data, name) for name in INPUTS if data.varies(name)}
    parts = []
    for name, x in inputs.items():
        part = roots(x[:, None])
        of_voltage = name in ("frequency_hz", "voltage_v")
        parts += [part * share[:, None] for share in (shown[:2] if of_voltage else shown)]
    for name in ("voltage_v", "time_s", "speed_m_s"):
        if "frequency_hz" in inputs and name in inputs:
            part = roots(np.stack([inputs["frequency_hz"], inputs[name]], axis=1))
            parts += [part * share[:, None] for share in shown[:2]]
    return parts


def roots(x: Array) -> Array:
    """F [n, m] with F F' = exp(-|x - x'|^2/(2 LENGTH^2)), from the distinct rows of `x` alone."""
    distinct, row = np.unique(np.round(x, 9), axis=0, return_inverse=True)
    # e.g. a time of its own for every row: a grid represents a smooth function
    if len(distinct) > MOST_DISTINCT:
        distinct, row = np.unique(np.round(x / GRID) * GRID, axis=0, return_inverse=True)
    square = np.sum((distinct[:, None, :] - distinct[None, :, :]) ** 2, axis=2)
    values, vectors = np.linalg.eigh(np.exp(-0.5 * square / LENGTH**2))
    kept = values > NEGLIGIBLE * values[-1]
    return np.asarray((vectors[:, kept] * np.sqrt(values[kept]))[row.ravel()])
