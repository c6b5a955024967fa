"""Voltage and current of the electrode as phasors against the set voltage (electrical.md), by state
of the finger.

A gap u carries J = V j w eps0 (k_g + beta u)/(a u + k_g h); the real contact, at u = 0, j w eps0
V/h. The stray capacitance lies straight from electrode to ground, before body and film.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .designs import NONE, RESTING, SLIDING, Design
from .effect import Hidden
from .nuisance import ROUGHNESS
from .touch import Finger, Rows, State, electrostatic_pressure, friction, prepare, settled


@dataclass(frozen=True)
class Rig:
    """What belongs to neither finger nor effect.

    `open_error` is how far the open circuit is off the stray capacitance (relative); a resting
    finger is as if its modulus were `softness` of a sliding one's, and leaks `rest_leak` times as
    much besides.
    """

    stray_f: float = 300e-12
    open_error: float = 0.0
    softness: float = 0.5
    rest_leak: float = 1.0


@dataclass(frozen=True)
class Observed:
    """What every row would show without noise: friction (NaN where nothing slides for it), V and A
    peak, complex.
    """

    cof: np.ndarray
    voltage: np.ndarray
    current: np.ndarray


def touch_admittance(state: State) -> np.ndarray:
    """Current per volt through the touch, S."""
    area = state.area
    pressure = state.rows.n / area + state.load_add + electrostatic_pressure(state)
    mass, stack = settled(state, pressure)
    density = stack.current()
    contact = (stack.gap / stack.length)[:, 0]
    if (
        state.field_cap is not None
    ):  # where the air gives way the layers carry what it does not hold
        own = 1 / (stack.slope * stack.air + stack.length)
        field = np.abs(own) * np.maximum(state.drive, 1e-9)[:, None]
        held = state.field_cap(field, stack.air) / field
        density = stack.gap / stack.length * (1 - held * own * stack.air)
    return area * state.cover * ((mass * density).sum(axis=1) + (1 - mass.sum(axis=1)) * contact)


def alone(rows: Rows, kind: int, finger: Finger, rig: Rig, hidden: tuple[Hidden, ...]) -> Observed:
    """Rows of one state of the finger."""
    if kind == RESTING:
        finger = replace(finger, leak=finger.leak * rig.rest_leak, gap_offset=0.0)
        rows = replace(rows, speed=0 * rows.speed)
    state = prepare(rows, finger, ROUGHNESS)
    if kind == RESTING:
        state.stiffness = state.stiffness * rig.softness
    for h in hidden:
        h.act(state)
    voltage = state.drive * np.exp(1j * state.drive_phase)
    stray = rig.stray_f * (1 + rig.open_error if kind == NONE else 1.0)
    admittance = 2j * np.pi * state.rows.f * stray
    if kind != NONE:
        admittance = admittance + touch_admittance(state)
    nothing = np.full(rows.f.size, np.nan)
    cof = friction(state) if kind == SLIDING else nothing
    current = admittance * voltage
    for read in state.monitors:
        voltage, current = read(state.rows, voltage, current)
    return Observed(cof, voltage, np.where(rows.v > 0, current, np.nan))


def observe(design: Design, finger: Finger, rig: Rig, hidden: tuple[Hidden, ...]) -> Observed:
    """Everything that a design's rows would show; each distinct condition is computed once."""
    live = tuple(h for h in hidden if h.strength > 0)
    rows = design.rows.seen_by(set().union(*(h.needs for h in live)))
    cof = np.full(rows.v.size, np.nan)
    voltage, current = cof.astype(complex), cof.astype(complex)
    for kind in np.unique(design.finger):
        mine = design.finger == kind
        distinct, back = rows.take(mine).unique()
        seen = alone(distinct, int(kind), finger, rig, live)
        cof[mine], voltage[mine], current[mine] = (
            seen.cof[back],
            seen.voltage[back],
            seen.current[back],
        )
    return Observed(np.where(design.slides, cof, np.nan), voltage, current)
