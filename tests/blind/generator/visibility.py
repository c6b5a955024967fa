"""lambda: how visible a hidden effect is once the base model has bent its own parameters as far as
it can.

Noise-free data with the effect are fitted by the base model over (log h_rms, log skin, log leak,
log mu_off), the first three with their priors, the residual of log friction whitened by row noise
and a shared gain per session. lambda is the cost of that fit less the cost of the same fit without
the effect (which is not nil: the true finger sits off the priors' centre), i.e. the
log-likelihood-ratio statistic of the Asimov data set.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from .designs import Design
from .effect import Hidden
from .nuisance import PRIOR_SD, REFERENCE, ROUGHNESS, SESSION_GAIN_SD
from .touch import Finger, Rows, base_friction, force, friction, prepare


def clean_friction(design: Design, finger: Finger, hidden: tuple[Hidden, ...]) -> np.ndarray:
    """Noise-free friction of every row, with the hidden effects in force where they are on."""
    base = base_friction(design.rows, finger, ROUGHNESS)
    live = tuple(h for h in hidden if h.strength > 0)
    if not live:
        return base
    if any(h.sessions for h in live):
        out = base
        for h in live:
            on = np.isin(design.session, h.sessions) if h.sessions else np.ones(base.size, bool)
            out = out * np.where(on, with_effects(design.rows, finger, (h,)) / base, 1.0)
        return out
    return with_effects(design.rows, finger, live)


def with_effects(rows: Rows, finger: Finger, hidden: tuple[Hidden, ...]) -> np.ndarray:
    """Friction with the effects acting together on every row."""
    seen = rows.seen_by(set().union(*(h.needs for h in hidden)))
    distinct, back = replace(seen, f=np.where(rows.v > 0, rows.f, 0.0)).unique()
    state = prepare(distinct, finger, ROUGHNESS)
    for h in hidden:
        h.act(state)
    return friction(state)[back]


def force_left(design: Design, finger: Finger, hidden: tuple[Hidden, ...]) -> float:
    """Median share of the electrostatic force that the effects leave on the rows with voltage."""
    state = prepare(design.rows.take(design.rows.v > 0), finger, ROUGHNESS)
    base = force(state)
    for h in hidden:
        h.act(state)
    return float(np.median(force(state) / base))


@dataclass(frozen=True)
class Whitener:
    """Inverse square root of diag(relative sigma^2) + gain^2 per session, applied without building
    the matrix.
    """

    sigma: np.ndarray
    groups: tuple[np.ndarray, ...]
    gain_sd: float

    def __call__(self, r: np.ndarray) -> np.ndarray:
        z = r / self.sigma
        out = z.copy()
        for rows in self.groups:
            a = 1 / self.sigma[rows]
            length = a @ a
            shrink = (1 - 1 / np.sqrt(1 + self.gain_sd**2 * length)) / length
            out[rows] = z[rows] - shrink * a * (a @ z[rows])
        return out


def whitener(design: Design, relative_sigma: np.ndarray) -> Whitener:
    """One group per session where sessions are recorded; a single unrecorded gain is mu_off's
    business.
    """
    groups = (
        [np.flatnonzero(design.session == s) for s in np.unique(design.session)]
        if design.has_session
        else []
    )
    return Whitener(relative_sigma, tuple(groups), SESSION_GAIN_SD)


def finger_from(theta: np.ndarray, start: Finger = REFERENCE) -> Finger:
    """Finger at prior-normal coordinates (h_rms, skin, leak), the rest from `start`."""
    values = {
        name: getattr(REFERENCE, name) * np.exp(sd * t)
        for (name, sd), t in zip(PRIOR_SD.items(), theta, strict=True)
    }
    return replace(start, area=REFERENCE.area, gap_offset=0.0, **values)


def coordinates(finger: Finger) -> np.ndarray:
    return np.array(
        [np.log(getattr(finger, n) / getattr(REFERENCE, n)) / sd for n, sd in PRIOR_SD.items()]
    )


def base_cost(design: Design, log_cof: np.ndarray, white: Whitener, start: Finger) -> float:
    """Least whitened chi2 plus prior cost of the base model on `log_cof`."""
    one = white(np.ones_like(log_cof))
    unit = replace(start, mu_off=1.0)

    def residual(theta: np.ndarray) -> np.ndarray:
        r = white(log_cof - np.log(base_friction(design.rows, finger_from(theta, unit), ROUGHNESS)))
        level = np.clip(
            (one @ r) / (one @ one), np.log(0.2), np.log(2.0)
        )  # mu_off, linear in the logarithm
        return np.concatenate([r - level * one, theta])

    fit = least_squares(
        residual,
        np.clip(coordinates(start), -5, 5),
        method="trf",
        bounds=(-6, 6),
        xtol=1e-5,
        ftol=1e-5,
        max_nfev=25,
    )
    return float(2 * fit.cost)


class Search:
    """Finds the strength of an effect that gives a wanted lambda."""

    def of(self, hidden: tuple[Hidden, ...]) -> float:
        """lambda of these effects together."""
        raise NotImplementedError

    def reach(self, hidden: Hidden, target: float) -> tuple[Hidden, float]:
        """Set the strength so that lambda is `target` within 3 %; where it is out of reach, the
        most visible strength.

        Only the visibility of `hidden` alone is aimed at, whatever else is present in truth.
        """
        low, high = hidden.knob
        ladder = np.geomspace(low, high, 13)
        best, below = (hidden.at(ladder[0]), self.of((hidden.at(ladder[0]),))), 1e-3 * ladder[0]
        for strength in ladder:
            seen = self.of((hidden.at(strength),))
            if seen > best[1]:
                best = (hidden.at(strength), seen)
            if seen >= target:
                break
            below = strength
        else:
            return best
        return self._bisect(hidden, target, np.log(below), np.log(strength), best)

    def _bisect(
        self, hidden: Hidden, target: float, low: float, high: float, best: tuple
    ) -> tuple[Hidden, float]:
        for _ in range(22):
            middle = 0.5 * (low + high)
            trial = hidden.at(float(np.exp(middle)))
            seen = self.of((trial,))
            if abs(seen - target) < abs(best[1] - target):
                best = (trial, seen)
            if abs(seen - target) <= 0.03 * target:
                break
            low, high = (middle, high) if seen < target else (low, middle)
        return best


@dataclass
class Visibility(Search):
    """lambda of hidden effects for one design, finger and noise level."""

    design: Design
    finger: Finger
    relative_sigma: np.ndarray

    def __post_init__(self) -> None:
        self.white = whitener(self.design, self.relative_sigma)
        self.null = self._cost(clean_friction(self.design, self.finger, ()))

    def _cost(self, cof: np.ndarray) -> float:
        return base_cost(self.design, np.log(cof), self.white, self.finger)

    def of(self, hidden: tuple[Hidden, ...]) -> float:
        return max(self._cost(clean_friction(self.design, self.finger, hidden)) - self.null, 0.0)
