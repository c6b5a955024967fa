"""Kinds of monitors of the electrode's own voltage and current; a rig takes the first that measures
the frequency.
"""

from __future__ import annotations

import re
from contextlib import closing
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from haptic_driver.config import Within
from haptic_driver.rig.check import Checks, Examination
from haptic_driver.rig.part import (
    Hertz,
    Part,
    PartSection,
    Resource,
    SampleRate,
    Seconds,
    ServedSection,
    Wiring,
)
from haptic_driver.rig.parts.interlocks import served_lines
from hw.amplifier.served_lines import ServedMonitor

if TYPE_CHECKING:
    from hw.impedance.e4980a import E4980A
    from hw.monitor.lines import MonitorLines, SampledMonitor, Sampling
    from hw.oscilloscope.infiniivision import InfiniiVision
    from hw.transport.contract import Transport


InstrumentHertz = Annotated[float, Within(1e-6, 1e9, "no instrument here reaches lower or higher")]


class SomeElectrodeMonitor(PartSection):
    """What every kind says: which carriers it measures.

    `drives`: it puts its own voltage on the electrode, in place of generator and amplifier, up to
    `highest_v`.
    """

    drives: ClassVar[bool] = False

    @property
    def highest_v(self) -> float:
        """The highest peak that it puts on the electrode itself."""
        return 0.0

    def range_hz(self, card_hz: tuple[float, float]) -> tuple[float, float]:
        """The lowest and the highest carrier; `card_hz` are those of the rig's card."""
        raise NotImplementedError

    def examine(self, at: Examination) -> Checks:
        hint = "a resistor in the finger's place must read as one throughout"
        yield at.unverified("needs a voltage", hint)


class SimulatedElectrodeMonitorConfig(SomeElectrodeMonitor, ServedSection):
    """A converter on the simulated amplifier's monitor lines and on the generator's output."""

    served_as = "amplifier_lines"

    kind: Literal["simulated"]
    sample_rate_hz: SampleRate = Field(description="of each channel")
    record_s: Seconds = Field(
        default=0.1,
        description="how long a record is, or a period of the carrier where that is longer",
    )
    buffer_s: Seconds = Field(
        default=2.0, description="how much is kept: the slowest carrier has a period in it"
    )
    range_v: Annotated[float, Within(1e-3, 1e3, "no converter takes less or more")] = Field(
        default=10.0, description="+-, beyond it the converter clips"
    )
    resolution_v: Annotated[float, Within(1e-9, 1.0, "no converter's step is finer or coarser")] = (
        Field(default=20.0 / 2**16, description="the converter's step")
    )

    def range_hz(self, card_hz: tuple[float, float]) -> tuple[float, float]:
        """One period in the buffer; what does not alias."""
        from hw.analog.demodulation import highest_carrier_hz

        return 1.0 / self.buffer_s, highest_carrier_hz(self.sample_rate_hz)

    def sampling(self) -> Sampling:
        """The same, as the driver takes it."""
        from hw.monitor.lines import Sampling

        return Sampling(**self.given_for(Sampling))

    def make(self, wiring: Wiring) -> Part[ServedMonitor]:
        monitor = ServedMonitor(served_lines(self._where), self.range_hz((0.0, 0.0)))
        return Part(monitor, closing=[monitor.close])


class CardElectrodeMonitorConfig(SomeElectrodeMonitor):
    """The amplifier's two monitors on the card of `[analog_inputs]`.

    `reference`: the channel on the generator's own output, through a T-piece; without it phases
    count from the voltage monitor. `conversion_interval_s`: from one channel of the card to the
    next, where they share one converter; 0 takes what the card says.
    """

    kind: Literal["card"]
    reference: str | None = Field(
        default=None,
        description=(
            "channel of the card on the generator's own output; without it phases "
            "count from the electrode's voltage"
        ),
    )
    record_s: Seconds = Field(
        default=0.1,
        description="how long a record is, or a period of the carrier where that is longer",
    )
    resolution_v: Annotated[float, Within(0.0, 1.0, "no converter's step is as coarse")] = Field(
        default=0.0, description="the converter's step"
    )
    conversion_interval_s: Annotated[
        float, Within(0.0, 1e-3, "no card is slower from one channel to the next")
    ] = Field(
        default=0.0,
        description=(
            "from one channel to the next where they share a converter; 0: what the card says"
        ),
    )

    @property
    def channels(self) -> list[str]:
        """The reference; the monitors are the amplifier's."""
        return [self.reference] if self.reference else []

    def range_hz(self, card_hz: tuple[float, float]) -> tuple[float, float]:
        return card_hz

    def make(self, wiring: Wiring) -> Part[SampledMonitor]:
        """Two or three columns of the card."""
        from hw.monitor.lines import SampledMonitor, Sampling

        inputs, lines = wiring.inputs, wiring.monitor_lines
        assert inputs is not None  # or the file would have been refused
        assert lines is not None
        channels = [*wiring.monitor_channels, *self.channels]
        columns = inputs.columns(channels, self.conversion_interval_s)
        return Part(SampledMonitor(columns, lines, Sampling(self.record_s, self.resolution_v)))


