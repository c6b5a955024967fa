"""`haptic mark`: something that happened, into the events and the recording."""

from __future__ import annotations

import json
from typing import Annotated, Any

from typer import Argument, Option

from haptic_driver.cli.control import client_of
from haptic_driver.cli.daemon import SocketOption
from haptic_driver.cli.output import Json, report, stdout
from haptic_driver.errors import BadInputError


def mark(
    label: Annotated[str, Argument(help="What happened, such as 'trial 7'.")],
    data: Annotated[str, Option(help="More of it: a JSON object.")] = "{}",
    socket: SocketOption = None,
    as_json: Json = False,
) -> None:
    """Write a marker among the daemon's events and into the recording.

    Example: `haptic mark "trial 7" --data '{"level": 0.1}'`
    """
    more = _object(data)
    with client_of(socket) as client:
        marked = client.mark(label, more)
    said = f"marker {marked.number} at {marked.time_s:.3f} s of CLOCK_MONOTONIC"
    report(as_json, marked.model_dump(mode="json"), lambda: stdout.print(said))


def _object(text: str) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except ValueError as error:
        raise BadInputError(
            "bad_json", f"--data is not JSON: {error}", "Give an object: '{\"level\": 0.1}'"
        ) from error
    if not isinstance(found, dict):
        raise BadInputError(
            "bad_json", f"--data {text} is no JSON object", "Give an object: '{\"level\": 0.1}'"
        )
    return found
