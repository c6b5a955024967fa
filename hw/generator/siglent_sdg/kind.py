"""The Siglent SDG series as a kind of generator."""

from __future__ import annotations

import re

from hw.generator.contract import GeneratorKind, GeneratorLatency, Listener, SimulatedGenerator
from hw.generator.siglent_sdg.driver import SiglentSdg


def simulator(
    latency: GeneratorLatency, *, listener: Listener | None = None, am_full_scale: float = 1.0
) -> SimulatedGenerator:
    """A simulated one; imported only here, since the watchdog reads this file too."""
    from hw.generator.siglent_sdg.simulator import SimulatedSdg  # noqa: PLC0415

    return SimulatedSdg(latency, listener=listener, am_full_scale=am_full_scale)


KIND = GeneratorKind(
    make=SiglentSdg,
    simulator=simulator,
    amplitude_low_vpp=SiglentSdg.amplitude_low_vpp,
    amplitude_high_vpp=SiglentSdg.amplitude_high_vpp,
    ask_off=b"C1:OUTP?\n",
    switch_off=b"C1:OUTP OFF\n",
    off_answers=re.compile(rb"C1:OUTP (?:(?P<off>OFF)|ON),.*"),
)