class InstrumentMonitor(SomeElectrodeMonitor):
    """An instrument of its own, which says who it is."""

    resource: Resource = Field(description="how to reach it, as the generator")
    visa_backend: str = Field(default="@py", description="of pyvisa, as the generator's")
    lowest_frequency_hz: Hertz
    highest_frequency_hz: InstrumentHertz
    reply_timeout_s: Seconds

    def range_hz(self, card_hz: tuple[float, float]) -> tuple[float, float]:
        """As the file says."""
        return self.lowest_frequency_hz, self.highest_frequency_hz

    def transport(self) -> Transport:
        """The way to it, closed."""
        from hw.transport.resource import make_transport

        return make_transport(self.resource, visa_backend=self.visa_backend)

    def identity(self) -> re.Pattern[str]:
        """What it calls itself, in the second field of its answer to *IDN?."""
        raise NotImplementedError

    def driver(self, lines: MonitorLines | None) -> InfiniiVision | E4980A:
        """What drives it, on an amplifier's lines; closed."""
        raise NotImplementedError

    def examine(self, at: Examination) -> Checks:
        """Ask who it is; what it would read needs a voltage."""
        monitor = self.driver(at.rig.amplifier.monitor_lines())
        with closing(monitor.line) as line:
            yield at.ok(line.identify(self.identity()), monitor.held())


class InfiniiVisionConfig(InstrumentMonitor):
    """A Keysight InfiniiVision oscilloscope on the monitor lines; the generator's Sync triggers it
    at EXT, `trigger_level_v` being between its two levels.
    """

    kind: Literal["infiniivision"]
    voltage_channel: Annotated[int, Field(ge=1, le=4)] = Field(
        default=1, description="which of its channels the voltage monitor is on"
    )
    current_channel: Annotated[int, Field(ge=1, le=4)] = Field(
        default=2, description="which the current monitor is on"
    )
    lowest_frequency_hz: Hertz = Field(
        default=100.0, description="it is not asked about slower carriers"
    )
    highest_frequency_hz: InstrumentHertz = Field(default=2e6, description="nor about faster ones")
    reply_timeout_s: Seconds = Field(default=2.0, description="for one answer")
    trigger_level_v: Annotated[
        float, Within(-8.0, 8.0, "no Sync swings around it, and no EXT takes more")
    ] = Field(default=1.2, description="of EXT, where the generator's Sync goes")

    def identity(self) -> re.Pattern[str]:
        from hw.oscilloscope.infiniivision import MODEL

        return MODEL

    def driver(self, lines: MonitorLines | None) -> InfiniiVision:
        from hw.oscilloscope.infiniivision import InfiniiVision, Oscilloscope

        assert lines is not None  # or the file would have been refused
        wired = Oscilloscope(
            self.voltage_channel,
            self.current_channel,
            self.lowest_frequency_hz,
            self.highest_frequency_hz,
            self.reply_timeout_s,
            self.trigger_level_v,
        )
        return InfiniiVision(self.transport(), wired, lines)

    @model_validator(mode="after")
    def _apart(self) -> InfiniiVisionConfig:
        if self.voltage_channel == self.current_channel:
            raise ValueError("voltage_channel and current_channel must be two channels")
        return self

    def make(self, wiring: Wiring) -> Part[InfiniiVision]:
        scope = self.driver(wiring.monitor_lines)
        return Part(scope, [scope.open], [scope.close])


class E4980AConfig(InstrumentMonitor):
    """A Keysight E4980A or E4980AL, wired to the electrode in place of the amplifier while it
    sweeps.

    `voltage_limit_v` is the highest peak that it may put on the electrode, `accuracy` its share of
    an impedance.
    """

    drives: ClassVar[bool] = True

    kind: Literal["e4980a"]
    voltage_limit_v: Annotated[float, Within(1e-3, 28.3, "its own levels end at 20 V rms")] = Field(
        default=2.8, description="highest peak that it may put on the electrode"
    )
    lowest_frequency_hz: Hertz = Field(
        default=20.0, description="it is not asked about slower carriers"
    )
    highest_frequency_hz: InstrumentHertz = Field(default=2e6, description="nor about faster ones")
    accuracy: Annotated[float, Within(1e-6, 1.0, "it is a share of an impedance")] = Field(
        default=1e-3, description="share by which an impedance may be off"
    )
    reply_timeout_s: Seconds = Field(default=10.0, description="for one answer")

    @property
    def highest_v(self) -> float:
        """As the file says."""
        return self.voltage_limit_v

    def identity(self) -> re.Pattern[str]:
        from hw.impedance.e4980a import MODEL

        return MODEL

    def driver(self, lines: MonitorLines | None) -> E4980A:
        from hw.impedance.e4980a import E4980A, LcrMeter

        allowed = LcrMeter(
            self.voltage_limit_v,
            self.lowest_frequency_hz,
            self.highest_frequency_hz,
            self.accuracy,
            self.reply_timeout_s,
        )
        return E4980A(self.transport(), allowed)

    def make(self, wiring: Wiring) -> Part[E4980A]:
        meter = self.driver(None)
        return Part(meter, [meter.open], [meter.close])
