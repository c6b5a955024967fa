"""Effects in the pressure, the load, the friction law and the contact (physics.md section 5), two
forms each.
"""

from __future__ import annotations

import numpy as np

from .effect import Effect, log_uniform, nothing, sign
from .touch import CREEP_SPEED, STEADY_SPEED, State

F_REF = 0.5  # N


def trapped_charge(state: State, knob: float, _shape: dict, alternative: bool) -> None:
    live = state.drive > 0  # a shorted electrode at rest: the static field is screened by leakage
    share = state.drive**2 / (state.drive**2 + 15.0**2) if alternative else 1.0
    state.bias_square = state.bias_square + np.where(live, knob**2 * share, 0.0)


def air_breakdown(state: State, knob: float, _shape: dict, alternative: bool) -> None:
    top = 1e9 / knob
    if alternative:
        state.field_cap = lambda e, _gap: e / (1 + (e / top) ** 2) ** 0.5
    else:
        state.field_cap = lambda e, _gap: np.minimum(e, top)


def capillary_adhesion(state: State, knob: float, shape: dict, alternative: bool) -> None:
    area = (state.rows.n / F_REF) ** shape["bridges"] if alternative else 1.0
    state.load_add = state.load_add + knob * area


def electrowetting(state: State, knob: float, shape: dict, alternative: bool) -> None:
    f, v, sat = state.rows.f, state.drive, shape["v_sat"]
    if alternative:
        extra = sat**2 * (1 - np.exp(-((v / sat) ** 2))) / (1 + (f / shape["f_c"]) ** 1.3)
    else:
        extra = v**2 / (1 + (v / sat) ** 2) / (1 + (f / shape["f_c"]) ** 2)
    state.load_add = state.load_add + knob * extra


def load_dependent_friction(state: State, knob: float, shape: dict, alternative: bool) -> None:
    m = 1 - knob * shape["sign"]
    if alternative:  # a sum of two contact regimes with the same slope at the reference load
        flat = knob * shape["sign"] / (1 / 3)
        state.load_law = lambda n, e: (
            F_REF / n * ((1 - flat) * (n + e) / F_REF + flat * ((n + e) / F_REF) ** (2 / 3))
        )
    else:
        state.load_law = lambda n, e: F_REF / n * ((n + e) / F_REF) ** m


def velocity_dependent_friction(state: State, knob: float, shape: dict, alternative: bool) -> None:
    v = np.maximum(state.rows.speed, CREEP_SPEED)
    if alternative:  # Stribeck-like: a boundary level that gives way to a lower or higher one
        factor = 1 + shape["sign"] * knob * 2.2 * (np.exp(-STEADY_SPEED / 0.03) - np.exp(-v / 0.03))
    else:
        factor = (v / STEADY_SPEED) ** (shape["sign"] * knob)
    state.mu_factor = state.mu_factor * np.maximum(factor, 0.05)


def contact_ageing(state: State, knob: float, shape: dict, alternative: bool) -> None:
    t, tau = state.rows.time, shape["tau_s"]
    left = np.exp(-((t / tau) ** 0.7)) if alternative else np.exp(-t / tau)
    state.mu_factor = state.mu_factor * np.maximum(1 + shape["sign"] * knob * (1 - left), 0.05)


def viscoelastic_skin(state: State, knob: float, _shape: dict, alternative: bool) -> None:
    v = np.maximum(state.rows.speed, CREEP_SPEED) / STEADY_SPEED
    if alternative:  # standard linear solid: soft at rest, stiff above a speed
        top = np.exp(4 * knob)
        factor = (1 + top * (v / 2) ** 2) / (1 + (v / 2) ** 2) / ((1 + top / 4) / (1 + 1 / 4))
    else:
        factor = v**knob
    state.stiffness = state.stiffness * np.clip(factor, 0.1, 10.0)


def contact_area_law(state: State, knob: float, _shape: dict, alternative: bool) -> None:
    load = state.rows.n / F_REF
    if alternative:  # a flat part that load does not change, and a Hertzian one
        share = knob / (2 / 3)
        factor = np.maximum(1 + share * (load ** (2 / 3) - 1), 0.05)
    else:
        factor = load**knob
    state.spread = state.spread * factor


def charge_build_up(state: State, knob: float, shape: dict, alternative: bool) -> None:
    over, t = state.rows.f / shape["f_b"], np.maximum(state.rows.time, 0) / shape["tau_s"]
    if alternative:  # relaxation times that are spread, in time as in frequency
        screened = (1 - np.exp(-(t**0.6))) / (1 + over)
    else:
        screened = (1 - np.exp(-t)) / (1 + over**2)
    state.kept = state.kept * (1 - np.minimum(knob, 0.98) * screened)


EFFECTS = [
    Effect(trapped_charge, (0.5, 120.0), nothing, lambda s, _: {"v_s_v": s}),
    Effect(air_breakdown, (0.5, 1e3), nothing, lambda s, _: {"e_bd_v_per_m": 1e9 / s}),
    Effect(
        capillary_adhesion,
        (5.0, 2e4),
        lambda rng: {"bridges": sign(rng) * rng.uniform(0.15, 0.35)},
        lambda s, _: {"pressure_pa": s},
    ),
    Effect(
        electrowetting,
        (1e-4, 20.0),
        lambda rng: {"v_sat": log_uniform(rng, 30.0, 150.0), "f_c": log_uniform(rng, 20.0, 5e3)},
        lambda s, shape: {"c_pa_per_v2": s, "v_sat_v": shape["v_sat"], "f_c_hz": shape["f_c"]},
    ),
    Effect(
        load_dependent_friction,
        (0.003, 0.3),
        lambda rng: {"sign": 1.0 if rng.random() < 0.8 else -1.0},
        lambda s, shape: {"m": 1 - s * shape["sign"], "f_ref_n": F_REF},
    ),
    Effect(
        velocity_dependent_friction,
        (0.002, 0.4),
        lambda rng: {"sign": sign(rng)},
        lambda s, shape: {"exponent": s * shape["sign"], "v_ref_m_per_s": STEADY_SPEED},
        needs="speed_m_s",
    ),
    Effect(
        contact_ageing,
        (0.003, 0.9),
        lambda rng: {
            "tau_s": log_uniform(rng, 60.0, 900.0),
            "sign": 1.0 if rng.random() < 0.75 else -1.0,
        },
        lambda s, shape: {"relative_rise": s * shape["sign"], "tau_s": shape["tau_s"]},
        needs="time_s",
    ),
    Effect(
        viscoelastic_skin,
        (0.005, 1.0),
        nothing,
        lambda s, _: {"exponent": s, "v_ref_m_per_s": STEADY_SPEED},
        needs="speed_m_s",
    ),
    Effect(contact_area_law, (0.005, 0.7), nothing, lambda s, _: {"exponent": s, "f_ref_n": F_REF}),
    Effect(
        charge_build_up,
        (0.005, 0.95),
        lambda rng: {"tau_s": log_uniform(rng, 0.3, 10.0), "f_b": log_uniform(rng, 3.0, 300.0)},
        lambda s, shape: {"share": s, "tau_s": shape["tau_s"], "f_b_hz": shape["f_b"]},
        needs="time_s",
    ),
]
