"""The same rig on simulated instruments: real bytes over TCP below, the model's physics behind.

Driver, limits and safety are those of a real rig; only what lies beyond the wires is simulated. Time passes in explicit
steps.
"""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType
from typing import Protocol, Self

import numpy as np

from haptic_driver.config import RigConfig
from haptic_driver.rig import build_rig
from hw.simulated.amplifier import SimulatedAmplifier
from hw.simulated.finger_plant import FingerPlant
from hw.simulated.force_sensor import SimulatedForceSensor
from hw.simulated.tcp_server import TcpServer
from hw.simulated.waveform_generator import GeneratorLatency, Simulated33220A
from hw.transport.memory import Responder
from hw.transport.tcp import TcpTransport
from model.touch_model import Conditions, TouchModel

LEAST_FORCE_N = 1e-3  # of a touch that the model is asked about


class _Wrap(Protocol):
    def __call__(self, core: Responder, /) -> Responder: ...


class SimulatedRig:
    """A rig served on loopback, with the finger that touches it.

    `rig` is what a driver sees. `amplifier` keeps the record of what really was at the electrode. `wrap` may put
    something between the generator and its socket, such as faults.
    """

    def __init__(self, config: RigConfig, model: TouchModel, wrap: _Wrap | None = None) -> None:
        simulation = config.simulation
        self.amplifier = SimulatedAmplifier(
            config.amplifier.gain_v_per_v,
            config.amplifier.voltage_limit_v,
            voltage_monitor_v_per_v=config.amplifier.voltage_monitor_v_per_v,
        )
        self._generator = Simulated33220A(
            GeneratorLatency(amplitude_s=simulation.amplitude_latency_s, frequency_s=simulation.frequency_latency_s),
            listener=self.amplifier.drive,  # so that the monitor sees what the generator does between steps
        )
        core = self._generator if wrap is None else wrap(self._generator)
        self._server = TcpServer(core)
        self.plant = FingerPlant(friction_of(model), cutoff_hz_per_mm_s=simulation.friction_cutoff_hz_per_mm_s)
        sensor = SimulatedForceSensor(
            self.plant, noise_n=simulation.force_noise_n, range_n=simulation.force_range_n, seed=simulation.seed
        )
        transport = TcpTransport.from_resource(self._server.resource)
        self.rig = build_rig(config, transport, sensor, self.amplifier, self.amplifier)

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


def friction_of(model: TouchModel) -> Callable[[float, float, float, float], float]:
    """Steady lateral force in N from (frequency_hz, voltage_v, normal_force_n, speed_m_s), by the model."""

    def friction_n(frequency_hz: float, voltage_v: float, normal_force_n: float, speed_m_s: float) -> float:
        load_n = max(normal_force_n, LEAST_FORCE_N)
        conditions = Conditions(np.array([frequency_hz]), np.array([voltage_v]), np.array([load_n]))
        return float(model.predict(conditions).cof[0]) * normal_force_n

    return friction_n
