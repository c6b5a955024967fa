"""Samples as the API sends them: columns of strict JSON, and frames of the decimated state."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_driver.daemon.messages import Column, StateFrame, Status, TickSummary
from haptic_driver.processes.samples import SAMPLE

LATENESS_EDGES_S = [0.0, 10e-6, 20e-6, 50e-6, 100e-6, 200e-6, 500e-6, 1e-3, 2e-3, 5e-3]
"""Lower edges of the bins of `TickSummary.lateness_counts`; the last bin is open."""


def state_frame(
    status: Status, samples: NDArray[np.void], columns: Sequence[str] = ()
) -> StateFrame:
    """A frame from the samples [n] since the one before, with those of their columns that are
    wanted.
    """
    newest = (
        {name: column[0] for name, column in sample_columns(samples[-1:]).items()}
        if samples.size
        else None
    )
    return StateFrame(
        time_s=time.monotonic(),
        unix_time_s=time.time(),
        status=status,
        newest=newest,
        ticks=tick_summary(samples),
        samples={name: _finite(samples[name]) for name in SAMPLE.names or () if name in columns},
    )


def tick_summary(samples: NDArray[np.void]) -> TickSummary:
    """How late the ticks were and how long they took. A tick that was early counts into the first
    bin.
    """
    lateness_s, compute_s = samples["lateness_s"], samples["compute_s"]
    place = np.searchsorted(LATENESS_EDGES_S, lateness_s, side="right") - 1
    return TickSummary(
        count=samples.size,
        lateness_median_s=float(np.median(lateness_s)) if samples.size else None,
        lateness_max_s=float(lateness_s.max()) if samples.size else None,
        compute_median_s=float(np.median(compute_s)) if samples.size else None,
        compute_max_s=float(compute_s.max()) if samples.size else None,
        lateness_edges_s=LATENESS_EDGES_S,
        lateness_counts=np.bincount(np.maximum(place, 0), minlength=len(LATENESS_EDGES_S)).tolist(),
    )


def sample_columns(samples: NDArray[np.void]) -> dict[str, Column]:
    """One list per field, as strict JSON allows: what is no number becomes None."""
    assert SAMPLE.names is not None
    return {name: _finite(samples[name]) for name in SAMPLE.names}


def samples_of(columns: dict[str, Column]) -> NDArray[np.void]:
    """The inverse of `sample_columns`."""
    samples = np.zeros(len(columns["tick"]), SAMPLE)
    for name, column in columns.items():
        samples[name] = [math.nan if value is None else value for value in column]
    return samples


def _finite(values: NDArray[Any]) -> Column:
    listed: Column = values.tolist()
    if values.dtype.kind != "f" or np.isfinite(values).all():
        return listed
    return [value if value is not None and math.isfinite(value) else None for value in listed]
