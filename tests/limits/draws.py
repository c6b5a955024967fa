"""A random model on a random rig, what its controller lets out, and what the full model says of
that.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.limits import OperatingLimits
from haptic_driver.lookup.build import SurfaceAxes, axes_within, build_surface
from haptic_driver.lookup.file import SurfaceFile, ready_for_lookup
from haptic_driver.render.controller import INITIAL, Controller, ControllerSettings
from haptic_driver.render.policies import POLICIES
from haptic_driver.render.safety import Worst, table_of, violation, worst_at
from haptic_driver.signals import NO_COMMAND, FingerState, TargetFriction
from model.conditions import Conditions
from model.description import ModelDescription
from model.effects import BY_NAME
from model.effects.base import EffectParameter
from model.effects.learned import LEARNED, LearnedForm, Term, learned_kind
from model.parameters import Parameter
from model.touch_model import TouchModel

POINTS = 12  # for each draw
FREQUENCIES_HZ = (1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6)
VOLTAGES_V = (0.0, 30.0, 80.0, 150.0)
AREAS_M2 = (471e-6, 684e-6, 9e-3)
COARSE = SurfaceAxes(frequency_count=60, voltage_count=32)
SCANNED = 1500  # voltages


class Point(NamedTuple):
    """What went out, and under which finger."""

    frequency_hz: float
    voltage_v: float
    normal_force_n: float
    speed_m_s: float
    contact_s: float


class Draw(NamedTuple):
    """One model on one rig."""

    description: ModelDescription
    limits: OperatingLimits
    settings: ControllerSettings
    file: SurfaceFile
    points: list[Point]
    refused: list[str]
    full_scale_v: list[float]  # of a carrier under an envelope, for each point

    @property
    def about(self) -> str:
        effects = {
            name: {
                key: round(p.value, 4) if abs(p.value) > 1e-3 else p.value
                for key, p in values.items()
            }
            for name, values in self.description.effect_parameters.items()
        }
        return f"{effects} {self.description.learned_form} {self.limits} {self.settings.policy}"


class Shares(NamedTuple):
    """What a point takes of each limit by the full model, [n] each."""

    stuck_current: np.ndarray
    sliding_current: np.ndarray
    electrode_volts: np.ndarray
    slew_rate: np.ndarray
    amplifier_current: np.ndarray


def drawn(
    reference: ModelDescription, rng: np.random.Generator, coarse: bool = False
) -> Draw | None:
    """A draw, with the usual surface or a coarse one; None for a finger that sticks to the screen
    by itself.
    """
    description, limits = _model(reference, rng), _limits(rng)
    file = build_surface(
        description, limits, axes_within(description, COARSE if coarse else SurfaceAxes())
    )
    try:
        lookup = ready_for_lookup(file, limits)
    except BadInputError:
        return None
    table = table_of(file.worst_case(limits))
    policy = str(rng.choice(list(POLICIES)))
    low, high = np.log(file.frequency_hz[[0, -1]])
    settings = ControllerSettings(
        lookup, limits, policy, float(np.exp(rng.uniform(low, high))), correction=file.correction
    )
    controller = Controller(settings)
    points, refused, full_scale_v = [], [], []
    for _ in range(POINTS):
        load_n, contact_s = _log(rng, 0.02, 8.0), _log(rng, 1e-2, 1e5)
        speed_m_s = _log(rng, 5e-4, 0.5)
        cof = np.inf if rng.random() < 0.3 else _log(rng, 0.2, 4.0)
        finger = FingerState(contact_s, 0.0, 0.0, speed_m_s, 0.0, load_n, True, contact_s=contact_s)
        _, wanted = controller.step(INITIAL, TargetFriction(cof, True), finger, NO_COMMAND)
        worst = Worst(*worst_at(table, wanted.frequency_hz, wanted.voltage_v))
        if reason := violation(limits, wanted, worst):
            refused.append(reason)
            continue
        points.append(Point(wanted.frequency_hz, wanted.voltage_v, load_n, speed_m_s, contact_s))
        full_scale_v.append(controller.full_scale_v(wanted.frequency_hz))
    return Draw(description, limits, settings, file, points, refused, full_scale_v)


def shares(draw: Draw, voltage_v: list[float]) -> Shares:
    """What the points take of the limits, at these voltages."""
    if not voltage_v:
        return Shares(*np.zeros((len(Shares._fields), 1)))
    p, v = Point(*map(np.array, zip(*draw.points, strict=True))), np.array(voltage_v)
    touch, limits = TouchModel(draw.description), draw.limits
    conditions = Conditions(
        p.frequency_hz, v, p.normal_force_n, speed_m_s=p.speed_m_s, time_s=p.contact_s
    )
    moving = touch.predict(conditions)
    resting = touch.predict(
        replace(conditions, speed_m_s=0.0 * v, finger=np.full(v.size, "resting"))
    )
    electrode_v = np.maximum(v, np.abs(moving.electrode_voltage_v))
    allowed_a = limits.contact_current_limit_a_rms(p.frequency_hz)
    deliverable_a = limits.amplifier_current_a / np.sqrt(2.0)
    if limits.series_resistance_ohm > 0.0:
        deliverable_a = np.minimum(
            deliverable_a, electrode_v / (np.sqrt(2.0) * limits.series_resistance_ohm)
        )
    slew = 2.0 * np.pi * p.frequency_hz * electrode_v
    more = _touches(draw, p.normal_force_n)
    sliding_a = more * np.fmax(moving.current_rms_a, resting.current_rms_a)
    stuck_a = more * np.fmax(moving.stuck_current_rms_a, resting.stuck_current_rms_a)
    return Shares(
        np.minimum(stuck_a, deliverable_a) / allowed_a,
        np.minimum(np.nan_to_num(sliding_a), deliverable_a) / allowed_a,
        electrode_v / limits.voltage_v,
        slew / limits.slew_v_per_s,
        slew * limits.panel_capacitance_f / limits.amplifier_current_a,
    )


def _touches(draw: Draw, load_n: np.ndarray) -> np.ndarray:
    """How many touches of its finger under each load [n] the rig's contact is, one at least."""
    loads, which = np.unique(load_n, return_inverse=True)
    touch = TouchModel(draw.description)
    area_m2 = np.array([touch.contact_area_m2(float(load)) for load in loads])
    return np.maximum(draw.limits.touching_area_m2 / area_m2, 1.0)[which]


