"""Sets with the electrode's voltage and current beside friction, each with a twin that has the same
friction alone.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from . import designs, nuisance
from .build import BlindSet, Spec, find
from .designs import Design
from .effect import Effect, Hidden, drawn
from .effects import STRANGERS
from .effects_electric import EFFECTS as ELECTRIC
from .electrode import Observed, Rig, observe
from .touch import Finger
from .visibility import Search, Visibility, Whitener, coordinates, finger_from

FINGERS = np.array(["sliding", "resting", "none"])
AREA_SD, REST_SD, STRAY_SD = 0.15, 0.8, 1.0  # of logarithms; a capacitance is as good as free
GAIN_SD = {
    "cof": nuisance.SESSION_GAIN_SD,
    "current": 0.02,
    "current_phase": 0.01,
    "voltage": 0.01,
    "phase": 0.01,
}
Truth = tuple[Hidden, ...]
# a gain bent over frequency would show more by its bend than by itself, since sessions share gains
BENDABLE = {effect.name for effect in ELECTRIC} - {"drive_gain_error"}


@dataclass(frozen=True)
class Noise:
    """Standard deviation of each witness, relative or rad."""

    cof: float
    current: float
    current_phase: float
    voltage: float
    phase: float


def draw_noise(rng: np.random.Generator) -> Noise:
    """1 to 5 % and 1 to 4 degrees of current, 1 to 3 % of friction; a voltage monitor is better
    than either.
    """
    return Noise(
        cof=float(np.exp(rng.uniform(np.log(0.01), np.log(0.03)))),
        current=float(np.exp(rng.uniform(np.log(0.01), np.log(0.05)))),
        current_phase=float(np.deg2rad(np.exp(rng.uniform(0.0, np.log(4.0))))),
        voltage=float(np.exp(rng.uniform(np.log(0.003), np.log(0.01)))),
        phase=float(np.deg2rad(np.exp(rng.uniform(np.log(0.25), 0.0)))),
    )


def draw_rig(rng: np.random.Generator) -> Rig:
    return Rig(
        stray_f=float(np.exp(rng.uniform(np.log(1.5e-10), np.log(5e-10)))),
        open_error=float(rng.uniform(-0.01, 0.01)),
        softness=float(np.exp(rng.uniform(np.log(0.25), np.log(0.8)))),
        rest_leak=float(np.exp(0.05 * rng.normal())),
    )


def draw_hidden(rng: np.random.Generator, effect: Effect, form: str) -> Hidden:
    """An effect whose shape is off by 5 to 20 % over the decades, where it is one of drive, layers
    or gap.
    """
    bend = (float(rng.uniform(0.05, 0.2)), float(rng.uniform(0.0, 2 * np.pi)))
    return replace(drawn(effect, rng, form), bend=bend if effect.name in BENDABLE else (0.0, 0.0))


def stacked(seen: Observed) -> dict[str, np.ndarray]:
    """Witness to what is compared, per row: logarithms and rad, NaN where nothing is seen."""
    return {
        "cof": np.log(seen.cof),
        "current": np.log(np.abs(seen.current)),
        "current_phase": np.angle(seen.current),
        "voltage": np.log(np.abs(np.where(np.isnan(seen.current), np.nan, seen.voltage))),
        "phase": np.angle(np.where(np.isnan(seen.current), np.nan, seen.voltage)),
    }


@dataclass
class WitnessSight(Search):
    """lambda over all witnesses: finger, friction without voltage, area, stray capacitance and rest
    are fitted anew.
    """

    design: Design
    finger: Finger
    rig: Rig
    noise: Noise

    def __post_init__(self) -> None:
        there = stacked(observe(self.design, self.finger, self.rig, ()))
        self._rows = {name: np.flatnonzero(np.isfinite(values)) for name, values in there.items()}
        self._white = {}
        for name, rows in self._rows.items():
            session = self.design.session[rows]
            groups = tuple(np.flatnonzero(session == s) for s in np.unique(session))
            self._white[name] = Whitener(
                np.full(rows.size, getattr(self.noise, name)), groups, GAIN_SD[name]
            )
        self.null = self._cost(there)

    def of(self, hidden: tuple[Hidden, ...]) -> float:
        return max(
            self._cost(stacked(observe(self.design, self.finger, self.rig, hidden))) - self.null,
            0.0,
        )

    def _start(self) -> np.ndarray:
        rest = np.log(self.rig.softness / 0.5) / REST_SD
        return np.r_[
            np.clip(coordinates(self.finger), -5, 5),
            np.log(self.finger.area / 1e-4) / AREA_SD,
            0.0,
            rest,
        ]

    def _cost(self, truth: dict[str, np.ndarray]) -> float:
        one = self._white["cof"](np.ones(self._rows["cof"].size))

        def residual(x: np.ndarray) -> np.ndarray:
            finger = replace(
                finger_from(x[:3], self.finger), mu_off=1.0, area=1e-4 * np.exp(AREA_SD * x[3])
            )
            stray, soft = self.rig.stray_f * np.exp(STRAY_SD * x[4]), 0.5 * np.exp(REST_SD * x[5])
            said = stacked(observe(self.design, finger, Rig(stray, softness=soft), ()))
            parts = []
            for name, rows in self._rows.items():
                r = truth[name][rows] - said[name][rows]
                if name.endswith("phase"):
                    r = np.angle(np.exp(1j * r))
                parts.append(self._white[name](r))
            level = (one @ parts[0]) / (one @ one)  # mu_off, linear in the logarithm
            parts[0] = parts[0] - np.clip(level, np.log(0.2), np.log(2.0)) * one
            return np.concatenate([*parts, x])

        fit = least_squares(
            residual, self._start(), bounds=(-6, 6), xtol=1e-5, ftol=1e-5, max_nfev=15
        )
        return float(2 * fit.cost)


def measured(
    rng: np.random.Generator, design: Design, seen: Observed, noise: Noise
) -> dict[str, np.ndarray]:
    """Columns of electrical.md and design.md: noise as stated, gains that a session shares."""
    out: dict[str, np.ndarray] = {}
    names = {
        "cof": ("cof", "cof_std"),
        "current": ("current_a", "current_std_a"),
        "current_phase": ("current_phase_rad", "current_phase_std_rad"),
        "voltage": ("electrode_voltage_v", "electrode_voltage_std_v"),
        "phase": ("electrode_voltage_phase_rad", "electrode_voltage_phase_std_rad"),
    }
    for witness, clean in stacked(seen).items():
        column, std = names[witness]
        n = clean.size
        sigma = getattr(noise, witness) * np.exp(0.15 * rng.normal(size=n))
        gain = np.log(nuisance.session_gains(rng, design.session, GAIN_SD[witness]))
        value = clean + gain
        if witness.endswith("phase"):
            out[column] = value + sigma * rng.normal(size=n)
            out[std] = np.where(np.isnan(clean), np.nan, sigma)
        else:
            amount = np.exp(value)
            out[column] = amount * np.maximum(1 + sigma * rng.normal(size=n), 0.05)
            out[std] = amount * sigma
    return out


def file_columns(
    design: Design, seen: dict[str, np.ndarray], electric: bool
) -> dict[str, np.ndarray]:
    """Columns to write, of the whole design or of its friction alone."""
    rows = design.rows
    every = {
        "frequency_hz": np.where(rows.v > 0, rows.f, 250.0),
        "voltage_v": rows.v,
        "normal_force_n": rows.n,
        "cof": seen["cof"],
        "cof_std": seen["cof_std"],
        "speed_m_s": np.where(design.finger == designs.SLIDING, rows.speed, 0.0),
        "time_s": rows.time,
        "session": design.session,
        "trial": design.trial,
    }
    if not electric:
        return {name: values[design.slides] for name, values in every.items()}
    every |= {name: values for name, values in seen.items() if not name.startswith("cof")}
    return every | {"finger": FINGERS[design.finger]}


def friction_lambda(
    design: Design, finger: Finger, noise: Noise, hidden: tuple[Hidden, ...]
) -> list[float]:
    """Visibility of each effect in friction alone."""
    part = designs.friction_only(design)
    sight = Visibility(part, finger, np.full(part.session.size, noise.cof))
    return [sight.of((h,)) for h in hidden]


def _drawn(spec: Spec, seed: int) -> tuple[np.random.Generator, WitnessSight, Truth, list[float]]:
    """What a specification draws: its sight (design, finger, rig and noise), effects, and how
    visible each is.
    """
    rng = np.random.default_rng([seed, int.from_bytes(spec.family.encode(), "big"), spec.index])
    finger = replace(nuisance.draw_finger(rng), area=1e-4 * float(np.exp(0.1 * rng.normal())))
    sight = WitnessSight(designs.witnesses(rng), finger, draw_rig(rng), draw_noise(rng))
    found = [
        sight.reach(draw_hidden(rng, find(name), spec.form), target)
        for name, target in spec.effects
    ]
    return rng, sight, tuple(hidden for hidden, _ in found), [seen for _, seen in found]


def truth_of(spec: Spec, seed: int) -> tuple[Finger, Rig, Truth]:
    """The same finger, rig and effects as those of `build_pair`."""
    _, sight, truth, _ = _drawn(spec, seed)
    return sight.finger, sight.rig, truth


def build_pair(spec: Spec, seed: int) -> list[BlindSet]:
    """One truth twice: with every witness, and its friction alone."""
    rng, sight, truth, seen = _drawn(spec, seed)
    design, finger, rig, noise = sight.design, sight.finger, sight.rig, sight.noise
    observed = observe(design, finger, rig, truth)
    change = observed.cof / observe(design, finger, rig, ()).cof - 1.0
    values = measured(rng, design, observed, noise)
    alone = friction_lambda(design, finger, noise, truth)

    def friction_of(other: Design) -> tuple[np.ndarray, np.ndarray]:
        return observe(other, finger, rig, truth).cof, observe(other, finger, rig, ()).cof

    slides = designs.sliding(design)
    made = []
    for electric, visible in ((True, seen), (False, alone)):
        columns = file_columns(design, values, electric)
        label = {
            "family": spec.family,
            "index": spec.index,
            "witnesses": "all" if electric else "friction",
            "effects": [
                {
                    **h.label(),
                    "lambda": round(s, 3),
                    "lambda_wanted": t,
                    "stranger": h.effect.name in STRANGERS,
                }
                for h, s, (_, t) in zip(truth, visible, spec.effects, strict=True)
            ],
            "design": design.name,
            "rows": int(columns["cof"].size),
            "noise": asdict(noise),
            "rig": asdict(rig),
            "finger": nuisance.finger_record(finger),
        }
        of_rows = change if electric else change[design.slides]
        made.append(BlindSet(columns, label, of_rows, slides, friction_of))
    return made
