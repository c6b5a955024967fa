"""A measure of fidelity in words."""

from __future__ import annotations

from collections.abc import Sequence

from haptic_driver.fidelity.measure import Fidelity
from haptic_driver.textures.bands import CENTRES_HZ

GOOD_GAIN = (0.8, 1.2)  # of felt against asked friction: what this driver is to reach
ONE_CONSTANT = 1e-6  # relative error of the constant, below which it is all that was asked for


def said(fidelity: Fidelity) -> list[str]:
    """Tell a fidelity in sentences: score, texture, correlation, feeling, what is unverified."""
    if fidelity.sliding_time_s == 0.0:
        return ["nothing was felt: no sliding with a target and known forces"]
    said = [_score(fidelity), _texture(fidelity), _correlation(fidelity), _feeling(fidelity)]
    if fidelity.unverified:
        said.append(f"unverified in '{fidelity.thresholds}': {', '.join(fidelity.unverified)}")
    return said


def _score(f: Fidelity) -> str:
    """What a constant also reaches stands beside every score, unless one constant was asked for."""
    share, constant_share = f.share_within_5_percent, f.constant_share_within_5_percent
    error, constant_error = f.relative_error_rms, f.constant_relative_error_rms
    if share is None or constant_share is None or error is None or constant_error is None:
        return "no target was within reach"
    words = f"within 5 % for {_percent(share)} of the time"
    if constant_error < ONE_CONSTANT:
        words += f"; error {_percent(error, 1)} rms"
    else:
        words += f"; a constant {f.constant_cof:.2f} reaches {_percent(constant_share)}"
        if share <= constant_share:
            words += ", so this is no better than a constant"
        words += f"; error {_percent(error, 1)} rms, of the constant {_percent(constant_error, 1)}"
    if f.reachable_share is not None and f.reachable_share < 1.0:
        words += f"; {_percent(f.reachable_share)} of the time was within reach"
    return words


def _texture(f: Fidelity) -> str:
    """What is left of the texture, band by band."""
    within = f.bands_within(*GOOD_GAIN)
    counted = [i for i, good in enumerate(within) if good is not None]
    reach = "" if f.reach_hz is None else f" up to {f.reach_hz:.0f} Hz, all that this rig can do"
    if not counted:
        return f"no band can be judged{reach}: too little is asked for or too short a time"
    words = f"of the texture at {_bands(counted)} the gain is {_values(f.band_gain, counted)}"
    words += f", coherence {_values(f.band_coherence, counted)}"
    good = sum(within[i] is True for i in counted)
    words += f"; {good} of {len(counted)} bands within {GOOD_GAIN[0]:g} to {GOOD_GAIN[1]:g}"
    return words + reach


def _correlation(f: Fidelity) -> str:
    if f.correlation is None:
        return "no correlation: the target hardly changes"
    words = f"correlation {f.correlation:.2f}"
    if f.best_lag_s is not None:
        words += f", {f.correlation_at_best_lag:.2f} at a lag of {1e3 * f.best_lag_s:.1f} ms"
    if f.others_correlation and f.others_correlation_at_best_lag:
        words += "; others report {:g} to {:g}".format(*f.others_correlation)
        words += " and {:g} to {:g}".format(*f.others_correlation_at_best_lag)
    return words


def _feeling(f: Fidelity) -> str:
    """What a finger would feel of the error."""
    words = f"a finger would notice an error above {_percent(f.jnd_friction)} for"
    words += f" {_percent(f.share_above_jnd or 0.0)} of the time"
    felt = [i for i, above in enumerate(f.bands_felt) if above]
    if felt:
        words += f", and may feel what is wrong at {_bands(felt)}"
        words += f" (thresholds differ by a factor of {f.threshold_spread_factor:g} either way)"
    elif all(above is None for above in f.bands_felt):
        words += "; whether it feels ripple is unknown"
    else:
        words += ", and nothing of the rest"
    return words


def _percent(share: float, digits: int = 0) -> str:
    return f"{100.0 * share:.{digits}f} %"


def _bands(indices: Sequence[int]) -> str:
    return ", ".join(f"{CENTRES_HZ[i]:.0f}" for i in indices) + " Hz"


def _values(values: Sequence[float | None], indices: Sequence[int]) -> str:
    return ", ".join(f"{values[i]:.2f}" for i in indices)
