"""`haptic daemon`: the process that a rig runs all day."""

from __future__ import annotations

import getpass
import logging
import os
import sys
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from haptic_driver.base.interpreter import PYTHON
from haptic_driver.cli.output import Json, ModelOption, RigOption, report, stderr, stdout
from haptic_driver.daemon.address import Address, listen
from haptic_driver.daemon.private_file import kept_token
from haptic_driver.errors import BadInputError
from haptic_driver.files import require_free, write_text
from haptic_driver.processes.started import start_thread

FLUSH_S = 1.0
SHIPPED = "/usr/local/bin/haptic"  # in the unit

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
    token_file: Annotated[
        Path | None,
        Option(
            help="Keep the page's token there, so that it stays over restarts; made where missing."
        ),
    ] = None,
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
    if token_file == place.with_name(place.name + ".token"):
        said = f"{token_file} lasts as long as the daemon: each start writes it anew"
        raise BadInputError("bad_token", said, "Give another --token-file")
    token = None if token_file is None else kept_token(token_file)
    if port is not None:
        listen(port).close()  # one that is taken is told now, not after seconds
    # A thread says it: a terminal that is stopped keeps nobody from starting.
    start_thread("say", partial(stderr.print, f"starting rig {rig}; it takes some seconds"))
    from haptic_driver.daemon.quiet_log import OncePerSecond, Printable  # noqa: PLC0415

    # the web server is slow to import
    from haptic_driver.daemon.run import Links, run_daemon  # noqa: PLC0415
    from hw.dropping_log import DroppingHandler  # noqa: PLC0415

    def announce(socket: Path, page: str | None) -> None:
        def show() -> None:
            stdout.print(f"rig {rig} is ready at {socket}")
            if page is not None and token_file is not None:  # a token that stays is in no log
                stdout.print(f"page: {page.partition('?')[0]}?token= and what {token_file} holds")
            elif page is not None:
                stdout.print(f"page, for you alone: {page}")

        said = partial(report, as_json, {"socket": str(socket), "page": page}, show)
        start_thread("say", said)

    handler = DroppingHandler()
    handler.addFilter(OncePerSecond())
    handler.setFormatter(Printable("%(asctime)s %(name)s: %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
    links = Links(lsl, osc, lsl_markers, origins, token)
    status = run_daemon(rig, place, model, allow_no_rt, port, links, announce, slide)
    handler.flush()
    start_thread("say", sys.stdout.flush).join(FLUSH_S)
    # all is closed; what else Python does at its end may wait for a terminal that is stopped
    os._exit(status)


@app.command()
def unit(
    out: Annotated[Path, Option(help="The unit to write.")] = Path("haptic@.service"),
    force: Annotated[bool, Option("--force", help="Replace the file.")] = False,
    as_json: Json = False,
) -> None:
    """Write a unit of systemd that runs the daemon as you, with this installation of haptic.

    The rig's name stands behind the @. More options go to /etc/haptic/RIG.env.

    Example: `haptic daemon unit && sudo cp haptic@.service /etc/systemd/system/`
    """
    user = getpass.getuser()
    if user == "root":
        said = "root would be the user of the rig"
        raise BadInputError("as_root", said, "Run this as whoever works with the rig, without sudo")
    require_free(out, force)
    text = (Path(__file__).parents[1] / "daemon" / "haptic@.service").read_text()
    haptic = str(Path(PYTHON[0]).with_name("haptic"))
    quoted = '"' + haptic.replace("%", "%%") + '"'
    write_text(out, text.replace("User=haptic", f"User={user}").replace(SHIPPED, quoted))
    report(as_json, {"unit": str(out)}, lambda: stdout.print(f"{out} runs {haptic} as {user}"))
