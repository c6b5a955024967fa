"""Row noise: as stated, or of a kind the stated cof_std does not admit."""

from __future__ import annotations

import numpy as np

STATED = "stated"
WRONG = (
    "scale_0.67",
    "scale_1.5",
    "student_t3",
    "outliers_8_sigma",
    "ar1_0.5",
    "force_proportional",
)


def draw(
    rng: np.random.Generator, kind: str, cof: np.ndarray, sigma: np.ndarray, session: np.ndarray
) -> np.ndarray:
    """Noise of each row in units of cof; `sigma` is the stated standard deviation, rows stand in
    measuring order.
    """
    z = rng.normal(size=cof.size)
    if kind == "scale_0.67":
        z = 0.67 * z
    elif kind == "scale_1.5":
        z = 1.5 * z
    elif kind == "student_t3":
        z = rng.standard_t(3, size=cof.size)
    elif kind == "outliers_8_sigma":
        hit = rng.random(cof.size) < 0.05
        z = np.where(hit, z + 8.0 * rng.choice([-1.0, 1.0], cof.size), z)
    elif kind == "ar1_0.5":
        for i in range(1, z.size):
            if session[i] == session[i - 1]:
                z[i] = 0.5 * z[i - 1] + np.sqrt(0.75) * z[i]
    elif kind == "force_proportional":
        z = z * np.sqrt(0.5 + (cof / np.median(cof) - 0.8).clip(0.0) ** 2 * 4)
    elif kind != STATED:
        raise ValueError(f"unknown noise {kind!r}; one of {(STATED, *WRONG)}")
    return sigma * z
