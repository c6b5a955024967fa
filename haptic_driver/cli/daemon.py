"""`haptic daemon`: the process that a rig runs all day."""

from __future__ import annotations

import logging
import os
import sys
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from haptic_driver.cli.output import Json, ModelOption, RigOption, report, stderr, stdout
from haptic_driver.daemon.address import Address, listen
from haptic_driver.errors import BadInputError
from haptic_driver.processes.started import start_thread

FLUSH_S = 1.0

app = typer.Typer(no_args_is_help=True)
SocketOption = Annotated[
    str | None,
    Option(
        "--socket",
        envvar="HAPTIC_SOCKET",
        help=(
            "Where the daemon listens, by default in a private folder of yours; or the address of"
            " its page."
        ),
    ),
]


@app.callback()
def _group() -> None:
    pass


@app.command()
def run(
    rig: RigOption = "simulated",
    socket: SocketOption = None,
    model: ModelOption = "reference",
    port: Annotated[
        int | None, Option(min=0, max=65535, help="Serve the page at this loopback port; 0: any.")
    ] = None,
    allow_no_rt: Annotated[
        bool, Option("--allow-no-rt", help="Arm a real rig without real-time scheduling.")
    ] = False,
    lsl: Annotated[
        bool,
        Option(
            "--lsl",
            help="Offer samples and events to the Lab Streaming Layer, on the local network.",
        ),
    ] = False,
    osc: Annotated[
        str | None,
        Option(metavar="HOST:PORT", help="Send samples and events there, as OSC over UDP."),
    ] = None,
    lsl_markers: Annotated[
        str | None, Option(metavar="STREAM", help="Take markers from the LSL stream of that name.")
    ] = None,
    allow_origin: Annotated[
        list[str],
        Option(
            metavar="URL",
            help="Let pages of this address use the API too, with the token; may be repeated.",
        ),
    ] = [],  # noqa: B006 - typer copies it
    slide: Annotated[
        Path | None,
        Option(
            help="What the finger of a simulated rig does, again and again; as --trace of the demo."
        ),
    ] = None,
    as_json: Json = False,
) -> int:
    """Run the daemon in the foreground until Ctrl-C or SIGTERM; it starts idle, with the output
    off.

    Once it can be used it says its socket and, with --port, the address of its page, which holds a
    token. Exit status 0 when the output is known to be off at the end.

    Example: `haptic daemon run --rig simulated --port 8470`
    """
    address = Address.of(socket)
    place = address.path
    if place is None:
        raise BadInputError(
            "no_place",
            f"a daemon does not listen at {address}",
            "Give a path as --socket, and --port",
        )
    from haptic_driver.daemon.web.security import origin_of  # noqa: PLC0415

    origins = frozenset(map(origin_of, allow_origin))
    if port is not None:
        listen(port).close()  # one that is taken is told now, not after seconds
    # A thread says it: a terminal that is stopped keeps nobody from starting.
    start_thread("say", partial(stderr.print, f"starting rig {rig}; it takes some seconds"))
    from haptic_driver.daemon.quiet_log import OncePerSecond, Printable  # noqa: PLC0415

    # the web server is slow to import
    from haptic_driver.daemon.run import Links, run_daemon  # noqa: PLC0415
    from hw.dropping_log import DroppingHandler  # noqa: PLC0415

    def announce(socket: Path, page: str | None) -> None:
        said = partial(
            report, as_json, {"socket": str(socket), "page": page}, lambda: _show(rig, socket, page)
        )
        start_thread("say", said)

    handler = DroppingHandler()
    handler.addFilter(OncePerSecond())
    handler.setFormatter(Printable("%(asctime)s %(name)s: %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
    links = Links(lsl, osc, lsl_markers, origins)
    status = run_daemon(rig, place, model, allow_no_rt, port, links, announce, slide)
    handler.flush()
    start_thread("say", sys.stdout.flush).join(FLUSH_S)
    # all is closed; what else Python does at its end may wait for a terminal that is stopped
    os._exit(status)


def _show(rig: str, socket: Path, page: str | None) -> None:
    stdout.print(f"rig {rig} is ready at {socket}")
    if page is not None:
        stdout.print(f"page, for you alone: {page}")
