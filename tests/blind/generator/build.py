"""One blind set from one specification: draw a design, finger and noise, set the visibility, write
the rows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from . import designs, noise, nuisance
from .designs import Design
from .effect import ALTERNATIVE, CATALOGUE, Effect, Hidden, drawn
from .effects import CATALOGUE_EFFECTS, STRANGERS
from .measured import COMMANDED, SMALL, Trials, drawn_trials, in_windows
from .touch import Finger
from .visibility import Visibility, clean_friction, force_left

WITH_LOAD = ("factorial", "timed", "six_sessions", "rich", "quiet_grid")
WITH_SPEED = ("speed_sweep", "six_sessions", "rich")
WITH_TIME = ("timed", "six_sessions", "rich", "quiet_grid")
VANISHED = (
    0.15  # share of the electrostatic force below which a set is kept only for want of a better
)
NEEDS_LOAD = {
    "load_dependent_friction",
    "capillary_adhesion",
    "contact_area_law",
    "sensor_crosstalk",
    "loaded_sensor_resonance",
    "dust",
}
NEEDS_MANY_FREQUENCIES = {"screen_resonance", "mains_interference"}


@dataclass(frozen=True)
class Spec:
    """What a set should contain. `effects` are (name, wanted lambda); an empty `design` is
    drawn.
    """

    family: str
    index: int
    effects: tuple[tuple[str, float], ...] = ()
    form: str = CATALOGUE
    design: str = ""
    noise: str = noise.STATED
    far: bool = False
    gain_sd: float = nuisance.SESSION_GAIN_SD
    partial_sessions: int = 0
    contaminated: bool = False
    measured: bool = False  # loads as measured, gains of trials and drifts in them
    twin: bool = False  # of a measured set


@dataclass(frozen=True)
class BlindSet:
    """Columns to write, the sealed label, and by what share of friction without them the hidden
    effects change each row; NaN in rows without friction.

    `design` is that of the rows with friction. `friction_of` says without noise what another design
    would show, with the hidden effects and without.
    """

    columns: dict[str, np.ndarray]
    label: dict
    change: np.ndarray
    design: Design
    friction_of: Callable[[Design], tuple[np.ndarray, np.ndarray]]


def find(name: str) -> Effect:
    return CATALOGUE_EFFECTS[name] if name in CATALOGUE_EFFECTS else STRANGERS[name]


def suitable(name: str) -> tuple[str, ...]:
    """Designs whose columns and levels let the effect show."""
    needs = find(name).needs
    if needs == "speed_m_s":
        return WITH_SPEED
    if needs == "time_s":
        return WITH_TIME
    if name in NEEDS_LOAD:
        return WITH_LOAD
    if name in NEEDS_MANY_FREQUENCIES:
        return ("paper", "voltage_frequency", "factorial", "six_sessions")
    return tuple(designs.GOOD)


def _candidates(rng: np.random.Generator, spec: Spec) -> list[str]:
    if spec.design:
        return [spec.design] * 3
    if spec.partial_sessions or spec.contaminated:
        return ["six_sessions"] * 3
    common = set(designs.GOOD)
    for name, _ in spec.effects:
        common &= set(suitable(name))
    if len(spec.effects) > 1:
        common &= {"factorial", "timed", "six_sessions", "rich", "voltage_frequency"}
    if spec.measured or spec.twin:
        return [str(d) for d in rng.permutation(sorted(common & set(SMALL)))][:3]
    order = [str(d) for d in rng.permutation(sorted(common))][:3]
    return [*order, "rich"] if "rich" in common else order


def _hide(
    rng: np.random.Generator, spec: Spec, sight: Visibility
) -> tuple[tuple[Hidden, ...], list[float]]:
    """Effects at the strength that gives each, alone, its wanted lambda."""
    out, seen = [], []
    for name, target in spec.effects:
        effect = find(name)
        form = spec.form if name in CATALOGUE_EFFECTS else CATALOGUE
        hidden, reached = sight.reach(drawn(effect, rng, form), target)
        out.append(hidden)
        seen.append(reached)
    return tuple(out), seen


def _setting(
    rng: np.random.Generator, spec: Spec, trials: Trials | None = None
) -> tuple[Design, Finger, str, np.ndarray, tuple[Hidden, ...], list[float], Visibility]:
    """Try designs, then quieter noise, until every effect is as visible as wanted (or keep the most
    visible).
    """
    finger, far = nuisance.far_finger(rng) if spec.far else (nuisance.draw_finger(rng), "")
    best, best_share = None, -1.0
    for attempt, name in enumerate(_candidates(rng, spec)):
        design = designs.DESIGNS[name](rng)
        level = np.exp(rng.uniform(np.log(0.015), np.log(0.05) if attempt == 0 else np.log(0.022)))
        sigma = level * np.exp(0.15 * rng.normal(size=design.session.size))
        sight = Visibility(design, finger, sigma if trials is None else trials.of_trial(sigma))
        hidden, seen = _hide(rng, spec, sight)
        share = min((s / t for s, (_, t) in zip(seen, spec.effects, strict=True)), default=1.0)
        if hidden and force_left(design, finger, hidden) < VANISHED:
            share = min(
                share, 0.5
            )  # with the force all but gone every effect that weakens it looks the same
        if share > best_share:
            best, best_share = (design, finger, far, sigma, hidden, seen, sight), share
        if share >= 0.9:
            break
    return best


def _measured(
    rng: np.random.Generator, spec: Spec, design: Design, clean: np.ndarray, sigma: np.ndarray
) -> dict:
    gain = nuisance.session_gains(rng, design.session, spec.gain_sd)
    stated = sigma * clean * gain
    spread = stated.copy()
    bad = 0
    if spec.contaminated:
        bad = int(rng.choice(np.unique(design.session)))
        gain = np.where(design.session == bad, gain * np.exp(0.15 * rng.choice([-1.0, 1.0])), gain)
        spread = np.where(design.session == bad, 4 * stated, stated)
    cof = np.maximum(
        clean * gain + noise.draw(rng, spec.noise, clean, spread, design.session), 0.02
    )
    return {"cof": cof, "cof_std": stated, "contaminated_session": bad}


def _columns(design: Design, measured: dict, off_frequency: float) -> dict[str, np.ndarray]:
    rows = design.rows
    every = {
        "frequency_hz": np.where(rows.v > 0, rows.f, off_frequency),
        "voltage_v": rows.v,
        "normal_force_n": rows.n,
        "cof": measured["cof"],
        "cof_std": measured["cof_std"],
        "speed_m_s": rows.speed,
        "time_s": rows.time,
        "session": design.session,
        "trial": design.trial,
    }
    return {k: v for i, (k, v) in enumerate(every.items()) if i < 4 or k in design.columns}


def build(spec: Spec, seed: int) -> BlindSet:
    """Build one set; the same specification and seed give the same set."""
    rng = np.random.default_rng([seed, int.from_bytes(spec.family.encode(), "big"), spec.index])
    chance = np.random.default_rng([seed, 9, spec.index])  # others' draws stay as they are
    trials = drawn_trials(chance) if spec.measured or spec.twin else None
    design, finger, far, sigma, hidden, seen, sight = _setting(rng, spec, trials)
    if spec.partial_sessions and hidden:
        chosen = rng.choice(np.unique(design.session), spec.partial_sessions, replace=False)
        hidden = tuple(replace(h, sessions=tuple(sorted(int(s) for s in chosen))) for h in hidden)
        seen = [sight.of((h,)) for h in hidden]
    planned, factor = design, np.ones(design.session.size)
    if trials is not None and spec.twin:
        sigma = trials.of_trial(sigma)
    elif trials is not None:
        design, factor = in_windows(chance, design, trials)
        sigma = np.repeat(sigma, design.session.size // sigma.size)
    clean = clean_friction(design, finger, hidden)
    change = clean / clean_friction(design, finger, ()) - 1.0
    measured = _measured(rng, spec, design, clean * factor, sigma)
    off_frequency = float(rng.choice([250.0, 250.0, 0.0]))
    label = {
        "family": spec.family,
        "index": spec.index,
        "effects": [
            {
                **h.label(),
                "lambda": round(s, 3),
                "lambda_wanted": t,
                "stranger": h.effect.name in STRANGERS,
            }
            for h, s, (_, t) in zip(hidden, seen, spec.effects, strict=True)
        ],
        "lambda_together": round(sight.of(hidden), 3) if hidden else 0.0,
        "force_left": round(force_left(planned, finger, hidden), 4) if hidden else 1.0,
        "base_misfit": round(sight.null, 3),
        "design": design.name,
        "bad_design": design.bad,
        "rows": int(design.session.size),
        "noise": spec.noise,
        "relative_sigma": round(float(np.median(sigma)), 5),
        "session_gain_sd": spec.gain_sd,
        "contaminated_session": measured["contaminated_session"],
        "off_frequency_hz": off_frequency,
        "finger": nuisance.finger_record(finger),
        "far_off": far,
    }
    if spec.measured or spec.twin:
        label["pair"] = f"{spec.family}-{spec.index}"
    columns = _columns(design, measured, off_frequency)
    if trials is not None and spec.measured:
        label["trials"] = trials.label()
        columns.pop("trial", None)
        if trials.columns == COMMANDED:
            load_n = np.repeat(planned.rows.n, design.session.size // planned.session.size)
            columns |= {"trial": design.trial, "commanded_normal_force_n": load_n}

    def friction_of(other: Design) -> tuple[np.ndarray, np.ndarray]:
        return clean_friction(other, finger, hidden), clean_friction(other, finger, ())

    return BlindSet(columns, label, change, design, friction_of)


def build_twins(spec: Spec, seed: int) -> list[BlindSet]:
    """A measured set, and one with commanded loads.

    Finger, plan and effect are the same, and so is what the mean of a trial's rows scatters by: in
    the twin a row each, whose noise is stated. Hence lambda is the same too.
    """
    return [build(spec, seed), build(replace(spec, measured=False, twin=True), seed)]


__all__ = ["ALTERNATIVE", "CATALOGUE", "BlindSet", "Spec", "build", "build_twins", "suitable"]
