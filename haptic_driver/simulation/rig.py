"""The same rig on simulated instruments: real bytes over TCP below, the model's physics behind.

Driver, limits and safety are those of a real rig; only what lies beyond the wires is simulated. Time passes in explicit
steps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from types import TracebackType
from typing import Protocol, Self

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.limits import OperatingLimits
from haptic_driver.render.correction import factors_at
from haptic_driver.render.surface import cof_at
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.devices import build_rig
from haptic_driver.signals import FingerState
from haptic_driver.surface.file import SurfaceFile, ready_for_lookup
from hw.amplifier.simulated import SimulatedAmplifier
from hw.finger.plant import FingerPlant
from hw.force.simulated import SimulatedForceSensor
from hw.generator.contract import GeneratorLatency, Listener, SimulatedGenerator
from hw.serving.responder import Responder
from hw.serving.tcp import TcpServer
from hw.transport.contract import Transport
from hw.transport.tcp import TcpTransport
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


class _Wrap(Protocol):
    def __call__(self, core: Responder, /) -> Responder: ...


class SimulatedRig:
    """A rig served on loopback, with the finger that touches it.

    `rig` is what a driver sees. `amplifier` keeps the record of what really was at the electrode. `wrap` may put
    something between the generator and its socket, such as faults; `through` something around the driver's transport,
    such as a wire log. The finger's friction is the model's with the effects that the rig's configuration hides, or
    `friction`, any function at all; `finger_gain` multiplies it.
    """

    def __init__(
        self,
        config: RigConfig,
        model: TouchModel,
        wrap: _Wrap | None = None,
        friction: FrictionLaw | None = None,
        through: Callable[[Transport], Transport] = lambda transport: transport,
    ) -> None:
        simulation = config.simulation
        law = friction or friction_of(with_hidden(model, simulation.hide))
        self.amplifier = simulated_amplifier(config)
        self._generator = simulated_generator(config, self.amplifier)
        core = self._generator if wrap is None else wrap(self._generator)
        self._server = TcpServer(core)
        self.finger_gain = 1.0
        self.plant = FingerPlant(
            lambda f, v, n, speed: self.finger_gain * law(f, v, n, speed, self.plant.time_s),
            cutoff_hz_per_mm_s=simulation.friction_cutoff_hz_per_mm_s,
        )
        sensor = SimulatedForceSensor(
            self.plant, noise_n=simulation.force_noise_n, range_n=simulation.force_range_n, seed=simulation.seed
        )
        transport = TcpTransport.from_resource(self._server.resource)
        self.rig = build_rig(config, through(transport), sensor, self.amplifier, self.amplifier)

    def step(self, dt_s: float, normal_force_n: float, speed_m_s: float) -> None:
        """Let `dt_s` pass with the finger pressing and sliding so; the rig's outputs act on it."""
        self._generator.advance(dt_s)
        output = self._generator.output()
        voltage_v = self.amplifier.step(dt_s, output)
        self.plant.step(dt_s, output.frequency_hz, voltage_v, normal_force_n, speed_m_s)

    @property
    def voltage_v(self) -> float:
        """Peak voltage at the electrode now."""
        return self.amplifier.voltage_v

    @property
    def frequency_hz(self) -> float:
        """Frequency at the generator's terminals now."""
        return self._generator.output().frequency_hz

    def __enter__(self) -> Self:
        """Serve the instruments."""
        self._server.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Switch off and stop serving."""
        self.rig.close()
        self._server.close()


def simulated_amplifier(config: RigConfig, interlock: Callable[[], bool] = lambda: True) -> SimulatedAmplifier:
    """The amplifier as the rig's file describes it, with a contact in series with its enable line."""
    amplifier = config.amplifier
    return SimulatedAmplifier(
        amplifier.gain_v_per_v,
        amplifier.voltage_limit_v,
        voltage_monitor_v_per_v=amplifier.voltage_monitor_v_per_v,
        interlock=interlock,
    )


def simulated_generator(
    config: RigConfig, amplifier: SimulatedAmplifier, listener: Listener | None = None
) -> SimulatedGenerator:
    """The generator that drives it; amplifier, or `listener`, sees also what it does between steps."""
    simulation, modulation = config.simulation, config.waveform_generator.modulation_input
    latency = GeneratorLatency(amplitude_s=simulation.amplitude_latency_s, frequency_s=simulation.frequency_latency_s)
    highest = 1.0 if modulation is None else modulation.amplitude_at_full_scale
    kind = config.generator_kind()
    return kind.simulator(latency, listener=listener or amplifier.drive, am_full_scale=highest)


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
