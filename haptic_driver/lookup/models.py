"""Models by name: what surfaces are built from."""

from __future__ import annotations

from dataclasses import replace

from haptic_driver.config import find_config
from haptic_driver.errors import shown
from model.description import ModelDescription, read_model


def load_model(name_or_path: str) -> ModelDescription:
    """A model by the name of its file in `configs/models/`, or by path."""
    model = read_model(find_config(name_or_path, "models"))
    return replace(model, name=shown(model.name), about=shown(model.about, lines=True))
