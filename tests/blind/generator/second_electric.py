"""The second alternative of every effect in the drive, the layers and the air gap.

It is another law than the catalogue's and the first alternative. Each form says in its `reason`
whose law it is, or why a device or a finger would follow it.
"""

from __future__ import annotations

import numpy as np

from .effect import Form, Strength, log_uniform, nothing, sign
from .touch import STEADY_SPEED, VACUUM, State

F_REF = 0.5  # N
# Bessel's polynomials, and where in their own unit the amplitude has fallen to 0.707
BESSEL = {2: ((1, 3, 3), 1.3617), 3: ((1, 6, 15, 15), 1.7557), 4: ((1, 10, 45, 105, 105), 2.1139)}
QUARTER = (np.arange(48) + 0.5) * np.pi / 96  # midpoints over a quarter of a period
HALVINGS = 50


def amplifier_bandwidth(state: State, knob: Strength, shape: dict) -> None:
    polynomial, corner = BESSEL[shape["order"]]
    gain = polynomial[-1] / np.polyval(polynomial, 1j * corner * state.rows.f * knob / 1e6)
    state.drive = state.drive * np.abs(gain)
    state.drive_phase = state.drive_phase + np.angle(gain)


def _fundamental_of_tanh(z: np.ndarray) -> np.ndarray:
    """Fundamental of tanh(z sin wt)."""
    return 2 * np.mean(np.sin(QUARTER) * np.tanh(z[:, None] * np.sin(QUARTER)), axis=1)


def amplifier_slew_limit(state: State, knob: Strength, shape: dict) -> None:
    """An integrator follows at SR tanh(error/range): they are a quarter period apart."""
    most, wanted = 5e8 / knob / state.omega, state.drive
    low, high = np.zeros_like(wanted), wanted
    for _ in range(HALVINGS):
        error = 0.5 * (low + high)
        out = most * _fundamental_of_tanh(error / shape["range_v"])
        short = np.hypot(error, out) < wanted
        low, high = np.where(short, error, low), np.where(short, high, error)
    lag = np.arctan2(error, out)
    state.drive = wanted * np.cos(lag)
    state.drive_phase = state.drive_phase - lag


def drive_gain_error(state: State, knob: Strength, shape: dict) -> None:
    off = knob * shape["sign"]
    state.drive = state.drive * np.exp(off) * (1 - 0.06 * off * (state.drive / 75.0) ** 2)


def series_resistance(state: State, knob: Strength, _shape: dict) -> None:
    z = knob / 2000.0 * (500.0 + 1500.0 / (1 + state.jw * 1500.0 * 0.22e-6))
    state.stack_add = state.stack_add + state.jw * VACUUM * state.area * z


def floating_body(state: State, knob: Strength, shape: dict) -> None:
    admittance = 1e-8 / knob * (state.jw + 2 * np.pi * shape["shoe_hz"])
    state.stack_add = state.stack_add + state.jw * VACUUM * state.area / admittance


def skin_hydration(state: State, knob: Strength, _shape: dict) -> None:
    dry = state.k_skin
    state.k_skin = dry.real * (1 + 0.5 * knob) + 1j * dry.imag * (1 + 13 * knob**2)
    swollen = state.finger.skin * (1 + 0.25 * knob)
    state.skin_stack = lambda k: swollen / k


def skin_nonlinearity(state: State, knob: Strength, shape: dict) -> None:
    def law(volts: np.ndarray) -> np.ndarray:
        square = (volts * knob / 100.0) ** 2
        return 1 + square / (1 + square / shape["most"])

    state.skin_law = law


def johnsen_rahbek(state: State, knob: Strength, shape: dict) -> None:
    s = state.jw
    sigma = knob * (1 + (s / (2 * np.pi * shape["f_c"])) ** shape["n"])
    state.k_insulator = state.k_insulator + sigma / (s * VACUUM)


