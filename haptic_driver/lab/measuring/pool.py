"""What a rig may measure to tell effects apart: settings, spectra, and the same once somebody has
done something.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from haptic_driver.lab.measuring.check import check, resolved
from haptic_driver.lab.measuring.plan import Plan, Setting, Sweep
from haptic_driver.rig.config import RigConfig
from model.diagnosis.data import Measurements, stacked
from model.diagnosis.witness import CURRENT, CURRENT_PHASE, FRICTION, VOLTAGE, VOLTAGE_PHASE
from model.effects.interventions import INTERVENTIONS, NOTHING
from model.planning.design import Pool
from model.support.arrays import Array, Mask
from model.touch import SPEED_REFERENCE_M_S
from model.touch_model import TouchModel

REPEATS = 3
STEPS_HZ = tuple(m * 10.0**e for e in range(1, 6) for m in (1.0, 2.0, 5.0))
SHARES = (0.3, 0.5, 0.75, 0.95)  # of the rig's highest voltage
LOADS_N = (0.25, 0.5, 1.0)
SPEEDS_M_S = (0.005, 0.05)  # beside the usual one
BEFORE_AND_AFTER_HZ = (20.0, 100.0, 250.0, 1000.0)  # of friction around an intervention
SPECTRUM_HZ = {"low": 10.0, "high": 1e6, "per_decade": 3}
SPECTRUM_V = (
    1.0,
    5.0,
    40.0,
)  # what bends with the voltage shows beside less of it, also where the limits allow little
LOOK_S = 20.0  # that it takes to see what a block says
HANDS_S = 60.0  # that an intervention takes
REFERENCE = Setting(0.0, 0.0, LOADS_N[1], SPEED_REFERENCE_M_S)  # friction without voltage
SPECTRUM_REFERENCE = Setting(1e3, SPECTRUM_V[1], LOADS_N[1], 0.0, finger="resting", sweep=True)
WHILES_S = (
    5.0,
    15.0,
    290.0,
    300.0,
)  # from the beginning of a session: what drifts shows beside itself
USUAL_TIME_S = 60.0  # of a row that is measured at no time in particular


class Choices(NamedTuple):
    """Blocks of settings that a rig permits, and the observations that each would give."""

    blocks: tuple[tuple[Setting, ...], ...]
    pool: Pool


def choices(
    config: RigConfig,
    model: TouchModel,
    procedure: Plan,
    interventions: Sequence[str],
    known: Collection[Setting] = (),
) -> Choices:
    """Everything worth measuring within the rig's limits; `interventions` by name are those that
    can be done.

    With every setting comes a reference, which gives the gain of its session: one setting alone
    shows nothing. What is `known` is not measured again: where a model is off, it is off in every
    reading.
    """
    blocks: list[tuple[Setting, ...]] = [(REFERENCE, setting) for setting in _settings(config)]
    blocks += [
        (SPECTRUM_REFERENCE, setting) for spectrum in _spectra(NOTHING) for setting in spectrum
    ]
    blocks.append(tuple(REFERENCE._replace(time_s=time_s) for time_s in WHILES_S))
    for name in interventions:
        blocks += _after(config, name)
    every = list(dict.fromkeys(setting for block in blocks for setting in block))
    allowed = dict(zip(every, resolved(every, config, model), strict=True))
    points, _ = check(list(allowed.values()), procedure, config, model)
    usable = {s for s in points if not s.by_meter}  # nobody is asked to wire the electrode anew
    kept = [tuple(allowed[s] for s in block if allowed[s] in usable) for block in blocks]
    nothing_new = {allowed[REFERENCE], allowed[SPECTRUM_REFERENCE], *known}
    # limits make alike
    permitted = tuple(dict.fromkeys(block for block in kept if not nothing_new.issuperset(block)))
    cost_s = [REPEATS * len(block) * procedure.row_s + _besides_s(block) for block in permitted]
    return Choices(permitted, _pool(config, permitted, np.array(cost_s)))


def able(has_function: bool) -> tuple[str, ...]:
    """The interventions that somebody can do here; nobody can wipe a finger that is a function."""
    return () if has_function else tuple(known.name for known in INTERVENTIONS)


def _settings(config: RigConfig) -> list[Setting]:
    volts = [float(f"{share * config.limits.voltage_v:.3g}") for share in SHARES]
    usual = [
        Setting(f, v, n, SPEED_REFERENCE_M_S) for f in STEPS_HZ for v in volts for n in LOADS_N
    ]
    other = [
        Setting(f, v, 0.5, speed) for f in STEPS_HZ for v in volts[1:3] for speed in SPEEDS_M_S
    ]
    return [*usual, *other]


def _spectra(intervention: str) -> list[tuple[Setting, ...]]:
    """Spectra of the electrode's current, one of each touch and voltage."""
    found = []
    for volts in SPECTRUM_V:
        sweep = Sweep(frequency_hz=SPECTRUM_HZ, voltage_v=volts, normal_force_n=list(LOADS_N))  # type: ignore[arg-type]
        by_touch: dict[tuple[str, float], list[Setting]] = {}
        for setting in sweep.settings():
            touch = (setting.finger, setting.normal_force_n)
            by_touch.setdefault(touch, []).append(setting._replace(intervention=intervention))
        found += [tuple(settings) for settings in by_touch.values()]
    return found


