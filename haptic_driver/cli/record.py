"""`haptic record`: every tick into a file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from haptic_driver.cli.control import Verbose, client_of, show
from haptic_driver.cli.daemon import SocketOption
from haptic_driver.cli.output import Json
from haptic_driver.errors import BadInputError


def record(
    file: Annotated[Path | None, Argument(help="HDF5 file to write.")] = None,
    stop: Annotated[bool, Option("--stop", help="End the recording.")] = False,
    socket: SocketOption = None,
    as_json: Json = False,
    verbose: Verbose = False,
) -> None:
    """Record every tick into a file, until --stop.

    Example: `haptic record run.h5`
    """
    if stop == (file is not None):
        raise BadInputError("usage", "give either a file or --stop", "See: haptic record --help")
    with client_of(socket) as client:
        show(as_json, client.record(file), in_short=not verbose)
