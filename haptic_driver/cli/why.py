"""`haptic why`: what is missing from the model, by what was rendered so far."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated

from typer import Option

from haptic_driver.cli.control import client_of
from haptic_driver.cli.daemon import SocketOption
from haptic_driver.cli.output import Json, report, status, stdout
from haptic_driver.errors import HapticError

if TYPE_CHECKING:
    from haptic_driver.daemon.messages import Why

POLL_S = 0.5


def why(
    minutes: Annotated[float, Option(help="Of rendering, the last so many.")] = 1440.0,
    socket: SocketOption = None,
    as_json: Json = False,
) -> None:
    """Diagnose what was rendered so far, while rendering goes on: which effect is missing from the
    model.

    Example: `haptic why --minutes 5`
    """
    with client_of(socket) as client, status("diagnosing"):
        answer = client.ask_why(minutes)
        while answer.state == "running":
            time.sleep(POLL_S)
            answer = client.why()
    if answer.state == "failed":
        raise HapticError(
            "no_diagnosis", answer.said, "Slide on, at other frictions too, and ask again"
        )
    report(as_json, answer.model_dump(mode="json"), lambda: _show(answer))


def _show(answer: Why) -> None:
    stdout.print(answer.said)
    for name, probability in answer.suspects.items():
        stdout.print(f"  {name.replace('_', ' ')}: {probability:.0%}")
    stdout.print(
        f"by {answer.rows} rows of what was rendered; report: {answer.report}", soft_wrap=True
    )
    for purpose in answer.more:
        stdout.print(f"haptic investigate could add what {purpose}")
    if answer.effects:
        stdout.print(
            f"to render by it: haptic disarm, then haptic use {answer.model}", soft_wrap=True
        )
