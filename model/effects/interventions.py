"""What a person can do at the rig so that an effect goes away.

A row measured before and one measured after tell more than any setting, where two effects look the same at all of them:
each is predicted without the effects that the intervention removes.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Intervention:
    """One of them: what to do, and the names of the effects that are gone then."""

    name: str
    todo: str
    removes: tuple[str, ...]


NOTHING = "none"  # done: as the finger and the rig are

INTERVENTIONS = (
    Intervention("strap", "put a ground strap on the wrist of the finger", ("floating_body",)),
    Intervention(
        "dry_air",
        "blow dry air over the screen for a minute, and go on while it is measured",
        ("humid_gap_conduction", "capillary_adhesion"),
    ),
    Intervention(
        "wipe",
        "wipe finger and screen dry, with alcohol if they bear it, before every row",
        ("sweat_film", "electrode_polarization"),
    ),
    Intervention(
        "discharge", "take the charge off the screen: ground it, then blow ionised air over it", ("trapped_charge",)
    ),
    Intervention(
        "other_amplifier",
        "put another amplifier, or another range of it, in its place",
        ("amplifier_bandwidth", "amplifier_slew_limit", "drive_gain_error"),
    ),
)
BY_INTERVENTION = {known.name: known for known in INTERVENTIONS}


def removed(name: str) -> tuple[str, ...]:
    """The effects that are gone under an intervention, or under none."""
    return BY_INTERVENTION[name].removes if name != NOTHING else ()
