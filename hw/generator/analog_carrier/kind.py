"""A carrier from an analog output as a kind of generator, in its place."""

from __future__ import annotations

from hw.generator.analog_carrier.driver import AMPLITUDE_HIGH_VPP, AMPLITUDE_LOW_VPP, AnalogCarrier
from hw.generator.contract import GeneratorKind, GeneratorLatency, Listener, SimulatedGenerator


def simulator(
    latency: GeneratorLatency, *, listener: Listener | None = None, am_full_scale: float = 1.0
) -> SimulatedGenerator:
    """A simulated one; imported only here, since the watchdog reads this file too."""
    from hw.generator.analog_carrier.simulator import SimulatedCarrier  # noqa: PLC0415

    return SimulatedCarrier(latency, listener=listener, am_full_scale=am_full_scale)


KIND = GeneratorKind(
    make=AnalogCarrier,
    simulator=simulator,
    amplitude_low_vpp=AMPLITUDE_LOW_VPP,
    amplitude_high_vpp=AMPLITUDE_HIGH_VPP,
    by_samples=True,
    relay_interval_s=0.0,  # it has none
)
