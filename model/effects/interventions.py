"""What a person can do at the rig so that an effect goes away.

A row before an intervention and one after it can separate two effects that look the same at all
settings. Each effect is predicted without those that the intervention removes. Which those are,
each effect says itself (`removed_by`).
"""

from __future__ import annotations

from dataclasses import dataclass

from model.effects import CATALOGUE


@dataclass(frozen=True)
class Intervention:
    """One of them: its name in plans and tables, and what to do."""

    name: str
    todo: str


NOTHING = "none"  # done: as the finger and the rig are

INTERVENTIONS = (
    Intervention("strap", "put a ground strap on the wrist of the finger"),
    Intervention(
        "dry_air", "blow dry air over the screen for a minute, and go on while it is measured"
    ),
    Intervention(
        "wipe", "wipe finger and screen dry, with alcohol if they bear it, before every row"
    ),
    Intervention(
        "discharge", "take the charge off the screen: ground it, then blow ionised air over it"
    ),
    Intervention("other_amplifier", "put another amplifier, or another range of it, in its place"),
)
BY_INTERVENTION = {known.name: known for known in INTERVENTIONS}


def removed(name: str) -> tuple[str, ...]:
    """The effects that are gone under an intervention, or under none."""
    return tuple(kind.name for kind in CATALOGUE if name in kind.removed_by)
