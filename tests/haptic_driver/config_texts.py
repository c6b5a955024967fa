"""Configuration files made of the shipped ones."""

from __future__ import annotations

from pathlib import Path

CONFIGS = Path(__file__).parents[2] / "configs"
SIMULATED = (CONFIGS / "rigs" / "simulated.toml").read_text(encoding="utf-8")


def changed(text, *changes):
    """The text with each (old, new) replaced once; all that is old must be there."""
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    return text


def as_real_rig(resource):
    """The simulated rig's file with a generator at a resource; a real rig's other devices are still to be added."""
    return changed(
        SIMULATED, ("simulated = true", "simulated = false"), ('resource = "simulated"', f'resource = "{resource}"')
    )
