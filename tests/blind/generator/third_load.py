"""The third alternative of every effect in the pressure, the load, the friction and the contact."""

from __future__ import annotations

import numpy as np

from .effect import Form, Strength, log_uniform, sign
from .touch import CREEP_SPEED, STEADY_SPEED, State

F_REF = 0.5  # N


def _speed(state: State) -> np.ndarray:
    return np.maximum(state.rows.speed, CREEP_SPEED)


def trapped_charge(state: State, knob: Strength, shape: dict) -> None:
    rubbed = (_speed(state) / STEADY_SPEED) ** (2 * shape["power"])
    state.bias_square = state.bias_square + np.where(state.drive > 0, knob**2 * rubbed, 0.0)


def air_breakdown(state: State, knob: Strength, shape: dict) -> None:
    top = np.reshape(1e9 / knob, (-1, 1))
    state.field_cap = lambda field, gap: np.minimum(field, top / np.maximum(gap / shape["d"], 1.0))


def capillary_adhesion(state: State, knob: Strength, shape: dict) -> None:
    def formed(speed: np.ndarray | float, load: np.ndarray | float) -> np.ndarray | float:
        return 1 / (1 + speed / shape["v_c"] * (load / F_REF) ** (-1 / 3))

    share = formed(_speed(state), state.rows.n) / formed(STEADY_SPEED, F_REF)
    state.load_add = state.load_add + knob * share


def electrowetting(state: State, knob: Strength, shape: dict) -> None:
    low_pass = (1 - shape["floor"]) / (1 + (state.rows.f / shape["f_c"]) ** 2) + shape["floor"]
    state.load_add = state.load_add + knob * np.minimum(state.drive, shape["v_sat"]) ** 2 * low_pass


def load_dependent_friction(state: State, knob: Strength, shape: dict) -> None:
    def bent(load: np.ndarray | float) -> np.ndarray | float:
        return load - shape["sign"] * knob * np.maximum(load - shape["knee_n"], 0.0)

    state.load_law = lambda n, e: F_REF / n * bent(n + e) / bent(F_REF)


def velocity_dependent_friction(state: State, knob: Strength, shape: dict) -> None:
    v0 = shape["v0"]
    rise = np.arcsinh(_speed(state) / v0) - np.arcsinh(STEADY_SPEED / v0)
    state.mu_factor = state.mu_factor * np.maximum(1 + shape["sign"] * knob * rise, 0.05)


def contact_ageing(state: State, knob: Strength, shape: dict) -> None:
    filled = (np.maximum(state.rows.time, 0.0) / shape["tau_s"]) ** shape["power"]
    rise = filled / (1 + filled)
    state.mu_factor = state.mu_factor * np.maximum(1 + shape["sign"] * knob * rise, 0.05)


def viscoelastic_skin(state: State, knob: Strength, shape: dict) -> None:
    def modulus(speed: np.ndarray | float) -> np.ndarray | float:
        slow, fast = (1 + (speed / shape[v]) ** 2 for v in ("v_slow", "v_fast"))
        return 1 + np.expm1(3 * knob) / 2 * np.log(slow / fast)

    factor = modulus(_speed(state)) / modulus(STEADY_SPEED)
    state.stiffness = state.stiffness * np.clip(factor, 0.1, 10.0)


def contact_area_law(state: State, knob: Strength, shape: dict) -> None:
    indented = np.log1p(state.rows.n / shape["f_0"]) / np.log1p(F_REF / shape["f_0"])
    state.spread = state.spread * np.maximum(1 + knob * (indented - 1), 0.05)


def charge_build_up(state: State, knob: Strength, shape: dict) -> None:
    filled = np.maximum(state.rows.time, 0.0) / shape["tau_s"] * state.rows.v / 75.0
    root = np.sqrt(1j * np.maximum(state.rows.f, 1e-3) / shape["f_b"])
    screened = filled / (1 + filled) * np.abs(np.tanh(root) / root)
    state.kept = state.kept * (1 - np.minimum(knob, 0.98) * screened)


FORMS = [
    Form(
        trapped_charge,
        (0.5, 120.0),
        lambda rng: {"power": rng.uniform(0.15, 0.4)},
        "Harper 1967: rubbing makes the charge and a quiet contact lets it go: more at speed",
        needs="speed_m_s",
    ),
    Form(
        air_breakdown,
        (0.5, 1e3),
        lambda rng: {"d": log_uniform(rng, 5e-6, 2e-5)},
        "Slade and Taylor 2002: a few micrometres hold a field, wider gaps a voltage",
    ),
    Form(
        capillary_adhesion,
        (5.0, 2e4),
        lambda rng: {"v_c": log_uniform(rng, 0.03, 0.15)},
        "Langmuir's kinetics: a spot bears a bridge for that part of its passage, contact's length"
        " over speed, which is left after the bridge has formed",
        needs="speed_m_s",
    ),
    Form(
        electrowetting,
        (1e-4, 20.0),
        lambda rng: {
            "v_sat": log_uniform(rng, 30.0, 150.0),
            "f_c": log_uniform(rng, 20.0, 5e3),
            "floor": rng.uniform(0.03, 0.15),
        },
        "Peykov 2000: the angle stops at a voltage; Jones 2003: what is left above a frequency is"
        " the pull on a dielectric",
    ),
    Form(
        load_dependent_friction,
        (0.005, 0.9),
        lambda rng: {"sign": 1.0 if rng.random() < 0.8 else -1.0, "knee_n": rng.uniform(0.4, 0.8)},
        "Tomlinson 2009: friction of fingers over load is two straight lines that meet",
    ),
    Form(
        velocity_dependent_friction,
        (0.002, 0.6),
        lambda rng: {"sign": sign(rng), "v0": log_uniform(rng, 0.01, 0.06)},
        "Eyring 1936, Prandtl 1928: barriers tilted by force: the area sine of speed",
    ),
    Form(
        contact_ageing,
        (0.003, 0.9),
        lambda rng: {
            "tau_s": log_uniform(rng, 100.0, 700.0),
            "power": rng.uniform(1.5, 3.0),
            "sign": 1.0 if rng.random() < 0.75 else -1.0,
        },
        "Hill 1910: sweat fills its ducts before it wets the surface: late, then fast, then full",
    ),
    Form(
        viscoelastic_skin,
        (0.005, 1.0),
        lambda rng: {"v_slow": log_uniform(rng, 3e-3, 1.5e-2), "v_fast": log_uniform(rng, 0.1, 1)},
        "Fung 1972: soft tissue loses the same at all rates of a band: modulus by their logarithm",
    ),
    Form(
        contact_area_law,
        (0.005, 1.5),
        lambda rng: {"f_0": log_uniform(rng, 0.05, 0.3)},
        "Pawluk and Howe 1999: a pad's force is exponential in depth, and a cap's area goes with"
        " depth",
    ),
    Form(
        charge_build_up,
        (0.005, 0.98),
        lambda rng: {"tau_s": log_uniform(rng, 0.3, 30.0), "f_b": log_uniform(rng, 3.0, 100.0)},
        "Langmuir 1918: traps fill as time and voltage bring charge; Warburg 1899: what diffuses"
        " falls by the root of frequency",
    ),
]
