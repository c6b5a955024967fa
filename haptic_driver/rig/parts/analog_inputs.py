"""Kinds of cards whose inputs read gauges and monitors, all of a card in one task."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from haptic_driver.config import Within
from haptic_driver.rig.check import Checks, Examination
from haptic_driver.rig.part import Part, PartSection, Patience, Seconds, Wiring

if TYPE_CHECKING:
    from hw.analog.lines import AnalogInputs

Terminal = Literal["DIFF", "RSE", "NRSE", "PSEUDO_DIFF", "DEFAULT"]


class AnalogInputsSection(PartSection):
    """What every card has: how fast it samples, how far back it remembers, and how long a monitor's
    peak is looked for.
    """

    sample_rate_hz: Annotated[float, Within(1.0, 1e7, "no card is slower or faster")] = Field(
        description="per channel"
    )
    buffer_s: Seconds = Field(default=2.0, description="how much is kept")
    monitor_window_s: Patience = Field(
        default=0.02,
        description=(
            "monitors report the peak over so long; >= 1/lowest_carrier_hz, < safety.settle_s"
        ),
    )

    def inputs(self, channels: Sequence[str]) -> AnalogInputs:
        """Some channels, not open."""
        raise NotImplementedError

    def wire(self, wiring: Wiring) -> Wiring:
        return replace(wiring, monitor_window_s=self.monitor_window_s)

    def make(self, wiring: Wiring) -> Part[AnalogInputs]:
        """All channels that the rig's file names."""
        inputs = self.inputs(wiring.channels)
        return Part(inputs, [inputs.open], [inputs.close])

    def examine(self, at: Examination) -> Checks:
        """What reads a channel looks at it."""
        return iter(())


class NiAnalogInputsConfig(AnalogInputsSection):
    """The NI card or cards whose inputs read gauges and monitors."""

    kind: Literal["ni"] = "ni"
    terminal: Terminal = Field(
        default="DIFF",
        description="DIFF, RSE, NRSE, PSEUDO_DIFF or DEFAULT, but for what `terminals` names",
    )
    terminals: dict[str, Terminal] = Field(
        default={}, description='of a channel that is wired otherwise: {"Dev1/ai6" = "RSE"}'
    )
    range_v: Annotated[float, Within(0.01, 10.0, "ranges of cards are 10 mV to 10 V")] = Field(
        default=10.0, description="+-"
    )
    timeout_s: Seconds = Field(default=0.5, description="no call waits much longer")

    def terminal_of(self, channel: str) -> str:
        """How a channel is wired."""
        return self.terminals.get(channel, self.terminal)

    def inputs(self, channels: Sequence[str]) -> AnalogInputs:
        """A task a card."""
        from hw.analog.ni_daq import NiAnalogInputs, NiCards, card_of

        how = self.model_dump(include={"sample_rate_hz", "range_v", "buffer_s", "timeout_s"})
        cards: dict[str, list[str]] = {}
        for channel in channels:
            cards.setdefault(card_of(channel), []).append(channel)
        return NiCards(
            [
                NiAnalogInputs(on_card, terminal={c: self.terminal_of(c) for c in on_card}, **how)
                for on_card in cards.values()
            ]
        )