def _after(config: RigConfig, intervention: str) -> list[tuple[Setting, ...]]:
    """Friction at a few settings, and a spectrum, once that is done."""
    volts = float(f"{SHARES[1] * config.limits.voltage_v:.3g}")
    friction = tuple(
        Setting(f, volts, 0.5, SPEED_REFERENCE_M_S, intervention=intervention)
        for f in BEFORE_AND_AFTER_HZ
    )
    return [
        friction,
        *(block for block in _spectra(intervention) if block[0].normal_force_n == LOADS_N[1]),
    ]


def _besides_s(block: tuple[Setting, ...]) -> float:
    """For a look at what is measured, for somebody's hands, or until it is time."""
    until_s = max(setting.time_s or 0.0 for setting in block)
    return LOOK_S + until_s + (HANDS_S if block[0].intervention != NOTHING else 0.0)


def _pool(config: RigConfig, blocks: tuple[tuple[Setting, ...], ...], cost_s: Array) -> Pool:
    settings = [setting for block in blocks for setting in block]
    block = np.repeat(np.arange(len(blocks)), [len(b) for b in blocks])
    seen = observations(
        settings, np.array([config.electrode_monitor(s.frequency_hz) is not None for s in settings])
    )
    assert seen.row is not None
    return Pool(seen, block[seen.row], cost_s, REPEATS)


def observations(settings: Sequence[Setting], monitored: Mask) -> Measurements:
    """The observations to come: friction where the finger slides, the electrode's witnesses where
    it is `monitored`.

    An intervention is a session of its own.
    """
    columns = {
        name: np.array([getattr(s, name) for s in settings])
        for name in ("frequency_hz", "voltage_v", "normal_force_n", "speed_m_s", "voltage_offset_v")
    }
    columns["time_s"] = np.array([USUAL_TIME_S if s.time_s is None else s.time_s for s in settings])
    columns |= {
        "electrode_voltage_v": np.ones(len(settings)),
        "electrode_voltage_phase_rad": np.zeros(len(settings)),
    }
    sessions = list(dict.fromkeys(s.intervention for s in settings))
    rows = Measurements(
        columns,
        np.array([sessions.index(s.intervention) for s in settings], dtype=np.intp),
        tuple(sessions),
        None,
        "",
        finger=np.array([s.finger for s in settings]),
        intervention=np.array([s.intervention for s in settings]),
    )
    friction = np.array([not s.sweep for s in settings])
    there = {FRICTION: friction} | dict.fromkeys(
        (CURRENT, CURRENT_PHASE, VOLTAGE, VOLTAGE_PHASE), monitored
    )
    return stacked(rows, {witness: mask for witness, mask in there.items() if mask.any()})
