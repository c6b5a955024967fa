"""The registry: the effects that the catalogue knows, and the strangers."""

from __future__ import annotations

from dataclasses import replace

from . import (
    effects_electric,
    effects_load,
    more_strangers,
    second_electric,
    second_load,
    strangers,
)
from .effect import ALTERNATIVE, CATALOGUE, FORMS, SECOND, Effect, Hidden, drawn

_SECOND = {form.apply.__name__: form for form in second_electric.FORMS + second_load.FORMS}
CATALOGUE_EFFECTS: dict[str, Effect] = {
    e.name: replace(e, second=_SECOND[e.name])
    for e in effects_electric.EFFECTS + effects_load.EFFECTS
}
FIRST_STRANGERS: dict[str, Effect] = {e.name: e for e in strangers.EFFECTS}
SECOND_STRANGERS: dict[str, Effect] = {e.name: e for e in more_strangers.EFFECTS}
STRANGERS = FIRST_STRANGERS | SECOND_STRANGERS
UNFELT = more_strangers.UNFELT

__all__ = [
    "ALTERNATIVE",
    "CATALOGUE",
    "CATALOGUE_EFFECTS",
    "FIRST_STRANGERS",
    "FORMS",
    "SECOND",
    "SECOND_STRANGERS",
    "STRANGERS",
    "UNFELT",
    "Effect",
    "Hidden",
    "drawn",
]
