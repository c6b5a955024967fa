"""The reference finger, and fingers that hide what it knows nothing of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from model.description import ModelDescription, read_model
from model.parameters import Parameter

MODELS = Path(__file__).parents[1] / "configs" / "models"
REFERENCE = MODELS / "reference.toml"
FINGER, SHIPPED = read_model(REFERENCE), REFERENCE.read_text(encoding="utf-8")


def hiding(finger: ModelDescription, **effects: Mapping[str, float]) -> ModelDescription:
    """With effects on, each by its numbers."""
    on = {
        name: {key: Parameter(value, "", "") for key, value in numbers.items()}
        for name, numbers in effects.items()
    }
    return replace(finger, effect_parameters=finger.effect_parameters | on)
