"""How a true finger and a real session differ from the reference before any effect is missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .touch import Finger, Roughness

REFERENCE = Finger()
ROUGHNESS = Roughness()
PRIOR_SD = {"h_rms": 0.10, "skin": 0.20, "leak": float(np.log(1.5))}  # of the logarithm
SESSION_GAIN_SD = 0.05


def draw_finger(rng: np.random.Generator, width: float = 1.0) -> Finger:
    """One finger from the priors (deviations cut at 2.5 sd) times `width`."""
    z = {
        name: sd * width * float(np.clip(rng.normal(), -2.5, 2.5)) for name, sd in PRIOR_SD.items()
    }
    return Finger(
        h_rms=REFERENCE.h_rms * np.exp(z["h_rms"]),
        skin=REFERENCE.skin * np.exp(z["skin"]),
        leak=REFERENCE.leak * np.exp(z["leak"]),
        mu_off=float(rng.uniform(0.3, 0.8)),
    )


def far_finger(rng: np.random.Generator) -> tuple[Finger, str]:
    """A finger or a rig off by far more than the priors say, and which way."""
    kind = str(rng.choice(["h_rms", "skin", "leak", "area", "gap_offset"]))
    finger = draw_finger(rng, 0.5)
    sign = float(rng.choice([-1.0, 1.0]))
    if kind in PRIOR_SD:
        return (
            replace(finger, **{kind: getattr(REFERENCE, kind) * np.exp(3 * sign * PRIOR_SD[kind])}),
            kind,
        )
    if kind == "area":
        return replace(finger, area=REFERENCE.area * np.exp(0.3 * sign)), kind
    return replace(finger, gap_offset=float(rng.uniform(0.1e-6, 0.4e-6))), kind


def session_gains(
    rng: np.random.Generator, session: np.ndarray, sd: float = SESSION_GAIN_SD
) -> np.ndarray:
    """Gain of each row, shared within a session."""
    values, back = np.unique(session, return_inverse=True)
    return np.exp(sd * rng.normal(size=values.size))[back]


def finger_record(finger: Finger) -> dict:
    return {
        name: float(getattr(finger, name))
        for name in ("h_rms", "skin", "leak", "mu_off", "area", "gap_offset")
    }
