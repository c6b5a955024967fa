"""The second alternative of every effect in the pressure, the load, the friction and the contact.

Each form says in its `reason` whose law it is, or why a device or a finger would follow it.
"""

from __future__ import annotations

import numpy as np

from .effect import Form, Strength, log_uniform, nothing, sign
from .touch import CREEP_SPEED, STEADY_SPEED, State

F_REF = 0.5  # N
GAP_REF = 40e-6  # m, about the mean gap under a sliding finger
PASCHEN_GAP = 7.61e-4  # m, (6.72/24.36)^2 cm
BELL_WIDTH = 2.0  # of the logarithm of speed


def trapped_charge(state: State, knob: Strength, shape: dict) -> None:
    share = np.where(state.drive > 0, 1.0, shape["at_rest"])
    by_load = (state.rows.n / F_REF) ** (2 * shape["power"])
    state.bias_square = state.bias_square + knob**2 * share * by_load


def air_breakdown(state: State, knob: Strength, _shape: dict) -> None:
    top = 1e9 / knob

    def cap(field: np.ndarray, gap: np.ndarray) -> np.ndarray:
        narrow = 1 + np.sqrt(PASCHEN_GAP / np.maximum(gap, 1e-12))
        return np.minimum(field, top * narrow / (1 + np.sqrt(PASCHEN_GAP / GAP_REF)))

    state.field_cap = cap


def capillary_adhesion(state: State, knob: Strength, shape: dict) -> None:
    speed = np.maximum(state.rows.speed, CREEP_SPEED) / STEADY_SPEED
    state.load_add = state.load_add + knob * np.maximum(1 - shape["slope"] * np.log(speed), 0.1)


def electrowetting(state: State, knob: Strength, shape: dict) -> None:
    over = 3 * (state.drive / shape["v_sat"]) ** 2
    much = np.maximum(over, 1e-3)  # below, Langevin's function is a third of it
    saturating = shape["v_sat"] ** 2 * np.where(over > 1e-3, 1 / np.tanh(much) - 1 / much, over / 3)
    low_pass = 1 / np.sqrt(1 + (state.rows.f / shape["f_c"]) ** 2)
    state.load_add = state.load_add + knob * saturating * low_pass


def load_dependent_friction(state: State, knob: Strength, shape: dict) -> None:
    m, bulge = 1 - knob * shape["sign"], shape["bulge_n"]

    def grown(load: np.ndarray | float) -> np.ndarray | float:
        return (1 + load / bulge) ** m - 1

    state.load_law = lambda n, e: F_REF / n * grown(n + e) / grown(F_REF)


def velocity_dependent_friction(state: State, knob: Strength, shape: dict) -> None:
    def bell(speed: np.ndarray | float) -> np.ndarray | float:
        return np.exp(-((np.log(speed / shape["v_peak"]) / BELL_WIDTH) ** 2))

    rise = bell(np.maximum(state.rows.speed, CREEP_SPEED)) - bell(STEADY_SPEED)
    state.mu_factor = state.mu_factor * np.maximum(1 + shape["sign"] * knob * rise, 0.05)


def contact_ageing(state: State, knob: Strength, shape: dict) -> None:
    t, tau, end = state.rows.time, shape["tau_s"], shape["end_s"]
    rise = np.log1p(t * end / (t + end) / tau) / np.log1p(end / tau)
    state.mu_factor = state.mu_factor * np.maximum(1 + shape["sign"] * knob * rise, 0.05)


def viscoelastic_skin(state: State, knob: Strength, shape: dict) -> None:
    glassy = np.expm1(4 * knob)

    def modulus(speed: np.ndarray | float) -> np.ndarray | float:
        x = (speed / shape["v_c"]) ** 0.8
        return 1 + glassy * x / (1 + x)

    factor = modulus(np.maximum(state.rows.speed, CREEP_SPEED)) / modulus(STEADY_SPEED)
    state.stiffness = state.stiffness * np.clip(factor, 0.1, 10.0)


