"""Hidden effects that no catalogue entry describes: they live in the measuring chain, the screen or
the room.
"""

from __future__ import annotations

import numpy as np

from .effect import Effect, log_uniform, nothing, sign
from .touch import CREEP_SPEED, State


def peak(x: np.ndarray, centre: float, width: float) -> np.ndarray:
    return 1 / (1 + ((x - centre) / width) ** 2)


def sensor_resonance_speed(state: State, knob: float, shape: dict, _alt: bool) -> None:
    bump = peak(np.log(np.maximum(state.rows.speed, CREEP_SPEED)), np.log(shape["v_r"]), 0.25)
    state.after.append(lambda _rows, mu, _force: mu * (1 + knob * bump))


def sensor_resonance_frequency(state: State, knob: float, shape: dict, _alt: bool) -> None:
    x = np.log(state.rows.f / shape["f_r"])
    swing = x / 0.5 / (1 + (x / 0.5) ** 2)  # dispersive: above on one side, below on the other
    live = state.rows.v > 0
    state.after.append(lambda _rows, mu, _force: mu * np.where(live, 1 + knob * 2 * swing, 1.0))


def screen_resonance(state: State, knob: float, shape: dict, _alt: bool) -> None:
    bump = np.where(state.rows.v > 0, peak(np.log(state.rows.f), np.log(shape["f_r"]), 0.25), 0.0)
    state.after.append(lambda _rows, mu, _force: mu * (1 + shape["sign"] * knob * bump))


def gain_drift(state: State, knob: float, shape: dict, _alt: bool) -> None:
    t = state.rows.time
    ramp = shape["sign"] * (t - t.mean()) / max(np.ptp(t), 1.0)
    off = state.finger.mu_off

    def scale(rows, mu, force):
        return mu + off * force / rows.n * np.clip(knob * ramp, -0.9, 9.0)

    state.after.append(scale)


def force_quantiser(state: State, knob: float, _shape: dict, _alt: bool) -> None:
    state.after.append(
        lambda rows, mu, _force: np.maximum(np.round(mu * rows.n / knob), 1) * knob / rows.n
    )


def humidity_ramp(state: State, knob: float, shape: dict, _alt: bool) -> None:
    t = state.rows.time
    ramp = (t - t.min()) / max(np.ptp(t), 1.0)
    window = peak(np.log(state.rows.f), np.log(shape["f_m"]), 1.2)
    off = state.finger.mu_off
    state.after.append(
        lambda rows, mu, force: mu - off * force / rows.n * np.minimum(knob * ramp * window, 0.95)
    )


def mains_interference(state: State, knob: float, _shape: dict, _alt: bool) -> None:
    near = peak(np.log(state.rows.f), np.log(50.0), 0.08) + 0.6 * peak(
        np.log(state.rows.f), np.log(100.0), 0.08
    )
    near = np.where(state.rows.v > 0, near, 0.0)
    state.after.append(lambda _rows, mu, _force: mu * (1 + knob * near))


def sensor_crosstalk(state: State, knob: float, shape: dict, _alt: bool) -> None:
    state.after.append(
        lambda rows, mu, _force: np.maximum(mu + shape["sign"] * knob * (1 - 0.5 / rows.n), 0.05)
    )


def lateral_saturation(state: State, knob: float, _shape: dict, _alt: bool) -> None:
    top = 1.0 / knob  # N
    state.after.append(lambda rows, mu, _force: np.minimum(mu * rows.n, top) / rows.n)


def stick_slip(state: State, knob: float, shape: dict, _alt: bool) -> None:
    slow = np.exp(-((state.rows.speed / shape["v_ss"]) ** 2))
    state.after.append(
        lambda rows, mu, force: mu * (1 - min(knob, 0.9) * slow * force / (rows.n + force))
    )


def make(apply, knob, draw, needs="") -> Effect:
    return Effect(apply, knob, draw, lambda s, shape: {"strength": s, **shape}, needs)


EFFECTS = [
    make(
        sensor_resonance_speed,
        (0.003, 2.0),
        lambda rng: {"v_r": log_uniform(rng, 0.012, 0.06)},
        "speed_m_s",
    ),
    make(
        sensor_resonance_frequency, (0.003, 0.8), lambda rng: {"f_r": log_uniform(rng, 60.0, 2e3)}
    ),
    make(
        screen_resonance,
        (0.003, 2.0),
        lambda rng: {"f_r": float(rng.choice([100.0, 250.0, 500.0, 1e3, 1e4])), "sign": 1.0},
    ),
    make(gain_drift, (0.01, 6.0), lambda rng: {"sign": sign(rng)}, "time_s"),
    make(force_quantiser, (0.003, 0.6), nothing),
    make(humidity_ramp, (0.01, 0.95), lambda rng: {"f_m": log_uniform(rng, 30.0, 3e4)}, "time_s"),
    make(mains_interference, (0.003, 2.0), nothing),
    make(sensor_crosstalk, (0.003, 0.5), lambda rng: {"sign": sign(rng)}),
    make(lateral_saturation, (0.5, 12.0), nothing),
    make(
        stick_slip, (0.01, 0.9), lambda rng: {"v_ss": log_uniform(rng, 0.008, 0.025)}, "speed_m_s"
    ),
]
