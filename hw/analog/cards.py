"""Analog outputs by name: `card:KIND:WHERE`, for whoever drives one and for whoever watches it.

A kind is an entry point of the group `haptic_driver.cards` that names a function
`(where, settings) -> AnalogOutput`. So a device with calls instead of a wire, such as one with an
SDK, joins.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import cast

from hw import plugins
from hw.analog.output import AnalogOutput, AnalogOutputSettings

GROUP = "haptic_driver.cards"
WHAT = "card"
_NAME = re.compile(r"card:(?P<kind>\w+):(?P<where>.+)")

MakeCard = Callable[[str, AnalogOutputSettings], AnalogOutput]


def make_card(resource: str, settings: AnalogOutputSettings) -> AnalogOutput:
    """The output, not open. ValueError for a name of no such form, or of no kind that is there."""
    kind, where = _parts(resource)
    make = cast(MakeCard, plugins.load(GROUP, kind, WHAT))
    return make(where, settings)


def check_name(resource: str) -> str:
    """Return `resource` where such a card could be made; ValueError as `make_card`. Loads none."""
    plugins.known(GROUP, _parts(resource)[0], WHAT)
    return resource


def _parts(resource: str) -> tuple[str, str]:
    match = _NAME.fullmatch(resource)
    if match is None:
        raise ValueError(f"{resource!r} is not of the form card:KIND:WHERE: card:ni:Dev1/ao0")
    return match["kind"], match["where"]
