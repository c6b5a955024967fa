"""The registry: the effects that the catalogue knows, and the strangers."""

from __future__ import annotations

from . import effects_electric, effects_load, strangers
from .effect import ALTERNATIVE, CATALOGUE, FORMS, Effect, Hidden

CATALOGUE_EFFECTS: dict[str, Effect] = {e.name: e for e in effects_electric.EFFECTS + effects_load.EFFECTS}
STRANGERS: dict[str, Effect] = {e.name: e for e in strangers.EFFECTS}

__all__ = ["ALTERNATIVE", "CATALOGUE", "CATALOGUE_EFFECTS", "FORMS", "STRANGERS", "Effect", "Hidden"]
