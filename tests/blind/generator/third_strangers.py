"""Ten more effects that no catalogue entry describes: faults of instruments, a finger's ways and
the room. The two of `UNFELT` leave no trace in friction.
"""

from __future__ import annotations

import numpy as np

from .effect import Effect, log_uniform, nothing, sign
from .strangers import make, peak
from .touch import State


def amplifier_warm_up(state: State, knob: float, shape: dict, _alt: bool) -> None:
    """Gain creeps while the amplifier becomes warm."""
    warm = 1 - np.exp(-state.rows.time / shape["tau_s"])
    state.drive = state.drive * np.exp(shape["sign"] * knob * warm)


def supply_clipping(state: State, knob: float, _shape: dict, _alt: bool) -> None:
    """Sines are cut flat at the supply."""
    x = np.minimum(200.0 / knob / np.maximum(state.drive, 1e-9), 1.0)
    state.drive = state.drive * 2 / np.pi * (np.arcsin(x) + x * np.sqrt(1 - x**2))


def supply_recovery(state: State, knob: float, _shape: dict, _alt: bool) -> None:
    """The supply still sags from the row before."""
    before = 0.0 if state.rows.before is None else state.rows.before
    state.drive = state.drive * np.exp(-knob * before / 100.0)


def leaky_cable(state: State, knob: float, _shape: dict, _alt: bool) -> None:
    """The cable's insulation conducts, finger or none."""
    state.monitors.append(lambda _rows, voltage, current: (voltage, current + knob * voltage))


def monitor_range(state: State, knob: float, _shape: dict, _alt: bool) -> None:
    """The current monitor bends at the end of its range, 1 A / `knob`."""
    state.monitors.append(
        lambda _rows, voltage, i: (voltage, i / np.sqrt(1 + np.abs(knob * i) ** 2))
    )


def air_conditioning(state: State, knob: float, shape: dict, _alt: bool) -> None:
    """The room is dry and humid by turns."""
    turn = np.sin(2 * np.pi * state.rows.time / shape["period_s"] + shape["phase"])
    state.mu_factor = state.mu_factor * np.exp(knob * turn)


def flinch(state: State, knob: float, shape: dict, _alt: bool) -> None:
    """A finger that feels vibration lifts a little: most where skin feels most (Verrillo 1963)."""
    felt = (
        peak(np.log(2 * state.rows.f), np.log(shape["f_felt"]), 0.7) * (state.rows.v / 100.0) ** 2
    )
    state.after.append(lambda _rows, mu, _force: mu / (1 + knob * felt))


def dust(state: State, knob: float, shape: dict, _alt: bool) -> None:
    """A fibre props the finger up, the less the harder it presses."""
    state.gap_add = state.gap_add + knob * np.exp(-state.rows.n / shape["n_0"])


def weighed_attraction(state: State, knob: float, _shape: dict, _alt: bool) -> None:
    """The load cell weighs a share of the attraction too, and friction is divided by it."""
    state.after.append(lambda rows, mu, force: mu * rows.n / (rows.n + np.minimum(knob, 1) * force))


def aliased_sampling(state: State, knob: float, shape: dict, _alt: bool) -> None:
    """Samples in step with the drive meet friction's swing, of twice its frequency, at a phase."""
    swing = np.cos(4 * np.pi * state.rows.f / shape["rate_hz"]) / (1 + (state.rows.f / 500.0) ** 2)
    off = state.finger.mu_off
    state.after.append(lambda rows, mu, force: mu + knob * off * force / rows.n * swing)


EFFECTS: list[Effect] = [
    make(
        amplifier_warm_up,
        (0.003, 1.0),
        lambda rng: {"tau_s": log_uniform(rng, 50.0, 300.0), "sign": sign(rng)},
        "time_s",
    ),
    make(supply_clipping, (1.6, 8.0), nothing),
    make(supply_recovery, (0.003, 1.0), nothing, "before"),
    make(leaky_cable, (1e-10, 1e-3), nothing),
    make(monitor_range, (1.0, 1e6), nothing),
    make(
        air_conditioning,
        (0.003, 0.7),
        lambda rng: {
            "period_s": float(rng.uniform(150.0, 400.0)),
            "phase": float(rng.uniform(0.0, 2 * np.pi)),
        },
        "time_s",
    ),
    make(flinch, (0.01, 5.0), lambda rng: {"f_felt": log_uniform(rng, 150.0, 350.0)}),
    make(dust, (1e-8, 3e-5), lambda rng: {"n_0": log_uniform(rng, 0.15, 0.5)}),
    make(weighed_attraction, (0.01, 1.0), nothing),
    make(aliased_sampling, (0.01, 0.95), lambda rng: {"rate_hz": log_uniform(rng, 300.0, 1200.0)}),
]
UNFELT = {"leaky_cable", "monitor_range"}
