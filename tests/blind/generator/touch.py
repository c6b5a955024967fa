"""Forward model of one touch: electrode, insulator, air gap, skin, contact, friction. SI units
throughout.

`State` holds every quantity a hidden effect may change, one value per row; `solve` closes the loop
between gap and electrostatic pressure and returns friction. An untouched state is the base model
(applied-load friction, sine drive).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.special import gamma as gamma_function

from . import gaps

VACUUM = 8.8541878128e-12
AREA = 1e-4  # nominal contact, m2
STEADY_SPEED = 0.02  # m/s, the paper's stage, where a design records no speed
CREEP_SPEED = 1e-3  # m/s, of the skin of a resting finger


@dataclass(frozen=True)
class Roughness:
    """Self-affine surface: Hurst exponent and wavevectors in 1/m (the amplitude belongs to the
    finger).
    """

    hurst: float = 0.71
    low: float = 1e3
    high: float = 1e10


@dataclass(frozen=True)
class Finger:
    """What differs between one finger and another."""

    h_rms: float = 20e-6
    skin: float = 200e-6
    leak: float = 1.0
    mu_off: float = 0.512
    insulator: float = 1e-6
    area: float = AREA
    gap_offset: float = 0.0


@dataclass
class Rows:
    """Conditions, one entry per row. Speed and time are always there for the physics, recorded or
    not.

    `before` is the voltage of the row that was measured before in the session; without it nothing
    was.
    """

    f: np.ndarray
    v: np.ndarray
    n: np.ndarray
    speed: np.ndarray
    time: np.ndarray
    before: np.ndarray | None = None

    def take(self, which: np.ndarray) -> Rows:
        """Some of the rows."""
        return Rows(*(None if column is None else column[which] for column in vars(self).values()))

    def seen_by(self, needs: set[str]) -> Rows:
        """What effects that need these columns see: a steady speed, no time and nothing before
        where none does.
        """
        return replace(
            self,
            speed=self.speed if "speed_m_s" in needs else np.full_like(self.v, STEADY_SPEED),
            time=self.time if "time_s" in needs else np.zeros_like(self.v),
            before=self.before if "before" in needs else None,
        )

    def unique(self) -> tuple[Rows, np.ndarray]:
        """Distinct conditions and the index that spreads them over the rows again."""
        table = np.column_stack([column for column in vars(self).values() if column is not None])
        distinct, back = np.unique(table, axis=0, return_inverse=True)
        return Rows(*distinct.T), back.ravel()


def dry_skin(f: np.ndarray) -> np.ndarray:
    """Relative permittivity of dry skin, conduction included (Gabriel et al. 1996, two
    dispersions).
    """
    s = 2j * np.pi * f
    return 4 + 32 / (1 + 7.23e-12 * s) + 1100 / (1 + (3.248e-8 * s) ** 0.8) + 2e-4 / (s * VACUUM)


def modulus() -> float:
    """Effective modulus (38) of skin (10 MPa, 0.5) on glass (70 GPa, 0.15), Pa."""
    return 1 / ((1 - 0.5**2) / 10e6 + (1 - 0.15**2) / 70e9)


def leak_length(rough: Roughness, h_rms: float) -> float:
    """Length L0 of (39) with the integral (40) in closed form, m."""
    H = rough.hurst
    a = H / (2 * (1 - H))
    r = a * np.sqrt(np.pi) * gamma_function(a) / gamma_function(1 / (2 * (1 - H)))
    return np.sqrt(2 * (1 - H) / (np.pi * H)) * h_rms * (r - (rough.low / rough.high) ** H)


def _straight(normal: np.ndarray, extra: np.ndarray) -> np.ndarray:
    return 1 + extra / normal


@dataclass
class State:
    """Everything an effect may touch; the values set by `prepare` are the base model."""

    rows: Rows
    finger: Finger
    rough: Roughness
    drive: np.ndarray  # V, amplitude that reaches the stack
    drive_phase: np.ndarray  # rad, of the same against the set voltage
    k_insulator: np.ndarray
    k_skin: np.ndarray
    stack_add: np.ndarray  # complex length added to the layers, m
    gap_admittance: np.ndarray  # in parallel with the air gap, S/m2
    k_gap: np.ndarray
    gap_add: np.ndarray  # m
    bias_square: np.ndarray  # V2 added to the mean square
    load_add: np.ndarray  # Pa, adhesion-like
    stiffness: np.ndarray  # factor on Y*
    mu_factor: np.ndarray
    skin_stack: Callable | None = None  # k_skin -> complex length, replaces skin/k_skin
    film: Callable | None = None  # gap (m) -> thickness of liquid in it (m)
    k_film: np.ndarray | None = None
    field_cap: Callable | None = None  # |E|, air gap (m) -> |E|
    skin_law: Callable | None = None  # V over the skin -> factor on its conductivity
    load_law: Callable = _straight  # (applied, extra force) -> friction relative to mu_off
    cover: np.ndarray | float = 1.0  # share of the contact that lies over the electrode
    spread: np.ndarray | float = 1.0  # factor on the finger's area
    kept: np.ndarray | float = 1.0  # share of the driven mean square that is not screened
    after: list = field(default_factory=list)  # (rows, cof, force) -> cof, measuring chain
    monitors: list = field(
        default_factory=list
    )  # (rows, voltage, current) -> both as the monitors read them

    @property
    def omega(self) -> np.ndarray:
        return 2 * np.pi * self.rows.f

    @property
    def jw(self) -> np.ndarray:
        return 1j * self.omega

    @property
    def area(self) -> np.ndarray | float:
        return self.finger.area * self.spread


def prepare(rows: Rows, finger: Finger, rough: Roughness) -> State:
    """Return the base state. Rows without voltage get 250 Hz, which then matters to nothing."""
    rows = replace(rows, f=np.where((rows.v > 0) & (rows.f > 0), rows.f, 250.0))
    zero = np.zeros(rows.f.size)
    s = 2j * np.pi * rows.f * VACUUM
    return State(
        rows=rows,
        finger=finger,
        rough=rough,
        drive=rows.v.astype(float),
        drive_phase=zero.copy(),
        k_insulator=3.9 + 1e-13 / s,
        k_skin=dry_skin(rows.f),
        stack_add=zero.astype(complex),
        gap_admittance=zero.astype(complex),
        k_gap=1 + 1e-14 / s,
        gap_add=zero + finger.gap_offset,
        bias_square=zero.copy(),
        load_add=zero.copy(),
        stiffness=zero + 1.0,
        mu_factor=zero + 1.0,
    )


class Stack(NamedTuple):
    """What lies over the gap: the field per volt is 1/(slope air + length), the gap's admittance
    times air as given.
    """

    air: np.ndarray  # (n, bins), m
    slope: np.ndarray  # complex, (n, 1) or (n, bins)
    length: np.ndarray
    shunt: np.ndarray  # in parallel with the gap, S/m2
    gap: np.ndarray  # j w eps0 k_gap, S/m

    def field_square(self) -> np.ndarray:
        """Square of the field per volt in the gap, (n, bins)."""
        real = self.slope.real * self.air + self.length.real
        imaginary = self.slope.imag * self.air + self.length.imag
        return 1 / (real**2 + imaginary**2)

    def current(self) -> np.ndarray:
        """Current density per volt through each gap, (n, bins), S/m2."""
        return (self.gap + self.shunt * self.air) / (self.slope * self.air + self.length)


def _stack(state: State, k_skin: np.ndarray, pressure: np.ndarray, u: np.ndarray) -> Stack:
    finger = state.finger
    s = (1j * state.omega * VACUUM)[:, None]
    skin = finger.skin / k_skin if state.skin_stack is None else state.skin_stack(k_skin)
    h = (finger.insulator / state.k_insulator + skin + state.stack_add)[:, None]
    skin_sigma = -k_skin.imag * state.omega * VACUUM
    stiff = modulus() * state.stiffness
    spots = (
        finger.leak * 2 * skin_sigma * pressure / (stiff * leak_length(state.rough, finger.h_rms))
    )
    shunt = (spots + state.gap_admittance)[:, None]
    air = u
    if state.film is not None:
        wet = state.film(u)
        air = u - wet
        h = h + wet / state.k_film[:, None]
    k_gap = state.k_gap[:, None]
    return Stack(air, 1 + h * shunt / s, h * k_gap, shunt, s * k_gap)


def settled(state: State, pressure: np.ndarray) -> tuple[np.ndarray, Stack]:
    """Masses of the gaps (n, bins) and what lies over them, at the total `pressure` (Pa)."""
    finger, rough = state.finger, state.rough
    table = gaps.histograms(rough.hurst, rough.high / rough.low)
    mass = table.at(pressure / (modulus() * state.stiffness * rough.low * finger.h_rms))
    u = table.gap * finger.h_rms + state.gap_add[:, None]
    k_skin = state.k_skin
    stack = _stack(state, k_skin, pressure, u)
    if state.skin_law is not None:
        for _ in range(6):
            current = np.abs((mass * stack.current()).sum(axis=1)) * state.drive
            over = current * finger.skin / (state.omega * VACUUM * np.abs(k_skin))
            factor = state.skin_law(over)
            new = state.k_skin.real + 1j * state.k_skin.imag * factor
            k_skin = np.sqrt(k_skin * new)
            stack = _stack(state, k_skin, pressure, u)
    return mass, stack


def _electric_pressure(state: State, pressure: np.ndarray) -> np.ndarray:
    """Mean electrostatic pressure (Pa) when the total pressure is `pressure` (Pa)."""
    mass, stack = settled(state, pressure)
    square = stack.field_square()
    if state.field_cap is not None:
        attracting = np.sqrt(square) * (state.drive * np.sqrt(state.kept))[:, None]
        peak = state.field_cap(attracting, stack.air)
        return VACUUM / 4 * (mass * peak**2).sum(axis=1)
    mean_square = 0.5 * state.kept * state.drive**2 + state.bias_square
    return VACUUM / 2 * mean_square * (mass * square).sum(axis=1)


def electrostatic_pressure(state: State) -> np.ndarray:
    """Close the loop p = load + p_e(p) by a safeguarded secant; a row past pull-in ends at 1.5
    MPa.
    """
    base = state.rows.n / state.area + state.load_add
    old = base
    gap_old = _electric_pressure(state, old)
    new = np.minimum(base + gap_old, 1.5e6)
    for _ in range(40):
        gap_new = _electric_pressure(state, new)
        miss_new, miss_old = base + gap_new - new, base + gap_old - old
        slope = np.where(
            new == old, 0.0, (miss_new - miss_old) / np.where(new == old, 1.0, new - old)
        )
        step = np.where(slope < -0.02, -miss_new / np.minimum(slope, -0.02), miss_new)
        old, gap_old = new, gap_new
        new = np.clip(new + np.clip(step, -0.5 * new, 2.0 * new), base, 1.5e6)
        if np.all(np.abs(new - old) <= 1e-9 * new):
            break
    return np.maximum(new - base, 0.0)


def force(state: State) -> np.ndarray:
    active = (state.drive > 0) | (state.bias_square > 0)
    return np.where(active, electrostatic_pressure(state), 0.0) * state.area * state.cover


def friction(state: State) -> np.ndarray:
    """Coefficient of friction as measured: lateral force over applied load."""
    electric = force(state)
    normal = state.rows.n
    mu = (
        state.finger.mu_off
        * state.mu_factor
        * state.load_law(normal, electric + state.load_add * state.area)
    )
    for step in state.after:
        mu = step(state.rows, mu, electric)
    return mu


def base_friction(rows: Rows, finger: Finger, rough: Roughness) -> np.ndarray:
    """Friction of the base model, each distinct condition computed once."""
    bare = Rows(
        np.where(rows.v > 0, rows.f, 0.0),
        rows.v,
        rows.n,
        np.full_like(rows.v, STEADY_SPEED),
        0 * rows.v,
    )
    distinct, back = bare.unique()
    return friction(prepare(distinct, finger, rough))[back]
