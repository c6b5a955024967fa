"""Kinds of analog outputs, for the fast envelope."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, model_validator

from haptic_driver.config import Within
from haptic_driver.rig.check import Checks, Examination
from haptic_driver.rig.part import (
    LineVolts,
    NoPart,
    Part,
    PartSection,
    SampleRate,
    Seconds,
    ServedSection,
    SignedFigures,
    Wiring,
)

if TYPE_CHECKING:
    from hw.analog.output import AnalogOutput, AnalogOutputSettings


ENVELOPE_RATE_HZ = 50e3  # at most; slower outputs play at their own limit


class NoAnalogOutput(NoPart):
    """No fast envelope: amplitudes go over SCPI."""

    def examine(self, at: Examination) -> Checks:
        over_scpi = at.rig.waveform_generator.carrier is None
        how = "go over SCPI" if over_scpi else "are in the carrier's own samples"
        yield at.ok(f"amplitudes {how}; there is no analog output for them")


class SomeAnalogOutput(SignedFigures, PartSection):
    """What every analog output has; see `hw.analog.output.AnalogOutputSettings`.

    `lead_s`: the envelope is written so far ahead of what is played. So late may the driver be
    without a gap, and so much later is the voltage there. None lets the driver choose by how late
    this machine is.
    """

    low_v: LineVolts = Field(description="nothing below is ever put out")
    high_v: LineVolts = Field(description="nothing above is ever put out")
    zero_level_v: LineVolts = Field(
        description="means no voltage at the electrode; must be minus modulation_input.full_scale_v"
    )
    sample_rate_limit_hz: SampleRate = Field(description="no faster output is asked for")
    buffer_s: Seconds = Field(default=0.1, description="no more may wait: bounds the delay")
    lead_s: (
        Annotated[
            float, Within(0.0005, 1.0, "no writer is so early, and no voltage may be so late")
        ]
        | None
    ) = Field(
        default=None,
        description=(
            "the envelope is written so far ahead: delay, and how late the driver may"
            " be; none: chosen by how late this machine has been"
        ),
    )
    lease_s: Annotated[
        float, Within(1e-3, 10.0, "a level that nobody refreshes stays no longer")
    ] = Field(default=0.5, description="a level that is not refreshed goes to zero_level_v")
    timeout_s: Seconds = Field(default=0.5, description="no call waits much longer")

    @model_validator(mode="after")
    def _ordered_levels(self) -> SomeAnalogOutput:
        if self.lead_s is not None and self.lead_s > self.buffer_s:
            raise ValueError("lead_s must not be above buffer_s")
        if not (self.low_v <= self.zero_level_v <= self.high_v and self.low_v < self.high_v):
            raise ValueError("low_v <= zero_level_v <= high_v must hold, with low_v < high_v")
        return self

    @property
    def envelope_rate_hz(self) -> float:
        """At which envelopes are played."""
        return min(self.sample_rate_limit_hz, ENVELOPE_RATE_HZ)

    def settings(self) -> AnalogOutputSettings:
        """The same, as the driver takes it."""
        from hw.analog.output import AnalogOutputSettings

        return AnalogOutputSettings(**self.given_for(AnalogOutputSettings))

    def examine(self, at: Examination) -> Checks:
        said = (
            f"{self.kind} output, {self.zero_level_v:g} V for nothing: opening it would put out a"
            " level"
        )
        hint = "measure Modulation In at low voltage: 0 V may be half the amplitude"
        names = "sample_rate_hz", "full_scale_v", "latency_s", "sample_rate_limit_hz"
        yield at.unverified(said, hint, self.untold(*names))


class SimulatedAnalogOutputConfig(SomeAnalogOutput, ServedSection):
    """The simulated rig's own."""

    served_as = "analog_output"

    kind: Literal["simulated"]

    def make(self, wiring: Wiring) -> Part[AnalogOutput]:
        from hw.analog.simulated_output import CardMemory, SimulatedAnalogOutput

        output = SimulatedAnalogOutput(lambda: CardMemory.at(self._where), self.settings())
        return Part(output, [output.open], [output.close])


class NiAnalogOutputConfig(SomeAnalogOutput):
    """An analog output of an NI card."""

    kind: Literal["ni"]
    channel: str = Field(description="output of the NI card, or number of the sound card's channel")

    @property
    def addresses(self) -> list[str]:
        """The output; the card's others are free."""
        return [self.channel]

    def make(self, wiring: Wiring) -> Part[AnalogOutput]:
        from hw.analog.ni_daq import NiAnalogOutput

        output = NiAnalogOutput(self.channel, self.settings())
        return Part(output, [output.open], [output.close])


class SoundAnalogOutputConfig(SomeAnalogOutput):
    """One channel of a sound card; see `hw.analog.sound_card`."""

    kind: Literal["sound"]
    device: str | int | None = Field(
        default=None, description="sound card by name or number; none: the system's default"
    )
    channel: Annotated[int, Field(ge=0, le=31)] = Field(
        default=0, description="output of the NI card, or number of the sound card's channel"
    )
    sample_rate_hz: SampleRate = Field(description="of the sound card")
    full_scale_v: Annotated[float, Within(0.01, 20.0, "no sound card's line has less or more")] = (
        Field(description="volts at digital full scale")
    )
    dc_coupled: bool = Field(description="whether a constant level gets out")
    latency_s: Seconds = Field(default=0.02, description="asked of the sound system")

    @property
    def addresses(self) -> list[str]:
        """The card, by the sound system's name or number."""
        return [f"sound:{self.device}"]

    @property
    def envelope_rate_hz(self) -> float:
        """The card's own rate, whatever it is."""
        return self.sample_rate_hz

    def make(self, wiring: Wiring) -> Part[AnalogOutput]:
        from hw.analog.sound_card import SoundCardOutput, SoundSettings

        sound = SoundSettings(
            self.sample_rate_hz, self.full_scale_v, self.dc_coupled, self.channel, self.latency_s
        )
        output = SoundCardOutput(self.device, self.settings(), sound)
        return Part(output, [output.open], [output.close])
