"""`haptic watch`: the daemon as it is now, over and over."""

from __future__ import annotations

import math
import sys
import time
from collections import deque
from collections.abc import Iterable, Sequence
from contextlib import closing
from typing import TYPE_CHECKING, Annotated

from rich.live import Live
from rich.table import Table
from rich.text import Text
from typer import Option

from haptic_driver.cli.control import agreement_lines, client_of
from haptic_driver.cli.daemon import SocketOption
from haptic_driver.cli.output import Json, stdout
from haptic_driver.daemon.messages import number

if TYPE_CHECKING:
    from haptic_driver.daemon.messages import StateFrame

BLOCKS = "▁▂▃▄▅▆▇█"
HISTORY = 60  # frames, 3 s
SCALE_STEPS = 10  # per unit of friction: the scale of a line moves in tenths


def watch(
    for_s: Annotated[
        float | None, Option("--for", min=0.0, help="End after so many seconds.")
    ] = None,
    socket: SocketOption = None,
    as_json: Json = False,
) -> None:
    """Show state, friction, voltage and flags until Ctrl-C; in a pipe or with --json, a JSON object
    per line.

    Example: `haptic watch --for 10`
    """
    until_s = math.inf if for_s is None else time.monotonic() + for_s
    with client_of(socket) as client, closing(client.watch()) as frames:
        lively = stdout.is_terminal and not as_json
        try:
            (_show if lively else _print)(_until(frames, until_s))
        except KeyboardInterrupt:
            return  # the usual end


def _until(frames: Iterable[StateFrame], until_s: float) -> Iterable[StateFrame]:
    for frame in frames:
        yield frame
        if time.monotonic() >= until_s:
            return


def _print(frames: Iterable[StateFrame]) -> None:
    for frame in frames:
        sys.stdout.write(frame.model_dump_json() + "\n")
        sys.stdout.flush()


def _show(frames: Iterable[StateFrame]) -> None:
    history: deque[StateFrame] = deque(maxlen=HISTORY)
    with Live(console=stdout, auto_refresh=False) as live:
        for frame in frames:
            history.append(frame)
            live.update(picture(history), refresh=True)


def picture(history: Sequence[StateFrame]) -> Table:
    """The newest frame, and how friction went over all of them."""
    frame = history[-1]
    status, ticks = frame.status, frame.ticks
    newest = [shown.newest or {} for shown in history]
    felt = "measured" if status.estimated_cof is None else "estimated"
    target, measured = (
        [sample.get(name) for sample in newest] for name in ("target_cof", f"{felt}_cof")
    )
    known = [value for value in (*target, *measured) if value is not None]
    low = math.floor(min(known, default=0.0) * SCALE_STEPS) / SCALE_STEPS
    high = math.ceil(max(known, default=1.0) * SCALE_STEPS) / SCALE_STEPS
    table = Table.grid(padding=(0, 2))
    table.add_row("state", _state(frame))
    table.add_row("texture", status.texture or "none")
    table.add_row("target", f"{sparkline(target, low, high)} {number(target[-1], '.3f')}")
    table.add_row(felt, f"{sparkline(measured, low, high)} {number(measured[-1], '.3f')}")
    table.add_row("", f"friction from {low:g} to {high:g}")
    table.add_row(
        "command",
        f"{number(status.frequency_hz, '.4g')} Hz, {number(status.voltage_v, '.4g')} V peak",
    )
    if status.load is not None:
        table.add_row("load", str(status.load))
    late = "-" if ticks.lateness_max_s is None else f"{1e6 * ticks.lateness_max_s:.0f} us"
    table.add_row("ticks", f"{status.ticks}, {status.overruns} overruns, latest {late} late")
    table.add_row("flags", ", ".join(status.flags) or "none")
    if status.fidelity is not None:
        table.add_row("fidelity", status.fidelity.said[0])
    table.add_row("latency", status.latency_said())
    for line in agreement_lines(status):
        table.add_row("", line)
    return table


def sparkline(values: Sequence[float | None], low: float, high: float) -> str:
    """One character per value between `low` and `high`; a blank where there is none."""
    span = max(high - low, 1e-9)
    return "".join(
        (
            " "
            if value is None
            else BLOCKS[min(max(int((value - low) / span * len(BLOCKS)), 0), len(BLOCKS) - 1)]
        )
        for value in values
    )


def _state(frame: StateFrame) -> Text:
    status = frame.status
    style = "green" if status.output_on is False else "bold red"
    output = f"output {status.output_said}", style
    text = Text.assemble((status.state, "bold"), ", ", output)
    text.append(f"; rig {status.rig}{' (simulated)' if status.simulated else ''}")
    if status.fault is not None:
        text.append(f"; fault: {status.fault}", "bold red")
    return text
