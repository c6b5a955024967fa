"""Effects in the drive, the layers and the air gap (physics.md section 5), each in two forms of
like behaviour.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from .effect import Effect, log_uniform, nothing, sign
from .touch import AREA, VACUUM, State


def amplifier_bandwidth(state: State, knob: float, shape: dict, alternative: bool) -> None:
    x = state.rows.f * knob / 1e6
    if alternative:  # unequal cascaded poles instead of Butterworth
        spread = (1.0, 1.9, 3.2, 5.0)[: max(2, int(shape["order"]))]
        for pole in spread:
            state.drive = state.drive / np.sqrt(1 + (x / pole) ** 2)
            state.drive_phase = state.drive_phase - np.arctan(x / pole)
        return
    for k in range(shape["order"]):  # Butterworth's poles
        pole = np.exp(0.5j * np.pi * (1 + (2 * k + 1) / shape["order"]))
        state.drive_phase = state.drive_phase - np.angle((1j * x - pole) / -pole)
    state.drive = state.drive / np.sqrt(1 + x ** (2 * shape["order"]))


@cache
def _tracked() -> tuple[np.ndarray, np.ndarray]:
    """Ratios of slew rate to a sine's steepest slope, and the fundamental that is left of it:
    stepped through time.
    """
    steps, ratio = 4000, np.linspace(0.3, 1.0, 141)
    t = 2 * np.pi * np.arange(4 * steps) / steps
    out, left = np.zeros(ratio.size), np.zeros(ratio.size, complex)
    for i, at in enumerate(t):
        out = out + np.clip(np.sin(at) - out, -ratio * t[1], ratio * t[1])
        if i >= 3 * steps:
            left += 2j * out * np.exp(-1j * at) / steps
    return ratio, left


def amplifier_slew_limit(state: State, knob: float, _shape: dict, alternative: bool) -> None:
    triangle = 8 / np.pi**2 * (5e8 / knob) / (4 * state.rows.f)
    if alternative:
        left = (1 + (state.drive / triangle) ** 3) ** (-1 / 3)
        state.drive_phase = state.drive_phase - np.arccos(
            left
        )  # a saturated integrator in its loop: error leads by 90
        state.drive = state.drive * left
        return
    peak = np.pi**2 / 8 * triangle / state.drive.clip(1e-12)
    ratio, left = _tracked()
    slope = 2 / np.pi * peak
    partly = np.interp(slope, ratio, np.abs(left)), np.interp(slope, ratio, np.angle(left))
    always = slope < 0.5  # a triangle, which turns where it meets the sine
    state.drive_phase = state.drive_phase + np.where(
        always, -np.arccos(np.minimum(peak, 1.0)), partly[1]
    )
    state.drive = np.where(always, triangle, partly[0] * state.drive)


def drive_gain_error(state: State, knob: float, shape: dict, alternative: bool) -> None:
    gain = np.exp(knob * shape["sign"])
    if alternative:  # a gain that bends a little with amplitude
        gain = gain * (state.drive.clip(1.0) / 75.0) ** (0.07 * np.log(gain))
    state.drive = gain * state.drive


def series_resistance(state: State, knob: float, shape: dict, alternative: bool) -> None:
    z = knob * np.ones_like(state.k_skin)
    if (
        alternative
    ):  # tissue: the resistance falls slowly with frequency and turns a little capacitive
        z = z * (state.jw / (2 * np.pi * 1e4)) ** -shape["slope"]
    state.stack_add = state.stack_add + state.jw * VACUUM * AREA * z


def floating_body(state: State, knob: float, shape: dict, alternative: bool) -> None:
    admittance = state.jw * (1e-8 / knob)
    if alternative:  # a lossy body capacitance, nearly constant phase
        admittance = admittance * (state.jw / (2 * np.pi * 1e3)) ** -shape["loss"]
    state.stack_add = state.stack_add + state.jw * VACUUM * AREA / admittance


def _wetter(k: np.ndarray, w: np.ndarray | float) -> np.ndarray:
    return k.real * 1.5**w + 1j * k.imag * 14.0**w


def skin_hydration(state: State, knob: float, shape: dict, alternative: bool) -> None:
    if not alternative:
        state.k_skin = _wetter(state.k_skin, knob)
        return
    dry, thickness = state.k_skin, state.finger.skin
    levels = [
        knob * fall for fall in np.exp(-np.linspace(0.05, 0.95, 10) * shape["fall"])
    ]  # from the outside in
    state.k_skin = _wetter(dry, levels[0])
    state.skin_stack = lambda _k: sum(thickness / 10 / _wetter(dry, w) for w in levels)


def skin_nonlinearity(state: State, knob: float, _shape: dict, alternative: bool) -> None:
    v0 = 100.0 / knob
    power = 1.6 if alternative else 2.0
    state.skin_law = lambda v: 1 + (v / v0) ** power


def johnsen_rahbek(state: State, knob: float, _shape: dict, alternative: bool) -> None:
    sigma = knob * np.ones_like(state.drive)
    if alternative:  # conductivity that grows with the field in the insulator
        sigma = sigma * np.exp(0.5 * (np.sqrt(state.drive / 75.0) - 1))
    state.k_insulator = state.k_insulator + sigma / (state.jw * VACUUM)


def electrode_polarization(state: State, knob: float, shape: dict, alternative: bool) -> None:
    n, s = shape["n"], state.jw
    if alternative:  # finite-length Warburg-like element
        root = (s * shape["tau_s"]) ** n
        z = shape["tau_s"] ** n / knob * np.tanh(root) / root
    else:
        z = 1 / (knob * s**n)
    state.gap_admittance = state.gap_admittance + 1 / (shape["r_ct"] + z)


def humid_gap_conduction(state: State, knob: float, _shape: dict, alternative: bool) -> None:
    sigma = knob * np.ones_like(state.drive)
    if alternative:  # hopping conduction rises slowly with frequency
        sigma = sigma * (state.rows.f / 100.0) ** 0.12
    state.k_gap = state.k_gap + sigma / (state.jw * VACUUM)


def sweat_film(state: State, knob: float, shape: dict, alternative: bool) -> None:
    share, h = np.minimum(knob * np.ones_like(state.drive), 0.95)[:, None], state.finger.h_rms
    state.k_film = 80 + shape["sigma_s"] / (state.jw * VACUUM)
    if alternative:  # wide gaps fill less
        state.film = lambda u: share * u / (1 + 0.15 * u / h)
    else:
        state.film = lambda u: share * u


def speed_dependent_gap(state: State, knob: float, shape: dict, alternative: bool) -> None:
    v, v0 = state.rows.speed, shape["v0"]
    rise = v**2 / (v**2 + v0**2) if alternative else 1 - np.exp(-v / v0)
    state.gap_add = state.gap_add + knob * rise


EFFECTS = [
    Effect(
        amplifier_bandwidth,
        (0.05, 2e4),
        lambda rng: {"order": int(rng.integers(1, 4))},
        lambda s, shape: {"f_c_hz": 1e6 / s, "order": shape["order"]},
    ),
    Effect(amplifier_slew_limit, (0.1, 5e5), nothing, lambda s, _: {"slew_v_per_s": 5e8 / s}),
    Effect(
        drive_gain_error,
        (0.01, 1.0),
        lambda rng: {"sign": sign(rng)},
        lambda s, shape: {"gain": np.exp(s * shape["sign"])},
    ),
    Effect(
        series_resistance,
        (1.0, 1e7),
        lambda rng: {"slope": rng.uniform(0.12, 0.25)},
        lambda s, _: {"resistance_ohm": s},
    ),
    Effect(
        floating_body,
        (0.1, 1e4),
        lambda rng: {"loss": rng.uniform(0.08, 0.18)},
        lambda s, _: {"body_capacitance_f": 1e-8 / s},
    ),
    Effect(
        skin_hydration,
        (0.02, 3.0),
        lambda rng: {"fall": rng.uniform(0.5, 1.2)},
        lambda s, _: {"w": s},
    ),
    Effect(skin_nonlinearity, (0.02, 1e3), nothing, lambda s, _: {"v0_v": 100.0 / s}),
    Effect(johnsen_rahbek, (1e-12, 1e-6), nothing, lambda s, _: {"sigma_insulator_s_per_m": s}),
    Effect(
        electrode_polarization,
        (1e-9, 1e-1),
        lambda rng: {
            "n": rng.uniform(0.55, 0.95),
            "r_ct": log_uniform(rng, 1e-2, 1e1),
            "tau_s": log_uniform(rng, 5e-4, 1e-2),
        },
        lambda s, shape: {"q_per_area": s, "n": shape["n"], "r_ct_ohm_m2": shape["r_ct"]},
    ),
    Effect(humid_gap_conduction, (1e-11, 1e-3), nothing, lambda s, _: {"sigma_gap_s_per_m": s}),
    Effect(
        sweat_film,
        (0.003, 0.9),
        lambda rng: {"sigma_s": log_uniform(rng, 0.1, 1.0)},
        lambda s, shape: {"share": s, "sigma_s_s_per_m": shape["sigma_s"]},
    ),
    Effect(
        speed_dependent_gap,
        (4e-9, 2e-5),
        lambda rng: {"v0": log_uniform(rng, 0.01, 0.05)},
        lambda s, shape: {"du_m": s, "v0_m_per_s": shape["v0"]},
        needs="speed_m_s",
    ),
]
