"""A simulated finger: its model's friction and electrode current, with the effects that a
configuration hides.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from math import floor, log
from typing import Any, NamedTuple

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.limits import OperatingLimits
from haptic_driver.lookup.file import SurfaceFile, ready_for_lookup
from haptic_driver.render.correction import factors_at
from haptic_driver.render.surface import cof_at
from haptic_driver.rig.config import SimulationConfig
from haptic_driver.rig.sealed import opened
from haptic_driver.signals import FingerState
from hw.monitor.simulated import ElectrodeState
from model.conditions import Conditions
from model.effects import BY_NAME
from model.parameters import Parameter
from model.support.errors import nearest
from model.touch_model import TouchModel

LEAST_FORCE_N = 1e-3  # of a touch that the model is asked about
HIGHEST_SPEED_M_S = 10.0  # that the model is asked about
LOAD_RATIO = 1.05  # between loads that the model is asked about, where loads vary
TIME_STEP_S = 0.05  # effects of time see it in steps this long

FrictionLaw = Callable[..., float]
"""(frequency_hz, voltage_v, normal_force_n, speed_m_s, time_s) -> lateral force in N that would be
there after long.

Under a bias or another waveform than a sine it is also given (voltage_offset_v, waveform).
"""

ElectrodeLaw = Callable[..., ElectrodeState | None]
"""The same inputs -> what is at the electrode, stray current included, against the set voltage;
None where not known.

