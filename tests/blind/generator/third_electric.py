"""The third alternative of every effect in the drive, the layers and the air gap: laws that neither
the catalogue nor the other two alternatives have.
"""

from __future__ import annotations

import numpy as np

from .effect import Form, Strength, log_uniform, nothing, sign
from .touch import STEADY_SPEED, VACUUM, State

QUARTER = (np.arange(48) + 0.5) * np.pi / 96  # midpoints over a quarter of a period
SWEAT_S = 1.0  # S/m
DROP_REF = 1e-5  # m


def amplifier_bandwidth(state: State, knob: Strength, shape: dict) -> None:
    """A line with an open or loaded end, whose Elmore delay is that of one pole."""
    theta = np.sqrt(1j * state.rows.f * knob / 1e6 / (0.5 + shape["load"]))
    gain = 1 / (np.cosh(theta) + shape["load"] * theta * np.sinh(theta))
    state.drive = state.drive * np.abs(gain)
    state.drive_phase = state.drive_phase + np.angle(gain)


def amplifier_slew_limit(state: State, knob: Strength, shape: dict) -> None:
    """Beyond `v_p` the rate falls as one over voltage; loops lag by what they lose."""
    v_p, rate = shape["v_p"], 2 * 5e8 / knob / shape["v_p"] / state.omega
    wave = v_p * (np.sqrt(1 + rate[:, None] * QUARTER) - 1)
    most = 2 * np.mean(np.sin(QUARTER) * wave, axis=1)
    left = (1 + (state.drive / most) ** 4) ** -0.25
    state.drive = state.drive * left
    state.drive_phase = state.drive_phase - np.arccos(left)


def drive_gain_error(state: State, knob: Strength, shape: dict) -> None:
    off, jf = knob * shape["sign"], 1j * state.rows.f / shape["f_p"]
    gain = np.exp(off) * (1 + shape["share"] * off * jf / (1 + jf))
    state.drive = state.drive * np.abs(gain)
    state.drive_phase = state.drive_phase + np.angle(gain)


def series_resistance(state: State, knob: Strength, shape: dict) -> None:
    theta = np.sqrt(state.jw * knob * shape["c_touch"])
    z = 3 * knob * (1 / (theta * np.tanh(theta)) - 1 / theta**2)
    state.stack_add = state.stack_add + state.jw * VACUUM * state.area * z


def floating_body(state: State, knob: Strength, shape: dict) -> None:
    path = 1 + shape["share"] / (1 + 1j * state.rows.f / shape["f_r"])
    state.stack_add = state.stack_add + VACUUM * state.area / (1e-8 / knob * path)


def skin_hydration(state: State, knob: Strength, _shape: dict) -> None:
    share, sweat = np.minimum(knob, 0.9), 80 + SWEAT_S / (state.jw * VACUUM)
    state.k_skin = ((1 - share) * state.k_skin ** (1 / 3) + share * sweat ** (1 / 3)) ** 3


def skin_nonlinearity(state: State, knob: Strength, _shape: dict) -> None:
    def law(volts: np.ndarray) -> np.ndarray:
        b = volts * knob / 100.0
        return 1 + b + b**2 / 3

    state.skin_law = law


def johnsen_rahbek(state: State, knob: Strength, shape: dict) -> None:
    tight, leaky = state.k_insulator, state.k_insulator + knob / (state.jw * VACUUM)
    state.k_insulator = 1 / ((1 - shape["barrier"]) / leaky + shape["barrier"] / tight)


def electrode_polarization(state: State, knob: Strength, shape: dict) -> None:
    root = (state.jw * shape["tau_s"]) ** (shape["n"] / 2)
    z = shape["tau_s"] ** shape["n"] / knob / (root * np.tanh(root))
    state.gap_admittance = state.gap_admittance + 1 / (shape["r_ct"] + z)


def humid_gap_conduction(state: State, knob: Strength, shape: dict) -> None:
    sigma = knob / (1 + state.drive / shape["v_sat"])
    state.k_gap = state.k_gap + sigma / (state.jw * VACUUM)


