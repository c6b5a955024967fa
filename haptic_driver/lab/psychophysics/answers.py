"""Answers that come over the daemon: from its participant's page, or from any program, as markers.

A marker `question` says `{"text", "answers"}`. Its answer is a marker `answer` with `{"question":
number of that marker, "answer": one of them}`, the number optional. A marker whose label is one of
the answers will do too (all that LSL says).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from haptic_driver.lab.psychophysics.apparatus import TAKEN_AWAY, stopped
from haptic_driver.lab.psychophysics.run import Question

if TYPE_CHECKING:
    from haptic_driver.client import HapticClient
    from haptic_driver.recording.event import Event

LOOK_S = 0.03
ARMED = ("armed", "rendering")
GO_ON = "go on"


class MarkerParticipant:
    """Somebody at the participant's page, or at another program."""

    def __init__(self, client: HapticClient) -> None:
        self.answered_s: float | None = None
        self._client = client

    def wait(self, text: str) -> None:
        """A question with one answer."""
        self._answer(text, [GO_ON])

    def tell(self, text: str) -> None:
        """A marker `told`, which the page shows."""
        self._client.mark("told", {"text": text})

    def ask(self, question: Question) -> int:
        """The first answer that comes after the question. HapticError when the output was taken
        away meanwhile.
        """
        return self._answer(question.text, question.answers)

    def _answer(self, text: str, answers: Sequence[str]) -> int:
        asked = int(self._client.mark("question", {"text": text, "answers": list(answers)}).number)
        since = asked
        while True:
            for event in self._client.events(since):
                since = event.number
                if event.kind in TAKEN_AWAY and self._client.status().state not in ARMED:
                    raise stopped(event.message)
                if (found := _answered(event, asked, answers)) is not None:
                    self.answered_s = event.time_s
                    return found
            time.sleep(LOOK_S)


def _answered(event: Event, asked: int, answers: Sequence[str]) -> int | None:
    if event.kind != "marker":
        return None
    meant = event.data.get("question", asked) == asked
    word = event.data.get("answer") if event.message == "answer" and meant else event.message
    return answers.index(word) if word in answers else None
