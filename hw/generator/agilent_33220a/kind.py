"""The Agilent 33220A as a kind of generator."""

from __future__ import annotations

from hw.generator.agilent_33220a.driver import Agilent33220A
from hw.generator.contract import GeneratorKind, GeneratorLatency, Listener, SimulatedGenerator


def simulator(
    latency: GeneratorLatency, *, listener: Listener | None = None, am_full_scale: float = 1.0
) -> SimulatedGenerator:
    """A simulated one; imported only here, since the watchdog reads this file too."""
    from hw.generator.agilent_33220a.simulator import Simulated33220A  # noqa: PLC0415

    return Simulated33220A(latency, listener=listener, am_full_scale=am_full_scale)


KIND = GeneratorKind(
    make=Agilent33220A,
    simulator=simulator,
    amplitude_low_vpp=Agilent33220A.amplitude_low_vpp,
    amplitude_high_vpp=Agilent33220A.amplitude_high_vpp,
    external_modulation=Agilent33220A.external_modulation,
    shapes=Agilent33220A.shapes,
)
