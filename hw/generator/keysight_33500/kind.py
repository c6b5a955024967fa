"""The Keysight 33500 and 33600 series as a kind of generator."""

from __future__ import annotations

from hw.generator.contract import GeneratorKind, GeneratorLatency, Listener, SimulatedGenerator
from hw.generator.keysight_33500.driver import Keysight33500


def simulator(
    latency: GeneratorLatency, *, listener: Listener | None = None, am_full_scale: float = 1.0
) -> SimulatedGenerator:
    """A simulated one; imported only here, since the watchdog reads this file too."""
    from hw.generator.keysight_33500.simulator import Simulated33500  # noqa: PLC0415

    return Simulated33500(latency, listener=listener, am_full_scale=am_full_scale)


KIND = GeneratorKind(
    make=Keysight33500,
    simulator=simulator,
    amplitude_low_vpp=Keysight33500.amplitude_low_vpp,
    amplitude_high_vpp=Keysight33500.amplitude_high_vpp,
    external_modulation=Keysight33500.external_modulation,
    shapes=Keysight33500.shapes,
    limits_itself=Keysight33500.limits_itself,
)
