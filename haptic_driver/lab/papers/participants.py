"""Participant information and consent for a study on a rig: a draft with the rig's own figures.

What the laboratory alone knows is a line in brackets; a board may ask for other words.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from haptic_driver.base.units import readable
from haptic_driver.lab.papers.document import Block, Document, Heading, Paragraph, Table
from haptic_driver.lab.papers.safety_facts import VOLUNTEERS, Inspected, facts_of

STATEMENTS = (
    "I have read this information, and could ask about it.",
    "I know that I may stop at any time, without a reason and without a disadvantage.",
    "None of the reasons not to take part holds for me.",
    "I agree that what I answer and what the sensors record is kept as described here.",
    "I take part of my own will.",
)


def participant_information(seen: Inspected) -> Document:
    """The paper for those who touch the rig's screen; to be completed by the laboratory."""
    facts = facts_of(seen)
    return Document(
        title=f"Participant information and consent: rig '{facts['rig']}'",
        about=(
            f"{seen.today.isoformat()} · DRAFT by {facts['program']}: complete what stands in"
            " brackets, and have it approved"
        ),
        foot=f"rig '{facts['rig']}', file {seen.sha256[:12]}, {seen.today.isoformat()}",
        blocks=[*_study(), *_touch(facts), *_rights(), *_consent()],
        facts=facts,
    )


def _study() -> Iterator[Block]:
    yield Heading("The study")
    yield Paragraph(
        "[Purpose, who pays for it, who runs it, approval by which board, under which number.]\n"
        "[How long it takes, how often you come, and what you get for it.]\n"
        "You slide a bare finger over a glass plate and answer questions about what you feel."
    )


def _touch(facts: dict[str, Any]) -> Iterator[Block]:
    limits, worst = facts["limits"], max(facts["touch_currents"], key=lambda one: one["share"])
    yield Heading("What happens at the plate")
    yield Paragraph(
        "An electrode lies under an insulating layer of the plate. An alternating voltage on it"
        " attracts the skin, and the finger feels more friction. You may feel the plate become"
        " rough, sticky or slippery. Nothing should prick, tingle or hurt: if it does, lift the"
        " finger and say so."
    )
    yield Heading("What protects you")
    rows = [
        ("voltage at the electrode", f"at most {limits['voltage_v']:g} V peak, under insulation"),
        (
            "current through the finger",
            f"at most {readable(worst['stuck_a_rms'], 'A rms')} by the model of this rig, reached"
            f" at {worst['frequency_hz']:g} Hz; that is {worst['share']:.0%} of the limit there,"
            f" {readable(worst['limit_a_rms'], 'A rms')}",
        ),
        ("this holds for", f"{limits['current_holds_for']}: touch with nothing else"),
        ("switching off", f"by itself {limits['lease_s']:g} s after the computer falls silent"),
        ("you", "lift the finger, or press [where the emergency stop is]"),
    ]
    yield Table(("", ""), rows, (1, 3))
    yield Paragraph(VOLUNTEERS)
    yield Heading("Reasons not to take part")
    yield Paragraph(
        "– a pacemaker, a defibrillator or another electronic implant;\n"
        "– wounds, eczema or other damage of the skin of the finger or hand;\n"
        "– epilepsy, pregnancy, or a condition of the heart, unless a physician agrees;\n"
        "– an allergy to glass cleaners or alcohol;\n"
        "– [others that your board asks for]."
    )


def _rights() -> Iterator[Block]:
    yield Heading("Your data and your rights")
    yield Paragraph(
        "Recorded are your answers, their times, and place, load and friction of your finger, under"
        " a number in place of your name. [Where they are kept, for how long, who sees them, and"
        " whether they are published.] You may stop at any time without a reason, and ask that your"
        " data are deleted [until when].\n"
        "[Name, address and telephone of who answers questions; of the board, of data protection.]"
    )


def _consent() -> Iterator[Block]:
    yield Heading("Consent")
    rows = [("☐", statement) for statement in STATEMENTS]
    yield Table(("", "I state"), rows, (0.3, 10))
    signed = [("participant", "", "", ""), ("experimenter", "", "", "")]
    yield Table(("", "name", "date", "signature"), signed, (2, 3, 2, 4), row_mm=8.0)