Without a load there is no finger, without speed it rests.
"""


class FingerLaws(NamedTuple):
    """What a finger does under voltages, and to the electrode."""

    friction: FrictionLaw
    electrode: ElectrodeLaw


def friction_of(model: TouchModel, answers: int = 64) -> FrictionLaw:
    """The model's steady lateral force; without an effect of time, time does not matter to it. The
    last answers are kept.
    """
    ages = any("time_s" in effect.needs for effect in model.description.effects)

    @lru_cache(maxsize=answers)
    def cof(*condition: Any) -> float:
        return float(model.cof(_condition(*condition))[0])

    def friction_n(
        frequency_hz: float,
        voltage_v: float,
        normal_force_n: float,
        speed_m_s: float,
        time_s: float,
        *bias_and_waveform: Any,
    ) -> float:
        load_n = max(normal_force_n, LEAST_FORCE_N)
        seen_s = TIME_STEP_S * round(time_s / TIME_STEP_S) if ages else 0.0
        speed_m_s = min(abs(speed_m_s), HIGHEST_SPEED_M_S)
        mu = cof(frequency_hz, voltage_v, load_n, speed_m_s, seen_s, *bias_and_waveform)
        return mu * normal_force_n

    return friction_n


def between_loads(model: TouchModel) -> FrictionLaw:
    """The same for loads that change all the time, at a hundredth of the cost. It interpolates
    coefficients of friction linearly between loads a twentieth apart.
    """
    exact = friction_of(model, answers=1024)

    def friction_n(
        frequency_hz: float, voltage_v: float, normal_force_n: float, *rest: Any
    ) -> float:
        place = log(max(normal_force_n, LEAST_FORCE_N)) / log(LOAD_RATIO)
        low_n, high_n = LOAD_RATIO ** floor(place), LOAD_RATIO ** (floor(place) + 1)
        low, high = (exact(frequency_hz, voltage_v, n, *rest) / n for n in (low_n, high_n))
        share = place - floor(place)
        return normal_force_n * ((1.0 - share) * low + share * high)

    return friction_n


def electrode_of(model: TouchModel, stray_capacitance_f: float = 0.0) -> ElectrodeLaw:
    """What the model says of the electrode, with more stray capacitance than the model's own in
    parallel.
    """

    def state(
        frequency_hz: float,
        voltage_v: float,
        normal_force_n: float,
        speed_m_s: float,
        time_s: float,
        voltage_offset_v: float = 0.0,
        waveform: str = "sine",
    ) -> ElectrodeState:
        finger = "none" if normal_force_n <= 0.0 else "resting" if speed_m_s == 0.0 else "sliding"
        condition = _condition(
            frequency_hz,
            voltage_v,
            max(normal_force_n, LEAST_FORCE_N),
            min(abs(speed_m_s), HIGHEST_SPEED_M_S),
            time_s,
            voltage_offset_v,
            waveform,
        )
        answer = model.predict(replace(condition, finger=np.array([finger])))
        voltage = complex(answer.electrode_voltage_v[0])
        current = complex(answer.electrode_current_a[0])
        stray_a = 2j * np.pi * frequency_hz * stray_capacitance_f * voltage
        return ElectrodeState(frequency_hz, voltage, current + stray_a, direct_v=voltage_offset_v)

    return state


def _condition(
    frequency_hz: float,
    voltage_v: float,
    load_n: float,
    speed_m_s: float,
    time_s: float,
    offset_v: float = 0.0,
    waveform: str = "sine",
) -> Conditions:
    f, v, n, offset, wave, s, t = (
        np.array([x])
        for x in (frequency_hz, voltage_v, load_n, offset_v, waveform, speed_m_s, time_s)
    )
    return Conditions(f, v, n, offset, wave, s, t)


def surface_friction(file: SurfaceFile, limits: OperatingLimits) -> FrictionLaw:
    """The same from a surface of the finger's model: a thousand times faster, for a finger in real
    time.
    """
    surface = ready_for_lookup(file, limits)

    def friction_n(
        frequency_hz: float,
        voltage_v: float,
        normal_force_n: float,
        speed_m_s: float,
        time_s: float,
    ) -> float:
        load_n = max(normal_force_n, LEAST_FORCE_N)
        cof = cof_at(surface, frequency_hz, voltage_v, load_n)
        if file.correction is not None:
            finger = FingerState(time_s, 0.0, 0.0, speed_m_s, 0.0, load_n, True, contact_s=time_s)
            off, rise = factors_at(file.correction, frequency_hz, voltage_v, finger)
            low = cof_at(surface, frequency_hz, 0.0, load_n)
            cof = off * low + rise * (cof - low)
        return cof * normal_force_n

    return friction_n


def finger_of(model: TouchModel, simulation: SimulationConfig) -> TouchModel:
    """`model` with all that a rig's file says of its finger alone, openly or sealed."""
    sealed = opened(simulation.sealed)
    if sealed.finger:
        model = TouchModel(model.description.with_values(**sealed.finger))
    return with_hidden(model, simulation.hide | sealed.hide)


def with_hidden(model: TouchModel, hide: Mapping[str, Mapping[str, float]]) -> TouchModel:
    """`model` with effects switched on that its file does not tell of; BadInputError names what is
    wrong.
    """
    hidden: dict[str, dict[str, Parameter]] = {}
    for name, values in hide.items():
        if name not in BY_NAME:
            raise BadInputError(
                "bad_hide", f"hide: there is no effect '{name}'", nearest(name, list(BY_NAME))
            )
        known = [p.name for p in BY_NAME[name].parameters()]
        for key in values:
            if key not in known:
                raise BadInputError(
                    "bad_hide", f"hide: {name} has no parameter '{key}'", nearest(key, known)
                )
        asked = BY_NAME[name].asked(values)
        for p in asked:
            if not p.low <= values.get(p.name, np.nan) <= p.high:
                what = f"hide: {name}.{p.name} is {values.get(p.name, 'missing')}"
                raise BadInputError(
                    "bad_hide", what, f"Give a number in {p.low:g}..{p.high:g} {p.unit}"
                )
        hidden[name] = {p.name: Parameter(float(values[p.name]), p.unit, "hidden") for p in asked}
    switched_on = {**model.description.effect_parameters, **hidden}
    return TouchModel(replace(model.description, effect_parameters=switched_on)) if hide else model