def authority_left(draw: Draw) -> float:
    """V^2 of the first point's carrier at full scale, over V^2 that the limits allow there by the
    full model.

    NaN where nothing is out.
    """
    if not draw.points or not draw.full_scale_v[0]:
        return float("nan")
    v = np.linspace(0.0, draw.file.voltage_v[-1], SCANNED + 1)[1:]
    scan = draw._replace(points=[draw.points[0]] * SCANNED)
    is_beyond = np.max(shares(scan, v.tolist()), axis=0) > 1.0
    allowed_v = v[np.argmax(is_beyond)] if is_beyond.any() else v[-1]
    return float(min(draw.full_scale_v[0] / allowed_v, 1.0) ** 2)


def _model(reference: ModelDescription, rng: np.random.Generator) -> ModelDescription:
    """Some effects, as priors have them or anywhere within their bounds, and often a learned
    one.
    """
    count = int(rng.choice([0, 1, 1, 2, 3]))
    names = rng.choice(list(BY_NAME), count, replace=False)
    wide = rng.random() < 0.3
    effects = {
        str(name): {p.name: _parameter(p, rng, wide) for p in BY_NAME[name].parameters()}
        for name in names
    }
    form = random_form(rng) if rng.random() < 0.4 else None
    if form is not None:
        kind = learned_kind(form)
        effects[LEARNED] = {p.name: _parameter(p, rng, wide=False) for p in kind.parameters()}
    return replace(reference, effect_parameters=effects, learned_form=form)


def random_form(rng: np.random.Generator) -> LearnedForm:
    """A term at some place of the chain, over one of its inputs."""
    acts_on = str(
        rng.choice(
            ["voltage", "series_impedance", "gap_permittivity", "friction", "skin_stiffness"]
        )
    )
    inputs = {"skin_stiffness": "normal_force_n"}.get(acts_on) or str(
        rng.choice(["frequency_hz", "voltage_v"])
    )
    nodes = {
        "frequency_hz": FREQUENCIES_HZ,
        "voltage_v": VOLTAGES_V,
        "normal_force_n": (0.1, 0.5, 2.0),
    }[inputs]
    return LearnedForm(
        acts_on, "spline", (Term((inputs,), (nodes,), float(rng.uniform(0.1, 0.8))),), 1.0
    )


def _parameter(p: EffectParameter, rng: np.random.Generator, wide: bool) -> Parameter:
    low, high = max(p.low, p.median * 1e-4 if p.scale == "log" else p.low), p.high
    if not wide:
        value = float(p.from_normal(rng.normal()))
    elif p.scale == "log":
        value = _log(rng, low, min(high, p.median * 1e4))
    else:
        value = float(rng.uniform(low, high))
    return Parameter(value, p.unit, "drawn")


def _limits(rng: np.random.Generator) -> OperatingLimits:
    """Of a rig as files of the project have them, or with every limit drawn; for one touch, one
    hand's fingers, or a palm.
    """
    voltage_v = float(rng.choice([150.0, 150.0, 120.0, 60.0]))
    touching_area_m2 = float(rng.choice([0.0, *AREAS_M2]))
    if rng.random() < 0.4:
        return OperatingLimits(voltage_v, 1.0, 1e6, touching_area_m2=touching_area_m2)
    return OperatingLimits(
        voltage_v,
        1.0,
        1e6,
        slew_v_per_s=float(rng.choice([np.inf, _log(rng, 1e5, 1e9)])),
        series_resistance_ohm=float(rng.choice([0.0, _log(rng, 1e3, 1e6)])),
        amplifier_current_a=float(rng.choice([np.inf, _log(rng, 1e-3, 1.0)])),
        panel_capacitance_f=float(rng.choice([0.0, _log(rng, 1e-11, 1e-8)])),
        touching_area_m2=touching_area_m2,
    )


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
