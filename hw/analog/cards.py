"""Analog outputs by name: `card:KIND:WHERE`, for whoever drives one and for whoever watches it.

A device with calls instead of a wire, such as one with an SDK, joins by an entry point of the group
`haptic_driver.cards` that names a function `(where, settings) -> AnalogOutput`.
"""

# ruff: noqa: PLC0415 - each kind imports what its device needs

from __future__ import annotations

import re
from collections.abc import Callable

from hw import plugins
from hw.analog.output import AnalogOutput, AnalogOutputSettings

GROUP = "haptic_driver.cards"
WHAT = "card"
FORM = re.compile(r"card:(?P<kind>\w+):(?P<where>.+)")

MakeCard = Callable[[str, AnalogOutputSettings], AnalogOutput]


def make_card(resource: str, settings: AnalogOutputSettings) -> AnalogOutput:
    """The output, not open. ValueError for a name of no such form, or of no kind that is there."""
    match = FORM.fullmatch(resource)
    if match is None:
        raise ValueError(
            f"{resource!r} is not of the form card:KIND:WHERE, such as card:ni:Dev1/ao0"
        )
    built_in = _BUILT_IN.get(match["kind"])
    make: MakeCard = built_in or plugins.load(GROUP, match["kind"], WHAT)
    return make(match["where"], settings)


def check_name(resource: str) -> str:
    """Return `resource` where such a card could be made; ValueError as `make_card`. Loads none."""
    match = FORM.fullmatch(resource)
    if match is None:
        raise ValueError(
            f"{resource!r} is not of the form card:KIND:WHERE, such as card:ni:Dev1/ao0"
        )
    if match["kind"] not in _BUILT_IN:
        plugins.known(GROUP, match["kind"], WHAT)
    return resource


def _ni(where: str, settings: AnalogOutputSettings) -> AnalogOutput:
    from hw.analog.ni_daq import NiAnalogOutput

    return NiAnalogOutput(where, settings)


def _simulated(where: str, settings: AnalogOutputSettings) -> AnalogOutput:
    from hw.analog.simulated_output import CardMemory, SimulatedAnalogOutput

    return SimulatedAnalogOutput(lambda: CardMemory.at(where), settings)


_BUILT_IN: dict[str, MakeCard] = {"ni": _ni, "simulated": _simulated}