def electrode_polarization(state: State, knob: Strength, shape: dict) -> None:
    z = 1 / (knob * (state.jw + 1 / shape["tau_s"]) ** shape["n"])
    state.gap_admittance = state.gap_admittance + 1 / (shape["r_ct"] + z)


def humid_gap_conduction(state: State, knob: Strength, shape: dict) -> None:
    sigma = knob * (state.rows.n / F_REF) ** shape["power"]
    state.k_gap = state.k_gap + sigma / (state.jw * VACUUM)


def sweat_film(state: State, knob: Strength, shape: dict) -> None:
    depth = (knob * np.ones_like(state.drive))[:, None]
    state.k_film = 80 + shape["sigma_s"] / (state.jw * VACUUM)
    state.film = lambda u: depth * u / (depth + u)


def speed_dependent_gap(state: State, knob: Strength, _shape: dict) -> None:
    state.gap_add = state.gap_add + knob * (state.rows.speed / STEADY_SPEED) ** (2 / 3)


FORMS = [
    Form(
        amplifier_bandwidth,
        (0.05, 2e4),
        lambda rng: {"order": int(rng.integers(2, 5))},
        "Thomson 1949: a filter of flat delay, as after a switching stage, falls off more softly",
    ),
    Form(
        amplifier_slew_limit,
        (0.1, 5e5),
        lambda rng: {"range_v": log_uniform(rng, 0.1, 0.5)},
        "Solomon 1974: the current of an input pair of bipolar transistors is a tanh of the error",
    ),
    Form(
        drive_gain_error,
        (0.01, 1.0),
        lambda rng: {"sign": sign(rng)},
        "third-order term of an amplifier that is driven towards its rails",
    ),
    Form(
        series_resistance,
        (1.0, 3e7),
        nothing,
        "IEC 60990: a body is 500 ohm, then 1500 ohm beside 0.22 uF; scaled by the strength",
    ),
    Form(
        floating_body,
        (0.1, 1e4),
        lambda rng: {"shoe_hz": log_uniform(rng, 20.0, 300.0)},
        "soles conduct beside the body's capacitance: 10 Mohm, 150 pF: 100 Hz",
    ),
    Form(
        skin_hydration,
        (0.02, 6.0),
        nothing,
        "Archie 1942: conductivity by the square of the water's share, while the layer swells",
    ),
    Form(
        skin_nonlinearity,
        (0.02, 1e3),
        lambda rng: {"most": log_uniform(rng, 3.0, 15.0)},
        "Pavselj 2005: conductivity of skin in a strong field is a sigmoid: it saturates",
    ),
    Form(
        johnsen_rahbek,
        (1e-12, 1e-6),
        lambda rng: {"n": rng.uniform(0.6, 0.8), "f_c": log_uniform(rng, 50.0, 500.0)},
        "Jonscher 1977: disordered insulators conduct better by a power of frequency above a knee",
    ),
    Form(
        electrode_polarization,
        (1e-9, 1e-1),
        lambda rng: {
            "n": rng.uniform(0.55, 0.95),
            "r_ct": log_uniform(rng, 1e-2, 1e1),
            "tau_s": log_uniform(rng, 1e-3, 3e-2),
        },
        "Davidson and Cole 1951: below a frequency the constant phase ends in a resistance",
    ),
    Form(
        humid_gap_conduction,
        (1e-11, 1e-3),
        lambda rng: {"power": rng.uniform(0.4, 0.8)},
        "water condenses around asperities in contact, whose area grows with load (Persson 2001)",
    ),
    Form(
        sweat_film,
        (3e-9, 3e-4),
        lambda rng: {"sigma_s": log_uniform(rng, 0.1, 1.0)},
        "a wetting film is as deep everywhere: narrow gaps are full, wide ones hold its depth",
    ),
    Form(
        speed_dependent_gap,
        (2e-9, 2e-5),
        nothing,
        "Landau and Levich 1942: a film that is drawn along is as thick as speed to two thirds",
    ),
]
