"""The friction of a simulated finger: its model's, with the effects that a rig's configuration hides."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.limits import OperatingLimits
from haptic_driver.render.correction import factors_at
from haptic_driver.render.surface import cof_at
from haptic_driver.signals import FingerState
from haptic_driver.surface.file import SurfaceFile, ready_for_lookup
from model.conditions import Conditions
from model.effects import BY_NAME
from model.parameters import Parameter
from model.support.errors import nearest
from model.touch_model import TouchModel

LEAST_FORCE_N = 1e-3  # of a touch that the model is asked about
HIGHEST_SPEED_M_S = 10.0  # that the model is asked about
TIME_STEP_S = 0.05  # effects of time see it in steps this long

FrictionLaw = Callable[[float, float, float, float, float], float]
"""(frequency_hz, voltage_v, normal_force_n, speed_m_s, time_s) -> lateral force in N that would be there after long."""


def friction_of(model: TouchModel) -> FrictionLaw:
    """The model's steady lateral force; without an effect of time, time does not matter to it."""
    ages = any("time_s" in effect.needs for effect in model.description.effects)

    @lru_cache(maxsize=64)
    def cof(frequency_hz: float, voltage_v: float, load_n: float, speed_m_s: float, time_s: float) -> float:
        f, v, n, s, t = (np.array([x]) for x in (frequency_hz, voltage_v, load_n, speed_m_s, time_s))
        return float(model.predict(Conditions(f, v, n, speed_m_s=s, time_s=t)).cof[0])

    def friction_n(
        frequency_hz: float, voltage_v: float, normal_force_n: float, speed_m_s: float, time_s: float
    ) -> float:
        load_n = max(normal_force_n, LEAST_FORCE_N)
        seen_s = TIME_STEP_S * round(time_s / TIME_STEP_S) if ages else 0.0
        return cof(frequency_hz, voltage_v, load_n, min(abs(speed_m_s), HIGHEST_SPEED_M_S), seen_s) * normal_force_n

    return friction_n


def surface_friction(file: SurfaceFile, limits: OperatingLimits) -> FrictionLaw:
    """The same from a surface of the finger's model: a thousand times faster, for a finger in real time."""
    surface = ready_for_lookup(file, limits)

    def friction_n(
        frequency_hz: float, voltage_v: float, normal_force_n: float, speed_m_s: float, time_s: float
    ) -> float:
        load_n = max(normal_force_n, LEAST_FORCE_N)
        cof = cof_at(surface, frequency_hz, voltage_v, load_n)
        if file.correction is not None:
            finger = FingerState(time_s, 0.0, 0.0, speed_m_s, 0.0, load_n, True)
            off, rise = factors_at(file.correction, frequency_hz, voltage_v, finger)
            low = cof_at(surface, frequency_hz, 0.0, load_n)
            cof = off * low + rise * (cof - low)
        return cof * normal_force_n

    return friction_n


def with_hidden(model: TouchModel, hide: Mapping[str, Mapping[str, float]]) -> TouchModel:
    """`model` with effects switched on that its file does not tell of; BadInputError names what is wrong."""
    hidden: dict[str, dict[str, Parameter]] = {}
    for name, values in hide.items():
        if name not in BY_NAME:
            raise BadInputError("bad_hide", f"hide: there is no effect '{name}'", nearest(name, list(BY_NAME)))
        known = {p.name: p for p in BY_NAME[name].parameters()}
        for key in values:
            if key not in known:
                raise BadInputError("bad_hide", f"hide: {name} has no parameter '{key}'", nearest(key, list(known)))
        for key, p in known.items():
            if not p.low <= values.get(key, np.nan) <= p.high:
                what = f"hide: {name}.{key} is {values.get(key, 'missing')}"
                raise BadInputError("bad_hide", what, f"Give a number in {p.low:g}..{p.high:g} {p.unit}")
        hidden[name] = {key: Parameter(float(values[key]), p.unit, "hidden") for key, p in known.items()}
    switched_on = {**model.description.effect_parameters, **hidden}
    return TouchModel(replace(model.description, effect_parameters=switched_on)) if hide else model
