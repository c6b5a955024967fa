"""`haptic doctor`: checks a rig without energising it."""

from __future__ import annotations

import datetime
from collections import Counter
from contextlib import ExitStack
from typing import Annotated

from rich.table import Column, Table
from rich.text import Text
from typer import Option

from haptic_driver.cli.daemon import SocketOption
from haptic_driver.cli.output import SIMULATED, Json, RigOption, report, stdout
from haptic_driver.lookup.models import load_model
from haptic_driver.rig.check import Check, CheckStatus
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.doctor import alone_with, examine

COLOURS = {
    CheckStatus.OK: "green",
    CheckStatus.WARNING: "yellow",
    CheckStatus.FAILED: "red",
    CheckStatus.NOT_VERIFIED: "cyan",
}


def doctor(
    rig: RigOption = "simulated",
    latency: Annotated[
        bool,
        Option("--latency", help="Instead: time touches on the daemon that renders, to the edge."),
    ] = False,
    touches: Annotated[
        int, Option(min=1, max=1000, help="--latency: so many, by a finger or a simulated one.")
    ] = 20,
    socket: SocketOption = None,
    as_json: Json = False,
) -> int:
    """Check a rig without energising it: identity, settings, limits, monitors, calibration dates,
    scheduling.

    Only questions are asked. What could not be verified is said too. Exit status 1 when a check
    failed. The devices of a simulated rig are served for the occasion and asked over the same
    wires.

    With `--latency` it times touches on the running daemon, whatever its rig. Each stage is told,
    from a touch to the voltage that the amplifier's monitor shows. It arms nothing and asks for no
    friction: do both before.

    Example: `haptic doctor --rig simulated`
    """
    if latency:
        from haptic_driver.cli.loop_back import time_touches  # noqa: PLC0415 (HTTP is slow)

        time_touches(socket, touches, as_json=as_json)
        return 0
    config = load_rig(rig)
    today = datetime.date.today()
    with ExitStack() as serving:
        if config.simulated:
            today = config.limits.measured_at or today  # what is simulated does not age
        else:
            serving.enter_context(alone_with(config))
        checks = examine(_served(config, serving) if config.simulated else config, today)
    failed = any(check.status is CheckStatus.FAILED for check in checks)
    payload = {
        "rig": config.name,
        "simulated": config.simulated,
        "ok": not failed,
        "checks": [
            {
                "name": check.name,
                "status": check.status.value,
                "message": check.message,
                "hint": check.hint,
            }
            for check in checks
        ],
        "settings": [
            {"device": check.name, **one._asdict(), "as_asked": one.as_asked}
            for check in checks
            for one in check.held
        ],
    }
    report(as_json, payload, lambda: _show(config, checks))
    return int(failed)


def _served(config: RigConfig, serving: ExitStack) -> RigConfig:
    # a real rig needs no model
    from haptic_driver.simulation.served import ServedRig  # noqa: PLC0415
    from haptic_driver.simulation.twin import as_real  # noqa: PLC0415
    from model.touch_model import TouchModel  # noqa: PLC0415

    touch = TouchModel(load_model(config.simulation.model or "reference"))
    return serving.enter_context(ServedRig(as_real(config), touch)).config


def _show_settings(checks: list[Check]) -> None:
    """Asked and got; before the driver connects, what is not as asked may still be set."""
    table = Table("device", "setting", "asked", "got", box=None, pad_edge=False)
    for check in checks:
        for one in check.held:
            got = Text("does not say", "dim") if one.got is None else Text(_shown(one.got))
            if one.as_asked is False:
                got.stylize("yellow")
            table.add_row(check.name, one.name, _shown(one.asked), got)
    if table.rows:
        stdout.print(Text("\nasked of each device, and got (now, before it is set up)"))
        stdout.print(table)


def _shown(value: object) -> str:
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def _show(config: RigConfig, checks: list[Check]) -> None:
    table = Table("check", "status", Column("found", overflow="fold"), box=None, pad_edge=False)
    for check in checks:
        found = Text.assemble(check.message, (f"\n{check.hint}" if check.hint else "", "dim"))
        table.add_row(check.name, Text(check.status.value, COLOURS[check.status]), found)
    kind = Text.assemble(", ", SIMULATED) if config.is_computed else ""
    stdout.print(Text.assemble(f"rig {config.name}", kind, "; nothing was energised"))
    stdout.print(table)
    _show_settings(checks)
    counts = Counter(check.status for check in checks)
    stdout.print(
        ", ".join(f"{counts[status]} {status.value}" for status in CheckStatus if counts[status])
    )
