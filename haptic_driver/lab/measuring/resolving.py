"""What a plan would observe on a rig: as it is, with the electrode's current, and with whole
spectra.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.lab.measuring.check import Refusal, check, resolved
from haptic_driver.lab.measuring.plan import Plan, Setting, Sweep
from haptic_driver.lab.measuring.pool import observations
from haptic_driver.rig.config import RigConfig
from model.diagnosis.data import Measurements
from model.diagnosis.witness import FRICTION, WITNESSES
from model.support.arrays import Mask
from model.touch import SPEED_REFERENCE_M_S
from model.touch_model import TouchModel

CARD_REACH_HZ = 8e3  # of a card of 20 kS/s
SPECTRUM_REACH_HZ = 1e6
OPEN_N = 0.5  # stands for the load of an open circuit, which has none


def ways(
    config: RigConfig, model: TouchModel, plan: Plan, cof_std: float
) -> tuple[dict[str, Measurements], list[Refusal]]:
    """What would be observed: on this rig as it is, with the current as far as a card reads it,
    with a full sweep.

    `cof_std`: relative, of one friction; other witnesses have their usual noise. What the rig
    refuses is left out, and returned. BadInputError where nothing is left.
    """
    own, refusals = _permitted(plan.settings, plan, config, model)
    if not own:
        raise BadInputError(
            "bad_plan", f"plan '{plan.name}': {refusals[0]}", "Nothing of it may be measured here"
        )
    card, _ = _permitted((*own, *_spectrum(CARD_REACH_HZ)), plan, config, model)
    full, _ = _permitted((*own, *_spectrum(SPECTRUM_REACH_HZ)), plan, config, model)
    monitored = {
        "as it is": (
            own,
            [config.electrode_monitor(s.frequency_hz, s.sweep) is not None for s in own],
        ),
        "current by a card": (card, [s.frequency_hz <= CARD_REACH_HZ for s in card]),
        "full sweep": (full, [True] * len(full)),
    }
    times = plan.repeats * plan.sessions
    return {
        name: _rows(settings, np.array(read), cof_std, times)
        for name, (settings, read) in monitored.items()
    }, refusals


def _permitted(
    settings: Sequence[Setting], plan: Plan, config: RigConfig, model: TouchModel
) -> tuple[list[Setting], list[Refusal]]:
    every = list(dict.fromkeys(settings))
    allowed = resolved(every, config, model)
    points, refusals = check(allowed, plan, config, model)
    return [setting for setting in allowed if setting in points], refusals


def _spectrum(reach_hz: float) -> list[Setting]:
    """Open circuit, finger resting and sliding."""
    sweep = Sweep(
        frequency_hz={"low": 10.0, "high": reach_hz, "per_decade": 3},  # type: ignore[arg-type]
        speed_m_s=[SPEED_REFERENCE_M_S],
        finger=["none", "resting", "sliding"],
    )
    return list(sweep.settings())


def _rows(settings: Sequence[Setting], monitored: Mask, cof_std: float, times: int) -> Measurements:
    """What the settings would give, each the mean of so many `times`."""
    touched = [s if s.finger != "none" else s._replace(normal_force_n=OPEN_N) for s in settings]
    data = observations(touched, monitored & np.array([s.voltage_v > 0.0 for s in settings]))
    columns = dict(data.columns)
    for i in data.witnesses:
        witness = WITNESSES[i]
        std = cof_std if i == FRICTION else witness.usual_std
        assert std is not None
        columns[witness.column] = np.full(data.count, 0.0 if witness.is_phase else 1.0)
        columns[witness.std] = np.full(data.count, std / np.sqrt(times))
    return replace(data, columns=columns)
