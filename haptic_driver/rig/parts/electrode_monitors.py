"""Kinds of monitors of the electrode's own voltage and current; a rig takes the first that tells the frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, FiniteFloat

from haptic_driver.rig.part import NotNegative, Part, PartKind, PartSection, Positive, Seconds, Wiring

if TYPE_CHECKING:
    from hw.monitor.lines import SampledMonitor, Sampling


class SomeElectrodeMonitor(PartSection):
    """What every kind says: which carriers it tells. Where the card decides, `highest_hz` is 0."""

    @property
    def highest_hz(self) -> float:
        """The highest carrier."""
        return 0.0

    @property
    def lowest_hz(self) -> float:
        """The lowest carrier."""
        return 0.0


class SimulatedElectrodeMonitorConfig(SomeElectrodeMonitor):
    """A converter on the simulated amplifier's monitor lines and on the generator's output."""

    kind: Literal["simulated"]
    sample_rate_hz: Positive
    record_s: Seconds = 0.2
    buffer_s: Seconds = 2.0
    range_v: Positive = 10.0
    resolution_v: Positive = 20.0 / 2**16

    @property
    def highest_hz(self) -> float:
        """What does not alias."""
        from hw.analog.demodulation import highest_carrier_hz

        return highest_carrier_hz(self.sample_rate_hz)

    @property
    def lowest_hz(self) -> float:
        """One period in the buffer."""
        return 1.0 / self.buffer_s

    def sampling(self) -> Sampling:
        """The same, as the driver takes it."""
        from hw.monitor.lines import Sampling

        return Sampling(**self.given_for(Sampling))


class CardElectrodeMonitorConfig(SomeElectrodeMonitor):
    """The amplifier's two monitors on the card of `[analog_inputs]`.

    `reference`: the channel on the generator's own output, through a T-piece; without it phases count from the voltage
    monitor. `conversion_interval_s`: from one channel of the card to the next, where they share one converter.
    """

    kind: Literal["card"]
    reference: str | None = None
    record_s: Seconds = 0.2
    resolution_v: NotNegative = 0.0
    conversion_interval_s: Annotated[FiniteFloat, Field(ge=0.0, le=1e-3)] = 0.0

    @property
    def channels(self) -> list[str]:
        """The reference; the monitors are the amplifier's."""
        return [self.reference] if self.reference else []


def make_card(section: CardElectrodeMonitorConfig, wiring: Wiring) -> Part[SampledMonitor]:
    """Two or three columns of the card."""
    from hw.monitor.lines import SampledMonitor, Sampling

    inputs, lines = wiring.inputs, wiring.monitor_lines
    assert inputs is not None  # or the file would have been refused
    assert lines is not None
    channels = [*wiring.monitor_channels, *section.channels]
    lags_s = tuple(section.conversion_interval_s * place for place in inputs.places(channels))
    sampling = Sampling(inputs.sample_rate_hz, section.record_s, inputs.buffer_s, section.resolution_v, lags_s)
    return Part(SampledMonitor(inputs.columns(channels), lines, sampling))


SIMULATED = PartKind(SimulatedElectrodeMonitorConfig)
CARD = PartKind(CardElectrodeMonitorConfig, make_card)