def contact_area_law(state: State, knob: Strength, _shape: dict) -> None:
    load, least = state.rows.n / F_REF, 1 - np.minimum(knob, 0.95)
    state.spread = state.spread * load / (least * load + 1 - least)


def charge_build_up(state: State, knob: Strength, shape: dict) -> None:
    t, tau, end = np.maximum(state.rows.time, 0.0), shape["tau_s"], shape["end_s"]
    rise = np.log1p(t * end / (t + end) / tau) / np.log1p(end / tau)
    injected = state.rows.v / (state.rows.v + shape["v_half"])
    screened = rise * injected / (1 + (state.rows.f / shape["f_b"]) ** 0.8)
    state.kept = state.kept * (1 - np.minimum(knob, 0.98) * screened)


FORMS = [
    Form(
        trapped_charge,
        (0.5, 120.0),
        lambda rng: {"at_rest": rng.uniform(0.2, 0.8), "power": rng.uniform(0.15, 0.35)},
        "Lowell and Rose-Innes 1980: charge grows with real contact; a part acts at rest",
    ),
    Form(
        air_breakdown,
        (0.5, 1e3),
        nothing,
        "Kuffel, Zaengl and Kuffel 2000: air holds 24.36 + 6.72/sqrt(gap in cm) kV/cm",
    ),
    Form(
        capillary_adhesion,
        (5.0, 2e4),
        lambda rng: {"slope": rng.uniform(0.2, 0.4)},
        "Riedo 2002: bridges need time to condense: their pull falls with the logarithm of speed",
        needs="speed_m_s",
    ),
    Form(
        electrowetting,
        (1e-4, 20.0),
        lambda rng: {"v_sat": log_uniform(rng, 30.0, 150.0), "f_c": log_uniform(rng, 20.0, 5e3)},
        "aligning dipoles saturate by Langevin's function; a droplet follows in amplitude",
    ),
    Form(
        load_dependent_friction,
        (0.003, 0.6),
        lambda rng: {
            "sign": 1.0 if rng.random() < 0.8 else -1.0,
            "bulge_n": log_uniform(rng, 0.05, 0.3),
        },
        "power of load with an offset: proportional at first, then the pad spreads less",
    ),
    Form(
        velocity_dependent_friction,
        (0.005, 1.5),
        lambda rng: {"sign": sign(rng), "v_peak": log_uniform(rng, 0.06, 0.3)},
        "Grosch 1963: friction of rubber over the logarithm of speed is a bell",
    ),
    Form(
        contact_ageing,
        (0.003, 0.9),
        lambda rng: {
            "tau_s": log_uniform(rng, 2.0, 30.0),
            "end_s": log_uniform(rng, 300.0, 2000.0),
            "sign": 1.0 if rng.random() < 0.75 else -1.0,
        },
        "Dieterich 1972: contacts age with the logarithm of time; skin ends when it is moist",
    ),
    Form(
        viscoelastic_skin,
        (0.005, 1.0),
        lambda rng: {"v_c": log_uniform(rng, 0.05, 0.2)},
        "Bagley and Torvik 1983: a solid with a fractional derivative rises over more decades",
    ),
    Form(
        contact_area_law,
        (0.005, 0.9),
        nothing,
        "Serina 1998: the area of a fingertip grows fast under light load, then hardly: saturation",
    ),
    Form(
        charge_build_up,
        (0.005, 0.98),
        lambda rng: {
            "tau_s": log_uniform(rng, 0.1, 1.0),
            "end_s": log_uniform(rng, 5.0, 60.0),
            "f_b": log_uniform(rng, 3.0, 300.0),
            "v_half": log_uniform(rng, 10.0, 60.0),
        },
        "Curie and von Schweidler: absorbed charge goes with the logarithm of time; more volts"
        " inject more of it",
    ),
]
