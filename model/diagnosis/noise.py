"""What is known about the noise before any fit: each row's own, what sessions share, and how far to
trust both.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from model.diagnosis.data import Measurements
from model.diagnosis.levels import FEWEST_DEGREES, Levels, levels, of_trials, rows_in_order, trials
from model.diagnosis.smooth import roots, standardised
from model.diagnosis.witness import CURRENT, CURRENT_PHASE, FRICTION, WITNESSES, Witness
from model.support.arrays import Array, ComplexArray

SESSION_GAIN_STD = WITNESSES[FRICTION].gain_std
# worth of the stated noise where no replicates check it: a scale known to about 30 %
LOOSE_DEGREES = 6.0
MOST_DEGREES = 200.0
USUAL_STRAY_F = 300e-12  # where no open circuit tells
AREA_STD = 0.03  # of the logarithm of the touch's area, from session to session


@dataclass(frozen=True)
class Noise:
    """Covariance of what is observed: diag(`own_std`^2) + gains of sessions + AR(1), up to one
    unknown scale.

    The scale's square is inverse-gamma around 1 with `degrees` degrees of freedom. `source` says
    where the noise comes from, `replicate_degrees` how many replicates checked it. `correlation`
    and `inflation` are as asked for. `whiten` takes residuals [n] or [n, k] to unit variance.
    `blocks`: what shares no noise with the rest, each by its numbers; all together where there are
    none. `sure`: how many are said to be better than any model is; what is left of them says
    nothing about the scale.
    """

    own_std: Array
    lower: Array
    degrees: float
    source: str
    replicate_degrees: int
    correlation: float
    inflation: Array
    warnings: tuple[str, ...] = field(default=())
    blocks: tuple[NDArray[np.intp], ...] = ()
    sure: int = 0

    @property
    def log_determinant(self) -> float:
        """Half the log determinant of the covariance: what evidences under two noises differ by
        besides the fit.
        """
        return float(np.sum(np.log(np.diag(self.lower))))

    def whiten(self, values: Array) -> Array:
        """L^-1 values."""
        if not self.blocks:
            return np.asarray(solve_triangular(self.lower, values, lower=True, check_finite=False))
        white = np.empty(values.shape)
        for block, inverse in zip(self.blocks, self._inverses, strict=True):
            white[block] = inverse @ values[block]
        return white

    @cached_property
    def _inverses(self) -> list[Array]:
        lowers = (self.lower[np.ix_(block, block)] for block in self.blocks)
        return [solve_triangular(lower, np.eye(len(lower)), lower=True) for lower in lowers]


@dataclass(frozen=True)
class _Own:
    """Standard deviations of one witness's observations [n], where they come from, and the
    replicates that checked; `trial` [n]: what the observations of a trial share.
    """

    std: Array
    source: str
    degrees: int
    warnings: tuple[str, ...] = ()
    trial: Array | None = None


def noise_of(
    data: Measurements, correlation: float = 0.0, inflation: Array | None = None
) -> Noise | None:
    """The noise model of a data set; None where nothing says how noisy friction is, be it stated or
    replicates.

    `correlation`: of neighbouring rows in a session, in order of measurement. `inflation` [n]: of
    single rows' noise.
    """
    inflation = np.ones(data.count) if inflation is None else inflation
    own_std, trial_std, found = np.empty(data.count), np.zeros(data.count), list[_Own]()
    for witness in data.witnesses:
        mine = data.of(witness)
        own = _own_noise(data.subset(mine), witness, inflation[mine])
        if own is None:
            return None
        own_std[mine] = own.std
        trial_std[mine] = 0.0 if own.trial is None else own.trial
        found.append(own)
    least = _least_std(data)
    sure = own_std < least
    own_std = np.maximum(own_std, least)
    shared = np.hstack([shared_std(data), _response_std(data, np.where(sure, least, 0.0))])
    lower, blocks, trial = np.zeros((data.count, data.count)), [], trials(data)
    for rows in rows_in_order(data):
        rank = np.argsort(rows)  # when each was measured, in the order of the file
        blocks.append(rows[rank])
        std = own_std[blocks[-1]]
        covariance = np.diag(std**2)
        if correlation != 0.0:
            covariance = correlation ** np.abs(rank[:, None] - rank) * np.outer(std, std)
        covariance += shared[blocks[-1]] @ shared[blocks[-1]].T
        together = trial[blocks[-1]][:, None] == trial[blocks[-1]]
        covariance += together * np.outer(trial_std[blocks[-1]], trial_std[blocks[-1]])
        lower[np.ix_(blocks[-1], blocks[-1])] = cholesky(covariance, lower=True)
    degrees = sum(own.degrees for own in found)
    return Noise(
        own_std,
        lower,
        min(max(float(degrees), LOOSE_DEGREES), MOST_DEGREES),
        "; ".join(dict.fromkeys(own.source for own in found)),
        degrees,
        correlation,
        inflation,
        tuple(warning for own in found for warning in own.warnings),
        tuple(blocks),
        int(sure.sum()),
    )


def _least_std(data: Measurements) -> Array:
    """What no model is better than [n]: what one is off at a setting is off in every session that
    reads it.
    """
    least = np.array([witness.least_std for witness in WITNESSES])
    least[FRICTION] = data.least_cof_std
    setting = data.replicate_groups(sessions_apart=False)
    sessions = np.bincount(np.unique(np.stack([setting, data.session]), axis=1)[0])
    return np.asarray(
        least[FRICTION if data.witness is None else data.witness] * np.sqrt(sessions[setting])
    )


def _response_std(data: Measurements, least_std: Array) -> Array:
    """What a session shares of how far a monitor's response is off smoothly over frequency [n, m].

    `least_std` [n]: what it is believed to where it claims more, 0 elsewhere.
    """
    if not data.varies("frequency_hz"):
        return np.zeros((data.count, 0))
    monitored = np.where(data.of(FRICTION), 0.0, least_std)
    return np.asarray(monitored[:, None] * roots(standardised(data, "frequency_hz")[:, None]))


def shared_std(data: Measurements) -> Array:
    """Standard deviations [n, 2] of what the observations of a session and witness share.

    The witness's own gain, and in the current the area of the touch, which varies between sessions.
    The current beside the touch does not depend on that area.
    """
    gains = np.array([witness.gain_std for witness in WITNESSES])
    if data.witness is None:
        return np.outer(np.full(data.count, gains[FRICTION]), [1.0, 0.0])
    share = touch_share(data)
    area = np.select([data.of(CURRENT), data.of(CURRENT_PHASE)], [share.real, share.imag])
    return np.stack([gains[data.witness], AREA_STD * area], axis=1)


def touch_share(data: Measurements) -> ComplexArray:
    """Of the current of each row [n], what flows through the touch rather than beside it, as open
    circuits tell it.
    """
    c, nothing = data.columns, np.full(data.count, np.nan)
    is_open = np.zeros(data.count, bool) if data.finger is None else data.finger == "none"
    voltage_v = c.get("electrode_voltage_v", nothing)
    voltage_v = np.where(np.isfinite(voltage_v), voltage_v, c["voltage_v"])
    lead_rad = c.get("current_phase_rad", nothing) - np.nan_to_num(
        c.get("electrode_voltage_phase_rad", nothing)
    )
    lead_rad = np.where(np.isfinite(lead_rad), lead_rad, 0.5 * np.pi)
    with np.errstate(divide="ignore", invalid="ignore"):
        capacitance_f = c.get("current_a", nothing) / (2.0 * np.pi * c["frequency_hz"] * voltage_v)
        told = capacitance_f[is_open & np.isfinite(capacitance_f)]
        stray_f = float(np.median(told)) if told.size else USUAL_STRAY_F
        beside = stray_f / capacitance_f * np.exp(1j * (0.5 * np.pi - lead_rad))
    return np.where(is_open, 0.0, 1.0 - np.where(np.isfinite(beside), beside, 0.0))


def _own_noise(data: Measurements, witness: int, inflation: Array) -> _Own | None:
    """The noise of one witness alone: as stated and compared with replicates; from replicates; or
    the usual.
    """
    known, stated = WITNESSES[witness], data.stated_std
    if np.isnan(stated).all():
        return _unstated(known, data, inflation)
    if np.isnan(stated).any():
        usual = _unstated(known, data, inflation)
        if usual is None:
            return None
        stated = np.where(np.isnan(stated), usual.std / inflation, stated)
    std = stated * inflation
    told = levels(data, data.observed, std, inflation)
    if told.has_trials:
        together = of_trials(trials(data), inflation)
        return _of_levels(told, std, together, f"{known.std}, scaled to rows and trials")
    if told.row.degrees < FEWEST_DEGREES:
        return _Own(std, known.std, told.row.degrees)
    ratio = float(np.sqrt(told.row.variance))
    if 1.0 / 1.3 < ratio < 1.3:
        return _Own(std * ratio, known.std, told.row.degrees)
    said = f"replicates scatter {ratio:.2f} times as much as {known.std} says"
    return _Own(
        std * ratio,
        f"{known.std}, scaled to the replicates",
        told.row.degrees,
        (f"{said}; their scatter is used",),
    )


def _unstated(known: Witness, data: Measurements, inflation: Array) -> _Own | None:
    """What replicates say, or else what is usual of such an instrument; None where nothing is."""
    told = levels(data, data.observed, inflation, inflation)
    if told.has_trials:
        together = of_trials(trials(data), inflation)
        return _of_levels(told, inflation, together, "rows and trials")
    if told.row.degrees >= 2:
        return _Own(np.sqrt(told.row.variance) * inflation, "replicates", told.row.degrees)
    if known.usual_std is None:
        return None
    unit = "rad" if known.is_phase else "of the value"
    said = f"{known.column} has neither {known.std} nor replicates"
    return _Own(
        known.usual_std * inflation,
        f"assumed for {known.column}",
        0,
        (f"{said}: {known.usual_std:g} {unit} is assumed",),
    )


def _of_levels(told: Levels, std: Array, together: Array, source: str) -> _Own:
    """Rows' own noise of such `std` [n], and what a trial's rows share, each by its own scatter."""
    return _Own(
        np.sqrt(told.row.variance) * std,
        source,
        told.trial.degrees,
        trial=np.sqrt(told.trial.variance) * together,
    )
