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
    third_electric,
    third_load,
    third_strangers,
)
from .effect import ALTERNATIVE, CATALOGUE, FORMS, SECOND, THIRD, Effect, Hidden, drawn

_OWN = {
    name: {form.apply.__name__: form for form in forms}
    for name, forms in (
        (SECOND, second_electric.FORMS + second_load.FORMS),
        (THIRD, third_electric.FORMS + third_load.FORMS),
    )
}
CATALOGUE_EFFECTS: dict[str, Effect] = {
    e.name: replace(e, own={name: forms[e.name] for name, forms in _OWN.items()})
    for e in effects_electric.EFFECTS + effects_load.EFFECTS
}
FIRST_STRANGERS: dict[str, Effect] = {e.name: e for e in strangers.EFFECTS}
SECOND_STRANGERS: dict[str, Effect] = {e.name: e for e in more_strangers.EFFECTS}
THIRD_STRANGERS: dict[str, Effect] = {e.name: e for e in third_strangers.EFFECTS}
STRANGERS = FIRST_STRANGERS | SECOND_STRANGERS | THIRD_STRANGERS
UNFELT = more_strangers.UNFELT | third_strangers.UNFELT

__all__ = [
    "ALTERNATIVE",
    "CATALOGUE",
    "CATALOGUE_EFFECTS",
    "FIRST_STRANGERS",
    "FORMS",
    "SECOND",
    "SECOND_STRANGERS",
    "STRANGERS",
    "THIRD",
    "THIRD_STRANGERS",
    "UNFELT",
    "Effect",
    "Hidden",
    "drawn",
]
