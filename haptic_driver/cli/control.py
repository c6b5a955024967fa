"""What a client asks of the daemon: `haptic arm`, and the commands that follow from `Verbs`."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from inspect import Parameter, Signature, getdoc
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from rich.text import Text
from typer import Argument, BadParameter, Option

from haptic_driver.base.interpreter import PYTHON
from haptic_driver.cli.daemon import SocketOption
from haptic_driver.cli.output import Json, report, say, signals_to, stdout
from haptic_driver.config import config_names, members
from haptic_driver.daemon.address import Address
from haptic_driver.daemon.messages import Lease, RefusedError, Status
from haptic_driver.daemon.private_file import private_folder, write_private
from haptic_driver.daemon.verbs import Leased, Verb, Written
from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.live.agreement import AXES
from haptic_driver.processes.started import start_process

if TYPE_CHECKING:
    from haptic_driver.client import HapticClient, Session
    from haptic_driver.daemon.messages import AgreementCell

SIGNS = ((0.05, "▲", "▼"), (0.02, "+", "-"), (0.0, "·", "·"))  # of friction: from so much off on
Verbose = Annotated[bool, Option("--verbose", help="Say the whole status.")]
POLL_S = 0.1
STARTING_S = 0.1  # some ticks: an output that was just asked for has come on
ALREADY = "armed already"


def arm(
    lease_s: Annotated[
        float, Option("--lease", help="Lease in seconds; Ctrl-C or death ends it sooner.")
    ] = 0.5,
    for_s: Annotated[
        float | None, Option("--for", min=0.0, help="Disarm after so many seconds.")
    ] = None,
    detach: Annotated[
        bool,
        Option(
            "--detach", help="Return once armed; disarm when the shell or script that called ends."
        ),
    ] = False,
    while_pid: Annotated[int | None, Option(hidden=True)] = None,
    socket: SocketOption = None,
    as_json: Json = False,
) -> None:
    """Arm, and hold the lease until Ctrl-C or `haptic disarm`; whatever ends this leaves the output
    off.

    Meanwhile `haptic set` and `haptic texture play` may be used in another terminal, or in this one
    after --detach.

    Example: `haptic arm --for 60`
    """
    if detach:
        held = _detached(socket, lease_s, for_s)
        report(as_json, held, lambda: stdout.print(f"{held['state']}; disarm with: haptic disarm"))
        return
    from haptic_driver.client import LeaseLostError  # noqa: PLC0415  (HTTP is slow to import)

    # SIGTERM and a closed terminal end it as Ctrl-C does, which also ends it where a script ignores
    # it.
    as_ctrl_c = signals_to(signal.default_int_handler)
    holder = f"haptic arm, process {os.getpid()}"
    with client_of(socket) as client:
        try:
            with (
                client.armed(lease_s, holder) as session,
                lease_file(client.address, session.token),
                as_ctrl_c,
            ):
                session.wait_held()
                held = {
                    "state": "armed",
                    "lease_s": lease_s,
                    "token_file": str(client.address.lease_file),
                }
                report(
                    as_json,
                    held,
                    lambda: stdout.print(f"armed, lease {lease_s:g} s; Ctrl-C disarms"),
                )
                with suppress(KeyboardInterrupt):  # the usual end
                    _hold(client, session, for_s, while_pid, tell=not as_json)
        except LeaseLostError as lost:
            _raise_unless_disarmed(client.status(), lost.code)
        except RefusedError as refused:
            if refused.code != "already_armed" or (lease := held_already(client)) is None:
                raise
            held = {
                "state": ALREADY,
                "lease_s": lease.lease_s,
                "token_file": str(client.address.lease_file),
            }
            said = f"{ALREADY}, by an earlier haptic arm of yours; lease {lease.lease_s:g} s"
            report(as_json, held, lambda: stdout.print(said))


def command_of(verb: Verb[..., Any, Any]) -> Callable[..., None]:
    """The command of a verb: its fields are arguments and options, its words are the help."""
    words = verb.command.split()
    metavars = filter(str.isupper, words)
    fields = verb.schema.model_fields.items()
    parameters = [_parameter(name, field, metavars) for name, field in fields]

    def run(socket: str | None, as_json: bool, verbose: bool = True, **said: Any) -> None:
        with client_of(socket) as client:
            token = lease_token(client.address) if isinstance(verb, Leased) else ""
            answer = client.ask(verb, said, token)
            if isinstance(verb, Leased) and isinstance(answer, Status) and not answer.output_on:
                time.sleep(STARTING_S)
                answer = client.status()
        show(as_json, answer, in_short=not verbose)

    of_all = [("socket", SocketOption, None), ("as_json", Json, False)]
    if verb.answer is Status and verb.method == "POST":
        of_all.append(("verbose", Verbose, False))
    parameters += [
        Parameter(name, Parameter.KEYWORD_ONLY, annotation=kind, default=default)
        for name, kind, default in of_all
    ]
    run.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    shown = " ".join([*filter(str.islower, words), verb.example])
    paragraphs = [verb.said, f"Example: `haptic {shown}`"]
    if fields:
        paragraphs.insert(1, getdoc(verb.schema) or "")
    run.__doc__ = "\n\n".join(paragraphs)
    return run


def _names(kind: str) -> Callable[[], list[str]]:
    return lambda: config_names(kind)


def _on_or_off(word: str) -> bool:
    """True for `on` and False for `off`; typer.BadParameter for anything else."""
    if word not in ("on", "off"):
        raise BadParameter(f"{word!r} is neither on nor off")
    return word == "on"


def _parameter(name: str, field: FieldInfo, metavars: Iterator[str]) -> Parameter:
    """An argument where a field is required, else an option."""
    kind: Any = next(part for part in members(field.annotation) if isinstance(part, type))
    declared: dict[str, Any] = {"help": field.description}
    for how in field.metadata:
        if isinstance(how, Written) and how.kind:
            declared["autocompletion"] = _names(how.kind)
    if field.is_required():
        declared |= {"parser": _on_or_off} if kind is bool else {}
        kind = Annotated[kind, Argument(metavar=next(metavars), **declared)]
        default = Parameter.empty
    else:
        option, default = name.removesuffix("_hz"), field.default
        flag = f"--{option}/--no-{option}" if default is True else f"--{option}"
        kind = Annotated[kind if default is not None else kind | None, Option(flag, **declared)]
    return Parameter(name, Parameter.KEYWORD_ONLY, annotation=kind, default=default)


def show_status(status: Status, *, in_short: bool = False) -> None:
    """The status for a person; `in_short` in one line."""
    said = Text(status.in_short() if in_short else str(status))
    said.highlight_regex(r"(?<=output )(ON|UNKNOWN)|fault:", "bold red")
    stdout.print(said)
    for line in () if in_short else agreement_lines(status):
        stdout.print(Text(f"  {line}"))


def agreement_lines(status: Status) -> list[str]:
    """Measured against expected friction: a line per condition, a sign per cell, and a sentence."""
    by_axis: dict[str, list[AgreementCell]] = {}
    for cell in status.agreement:
        by_axis.setdefault(cell.axis, []).append(cell)
    lines = []
    for axis, cells in by_axis.items():
        unit, _ = AXES[axis]
        name = axis.removesuffix(f"_{unit.lower().replace('/', '_')}").replace("_", " ")
        signs = " ".join(_sign(cell.share) for cell in cells)
        lines.append(
            f"agreement, {name}: {signs} ({cells[0].low:.3g} to {cells[-1].high:.3g} {unit})"
        )
    return lines + ([] if status.disagreement is None else [status.disagreement])


def _sign(share: float) -> str:
    return next(
        (more if share > 0.0 else less) for least, more, less in SIGNS if abs(share) >= least
    )


def show(as_json: bool, answer: BaseModel, *, in_short: bool = False) -> None:
    """What the daemon answered, to a person or as JSON; a status `in_short` in one line."""
    report(as_json, answer.model_dump(mode="json"), lambda: _said(answer, in_short))


def _said(answer: BaseModel, in_short: bool) -> None:
    if isinstance(answer, Status):
        show_status(answer, in_short=in_short)
    else:
        stdout.print(str(answer))


def client_of(socket: str | None) -> HapticClient:
    """A client of the daemon at a socket, by default the usual one."""
    from haptic_driver.client import HapticClient  # noqa: PLC0415  (HTTP is slow to import)

    return HapticClient(socket)


def lease_token(address: Address) -> str:
    """What `haptic arm` left for the other commands."""
    try:
        return address.lease_file.read_text().strip()
    except OSError:
        said = "nobody has armed with `haptic arm`"
        raise HapticError(
            "not_armed", said, "haptic arm in another terminal, or haptic arm --detach"
        ) from None


def held_already(client: HapticClient) -> Lease | None:
    """The lease that an earlier `haptic arm` of this user holds; None where somebody else does."""
    try:
        return client.renew(lease_token(client.address))
    except HapticError:
        return None


@contextmanager
def lease_file(address: Address, token: str) -> Iterator[None]:
    """Leave the token for the other commands, as long as the block lasts."""
    path = address.lease_file
    private_folder(path.parent)
    write_private(path, token + "\n")
    try:
        yield
    finally:
        with suppress(FileNotFoundError):
            if path.read_text(encoding="utf-8").strip() == token:  # else who armed next has it
                path.unlink()


def _hold(
    client: HapticClient,
    session: Session,
    for_s: float | None,
    while_pid: int | None,
    *,
    tell: bool,
) -> None:
    """Until the time is over, the process is gone, or the lease is; says changes of state."""
    until_s = math.inf if for_s is None else time.monotonic() + for_s
    told = "armed"
    while time.monotonic() < until_s and (while_pid is None or _lives(while_pid)):
        if session.wait_lost(min(POLL_S, max(until_s - time.monotonic(), 0.0))):
            return
        state = client.status().state
        if tell and state != told:
            say(state)
            told = state


def _raise_unless_disarmed(status: Status, lost_by: str) -> None:
    """The lease has ended under us: somebody's `haptic disarm` is no failure, a fault or a late
    renewal is.
    """
    if status.fault is not None:
        raise HapticError(
            "fault",
            f"the daemon went into fault: {status.fault}",
            "remove the cause, then haptic reset",
        )
    # the flag comes once the output has ramped down
    if lost_by == "lease_expired" or "lease_lost" in status.flags:
        raise HapticError(
            "lease_lost",
            "the lease ran out before it was renewed",
            "arm again, with a longer --lease",
        )


def _lives(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def _detached(socket: str | None, lease_s: float, for_s: float | None) -> dict[str, Any]:
    """Have a process of its own hold the lease for as long as our caller lives; what it said once
    armed.
    """
    command = [*PYTHON, "-c", "from haptic_driver.cli.main import run; run()", "arm", "--json"]
    command += ["--lease", str(lease_s), "--while-pid", str(os.getppid())]
    command += [] if socket is None else ["--socket", socket]
    command += [] if for_s is None else ["--for", str(for_s)]
    holder = start_process(
        "holder",
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    assert holder.stdout is not None
    with holder.stdout as said:
        held: dict[str, Any] = json.loads(said.readline() or b"{}")
    if "state" not in held:
        error = held.get(
            "error", {"code": "not_armed", "message": "cannot arm", "hint": "haptic arm says more"}
        )
        raise (BadInputError if holder.wait() == BadInputError.exit_status else HapticError)(
            **error
        )
    if held["state"] == ALREADY:
        holder.wait()
    return held
