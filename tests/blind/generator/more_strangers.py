"""Ten more effects that no catalogue entry describes; seven act on the electrode's own witnesses.

Two of the seven leave no trace in friction at low frequency: `cable_resonance`, and at any
frequency `monitor_roll_off`.
"""

from __future__ import annotations

import numpy as np

from .effect import Effect, log_uniform, nothing
from .strangers import make, peak
from .touch import State

F_REF = 0.5  # N


def cable_resonance(state: State, knob: float, shape: dict, _alt: bool) -> None:
    """The cable's inductance resonates with what hangs on it."""
    x = state.rows.f * knob / 1e8
    gain = 1 / (1 - x**2 + 1j * x / shape["quality"])
    state.drive = state.drive * np.abs(gain)
    state.drive_phase = state.drive_phase + np.angle(gain)


def monitor_roll_off(state: State, knob: float, _shape: dict, _alt: bool) -> None:
    """The current monitor has one pole; the current itself is as it should be."""
    pole = 1 + 1j * state.rows.f * knob / 1e8
    state.monitors.append(lambda _rows, voltage, current: (voltage, current / pole))


def insulator_warming(state: State, knob: float, shape: dict, _alt: bool) -> None:
    """The insulator's permittivity rises while the screen becomes warm."""
    warm = 1 - np.exp(-state.rows.time / shape["tau_s"])
    state.k_insulator = state.k_insulator * (1 + knob * warm)


def crossover_distortion(state: State, knob: float, _shape: dict, _alt: bool) -> None:
    """Nothing comes out of the amplifier within `knob` volts of zero."""
    x = np.minimum(knob / np.maximum(state.drive, 1e-9), 0.98)
    state.drive = state.drive * (1 - 2 / np.pi * (np.arcsin(x) + x * np.sqrt(1 - x**2)))


def amplitude_steps(state: State, knob: float, shape: dict, _alt: bool) -> None:
    """The generator's attenuator has equal steps of the logarithm."""
    place = np.log(np.maximum(state.drive, 1e-9)) / knob - shape["place"]
    state.drive = np.where(state.drive > 0, np.exp(knob * (np.round(place) + shape["place"])), 0.0)


def electroosmotic_wetting(state: State, knob: float, shape: dict, _alt: bool) -> None:
    """Voltage draws sweat into the skin as time goes on; at a few volts it draws none."""
    wet = knob * (state.drive / 100.0) ** 2 * (1 - np.exp(-state.rows.time / shape["tau_s"]))
    state.k_skin = state.k_skin.real * (1 + 0.3 * wet) + 1j * state.k_skin.imag * (1 + 10 * wet)


def electrode_edge(state: State, knob: float, _shape: dict, _alt: bool) -> None:
    """The finger creeps over the electrode's edge: what is beyond neither attracts nor conducts."""
    state.cover = state.cover / (1 + knob * state.rows.time / 300.0)


def ridge_resonance(state: State, knob: float, shape: dict, _alt: bool) -> None:
    """Attraction at twice the drive's frequency meets the rate of passing ridges: load swings."""
    passing = np.maximum(state.rows.speed, 1e-3) / shape["pitch_m"]
    met = np.where(state.rows.v > 0, peak(np.log(2 * state.rows.f / passing), 0.0, 0.6), 0.0)
    state.after.append(lambda _rows, mu, _force: mu * (1 - np.minimum(knob, 0.9) * met))


def loaded_sensor_resonance(state: State, knob: float, shape: dict, _alt: bool) -> None:
    """The force sensor resonates with the contact's stiffness, which rises with load."""
    x = np.log(state.rows.f / shape["f_r"]) - 0.5 * np.log(state.rows.n / F_REF)
    swing = 2 * (x / 0.35) / (1 + (x / 0.35) ** 2)
    live = state.rows.v > 0
    state.after.append(lambda _rows, mu, _force: mu * np.where(live, 1 + knob * swing, 1.0))


def dielectric_absorption(state: State, knob: float, _shape: dict, _alt: bool) -> None:
    """The insulator holds a share of the voltage of the row before: Curie and von Schweidler."""
    before = 0.0 if state.rows.before is None else state.rows.before
    state.bias_square = state.bias_square + (knob * before) ** 2


EFFECTS: list[Effect] = [
    make(cable_resonance, (3.0, 1000.0), lambda rng: {"quality": log_uniform(rng, 5.0, 20.0)}),
    make(monitor_roll_off, (0.3, 1e4), nothing),
    make(
        insulator_warming,
        (0.01, 20.0),
        lambda rng: {"tau_s": log_uniform(rng, 30.0, 200.0)},
        "time_s",
    ),
    make(crossover_distortion, (0.001, 45.0), nothing),
    make(amplitude_steps, (0.003, 0.8), lambda rng: {"place": float(rng.uniform(0.0, 1.0))}),
    make(
        electroosmotic_wetting,
        (0.01, 100.0),
        lambda rng: {"tau_s": log_uniform(rng, 20.0, 120.0)},
        "time_s",
    ),
    make(electrode_edge, (0.01, 10.0), nothing, "time_s"),
    make(
        ridge_resonance,
        (0.003, 0.9),
        lambda rng: {"pitch_m": float(rng.uniform(3e-4, 6e-4))},
        "speed_m_s",
    ),
    make(loaded_sensor_resonance, (0.003, 0.8), lambda rng: {"f_r": log_uniform(rng, 60.0, 600.0)}),
    make(dielectric_absorption, (0.01, 0.9), nothing, "before"),
]
UNFELT = {"monitor_roll_off"}  # no trace in friction, whatever the design