def sweat_film(state: State, knob: Strength, shape: dict) -> None:
    share = (knob * np.ones_like(state.drive))[:, None]
    state.k_film = 80 + shape["sigma_s"] / (state.jw * VACUUM)
    state.film = lambda u: u * np.minimum(share * (u / DROP_REF) ** -shape["power"], 0.95)


def speed_dependent_gap(state: State, knob: Strength, shape: dict) -> None:
    rise = np.log1p(state.rows.speed / shape["v0"]) / np.log1p(STEADY_SPEED / shape["v0"])
    state.gap_add = state.gap_add + knob * rise


FORMS = [
    Form(
        amplifier_bandwidth,
        (0.05, 2e4),
        lambda rng: {"load": rng.uniform(0.0, 0.5)},
        "Kelvin 1855: a film resistor over ground, or a resistive lead, is a line: it falls by the"
        " exponential of a root of frequency",
    ),
    Form(
        amplifier_slew_limit,
        (0.1, 5e5),
        lambda rng: {"v_p": log_uniform(rng, 20.0, 100.0)},
        "a flyback stage of limited power charges slower the higher the voltage: amplitude falls"
        " by the root of frequency",
    ),
    Form(
        drive_gain_error,
        (0.01, 1.0),
        lambda rng: {
            "sign": sign(rng),
            "share": rng.uniform(0.1, 0.3),
            "f_p": log_uniform(rng, 100.0, 1e4),
        },
        "an ill compensated divider sets the gain: by resistors at low frequency, capacitors above",
    ),
    Form(
        series_resistance,
        (1.0, 3e7),
        lambda rng: {"c_touch": log_uniform(rng, 2e-11, 2e-10)},
        "Berger 1972: current crowds to the edge of a contact on a resistive film; the resistance"
        " falls by the root of frequency",
    ),
    Form(
        floating_body,
        (0.1, 1e4),
        lambda rng: {"share": log_uniform(rng, 0.5, 3.0), "f_r": log_uniform(rng, 100.0, 1e4)},
        "Debye: a second capacitance to ground, behind the resistance of a chair or table, follows"
        " at low frequency alone",
    ),
    Form(
        skin_hydration,
        (0.001, 0.8),
        nothing,
        "Looyenga 1965: cube roots of permittivities of tissue and of sweat add by volume",
    ),
    Form(
        skin_nonlinearity,
        (0.01, 1e3),
        nothing,
        "Onsager 1934: a field dissociates a weak electrolyte, in proportion to it at first",
    ),
    Form(
        johnsen_rahbek,
        (1e-12, 1e-6),
        lambda rng: {"barrier": rng.uniform(0.05, 0.25)},
        "Maxwell and Wagner: a tight barrier, such as an oxide, in series with the leaky layer",
    ),
    Form(
        electrode_polarization,
        (1e-9, 1e-1),
        lambda rng: {
            "n": rng.uniform(0.55, 0.95),
            "r_ct": log_uniform(rng, 1e-2, 1e1),
            "tau_s": log_uniform(rng, 3e-6, 3e-4),
        },
        "de Levie 1963: a pore is a line: half the power of frequency above, a resistance more"
        " below",
    ),
    Form(
        humid_gap_conduction,
        (1e-11, 1e-3),
        lambda rng: {"v_sat": log_uniform(rng, 20.0, 150.0)},
        "Thomson 1896: a voltage draws ions out faster than they form: conductivity falls with it",
    ),
    Form(
        sweat_film,
        (0.003, 0.9),
        lambda rng: {"sigma_s": log_uniform(rng, 0.1, 1.0), "power": rng.uniform(0.06, 0.15)},
        "Family and Meakin 1989: sizes of drops fall by a power: the wider a gap, the fewer wet it",
    ),
    Form(
        speed_dependent_gap,
        (2e-9, 2e-5),
        lambda rng: {"v0": log_uniform(rng, 5e-4, 5e-3)},
        "Dieterich and Kilgore 1994: asperities sink by the logarithm of how long they touch",
    ),
]
