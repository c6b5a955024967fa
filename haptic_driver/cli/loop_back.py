"""`haptic doctor --latency`: touches timed to the monitor's edge, on a daemon that renders."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.table import Column, Table
from rich.text import Text

from haptic_driver.cli.control import client_of
from haptic_driver.cli.output import SIMULATED, progress, report, stdout
from haptic_driver.client import HapticClient, new_samples
from haptic_driver.daemon.messages import DaemonState, Status
from haptic_driver.errors import HapticError
from haptic_driver.fidelity.edge import NO_MONITOR, UNSEEN, Stage, stages, touched, touches

SILENT_S = 10.0  # without a tick: render has ended, or this machine is beyond use
PATIENCE_S = 30.0  # without another touch: nobody touches any more
LOOK_S = 0.2  # between questions for how long the instruments took
GENERATOR, TRACKER = "waveform_generator", "finger_tracker"


class _Heard(NamedTuple):
    """Samples [n] of the touches, and what the status said meanwhile, in its order."""

    samples: NDArray[np.void]
    statuses: list[Status]

    def dialogues_s(self) -> dict[str, float]:
        """The median of what each instrument took to answer."""
        took_s: dict[str, list[float]] = {}
        for row in (row for status in self.statuses for row in status.instruments):
            if row.read_s is not None:
                took_s.setdefault(row.name, []).append(row.read_s)
        return {name: statistics.median(each) for name, each in took_s.items()}

    def report_s(self) -> float:
        """Between reports of what tells the finger's place, as told last; NaN where unknown."""
        rows = [row for row in self.statuses[-1].instruments if row.name == TRACKER]
        return next((row.every_s for row in rows if row.every_s is not None), math.nan)


def time_touches(socket: str | None, count: int, *, as_json: bool) -> None:
    """Wait for so many touches, and tell what each stage took; HapticError where nothing can be
    timed.
    """
    with client_of(socket) as client:
        heard = _heard(client, count)
    found, left_out = touches(heard.samples)
    status, dialogues_s = heard.statuses[-1], heard.dialogues_s()
    if not found:
        why = "; ".join(f"{why} ({n})" for why, n in left_out.items()) or "nobody touched"
        hint = "Touch for half a second and lift, again and again, while a friction is asked for"
        raise HapticError("no_touch_timed", f"no touch could be timed: {why}", hint)
    told = stages(found, heard.report_s(), dialogues_s.get(GENERATOR, math.nan))
    unknown = [*UNSEEN]
    if not np.isfinite(heard.samples["monitor_voltage_v"]).any():
        unknown.insert(0, NO_MONITOR)
    payload: dict[str, Any] = {
        "rig": status.rig,
        "simulated": status.simulated,
        "actuator": status.actuator,
        "touches": len(found),
        "left_out": left_out,
        "stages": [stage._asdict() for stage in told],
        "dialogues_s": dialogues_s,
        "unknown": unknown,
    }
    report(as_json, payload, lambda: _show(payload, told))


def _heard(client: HapticClient, count: int) -> _Heard:
    """Ticks until so many touches are whole, or nobody touches any more."""
    status = client.status()
    if status.state is not DaemonState.RENDERING:
        said = f"the daemon is {status.state}: no touch brings a voltage"
        hint = "haptic arm --detach, then haptic set with a friction within reach, then this again"
        raise HapticError("not_rendering", said, hint)
    statuses, kept, seen, asked_s = [status], list[NDArray[np.void]](), 0, time.monotonic()
    heard_s = asked_s
    with progress("touches", count) as advance:
        for new in new_samples(client.samples, SILENT_S):
            kept.append(new)
            now_s = time.monotonic()
            if now_s - asked_s < LOOK_S:
                continue
            asked_s = now_s
            statuses.append(client.status())
            done = touched(np.concatenate(kept)).size
            if done > seen:
                seen, heard_s = done, now_s
                advance(min(seen, count))
            is_over = seen >= count or now_s - heard_s > PATIENCE_S
            if is_over or statuses[-1].state is not DaemonState.RENDERING:
                break
    return _Heard(np.concatenate(kept), statuses)


def _show(payload: dict[str, Any], told: Sequence[Stage]) -> None:
    kind = Text.assemble(", ", SIMULATED) if payload["simulated"] else ""
    count = f"; {payload['touches']} touches by {payload['actuator']}"
    stdout.print(Text.assemble(f"rig {payload['rig']}", kind, count))
    table = Table("stage", "median", "95 %", Column("", overflow="fold"), box=None, pad_edge=False)
    for stage in told:
        times = (f"{1e3 * took_s:.3g} ms" for took_s in (stage.median_s, stage.most_s))
        table.add_row(stage.name, *times, stage.said)
    stdout.print(table)
    median_s = {stage.name: stage.median_s for stage in told}
    if "output" in median_s:
        ours_s = median_s["read"] + median_s["tick"] + median_s["wait"]
        stdout.print(
            f"of it {1e3 * ours_s:.3g} ms are the driver's (read, tick, wait),"
            f" {1e3 * median_s['output']:.3g} ms the instruments' (output)"
        )
    answered = payload["dialogues_s"].items()
    said = ", ".join(f"{name} {1e3 * took_s:.2g} ms" for name, took_s in answered)
    stdout.print(f"an answer took: {said}")
    for why, count in payload["left_out"].items():
        stdout.print(f"left out: {count} touches, {why}")
    for what in payload["unknown"]:
        stdout.print(f"not measured, {what}")
